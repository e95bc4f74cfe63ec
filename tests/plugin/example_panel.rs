//! Tuning panel of the examples: its controls change the components, show the current values, and
//! follow lights and tiers.

use crate::common::panel::{BakeAgain, Control, PanelPreset, TuningPanel, TuningPanelPlugin};
use crate::support::app::{finish_plugins, headless_plugins, run};
use crate::support::stage::{lit_room, spawn_light_source};
use bevy::diagnostic::DiagnosticsPlugin;
use bevy::prelude::*;
use bevy::ui::Checked;
use bevy::ui_widgets::{Activate, ValueChange};
use bevy_meshless_gi::prelude::*;
use bevy_meshless_gi::{GiBounceCount, GiDebugView, GiSolver};
use meshless_gi::Preset;

const LIGHT_POSITION: Vec3 = Vec3::new(-0.3, 1.5, 0.3);

/// Requested presets.
#[derive(Resource, Default)]
struct RequestedPresets(Vec<Preset>);

/// Creates an app with the panel. Returns it with scene, camera and light.
fn app_with_panel() -> (App, Entity, Entity, Entity) {
    let mut app = App::new();
    app.add_plugins((
        headless_plugins(),
        MeshlessGiPlugin::default(),
        TuningPanelPlugin,
    ))
    .insert_resource(GlobalAmbientLight::NONE)
    .insert_resource(PanelPreset(Preset::Draft))
    .init_resource::<RequestedPresets>()
    .add_observer(
        |event: On<BakeAgain>, mut requested: ResMut<RequestedPresets>| requested.0.push(event.0),
    );
    assert!(app.is_plugin_added::<DiagnosticsPlugin>());
    finish_plugins(&mut app);
    let (root, camera_entity, _, light_source) = lit_room(&mut app, LIGHT_POSITION);
    run(&mut app, 4);
    (app, root, camera_entity, light_source)
}

fn find(app: &mut App, control: Control) -> Option<(Entity, bool)> {
    let world = app.world_mut();
    let mut all = world.query::<(Entity, &Control, Has<Checked>)>();
    let mut found = all.iter(world).filter(|(_, of, _)| **of == control);
    found.next().map(|(entity, _, checked)| (entity, checked))
}

/// Triggers the event that the control's widget sends for a click, and runs two frames.
#[track_caller]
fn press(app: &mut App, control: Control) {
    let (entity, checked) = find(app, control).unwrap_or_else(|| panic!("no {control:?}"));
    match control {
        Control::BakeAgain => app.world_mut().trigger(Activate { entity }),
        _ => app.world_mut().trigger(ValueChange {
            source: entity,
            value: !checked,
            is_final: true,
        }),
    }
    run(app, 2);
}

#[test]
fn panel_pressed_controls_change_components() {
    let (mut app, root, camera_entity, light_source) = app_with_panel();
    let tier = GiQuality::Tier(1);
    for control in [
        Control::View(GiDebugView::Irradiance),
        Control::Bounces(GiBounceCount::Fixed(3)),
        Control::Quality(tier),
        Control::Full(false),
        Control::Light(light_source),
        Control::Preset(Preset::High),
        Control::BakeAgain,
    ] {
        press(&mut app, control);
    }
    let world = app.world();
    let camera = world.get::<GiCamera>(camera_entity).unwrap();
    assert_eq!(camera.debug_view, GiDebugView::Irradiance);
    let solver = world.get::<GiSolver>(root).unwrap();
    assert_eq!(solver.bounces, GiBounceCount::Fixed(3));
    assert_eq!(*world.get::<GiQuality>(root).unwrap(), tier);
    let display = *world.get::<GiSplatting>(camera_entity).unwrap();
    assert_eq!(display, GiSplatting::default());
    assert!(!world.get::<GiLight>(light_source).unwrap().enabled);
    assert_eq!(world.resource::<RequestedPresets>().0, [Preset::High]);
    press(&mut app, Control::Light(light_source));
    assert!(app.world().get::<GiLight>(light_source).unwrap().enabled);
}

#[test]
fn panel_marks_follow_component_changes() {
    let (mut app, root, camera_entity, light_source) = app_with_panel();
    let marked = |app: &mut App, control| find(app, control).expect("a control").1;
    // The tests' cameras evaluate every pixel and show indirect light only.
    assert!(marked(&mut app, Control::Full(true)));
    assert!(marked(&mut app, Control::View(GiDebugView::IndirectOnly)));
    assert!(!marked(&mut app, Control::View(GiDebugView::Final)));
    assert!(marked(&mut app, Control::Light(light_source)));
    let world = app.world_mut();
    world.get_mut::<GiCamera>(camera_entity).unwrap().debug_view = GiDebugView::Final;
    world.get_mut::<GiSolver>(root).unwrap().bounces = GiBounceCount::Auto;
    let off = GiLight {
        enabled: false,
        ..default()
    };
    world.entity_mut(light_source).insert(off);
    run(&mut app, 2);
    assert!(marked(&mut app, Control::View(GiDebugView::Final)));
    assert!(!marked(&mut app, Control::View(GiDebugView::IndirectOnly)));
    assert!(marked(&mut app, Control::Bounces(GiBounceCount::Auto)));
    assert!(!marked(&mut app, Control::Light(light_source)));
}

#[test]
fn panel_controls_follow_lights_and_key() {
    let (mut app, root, _, _) = app_with_panel();
    let tiers = app.world().resource::<Assets<GiBakedScene>>();
    let gi = app.world().get::<GiScene>(root).unwrap();
    let tiers = tiers.get(&gi.0).unwrap().scene.data().tiers();
    let tier = |n| Control::Quality(GiQuality::Tier(n));
    assert!(find(&mut app, tier(tiers)).is_some());
    assert!(find(&mut app, tier(tiers + 1)).is_none());
    let second = spawn_light_source(&mut app, LIGHT_POSITION + Vec3::X);
    assert!(find(&mut app, Control::Light(second)).is_none());
    run(&mut app, 2);
    assert!(find(&mut app, Control::Light(second)).is_some());
    app.world_mut().despawn(second);
    run(&mut app, 2);
    assert!(find(&mut app, Control::Light(second)).is_none());

    let shown = |app: &mut App| {
        let world = app.world_mut();
        let mut panel = world.query_filtered::<&Node, With<TuningPanel>>();
        panel.single(world).unwrap().display
    };
    assert_eq!(shown(&mut app), Display::Flex);
    for after in [Display::None, Display::Flex] {
        let mut keys = app.world_mut().resource_mut::<ButtonInput<KeyCode>>();
        keys.press(KeyCode::F1);
        app.world_mut().run_schedule(Update);
        let mut keys = app.world_mut().resource_mut::<ButtonInput<KeyCode>>();
        keys.reset(KeyCode::F1);
        assert_eq!(shown(&mut app), after);
    }
}
