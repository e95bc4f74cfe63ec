//! Cornell box with a moving light. Indirect light follows in the same frame. A blue ball, which is
//! not in the bake, rolls through it and tints the floor and the blocks.
//!
//! ```text
//! cargo run --release --example cornell
//! ```
//!
//! The box is made in code and baked in the background.
//!
//! | key | effect |
//! |---|---|
//! | arrows, Page Up, Page Down | move the light |
//! | left mouse button, held | the light follows the mouse |
//! | Space | indirect light on and off |
//! | Tab | one view, or direct light alone on the left |
//! | M | the ball stops and rolls on |
//! | B | the light that the ball reflects, on and off |
//! | D | indirect light at a fraction of the pixels, or at every pixel |
//! | V | the picture, indirect light alone, or irradiance |
//! | G | gizmos: points of the bake, radii of a level, non-zero coefficients, none |
//! | P | the plan of the frame: passes, reasons, times |
//! | F1 | the tuning panel |
//! | H | help on and off |
//!
//! With `-- --soft` the light is a panel that casts soft shadows without a shadow map. The ball is
//! not in the bake: it casts none and does not reflect the panel's light.
//!
//! `-- --screenshot FILE.png [--frames N] [--press Tab,G]` writes a picture without a window. Press
//! M first to keep the ball at its start.

mod common;

use bevy::prelude::*;
use bevy_meshless_gi::prelude::*;
use common::capture::Capture;
use common::clock::{Clock, ClockSystems};
use common::stage::{MovableLight, Stage, StageSystems, spawn_light};
use meshless_gi::{Quad, VisibilityRecipe};
use std::process::ExitCode;

fn main() -> ExitCode {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let before = arguments.len();
    arguments.retain(|a| a != "--soft");
    let soft = arguments.len() < before;
    let capture = match Capture::take_from(&mut arguments) {
        Ok(capture) if arguments.is_empty() => capture,
        Ok(_) => return usage(&format!("unknown arguments: {}", arguments.join(" "))),
        Err(error) => return usage(&error),
    };
    let mut app = common::app(capture.as_ref());
    app.insert_resource(Soft(soft))
        .add_plugins(Stage {
            look: Transform::from_xyz(0.0, 1.0, 4.2).looking_at(Vec3::new(0.0, 1.0, 0.0), Vec3::Y),
            // Positions inside the box.
            reach: Some((Vec3::new(-0.9, 0.1, -0.9), Vec3::new(0.9, 1.9, 1.5))),
            keys: "M: ball    B: its bounce    D: display",
        })
        .add_plugins(Clock::new(0.0, 1.0, capture.as_ref().and_then(|c| c.at)))
        .add_systems(Startup, setup)
        .add_systems(
            Update,
            (roll, switch_bounce)
                .chain()
                .after(ClockSystems)
                .before(StageSystems),
        );
    common::run(app)
}

fn usage(error: &str) -> ExitCode {
    eprintln!(
        "{error}\nusage: cornell [--soft] [--screenshot FILE.png [--size WIDTHxHEIGHT] [--frames N] [--at SECONDS] [--while-baking] [--press KEY,KEY]]"
    );
    ExitCode::from(2)
}

/// Dynamic object, not in the bake.
#[derive(Component)]
struct Ball;

/// `true` if the light is a panel with soft shadows instead of a point light with a shadow map.
#[derive(Resource)]
struct Soft(bool);

/// Edges of the panel, in meters.
const PANEL: Vec2 = Vec2::new(0.6, 0.4);

fn setup(
    mut commands: Commands,
    soft: Res<Soft>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let quads = Quad::cornell_box();
    let recipe = Recipe {
        preset: Preset::Draft,
        soft_shadows: soft.0.then(VisibilityRecipe::default),
        ..default()
    };
    let mut root = commands.spawn((Transform::default(), Visibility::default()));
    common::spawn_quads(&quads, &mut root, &mut meshes, &mut materials);
    root.bake_gi(recipe);

    if soft.0 {
        let panel = materials.add(StandardMaterial {
            base_color: Color::BLACK,
            emissive: LinearRgba::rgb(4.0, 3.8, 3.4),
            ..default()
        });
        commands.spawn((
            MovableLight,
            RectLight {
                color: Color::linear_rgb(1.0, 0.95, 0.85),
                intensity: 20_000.0,
                width: PANEL.x,
                height: PANEL.y,
                ..default()
            },
            GiSoftShadow::default(),
            Transform::from_xyz(0.0, 1.9, 0.0).looking_to(Vec3::NEG_Y, Vec3::NEG_Z),
            // A rectangle light shines along -Z.
            Mesh3d(meshes.add(Cuboid::new(PANEL.x, PANEL.y, 0.005))),
            MeshMaterial3d(panel),
        ));
    } else {
        spawn_light(
            &mut commands,
            &mut meshes,
            &mut materials,
            Vec3::new(0.0, 1.6, 0.0),
        )
        // Dynamic objects reflect the light.
        .insert(GiReflectiveShadowMap::default());
    }
    let blue = materials.add(StandardMaterial {
        base_color: Color::linear_rgb(0.05, 0.3, 0.95),
        perceptual_roughness: 1.0,
        ..default()
    });
    commands.spawn((
        Ball,
        GiReflector,
        Mesh3d(meshes.add(Sphere::new(BALL))),
        MeshMaterial3d(blue),
        Transform::from_translation(ball_at(0.0)),
    ));
}

/// Radius of the ball, in meters.
const BALL: f32 = 0.18;

/// Ends of the ball's path on the floor, in front of the small block at a distance of 4 cm.
const BALL_PATH: (Vec3, Vec3) = (Vec3::new(-0.7, BALL, 0.57), Vec3::new(0.6, BALL, 0.98));

/// Returns the position of the ball at a time. It starts in the middle of its path.
fn ball_at(seconds: f32) -> Vec3 {
    BALL_PATH
        .0
        .lerp(BALL_PATH.1, 0.5 + 0.5 * (0.7 * seconds).sin())
}

fn roll(mut ball: Single<&mut Transform, With<Ball>>, clock: Res<Clock>) {
    let position = ball_at(clock.now);
    // A ball at rest must not be marked as changed.
    if position != ball.translation {
        ball.translation = position;
    }
}

fn switch_bounce(
    mut commands: Commands,
    keys: Res<ButtonInput<KeyCode>>,
    ball: Single<(Entity, Has<GiReflector>), With<Ball>>,
    mut displays: Query<&mut GiSplatting>,
) {
    let (ball, bounces) = *ball;
    if keys.just_pressed(KeyCode::KeyB) {
        match bounces {
            true => commands.entity(ball).remove::<GiReflector>(),
            false => commands.entity(ball).insert(GiReflector),
        };
    }
    if keys.just_pressed(KeyCode::KeyD) {
        for mut display in &mut displays {
            *display = match *display {
                GiSplatting::PerPixel => GiSplatting::default(),
                _ => GiSplatting::PerPixel,
            };
        }
    }
}
