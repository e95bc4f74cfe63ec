//! A character walks through a door, which closes. The room behind it, which is lit through the
//! door only, goes dark. The door is an occluder of the bake. Probes light the character, and its
//! coat tints the floor.
//!
//! ```text
//! cargo run --release --example doors
//! ```
//!
//! Two rooms are made in code and baked in the background. Their ceiling and front wall are drawn
//! from inside only.
//!
//! | key | effect |
//! |---|---|
//! | M | pause and continue |
//! | Left, Right | change the time |
//! | B | the light that the character reflects, on and off |
//! | Space | indirect light on and off |
//! | Tab | one view, or direct light alone on the left |
//! | V | the picture, indirect light alone, or irradiance |
//! | G | gizmos: points of the bake, radii of a level, non-zero coefficients, none |
//! | P | the plan of the frame: passes, reasons, times |
//! | F1 | the tuning panel |
//! | H | help on and off |
//!
//! `-- --screenshot FILE.png --at 6.5` writes a picture of second 6.5, when the door is closed.
//! `--at 2.2` shows it open.

mod common;

use bevy::prelude::*;
use bevy_meshless_gi::prelude::*;
use common::capture::Capture;
use common::clock::{Clock, ClockSystems};
use common::stage::{Stage, StageSystems, spawn_light};
use meshless_gi::{Material, OccluderBox, OccluderDesc, ProbeSettings, Quad};
use std::f32::consts::PI;
use std::process::ExitCode;

fn main() -> ExitCode {
    let capture = match Capture::from_command_line("doors") {
        Ok(capture) => capture,
        Err(code) => return code,
    };
    let mut app = common::app(capture.as_ref());
    app.insert_resource(ClearColor(Color::BLACK))
        .add_plugins(Stage {
            look: Transform::from_xyz(0.0, 4.6, 4.9).looking_at(Vec3::new(0.0, 0.9, -1.6), Vec3::Y),
            reach: None,
            keys: "M, Left, Right: time    B: bounce",
        })
        .add_plugins(Clock::new(0.0, 1.0, capture.as_ref().and_then(|c| c.at)).by_hand())
        .add_systems(Startup, set_up)
        .add_systems(
            Update,
            (walk, slide, switch_bounce)
                .after(ClockSystems)
                .before(StageSystems),
        );
    common::run(app)
}

/// Corners of both rooms together, in meters.
const ROOMS: (Vec3, Vec3) = (Vec3::new(-4.0, 0.0, -3.0), Vec3::new(4.0, 2.7, 0.0));
/// Half of the thickness of the wall between them, at x = 0.
const WALL: f32 = 0.1;
/// Doorway: z from, z to, and height.
const DOORWAY: (f32, f32, f32) = (-2.0, -1.0, 2.2);
/// Center and edges of the closed door.
const DOOR: (Vec3, Vec3) = (Vec3::new(0.0, 1.1, -1.5), Vec3::new(0.06, 2.2, 1.0));

fn rooms() -> Vec<Quad> {
    let (min, max) = ROOMS;
    let paint = |r, g, b| Material::diffuse(Vec3::new(r, g, b));
    let white = paint(0.72, 0.7, 0.66);
    let mut quads = common::room(min, max, &white);
    // Left, right and floor.
    quads[0].material = paint(0.62, 0.34, 0.12);
    quads[1].material = paint(0.12, 0.3, 0.62);
    quads[2].material = paint(0.45, 0.36, 0.28);
    let (from, to, high) = DOORWAY;
    let mut wall = |low: Vec3, high: Vec3| quads.extend(common::block(low, high, &white));
    wall(Vec3::new(-WALL, 0.0, min.z), Vec3::new(WALL, max.y, from));
    wall(Vec3::new(-WALL, 0.0, to), Vec3::new(WALL, max.y, max.z));
    wall(Vec3::new(-WALL, high, from), Vec3::new(WALL, max.y, to));
    quads
}

#[derive(Component)]
struct Character;

/// Limb that swings while the character walks. Amplitude in radians.
#[derive(Component)]
struct Swings(f32);

#[derive(Component)]
struct Door;

fn set_up(
    mut commands: Commands,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let quads = rooms();
    let recipe = Recipe {
        preset: Preset::Draft,
        viewpoints: vec![[-2.0, 1.5, -1.5], [2.0, 1.5, -1.5]],
        probes: Some(ProbeSettings::default()),
        occluders: vec![OccluderDesc {
            name: "door".into(),
            boxes: vec![OccluderBox {
                center: DOOR.0.to_array(),
                half_edges: (0.5 * DOOR.1).to_array(),
            }],
        }],
        ..default()
    };
    let mut root = commands.spawn((Transform::default(), Visibility::default()));
    common::spawn_quads(&quads, &mut root, &mut meshes, &mut materials);
    root.bake_gi(recipe);
    let transform = Vec3::new(-1.9, 2.05, -1.9);
    spawn_light(&mut commands, &mut meshes, &mut materials, transform)
        .insert(GiReflectiveShadowMap::default());
    let mut paint = |r, g, b| {
        materials.add(StandardMaterial {
            base_color: Color::linear_rgb(r, g, b),
            perceptual_roughness: 1.0,
            reflectance: 0.0,
            ..default()
        })
    };
    commands.spawn((
        Door,
        GiOccluder {
            name: "door".into(),
            transmittance: 1.0,
        },
        Mesh3d(meshes.add(Cuboid::from_size(DOOR.1))),
        MeshMaterial3d(paint(0.5, 0.45, 0.4)),
        Transform::from_translation(DOOR.0),
    ));
    // Section of the wall toward the camera, drawn black.
    let cut = paint(0.0, 0.0, 0.0);
    let (min, max) = ROOMS;
    let top = Cuboid::new(2.0 * WALL, 0.004, max.z - min.z);
    let front = Cuboid::new(2.0 * WALL, max.y, 0.004);
    for (cover, at) in [
        (top, Vec3::new(0.0, max.y, 0.5 * (min.z + max.z))),
        (front, Vec3::new(0.0, 0.5 * max.y, max.z)),
    ] {
        commands.spawn((
            Mesh3d(meshes.add(cover)),
            MeshMaterial3d(cut.clone()),
            Transform::from_translation(at),
        ));
    }
    let (coat, skin, trousers) = (
        paint(0.75, 0.05, 0.04),
        paint(0.6, 0.36, 0.25),
        paint(0.12, 0.13, 0.2),
    );
    let trunk = meshes.add(Capsule3d::new(0.2, 0.36));
    let head = meshes.add(Sphere::new(0.14));
    let leg = meshes.add(Capsule3d::new(0.085, 0.66));
    let arm = meshes.add(Capsule3d::new(0.06, 0.42));
    let character = (
        Character,
        GiReflector,
        Transform::default(),
        Visibility::default(),
    );
    commands.spawn(character).with_children(|body| {
        let mut part = |mesh: &Handle<Mesh>, paint: &Handle<StandardMaterial>, at: Vec3| {
            body.spawn((
                Mesh3d(mesh.clone()),
                MeshMaterial3d(paint.clone()),
                Transform::from_translation(at),
            ));
        };
        part(&trunk, &coat, Vec3::new(0.0, 1.14, 0.0));
        part(&head, &skin, Vec3::new(0.0, 1.63, 0.0));
        // Legs and arms hang from joints. Those of one side swing in opposite directions.
        for (mesh, paint, side, high, hangs, far) in [
            (&leg, &trousers, 0.1, 0.86, 0.44, 0.5),
            (&leg, &trousers, -0.1, 0.86, 0.44, -0.5),
            (&arm, &coat, 0.27, 1.36, 0.27, -0.4),
            (&arm, &coat, -0.27, 1.36, 0.27, 0.4),
        ] {
            let joint = Transform::from_xyz(0.0, high, side);
            body.spawn((Swings(far), joint, Visibility::default()))
                .with_child((
                    Mesh3d(mesh.clone()),
                    MeshMaterial3d(paint.clone()),
                    Transform::from_xyz(0.0, -hangs, 0.0),
                ));
        }
    });
}

/// Seconds of one round.
const ROUND: f32 = 17.0;

/// Returns the position on the path through the door to the left and back, in meters, and the
/// rotation in radians.
fn path_at(seconds: f32) -> (f32, f32) {
    let t = seconds.rem_euclid(ROUND);
    let there = (t / 6.0).clamp(0.0, 1.0);
    let back = ((t - 8.5) / 6.0).clamp(0.0, 1.0);
    let turned = smooth_step(6.0, 7.0, t) + smooth_step(15.0, 16.0, t);
    (3.0 - 6.0 * there + 6.0 * back, PI * turned)
}

/// Returns the transmittance of the door. It closes behind the character and opens in front of it.
fn transmittance(seconds: f32) -> f32 {
    let t = seconds.rem_euclid(ROUND);
    1.0 - smooth_step(4.2, 5.4, t) + smooth_step(8.5, 9.7, t)
}

/// Returns the smooth step from 0 at `from` to 1 at `to`.
fn smooth_step(from: f32, to: f32, t: f32) -> f32 {
    let s = ((t - from) / (to - from)).clamp(0.0, 1.0);
    s * s * (3.0 - 2.0 * s)
}

fn walk(
    mut character: Single<&mut Transform, With<Character>>,
    mut limbs: Query<(&Swings, &mut Transform), Without<Character>>,
    clock: Res<Clock>,
    mut last: Local<Option<f32>>,
) {
    // A character at rest must not be marked as changed.
    if last.replace(clock.now) == Some(clock.now) {
        return;
    }
    let (x, turned) = path_at(clock.now);
    // The body moves up and down slightly.
    let (step, _) = (4.2 * x).sin_cos();
    let high = 0.02 * (1.0 - step * step);
    let transform = Transform::from_xyz(x, high, 0.5 * (DOORWAY.0 + DOORWAY.1))
        .with_rotation(Quat::from_rotation_y(turned));
    character.set_if_neq(transform);
    for (swings, mut limb) in &mut limbs {
        limb.rotation = Quat::from_rotation_z(swings.0 * step);
    }
}

fn slide(mut door: Single<(&mut Transform, &mut GiOccluder), With<Door>>, clock: Res<Clock>) {
    let open = transmittance(clock.now);
    let (transform, occluder) = &mut *door;
    if occluder.transmittance != open {
        occluder.transmittance = open;
    }
    // The open door is inside the wall.
    let slid = DOOR.0 - Vec3::Z * open * DOOR.1.z;
    if transform.translation != slid {
        transform.translation = slid;
    }
}

fn switch_bounce(
    mut commands: Commands,
    keys: Res<ButtonInput<KeyCode>>,
    character: Single<(Entity, Has<GiReflector>), With<Character>>,
) {
    let (character, bounces) = *character;
    if keys.just_pressed(KeyCode::KeyB) {
        match bounces {
            true => commands.entity(character).remove::<GiReflector>(),
            false => commands.entity(character).insert(GiReflector),
        };
    }
}
