//! Tuning panel: settings of indirect light as buttons over the picture, and the plan of the frame.
//!
//! | section | sets |
//! |---|---|
//! | view | `GiCamera::debug_view` of all cameras |
//! | reflections | `GiSolver::bounces` of all scenes |
//! | quality | `GiQuality` of all scenes, with the tiers that their bakes have |
//! | display | `GiSplatting` of all cameras |
//! | preset, "bake again" | triggers [`BakeAgain`] (examples with resource [`PanelPreset`]) |
//! | lights | `GiLight::enabled` of each light |
//!
//! F1 shows and hides the panel. It starts hidden with `--screenshot`.

use super::capture::Capture;
use super::table;
use bevy::diagnostic::DiagnosticsStore;
use bevy::feathers::FeathersCorePlugin;
use bevy::feathers::controls::{FeathersButton, FeathersCheckbox, FeathersRadio};
use bevy::feathers::dark_theme::create_dark_theme;
use bevy::feathers::theme::{ThemedText, UiTheme};
use bevy::input::mouse::AccumulatedMouseScroll;
use bevy::input_focus::InputFocus;
use bevy::prelude::*;
use bevy::ui::{Checked, FocusPolicy};
use bevy::ui_widgets::{Activate, ValueChange};
use bevy_meshless_gi::prelude::*;
use bevy_meshless_gi::{
    GiActiveTier, GiBounceCount, GiDebugView, GiFrameStats, GiSolver, GiSystems,
};
use meshless_gi::Preset;

/// Shows the panel and applies its controls.
pub struct TuningPanelPlugin;

/// Preset of the next bake. An example that can bake again inserts it.
#[derive(Resource, Clone, Copy, Debug, PartialEq)]
pub struct PanelPreset(pub Preset);

/// The button "bake again" was pressed.
#[derive(Event, Clone, Copy, Debug, PartialEq)]
pub struct BakeAgain(pub Preset);

/// Root of the panel.
#[derive(Component)]
pub struct TuningPanel;

/// Value that a control sets.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
pub enum Control {
    /// View of all cameras.
    View(GiDebugView),
    /// Number of bounces of all scenes.
    Bounces(GiBounceCount),
    /// Quality of all scenes.
    Quality(GiQuality),
    /// Splatting of all cameras.
    Full(bool),
    /// Preset of the next bake.
    Preset(Preset),
    /// Starts a bake.
    BakeAgain,
    /// Contribution of a light.
    Light(Entity),
}

/// Heading, and controls with captions.
type Section = (&'static str, Vec<(String, Control)>);

/// Controls below the root.
#[derive(Component)]
struct Controls;

/// Text of the plan.
#[derive(Component)]
struct PlanText;

/// Frames between two updates of the plan's text.
const UPDATE_INTERVAL: u32 = 15;
/// Width of the panel, logical pixels.
const WIDTH: f32 = 330.0;

impl Plugin for TuningPanelPlugin {
    fn build(&self, app: &mut App) {
        if !app.is_plugin_added::<FeathersCorePlugin>() {
            app.add_plugins(FeathersCorePlugin);
        }
        app.insert_resource(UiTheme(create_dark_theme()))
            .add_observer(change)
            .add_observer(activate)
            .add_systems(Startup, set_up)
            .add_systems(
                Update,
                (show, build, mark, write_plan, scroll)
                    .chain()
                    .after(GiSystems::CollectBakes),
            );
    }
}

fn set_up(mut commands: Commands, capture: Option<Res<Capture>>) {
    let display = match capture {
        Some(_) => Display::None,
        None => Display::Flex,
    };
    let column = |display| Node {
        display,
        flex_direction: FlexDirection::Column,
        row_gap: px(4),
        ..default()
    };
    commands.spawn((
        TuningPanel,
        // Clicks on the panel do not reach the picture.
        (Interaction::default(), FocusPolicy::Block),
        Node {
            position_type: PositionType::Absolute,
            top: px(8),
            right: px(8),
            width: px(WIDTH),
            max_height: percent(97),
            padding: UiRect::all(px(8)),
            overflow: Overflow::scroll_y(),
            ..column(display)
        },
        BackgroundColor(Color::srgba(0.08, 0.08, 0.09, 0.92)),
        children![
            (Controls, column(Display::Flex)),
            (
                PlanText,
                Text::default(),
                TextFont::from_font_size(10.0),
                Node::default(),
            )
        ],
    ));
}

fn show(
    keys: Res<ButtonInput<KeyCode>>,
    mut panel: Single<&mut Node, With<TuningPanel>>,
    mut focus: ResMut<InputFocus>,
    controls: Query<(), With<Control>>,
) {
    // Keys go to the example, also after a click on a control.
    if focus
        .get()
        .is_some_and(|focused| controls.contains(focused))
    {
        focus.clear();
    }
    if keys.just_pressed(KeyCode::F1) {
        panel.display = match panel.display {
            Display::None => Display::Flex,
            _ => Display::None,
        };
    }
}

/// Input of the sections.
type Lights<'w, 's> = Query<
    'w,
    's,
    (
        Entity,
        Option<&'static Name>,
        Has<PointLight>,
        Has<SpotLight>,
        Has<DirectionalLight>,
    ),
    Or<(
        With<PointLight>,
        With<SpotLight>,
        With<DirectionalLight>,
        With<RectLight>,
    )>,
>;

/// Returns the sections of the panel for a number of tiers and these lights.
fn sections(tiers: u32, lights: &Lights, preset: bool) -> Vec<Section> {
    let named = |pairs: &[(&str, Control)]| -> Vec<(String, Control)> {
        let pairs = pairs.iter();
        pairs.map(|(name, c)| ((*name).to_string(), *c)).collect()
    };
    let view = named(&[
        ("lit", Control::View(GiDebugView::Final)),
        ("indirect", Control::View(GiDebugView::IndirectOnly)),
        ("irradiance", Control::View(GiDebugView::Irradiance)),
    ]);
    let mut bounces = named(&[("auto", Control::Bounces(GiBounceCount::Auto))]);
    bounces.extend((1..=8).map(|n| (n.to_string(), Control::Bounces(GiBounceCount::Fixed(n)))));
    let mut quality = named(&[("all", Control::Quality(GiQuality::Full))]);
    quality.extend((1..=tiers).map(|n| {
        let tier = Control::Quality(GiQuality::Tier(n));
        (format!("tier {n}"), tier)
    }));
    let within = |error| Control::Quality(GiQuality::MaxError(error));
    quality.extend(named(&[("5 %", within(0.05)), ("2 %", within(0.02))]));
    let display = named(&[
        ("subsplats", Control::Full(false)),
        ("every pixel", Control::Full(true)),
    ]);
    let mut all = vec![
        ("view", view),
        ("reflections", bounces),
        ("quality", quality),
        ("display", display),
    ];
    if preset {
        let presets = [Preset::Draft, Preset::Medium, Preset::High];
        let mut presets: Vec<_> = (presets.iter())
            .map(|p| (format!("{p:?}"), Control::Preset(*p)))
            .collect();
        presets.push(("bake again".into(), Control::BakeAgain));
        all.push(("preset", presets));
    }
    let mut found: Vec<_> = lights.iter().collect();
    found.sort_by_key(|light| light.0);
    let switch = |(entity, name, point, spot, sun): (Entity, Option<&Name>, bool, bool, bool)| {
        let kind = match (point, spot, sun) {
            (true, ..) => "point light",
            (_, true, _) => "spot light",
            (_, _, true) => "directional light",
            _ => "rectangle light",
        };
        let name = name.map_or_else(|| format!("{kind} {entity}"), ToString::to_string);
        (name, Control::Light(entity))
    };
    all.push(("lights", found.into_iter().map(switch).collect()));
    all
}

/// Builds the controls, again after a change of tiers or lights.
fn build(
    mut commands: Commands,
    panel: Single<&Node, With<TuningPanel>>,
    controls: Single<Entity, With<Controls>>,
    tiers: Query<&GiActiveTier>,
    lights: Lights,
    preset: Option<Res<PanelPreset>>,
    mut built: Local<Vec<Section>>,
) {
    if panel.display == Display::None {
        return;
    }
    let tiers = tiers.iter().map(|t| t.tiers).max().unwrap_or(0);
    let wanted = sections(tiers, &lights, preset.is_some());
    if *built == wanted {
        return;
    }
    commands.entity(*controls).despawn_children();
    for (heading, pairs) in &wanted {
        let row = Node {
            flex_wrap: FlexWrap::Wrap,
            align_items: AlignItems::Center,
            column_gap: px(8),
            row_gap: px(2),
            ..default()
        };
        let row = commands.spawn((row, ChildOf(*controls))).id();
        let heading = (Text::new(*heading), TextFont::from_font_size(12.0));
        commands.spawn((heading, ChildOf(row)));
        for (caption, control) in pairs {
            let text = caption.clone();
            let mut spawned = match control {
                Control::BakeAgain => commands.spawn_scene(
                    bsn! { @FeathersButton { @caption: bsn! { Text({text.clone()}) ThemedText } } },
                ),
                Control::Light(_) => commands.spawn_scene(
                    bsn! { @FeathersCheckbox { @caption: bsn! { Text({text.clone()}) ThemedText } } },
                ),
                _ => commands.spawn_scene(
                    bsn! { @FeathersRadio { @caption: bsn! { Text({text.clone()}) ThemedText } } },
                ),
            };
            spawned.insert((*control, ChildOf(row)));
        }
    }
    *built = wanted;
}

/// Handles a pressed button.
fn activate(
    event: On<Activate>,
    mut commands: Commands,
    controls: Query<&Control>,
    preset: Option<Res<PanelPreset>>,
) {
    if let (Ok(Control::BakeAgain), Some(preset)) = (controls.get(event.entity), preset) {
        commands.trigger(BakeAgain(preset.0));
    }
}

/// Applies a radio button or a checkbox.
fn change(
    event: On<ValueChange<bool>>,
    mut commands: Commands,
    controls: Query<&Control>,
    mut cameras: Query<(&mut GiCamera, &mut GiSplatting)>,
    mut scenes: Query<(&mut GiSolver, &mut GiQuality)>,
    lights: Query<Option<&GiLight>>,
    mut preset: Option<ResMut<PanelPreset>>,
) {
    let Ok(control) = controls.get(event.source) else {
        return;
    };
    match *control {
        Control::Light(light) => {
            if let Ok(before) = lights.get(light) {
                let light_settings = GiLight {
                    enabled: event.value,
                    ..before.cloned().unwrap_or_default()
                };
                commands.entity(light).insert(light_settings);
            }
        }
        Control::View(view) => (cameras.iter_mut()).for_each(|(mut c, _)| c.debug_view = view),
        Control::Full(full) => {
            let display = match full {
                true => GiSplatting::PerPixel,
                false => GiSplatting::default(),
            };
            (cameras.iter_mut()).for_each(|(_, mut of)| *of = display);
        }
        Control::Bounces(n) => (scenes.iter_mut()).for_each(|(mut s, _)| s.bounces = n),
        Control::Quality(q) => (scenes.iter_mut()).for_each(|(_, mut of)| *of = q),
        Control::Preset(next) => {
            if let Some(preset) = &mut preset {
                preset.0 = next;
            }
        }
        Control::BakeAgain => {}
    }
}

/// Marks the controls of the current values.
fn mark(
    mut commands: Commands,
    controls: Query<(Entity, &Control, Has<Checked>)>,
    cameras: Query<(&GiCamera, &GiSplatting)>,
    scenes: Query<(&GiSolver, &GiQuality)>,
    lights: Query<&GiLight>,
    preset: Option<Res<PanelPreset>>,
) {
    // A second camera can have indirect light disabled. The enabled one counts.
    let camera = cameras.iter().max_by_key(|(c, _)| c.enabled);
    let scene = scenes.iter().next();
    for (entity, control, checked) in &controls {
        let set = match *control {
            Control::View(view) => camera.is_some_and(|(c, _)| c.debug_view == view),
            Control::Full(full) => {
                camera.is_some_and(|(_, d)| (*d == GiSplatting::PerPixel) == full)
            }
            Control::Bounces(n) => scene.is_some_and(|(s, _)| s.bounces == n),
            Control::Quality(q) => scene.is_some_and(|(_, of)| *of == q),
            Control::Light(light) => lights.get(light).map_or(true, |l| l.enabled),
            Control::Preset(of) => preset.as_ref().is_some_and(|p| p.0 == of),
            Control::BakeAgain => false,
        };
        match (set, checked) {
            (true, false) => drop(commands.entity(entity).insert(Checked)),
            (false, true) => drop(commands.entity(entity).remove::<Checked>()),
            _ => {}
        }
    }
}

fn write_plan(
    panel: Single<&Node, With<TuningPanel>>,
    mut text: Single<&mut Text, With<PlanText>>,
    status: Res<GiFrameStats>,
    diagnostics: Res<DiagnosticsStore>,
    names: Query<Option<&Name>>,
    mut frame: Local<u32>,
) {
    if panel.display == Display::None {
        *frame = 0;
        return;
    }
    if frame.is_multiple_of(UPDATE_INTERVAL) {
        text.0 = table::overlay_text(&status, &diagnostics, &names);
    }
    *frame += 1;
}

fn scroll(
    wheel: Res<AccumulatedMouseScroll>,
    mut panel: Single<(&Interaction, &mut ScrollPosition), With<TuningPanel>>,
) {
    if *panel.0 != Interaction::None && wheel.delta.y != 0.0 {
        panel.1.y = (panel.1.y - 20.0 * wheel.delta.y).max(0.0);
    }
}
