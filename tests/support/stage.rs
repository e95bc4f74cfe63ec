//! Functions shared by the tests of the running plugin: the room on its root, the view, the light,
//! and the comparison of pictures.

use super::app::{BOUNCES, camera, target};
use super::flip::{Picture, flip};
use super::scenes::{Room, cornell};
use bevy::prelude::*;
use bevy_meshless_gi::internals::plan::FrameStage;
use bevy_meshless_gi::internals::plugin::FrameRecord;
use bevy_meshless_gi::prelude::*;
use bevy_meshless_gi::{GiDebugView, GiFrameStats};
use meshless_gi::{BakedScene, FrameSettings, Light};
use std::f32::consts::PI;
use std::sync::Arc;

/// Maximum mean FLIP between the plugin's frame and the CPU's frame.
pub const MAX: f32 = 0.02;

/// Intensity of the test's lights, candela.
pub const CANDELA: f32 = 1500.0;

/// Returns the camera's transform in front of the room, slightly off center. From the center, edges
/// of the room pass through pixel centers, and rounding determines the picture.
pub fn view() -> Transform {
    Transform::from_xyz(0.013, 1.007, 4.0).looking_at(Vec3::new(0.0, 1.0, 0.0), Vec3::Y)
}

pub fn bevy_light() -> PointLight {
    PointLight {
        intensity: CANDELA * 4.0 * PI,
        range: 20.0,
        ..default()
    }
}

pub fn light_source(position: Vec3) -> Light {
    Light::Point {
        position,
        intensity: Vec3::splat(CANDELA),
        range: 20.0,
    }
}

/// Returns a camera component that shows indirect light only.
pub fn indirect() -> GiCamera {
    GiCamera {
        debug_view: GiDebugView::IndirectOnly,
        ..default()
    }
}

/// Returns the frame settings of the tests' rooms.
pub fn settings() -> FrameSettings {
    FrameSettings {
        emission: 998.0,
        ..FrameSettings::bounces(BOUNCES)
    }
}

/// Spawns the room and a camera that shows indirect light only. Returns them with the camera's
/// target.
pub fn room_and_camera(app: &mut App) -> (Entity, Entity, Handle<Image>) {
    let root = spawn_room(app, Transform::IDENTITY);
    let image = target(app);
    let camera_entity = app
        .world_mut()
        .spawn((camera(&image, view()), indirect()))
        .id();
    (root, camera_entity, image)
}

/// Spawns the room's light at `position`.
pub fn spawn_light_source(app: &mut App, position: Vec3) -> Entity {
    app.world_mut()
        .spawn((bevy_light(), Transform::from_translation(position)))
        .id()
}

/// Spawns [`room_and_camera`] and a light at `position`.
pub fn lit_room(app: &mut App, position: Vec3) -> (Entity, Entity, Handle<Image>, Entity) {
    let (root, camera_entity, image) = room_and_camera(app);
    let light_source = spawn_light_source(app, position);
    (root, camera_entity, image, light_source)
}

/// Spawns the Cornell room with its bake on one root.
pub fn spawn_room(app: &mut App, root: Transform) -> Entity {
    let (room, bake) = cornell();
    spawn_baked(app, &room, &bake, root)
}

/// Spawns a room with a bake on one root.
pub fn spawn_baked(app: &mut App, room: &Room, bake: &Arc<BakedScene>, root: Transform) -> Entity {
    let scene = bake.clone();
    let asset = app
        .world_mut()
        .resource_mut::<Assets<GiBakedScene>>()
        .add(GiBakedScene { scene });
    let root = app.world_mut().spawn((GiScene(asset), root)).id();
    room.spawn(app, root);
    root
}

pub fn counters(app: &App) -> FrameRecord {
    let status = app.world().resource::<GiFrameStats>();
    FrameRecord::clone(&status.record())
}

/// Writes a picture to the folder in `MGI_TEST_PICTURES`, if set.
pub fn save_picture(name: &str, picture: &Picture) {
    if let Some(folder) = std::env::var_os("MGI_TEST_PICTURES") {
        picture.save(&std::path::Path::new(&folder).join(format!("{name}.png")));
    }
}

#[track_caller]
pub fn assert_pictures_match(name: &str, reference: &Picture, test: &Picture) {
    save_picture(name, &reference.beside(test));
    assert!(
        reference.mean() > 0.003,
        "{name}: the CPU's picture is dark ({})",
        reference.mean()
    );
    let (d, nrmse) = (flip(reference, test), test.nrmse(reference));
    println!("{name}: FLIP {d:.4}, NRMSE {nrmse:.4}");
    assert!(d <= MAX && nrmse <= 0.03, "{name}: FLIP {d}, NRMSE {nrmse}");
    // Checks that the test can fail: a picture upside down, a picture brighter by half, and a
    // picture brighter by 7 %.
    let mut reversed = test.clone();
    reversed.pixels.reverse();
    assert!(
        flip(reference, &reversed) > MAX,
        "{name}: a picture upside down is not distinguished"
    );
    let mut brighter = test.clone();
    brighter.pixels.iter_mut().flatten().for_each(|v| *v *= 1.5);
    assert!(
        flip(reference, &brighter) > MAX,
        "{name}: a brighter picture is not distinguished"
    );
    let mut off = test.clone();
    off.pixels.iter_mut().flatten().for_each(|v| *v *= 1.07);
    assert!(
        off.nrmse(reference) > 0.03,
        "{name}: seven percent more light is not distinguished"
    );
}

/// Returns the number of dispatches of stages that static lights must not run.
pub fn work(c: &FrameRecord) -> [u32; 4] {
    [
        FrameStage::PROJECT,
        FrameStage::PULL_PUSH,
        FrameStage::APPLY,
        FrameStage::FLATTEN,
    ]
    .map(|s| c.dispatches_of(s))
}
