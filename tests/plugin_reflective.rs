//! One bounce from what moves, in the running plugin: which cameras draw it, what they see, and what it adds to the picture.

mod plugin_support;

use bevy::camera::visibility::RenderLayers;
use bevy::prelude::*;
use bevy_meshless_gi::plan::Stage;
use bevy_meshless_gi::plugin::{CAPTURE_LAYER, MeshlessGiCapture};
use bevy_meshless_gi::prelude::*;
use plugin_support::app::{app, camera, picture, run, target};
use plugin_support::stage::{counters, indirect, keep, room_and_camera, spawn_lamp, view, work};

/// A matte ball of `radius` metres.
fn ball(app: &mut App, at: Vec3, radius: f32, colour: Color) -> Entity {
    let mesh = Sphere::new(radius).mesh().ico(5).unwrap();
    let mesh = app.world_mut().resource_mut::<Assets<Mesh>>().add(mesh);
    let material = app
        .world_mut()
        .resource_mut::<Assets<StandardMaterial>>()
        .add(StandardMaterial {
            base_color: colour,
            perceptual_roughness: 1.0,
            reflectance: 0.0,
            ..default()
        });
    app.world_mut()
        .spawn((
            Mesh3d(mesh),
            MeshMaterial3d(material),
            Transform::from_translation(at),
        ))
        .id()
}

/// Cameras of maps: all, and those that draw.
fn captures(app: &mut App) -> [usize; 2] {
    let mut cameras = app
        .world_mut()
        .query_filtered::<&Camera, With<MeshlessGiCapture>>();
    let all: Vec<bool> = cameras
        .iter(app.world())
        .map(|camera| camera.is_active)
        .collect();
    [all.len(), all.iter().filter(|a| **a).count()]
}

fn layers(app: &App, entity: Entity) -> Option<RenderLayers> {
    app.world().get::<RenderLayers>(entity).cloned()
}

const RED: Color = Color::linear_rgb(0.8, 0.02, 0.02);
const LAMP: Vec3 = Vec3::new(0.0, 1.7, 0.4);

#[test]
fn cameras_come_with_what_moves_and_go_with_it() {
    let mut app = app();
    room_and_camera(&mut app);
    let lamp = spawn_lamp(&mut app, LAMP);
    run(&mut app, 2);
    let bare = counters(&app);
    let ball = ball(&mut app, Vec3::new(-0.4, 0.3, 0.3), 0.25, RED);
    run(&mut app, 2);
    assert_eq!(captures(&mut app), [0, 0], "nobody asks");

    // A light asks, and nothing moves.
    app.world_mut()
        .entity_mut(lamp)
        .insert(MeshlessGiReflective::default());
    run(&mut app, 2);
    assert_eq!(captures(&mut app), [0, 0], "nothing moves");
    let c = counters(&app);
    assert!(c.plan.contains("nothing moves"), "{}", c.plan);
    assert_eq!(
        (c.buffers, c.bytes, c.pipelines),
        (bare.buffers, bare.bytes, bare.pipelines),
        "an asking light alone holds nothing"
    );

    // The ball moves, and its meshes are told apart by a layer beside theirs.
    let own = RenderLayers::from_layers(&[0, 3]);
    app.world_mut().entity_mut(ball).insert(own.clone());
    let parent = app.world_mut().spawn(Transform::default()).id();
    let parent_of = app
        .world_mut()
        .spawn((Transform::default(), ChildOf(parent)))
        .id();
    app.world_mut().entity_mut(ball).insert(ChildOf(parent_of));
    app.world_mut().entity_mut(parent).insert(MeshlessGiBouncer);
    run(&mut app, 2);
    assert_eq!(captures(&mut app), [1, 1]);
    assert_eq!(layers(&app, ball), Some(own.clone().with(CAPTURE_LAYER)));
    assert_eq!(layers(&app, parent), None, "it has no mesh");
    let c = counters(&app);
    let ran = |c: &bevy_meshless_gi::plugin::MeshlessGiCounters| c.plan.matches("run  rsm").count();
    assert_eq!(ran(&c), 1, "{}", c.plan);
    assert_eq!(work(&c), [0; 4], "the bake rests: {}", c.plan);

    // Out of the light's reach, the light dark, no camera that shows it: no map is drawn.
    type Change = fn(&mut App, Entity, Entity, bool);
    let changes: [(&str, Change); 4] = [
        ("nothing that moves is in reach", |app, ball, _, away| {
            let mut at = app.world_mut().get_mut::<Transform>(ball).unwrap();
            at.translation.x = if away { 1e4 } else { -0.4 };
        }),
        ("the light is off", |app, _, lamp, off| {
            let shown = if off {
                Visibility::Hidden
            } else {
                Visibility::Visible
            };
            app.world_mut().entity_mut(lamp).insert(shown);
        }),
        ("nothing moves", |app, ball, _, hidden| {
            let shown = if hidden {
                Visibility::Hidden
            } else {
                Visibility::Visible
            };
            app.world_mut().entity_mut(ball).insert(shown);
        }),
        ("no camera that asks", |app, _, _, off| {
            let mut cameras = app.world_mut().query::<&mut MeshlessGiCamera>();
            for mut camera in cameras.iter_mut(app.world_mut()) {
                camera.enabled = !off;
            }
        }),
    ];
    for (why, change) in changes {
        change(&mut app, ball, lamp, true);
        run(&mut app, 2);
        assert_eq!(captures(&mut app), [1, 0], "{why}");
        let c = counters(&app);
        assert_eq!(ran(&c), 0, "{}", c.plan);
        assert!(c.plan.contains(why), "{why}: {}", c.plan);
        change(&mut app, ball, lamp, false);
        run(&mut app, 2);
        assert_eq!(captures(&mut app), [1, 1], "{why}");
    }

    // The component goes: all that it brought goes.
    app.world_mut()
        .entity_mut(parent)
        .remove::<MeshlessGiBouncer>();
    run(&mut app, 2);
    assert_eq!(layers(&app, ball), Some(own), "as they were");
    assert_eq!(captures(&mut app), [1, 0]);
    app.world_mut().entity_mut(ball).remove::<RenderLayers>();
    app.world_mut().entity_mut(ball).insert(MeshlessGiBouncer);
    run(&mut app, 2);
    assert_eq!(
        layers(&app, ball),
        Some(RenderLayers::from_layers(&[0, CAPTURE_LAYER]))
    );
    app.world_mut()
        .entity_mut(ball)
        .remove::<MeshlessGiBouncer>();
    run(&mut app, 2);
    assert_eq!(layers(&app, ball), None, "it had none");
    app.world_mut()
        .entity_mut(lamp)
        .remove::<MeshlessGiReflective>();
    run(&mut app, 2);
    assert_eq!(captures(&mut app), [0, 0]);
    let c = counters(&app);
    assert_eq!(
        (c.buffers, c.bytes, c.pipelines),
        (bare.buffers, bare.bytes, bare.pipelines),
        "everything was given back"
    );

    // And with the light itself.
    app.world_mut().entity_mut(ball).insert(MeshlessGiBouncer);
    app.world_mut()
        .entity_mut(lamp)
        .insert(MeshlessGiReflective::default());
    run(&mut app, 2);
    assert_eq!(captures(&mut app), [1, 1]);
    app.world_mut().despawn(lamp);
    run(&mut app, 2);
    assert_eq!(captures(&mut app), [0, 0]);
}
