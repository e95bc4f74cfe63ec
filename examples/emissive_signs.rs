//! A street at night, lit by signs that blink and change color, and by a faint sky. Indirect light
//! follows in the same frame. Bevy displays emissive surfaces, but they light nothing.
//!
//! ```text
//! cargo run --release --example emissive_signs
//! ```
//!
//! The street is made in code and baked in the background, with dynamic materials.
//!
//! | key | effect |
//! |---|---|
//! | M | pause and continue |
//! | Left, Right | change the time |
//! | L | the signs off and on |
//! | Space | indirect light on and off (there is no other light) |
//! | Tab | one view, or direct light alone on the left |
//! | V | the picture, indirect light alone, or irradiance |
//! | G | gizmos: points of the bake, radii of a level, non-zero coefficients, none |
//! | P | the plan of the frame: passes, reasons, times |
//! | F1 | the tuning panel |
//! | H | help on and off |
//!
//! `-- --screenshot FILE.png --at 3` writes a picture of second 3 without a window.

mod common;

use bevy::prelude::*;
use bevy_meshless_gi::prelude::*;
use common::capture::Capture;
use common::clock::{Clock, ClockSystems};
use common::stage::{Stage, StageSystems};
use meshless_gi::{Material, Quad};
use std::process::ExitCode;

fn main() -> ExitCode {
    let capture = match Capture::from_command_line("emissive_signs") {
        Ok(capture) => capture,
        Err(code) => return code,
    };
    let mut app = common::app(capture.as_ref());
    app.insert_resource(ClearColor(Color::linear_rgb(0.003, 0.004, 0.009)))
        .insert_resource(SignsOn(true))
        .add_plugins(Stage {
            look: Transform::from_xyz(0.9, 1.7, 3.6)
                .looking_at(Vec3::new(-0.3, 2.1, -6.0), Vec3::Y),
            reach: None,
            keys: "M, Left, Right: time    L: signs",
        })
        .add_plugins(Clock::new(0.0, 1.0, capture.as_ref().and_then(|c| c.at)).by_hand())
        .add_systems(Startup, set_up)
        .add_systems(
            Update,
            update_emission.after(ClockSystems).before(StageSystems),
        );
    common::run(app)
}

/// State of the signs: on or off.
#[derive(Resource)]
struct SignsOn(bool);

/// Sign: boxes of one emissive material.
struct Sign {
    name: &'static str,
    /// Emissive color when it is fully on, as Bevy's `emissive`.
    color: Vec3,
    /// Corners of the boxes, in meters.
    boxes: &'static [([f32; 3], [f32; 3])],
}

/// Signs on the walls and at right angles to them.
const SIGNS: [Sign; 7] = [
    Sign {
        name: "blade",
        color: Vec3::new(3.2, 0.12, 1.5),
        boxes: &[([-2.75, 1.6, -3.6], [-1.75, 4.4, -3.4])],
    },
    Sign {
        name: "first bar",
        color: Vec3::new(0.08, 2.4, 2.0),
        boxes: &[([1.9, 2.3, -2.2], [2.8, 2.65, -2.0])],
    },
    Sign {
        name: "second bar",
        color: Vec3::new(0.08, 2.4, 2.0),
        boxes: &[([1.9, 2.85, -2.2], [2.8, 3.2, -2.0])],
    },
    Sign {
        name: "third bar",
        color: Vec3::new(0.08, 2.4, 2.0),
        boxes: &[([1.9, 3.4, -2.2], [2.8, 3.75, -2.0])],
    },
    Sign {
        name: "frame",
        color: Vec3::new(2.8, 1.4, 0.08),
        boxes: &[
            ([-2.8, 2.6, -8.8], [-2.68, 2.9, -5.8]),
            ([-2.8, 4.1, -8.8], [-2.68, 4.4, -5.8]),
            ([-2.8, 2.9, -6.1], [-2.68, 4.1, -5.8]),
            ([-2.8, 2.9, -8.8], [-2.68, 4.1, -8.5]),
        ],
    },
    Sign {
        name: "strip",
        color: Vec3::new(0.2, 0.5, 4.0),
        boxes: &[([2.66, 2.5, -9.8], [2.8, 3.3, -6.0])],
    },
    Sign {
        name: "gate",
        color: Vec3::new(3.2, 0.25, 0.08),
        boxes: &[
            ([-1.3, 0.1, -12.9], [-1.0, 3.0, -12.75]),
            ([1.0, 0.1, -12.9], [1.3, 3.0, -12.75]),
            ([-1.8, 3.0, -12.9], [1.8, 3.35, -12.75]),
        ],
    },
];

/// Returns the fraction of a sign's emission at a time, per color channel.
fn strength(sign: usize, t: f32) -> Vec3 {
    match sign {
        // Cycles through the colors.
        0 => {
            let hue = |shift: f32| 0.5 + 0.5 * (0.8 * t + shift).cos();
            Vec3::new(
                0.15 + 0.85 * hue(0.0),
                9.0 * hue(2.1),
                0.25 + 1.2 * hue(4.2),
            )
        }
        // One after the other.
        1..=3 => {
            let offset = (2.0 * t).rem_euclid(4.0);
            let after = (offset - (sign - 1) as f32).rem_euclid(4.0);
            Vec3::splat(if after < 2.0 { 1.0 } else { 0.04 })
        }
        // On and off.
        4 => Vec3::splat(if t.rem_euclid(3.0) < 2.0 { 1.0 } else { 0.03 }),
        // Flickers occasionally.
        5 => {
            let within = t.rem_euclid(5.0);
            let dark = within < 0.6 && (23.0 * within).sin() > 0.2;
            Vec3::splat(if dark { 0.15 } else { 1.0 })
        }
        _ => Vec3::splat(0.8 + 0.2 * (1.3 * t).sin()),
    }
}

fn street() -> Vec<Quad> {
    let paint = |r, g, b| Material::diffuse(Vec3::new(r, g, b));
    let mut quads = Vec::new();
    let mut solid = |low: [f32; 3], high: [f32; 3], material: &Material| {
        quads.extend(common::block(low.into(), high.into(), material));
    };
    let (brick, plaster, concrete) = (
        paint(0.42, 0.2, 0.14),
        paint(0.6, 0.57, 0.5),
        paint(0.38, 0.4, 0.42),
    );
    solid([-6.0, -0.3, -14.0], [6.0, 0.0, 6.0], &paint(0.2, 0.2, 0.21));
    // Pavements, then houses on the left, on the right, and at the end.
    let kerb = paint(0.45, 0.44, 0.42);
    solid([-2.8, 0.0, -13.0], [-1.7, 0.12, 6.0], &kerb);
    solid([1.7, 0.0, -13.0], [2.8, 0.12, 6.0], &kerb);
    solid([-6.0, 0.0, -4.6], [-2.8, 6.0, 6.0], &plaster);
    solid([-6.0, 0.0, -9.4], [-2.8, 7.5, -4.6], &brick);
    solid([-6.0, 0.0, -13.0], [-2.8, 5.2, -9.4], &concrete);
    solid([2.8, 0.0, -3.4], [6.0, 7.0, 6.0], &brick);
    solid([2.8, 0.0, -10.2], [6.0, 5.4, -3.4], &plaster);
    solid([2.8, 0.0, -13.0], [6.0, 8.0, -10.2], &concrete);
    solid([-6.0, 0.0, -14.0], [6.0, 6.5, -13.0], &plaster);
    // Objects: boxes, a counter under its roof, a balcony.
    let planks = paint(0.5, 0.36, 0.2);
    solid([-2.6, 0.12, -1.6], [-2.0, 0.7, -1.0], &planks);
    solid([-2.5, 0.7, -1.5], [-2.1, 1.05, -1.1], &planks);
    solid([2.0, 0.12, -5.6], [2.8, 1.0, -4.2], &concrete);
    solid([1.9, 2.1, -5.7], [2.8, 2.18, -4.1], &planks);
    solid([-2.8, 4.9, -8.6], [-2.0, 5.0, -6.0], &concrete);
    for sign in &SIGNS {
        let material = Material {
            name: sign.name.into(),
            ..Material::emissive(Vec3::splat(0.05), sign.color)
        };
        for (low, high) in sign.boxes {
            solid(*low, *high, &material);
        }
    }
    quads
}

fn set_up(
    mut commands: Commands,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let quads = street();
    let recipe = Recipe {
        preset: Preset::Draft,
        viewpoints: vec![[0.0, 1.6, 2.0], [0.0, 2.0, -5.0], [0.0, 2.0, -11.0]],
        dynamic_materials: true,
        ..default()
    };
    let mut root = commands.spawn((
        Transform::default(),
        Visibility::default(),
        // Night sky of a town.
        GiEnvironment {
            sky: GiSky::Uniform(LinearRgba::rgb(6.0, 7.0, 12.0)),
            ..default()
        },
    ));
    let named = common::spawn_quads(&quads, &mut root, &mut meshes, &mut materials);
    root.insert(GiDynamicMaterials(named)).bake_gi(recipe);
}

/// Updates the signs' emission.
fn update_emission(
    dynamic: Single<&GiDynamicMaterials>,
    mut materials: ResMut<Assets<StandardMaterial>>,
    keys: Res<ButtonInput<KeyCode>>,
    mut lit: ResMut<SignsOn>,
    clock: Res<Clock>,
) {
    if keys.just_pressed(KeyCode::KeyL) {
        lit.0 = !lit.0;
    }
    for (name, handle) in &dynamic.0 {
        let Some(k) = SIGNS.iter().position(|sign| sign.name == name) else {
            continue;
        };
        let on = if lit.0 { 1.0 } else { 0.0 };
        let [r, g, b] = (on * SIGNS[k].color * strength(k, clock.now)).to_array();
        let now = LinearRgba::rgb(r, g, b);
        // An unchanged sign must not be marked as changed.
        if materials.get(handle).is_some_and(|m| m.emissive != now)
            && let Some(mut material) = materials.get_mut(handle)
        {
            material.emissive = now;
        }
    }
}
