//! A Cornell box whose lamp moves, with the indirect light following in the same frame. A blue ball rolls through it, which no bake knows: it colours the floor and the blocks beside it.
//!
//! ```text
//! cargo run --release --features engine --example cornell
//! ```
//!
//! The box is made in code and baked while the window is already open.
//!
//! | key | does |
//! |---|---|
//! | arrows, Page Up, Page Down | move the lamp |
//! | left mouse button, held | the lamp follows the mouse |
//! | Space | indirect light on and off |
//! | Tab | one view, or direct light alone beside both |
//! | M | the ball stops and rolls on |
//! | B | the light that the ball reflects, on and off |
//! | D | indirect light at a fraction of the pixels, or at every pixel |
//! | V | the picture, indirect light alone, or irradiance |
//! | G | the points of the bake, then the radii of a level, then the non-zero coefficients, then none |
//!
//! `-- --screenshot FILE.png [--frames N] [--press Tab,G]` writes a picture of the window and ends (with M first, the ball stays where it starts).

mod common;

use bevy::prelude::*;
use bevy_meshless_gi::bake::{Preset, Recipe};
use bevy_meshless_gi::plugin::MeshlessGiBake;
use bevy_meshless_gi::prelude::*;
use bevy_meshless_gi::scene::{cornell_box, mesh_of_quads};
use common::capture::Capture;
use common::stage::{Stage, StageSystems, spawn_lamp};
use std::process::ExitCode;

fn main() -> ExitCode {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let capture = match Capture::take_from(&mut arguments) {
        Ok(capture) if arguments.is_empty() => capture,
        Ok(_) => return usage(&format!("what is {}?", arguments.join(" "))),
        Err(why) => return usage(&why),
    };
    let mut app = App::new();
    app.add_plugins((DefaultPlugins, MeshlessGiPlugin::default()))
        .insert_resource(GlobalAmbientLight::NONE)
        .add_plugins(Stage {
            look: Transform::from_xyz(0.0, 1.0, 4.2).looking_at(Vec3::new(0.0, 1.0, 0.0), Vec3::Y),
            // Inside the box.
            reach: (Vec3::new(-0.9, 0.1, -0.9), Vec3::new(0.9, 1.9, 1.5)),
            keys: "M: ball    B: its bounce    D: display",
        })
        .init_resource::<Rolling>()
        .add_systems(Startup, setup)
        .add_systems(Update, (roll, switch_bounce).chain().before(StageSystems));
    if let Some(capture) = capture {
        app.add_plugins(capture);
    }
    match app.run() {
        AppExit::Success => ExitCode::SUCCESS,
        AppExit::Error(code) => ExitCode::from(code.get()),
    }
}

fn usage(why: &str) -> ExitCode {
    eprintln!(
        "{why}\nusage: cornell [--screenshot FILE.png [--frames N] [--while-baking] [--press KEY,KEY]]"
    );
    ExitCode::from(2)
}

/// What moves: the bake does not hold its light.
#[derive(Component)]
struct Ball;

/// Seconds of the ball's path, and whether they go on.
#[derive(Resource)]
struct Rolling {
    seconds: f32,
    on: bool,
}

impl Default for Rolling {
    fn default() -> Self {
        Self {
            seconds: 0.0,
            on: true,
        }
    }
}

fn setup(
    mut commands: Commands,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let quads = cornell_box();
    let recipe = Recipe {
        preset: Preset::Draft,
        ..default()
    };
    let mut root = commands.spawn((
        Transform::default(),
        Visibility::default(),
        MeshlessGiBake::spawn(mesh_of_quads(&quads), recipe),
    ));
    common::spawn_quads(&quads, &mut root, &mut meshes, &mut materials);

    spawn_lamp(
        &mut commands,
        &mut meshes,
        &mut materials,
        Vec3::new(0.0, 1.6, 0.0),
    )
    // What moves bounces its light.
    .insert(MeshlessGiReflective::default());
    let blue = materials.add(StandardMaterial {
        base_color: Color::linear_rgb(0.05, 0.3, 0.95),
        perceptual_roughness: 1.0,
        ..default()
    });
    commands.spawn((
        Ball,
        MeshlessGiBouncer,
        Mesh3d(meshes.add(Sphere::new(BALL))),
        MeshMaterial3d(blue),
        Transform::from_translation(ball_at(0.0)),
    ));
}

/// Radius of the ball, metres.
const BALL: f32 = 0.18;

/// Ends of the ball's way on the floor: along the front of the small block, which it passes 4 cm away from.
const WAY: (Vec3, Vec3) = (Vec3::new(-0.7, BALL, 0.57), Vec3::new(0.6, BALL, 0.98));

/// Where the ball is: to and fro, from the middle of its way.
fn ball_at(seconds: f32) -> Vec3 {
    WAY.0.lerp(WAY.1, 0.5 + 0.5 * (0.7 * seconds).sin())
}

fn roll(
    mut ball: Single<&mut Transform, With<Ball>>,
    baking: Query<(), With<MeshlessGiBake>>,
    keys: Res<ButtonInput<KeyCode>>,
    mut rolling: ResMut<Rolling>,
    time: Res<Time>,
) {
    if keys.just_pressed(KeyCode::KeyM) {
        rolling.on = !rolling.on;
    }
    // It waits for its light.
    if rolling.on && baking.is_empty() {
        rolling.seconds += time.delta_secs();
        ball.translation = ball_at(rolling.seconds);
    }
}

fn switch_bounce(
    mut commands: Commands,
    keys: Res<ButtonInput<KeyCode>>,
    ball: Single<(Entity, Has<MeshlessGiBouncer>), With<Ball>>,
    mut displays: Query<&mut MeshlessGiDisplay>,
) {
    let (ball, bounces) = *ball;
    if keys.just_pressed(KeyCode::KeyB) {
        match bounces {
            true => commands.entity(ball).remove::<MeshlessGiBouncer>(),
            false => commands.entity(ball).insert(MeshlessGiBouncer),
        };
    }
    if keys.just_pressed(KeyCode::KeyD) {
        for mut display in &mut displays {
            *display = match *display {
                MeshlessGiDisplay::Full => MeshlessGiDisplay::default(),
                MeshlessGiDisplay::Subsplats(_) => MeshlessGiDisplay::Full,
            };
        }
    }
}
