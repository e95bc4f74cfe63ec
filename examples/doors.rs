//! A visitor walks through a door, which shuts: the room behind it, which had its light through the
//! door alone, goes dark. The bake knows the door; of the visitor it knows nothing, and yet light
//! in free space falls on it, and its coat colors the floor.
//!
//! ```text
//! cargo run --release --example doors
//! ```
//!
//! Two rooms, made in code and baked while the window is already open; their ceiling and the wall
//! before them are drawn from inside only.
//!
//! | key | does |
//! |---|---|
//! | M | time stops and goes on |
//! | Left, Right | time goes back and on |
//! | B | the light that the visitor reflects, on and off |
//! | Space | indirect light on and off |
//! | Tab | one view, or direct light alone beside both |
//! | V | the picture, indirect light alone, or irradiance |
//! | G | the points of the bake, then the radii of a level, then the non-zero coefficients, then none |
//! | P | the plan of the frame: what runs, why, and how long it takes |
//! | F1 | the tuning panel |
//! | H | the lines of help on and off |
//!
//! `-- --screenshot FILE.png --at 6.5` writes a picture of second 6.5, when the door is shut,
//! without a window; `--at 2.2` one through the open door.

mod common;

use bevy::prelude::*;
use bevy_meshless_gi::prelude::*;
use common::capture::Capture;
use common::clock::{Clock, ClockSystems};
use common::stage::{Stage, StageSystems, spawn_lamp};
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

/// Corners of both rooms together, meters.
const ROOMS: (Vec3, Vec3) = (Vec3::new(-4.0, 0.0, -3.0), Vec3::new(4.0, 2.7, 0.0));
/// Half of the thickness of the wall between them, at x = 0.
const WALL: f32 = 0.1;
/// The doorway in it: from z to z, and how high.
const DOORWAY: (f32, f32, f32) = (-2.0, -1.0, 2.2);
/// Middle and edges of the door, shut.
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
struct Visitor;

/// Swings to and fro while the visitor walks, by so many radians.
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
    let place = Vec3::new(-1.9, 2.05, -1.9);
    spawn_lamp(&mut commands, &mut meshes, &mut materials, place)
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
    // Where the wall is cut open to look in, it is black.
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
    let visitor = (
        Visitor,
        GiReflector,
        Transform::default(),
        Visibility::default(),
    );
    commands.spawn(visitor).with_children(|body| {
        let mut part = |mesh: &Handle<Mesh>, paint: &Handle<StandardMaterial>, at: Vec3| {
            body.spawn((
                Mesh3d(mesh.clone()),
                MeshMaterial3d(paint.clone()),
                Transform::from_translation(at),
            ));
        };
        part(&trunk, &coat, Vec3::new(0.0, 1.14, 0.0));
        part(&head, &skin, Vec3::new(0.0, 1.63, 0.0));
        // Legs and arms hang from joints; those of one side swing against each other.
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

/// Seconds until all begins again.
const ROUND: f32 = 17.0;

/// Where the visitor is on its way through the door, to the left and back, meters; and how far it
/// has turned round, radians.
fn way(seconds: f32) -> (f32, f32) {
    let t = seconds.rem_euclid(ROUND);
    let there = (t / 6.0).clamp(0.0, 1.0);
    let back = ((t - 8.5) / 6.0).clamp(0.0, 1.0);
    let turned = between(6.0, 7.0, t) + between(15.0, 16.0, t);
    (3.0 - 6.0 * there + 6.0 * back, PI * turned)
}

/// How far the door stands open: it shuts behind the visitor, and opens before it.
fn transmittance(seconds: f32) -> f32 {
    let t = seconds.rem_euclid(ROUND);
    1.0 - between(4.2, 5.4, t) + between(8.5, 9.7, t)
}

/// From 0 at `from` to 1 at `to`, smoothly.
fn between(from: f32, to: f32, t: f32) -> f32 {
    let s = ((t - from) / (to - from)).clamp(0.0, 1.0);
    s * s * (3.0 - 2.0 * s)
}

fn walk(
    mut visitor: Single<&mut Transform, With<Visitor>>,
    mut limbs: Query<(&Swings, &mut Transform), Without<Visitor>>,
    clock: Res<Clock>,
    mut last: Local<Option<f32>>,
) {
    // Who stands still must not look moved.
    if last.replace(clock.now) == Some(clock.now) {
        return;
    }
    let (x, turned) = way(clock.now);
    // It bobs a little.
    let (step, _) = (4.2 * x).sin_cos();
    let high = 0.02 * (1.0 - step * step);
    let place = Transform::from_xyz(x, high, 0.5 * (DOORWAY.0 + DOORWAY.1))
        .with_rotation(Quat::from_rotation_y(turned));
    visitor.set_if_neq(place);
    for (swings, mut limb) in &mut limbs {
        limb.rotation = Quat::from_rotation_z(swings.0 * step);
    }
}

fn slide(mut door: Single<(&mut Transform, &mut GiOccluder), With<Door>>, clock: Res<Clock>) {
    let open = transmittance(clock.now);
    let (place, occluder) = &mut *door;
    if occluder.transmittance != open {
        occluder.transmittance = open;
    }
    // Open, it is inside of the wall.
    let slid = DOOR.0 - Vec3::Z * open * DOOR.1.z;
    if place.translation != slid {
        place.translation = slid;
    }
}

fn switch_bounce(
    mut commands: Commands,
    keys: Res<ButtonInput<KeyCode>>,
    visitor: Single<(Entity, Has<GiReflector>), With<Visitor>>,
) {
    let (visitor, bounces) = *visitor;
    if keys.just_pressed(KeyCode::KeyB) {
        match bounces {
            true => commands.entity(visitor).remove::<GiReflector>(),
            false => commands.entity(visitor).insert(GiReflector),
        };
    }
}
