//! A day in an atrium, with a moving sun and a sky that changes color. Indirect light in the
//! arcades follows in the same frame.
//!
//! ```text
//! cargo run --release --example time_of_day
//! ```
//!
//! The atrium is made in code and baked in the background, for varying skies.
//!
//! | key | effect |
//! |---|---|
//! | M | pause and continue |
//! | Left, Right | change the time |
//! | F | mist over the court, lit by the sun and by indirect light, on and off |
//! | Space | indirect light of sky and walls on and off |
//! | Tab | one view, or direct light alone on the left |
//! | V | the picture, indirect light alone, or irradiance |
//! | G | gizmos: points of the bake, radii of a level, non-zero coefficients, none |
//! | P | the plan of the frame: passes, reasons, times |
//! | F1 | the tuning panel |
//! | H | help on and off |
//!
//! `-- --screenshot FILE.png --at 16.5` writes a picture of 16:30 without a window.

mod common;

use bevy::camera::Exposure;
use bevy::light::{CascadeShadowConfigBuilder, FogVolume, VolumetricFog, VolumetricLight};
use bevy::prelude::*;
use bevy_meshless_gi::prelude::*;
use common::capture::Capture;
use common::clock::{Clock, ClockSystems};
use common::stage::{Stage, StageSystems};
use meshless_gi::{Material, ProbeSettings, Quad, SkyModel, SkyRadiance};
use std::f32::consts::{PI, TAU};
use std::process::ExitCode;

/// Hours per second.
const SPEED: f32 = 0.5;

fn main() -> ExitCode {
    let capture = match Capture::from_command_line("time_of_day") {
        Ok(capture) => capture,
        Err(code) => return code,
    };
    let mut app = common::app(capture.as_ref());
    app.add_plugins(Stage {
        look: Transform::from_xyz(-6.6, 1.7, 4.6).looking_at(Vec3::new(3.0, 2.4, -1.5), Vec3::Y),
        reach: None,
        keys: "M, Left, Right: time; F: mist",
    })
    .add_plugins(Clock::new(8.0, SPEED, capture.as_ref().and_then(|c| c.at)).by_hand())
    .add_systems(Startup, set_up)
    .add_systems(
        Update,
        (follow, mist).after(ClockSystems).before(StageSystems),
    );
    common::run(app)
}

/// Distances from the center of the court to the columns and to the walls behind the arcades, in
/// meters.
const COURT: f32 = 5.0;
const WALLS: f32 = 8.0;
/// Heights of the arcades' ceiling and of the top of the upper story.
const CEILING: f32 = 3.2;
const TOP: f32 = 6.2;

fn atrium() -> Vec<Quad> {
    let paint = |r, g, b| Material::diffuse(Vec3::new(r, g, b));
    let (stone, render, terracotta) = (
        paint(0.62, 0.57, 0.48),
        paint(0.68, 0.62, 0.5),
        paint(0.55, 0.24, 0.13),
    );
    let mut quads = Vec::new();
    let mut solid = |low: [f32; 3], high: [f32; 3], material: &Material| {
        quads.extend(common::block(low.into(), high.into(), material));
    };
    let (c, w) = (COURT, WALLS);
    solid([-w, -0.2, -w], [w, 0.0, w], &paint(0.45, 0.42, 0.38));
    // Walls behind the arcades, their ceilings, and the story above. The sides along x include the
    // corners.
    for s in [-1.0f32, 1.0] {
        let along = |from: f32, to: f32| ((s * from).min(s * to), (s * from).max(s * to));
        let (outer, slab, upper) = (
            along(w, w + 0.3),
            along(c - 0.25, w),
            along(c - 0.25, c + 0.1),
        );
        let e = w + 0.3;
        solid([-e, 0.0, outer.0], [e, CEILING, outer.1], &terracotta);
        solid([outer.0, 0.0, -w], [outer.1, CEILING, w], &terracotta);
        solid([-e, CEILING, slab.0], [e, 3.5, slab.1], &stone);
        solid([slab.0, CEILING, 0.25 - c], [slab.1, 3.5, c - 0.25], &stone);
        solid([-c - 0.1, 3.5, upper.0], [c + 0.1, TOP, upper.1], &render);
        solid([upper.0, 3.5, 0.25 - c], [upper.1, TOP, c - 0.25], &render);
    }
    // Columns with bases and heads, four spans per side.
    for i in -2..=2i32 {
        for k in -2..=2i32 {
            if i.abs() < 2 && k.abs() < 2 {
                continue;
            }
            let (x, z) = (0.5 * c * i as f32, 0.5 * c * k as f32);
            let mut slice = |half: f32, low: f32, high: f32| {
                solid(
                    [x - half, low, z - half],
                    [x + half, high, z + half],
                    &stone,
                );
            };
            slice(0.25, 0.0, 0.25);
            slice(0.17, 0.25, 2.95);
            slice(0.25, 2.95, CEILING);
        }
    }
    // Basin in the middle.
    solid([-1.1, 0.0, -1.1], [1.1, 0.45, 1.1], &stone);
    solid([-0.25, 0.45, -0.25], [0.25, 1.2, 0.25], &terracotta);
    quads
}

fn set_up(
    mut commands: Commands,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let quads = atrium();
    let recipe = Recipe {
        preset: Preset::Draft,
        viewpoints: vec![[3.0, 1.6, 3.0], [-6.5, 1.6, 0.0], [6.5, 1.6, 0.0]],
        // The court is visible from the arcades between columns only: four times the preset's rays.
        rays_per_point: Some(1024),
        sky: SkyModel::Harmonics,
        // Probes, for the mist.
        probes: Some(ProbeSettings::default()),
        ..default()
    };
    let mut root = commands.spawn((
        Transform::default(),
        Visibility::default(),
        GiEnvironment::default(),
    ));
    common::spawn_quads(&quads, &mut root, &mut meshes, &mut materials);
    root.bake_gi(recipe);
    commands.spawn((
        DirectionalLight {
            shadow_maps_enabled: true,
            ..default()
        },
        CascadeShadowConfigBuilder {
            minimum_distance: 0.1,
            first_cascade_far_bound: 7.0,
            maximum_distance: 30.0,
            ..default()
        }
        .build(),
        Transform::default(),
    ));
}

/// Switches the mist: Bevy's volumetric fog with sunlight and indirect light. Removes it entirely
/// while it is off.
fn mist(
    mut commands: Commands,
    keys: Res<ButtonInput<KeyCode>>,
    mut there: Local<Option<Entity>>,
    root: Single<Entity, With<GiEnvironment>>,
    sun: Single<Entity, With<DirectionalLight>>,
    cameras: Query<Entity, With<Camera3d>>,
) {
    if !keys.just_pressed(KeyCode::KeyF) {
        return;
    }
    if let Some(mist) = there.take() {
        commands.entity(mist).despawn();
        commands.entity(*root).remove::<GiIrradianceVolume>();
        commands.entity(*sun).remove::<VolumetricLight>();
        for camera in &cameras {
            commands.entity(camera).remove::<VolumetricFog>();
        }
        return;
    }
    let over_the_court = Transform::from_xyz(0.0, 0.5 * TOP, 0.0).with_scale(Vec3::new(
        2.0 * WALLS,
        TOP,
        2.0 * WALLS,
    ));
    let thin = FogVolume {
        density_factor: 0.08,
        absorption: 0.05,
        ..default()
    };
    *there = Some(commands.spawn((thin, over_the_court)).id());
    commands.entity(*root).insert(GiIrradianceVolume::default());
    commands.entity(*sun).insert(VolumetricLight);
    for camera in &cameras {
        commands.entity(camera).insert(VolumetricFog {
            // The scene's indirect light replaces it.
            ambient_intensity: 0.0,
            ..default()
        });
    }
}

/// Returns the unit vector to the sun at an hour. It rises in the east (+X) at 6 and is highest at
/// noon in the south (+Z).
fn sun_at(hour: f32) -> Vec3 {
    let (high, east) = (PI * (hour - 6.0) / 12.0).sin_cos();
    Vec3::new(east, 0.83 * high, 0.56 * high).normalize()
}

/// Returns the fraction of sunlight that passes the air, linear RGB. It is lower and redder at low
/// elevation, and 0 below the horizon.
fn air_transmittance(sun: Vec3) -> Vec3 {
    let rises = ((sun.y + 0.02) / 0.06).clamp(0.0, 1.0);
    let direction = 1.0 / (sun.y.max(0.0) + 0.06);
    rises * (-direction * Vec3::new(0.06, 0.12, 0.24)).exp()
}

/// Illuminance of the sun above the atmosphere, in lux.
const SUN: f32 = 120_000.0;

/// Returns the luminance of the sky in a direction, in cd/m²: blue by day, warm around a low sun,
/// faint at night.
fn sky(sun: Vec3, direction: Vec3) -> Vec3 {
    let day = ((sun.y + 0.1) / 0.5).clamp(0.0, 1.0).powi(2);
    let up = direction.y.max(0.0);
    let blue = Vec3::new(1500.0, 2900.0, 6200.0)
        .lerp(Vec3::new(4200.0, 5200.0, 6600.0), (1.0 - up).powi(3));
    let low = (1.0 - 3.0 * sun.y.abs()).clamp(0.0, 1.0);
    let sun_side =
        (0.5 + 0.5 * direction.dot(Vec3::new(sun.x, 0.0, sun.z).normalize_or_zero())).powi(2);
    let warm = low * sun_side * (1.0 - up).powi(2) * Vec3::new(5200.0, 2000.0, 600.0);
    let night = Vec3::new(0.6, 0.9, 2.0);
    // Below the horizon is ground, lit by the sky.
    let share = if direction.y < 0.0 { 0.25 } else { 1.0 };
    share * (day * blue + warm + night)
}

/// Returns the 9 coefficients of the sky, from directions spread evenly over the sphere.
fn sky_coefficients(sun: Vec3) -> SkyRadiance {
    const DIRECTIONS: usize = 512;
    let golden = TAU * 0.618_034;
    SkyRadiance::of_map((0..DIRECTIONS).map(|k| {
        let y = 1.0 - (2 * k + 1) as f32 / DIRECTIONS as f32;
        let (sine, cosine) = (golden * k as f32).sin_cos();
        let ring = (1.0 - y * y).sqrt();
        let direction = Vec3::new(ring * cosine, y, ring * sine);
        (direction, 1.0, sky(sun, direction))
    }))
}

/// Returns the exposure for the illuminance of the court.
fn exposure(sun: Vec3) -> Exposure {
    let light = (SUN * air_transmittance(sun) * sun.y.max(0.0)).max_element()
        + 3.0 * sky(sun, Vec3::Y).max_element();
    Exposure {
        ev100: (light / 5.0).log2().clamp(5.0, 13.3),
    }
}

/// Updates sun, sky, background and exposure.
fn follow(
    mut commands: Commands,
    clock: Res<Clock>,
    mut light: Single<(&mut DirectionalLight, &mut Transform)>,
    mut environment: Single<&mut GiEnvironment>,
    cameras: Query<(Entity, &GlobalTransform), With<GiCamera>>,
    mut clear: ResMut<ClearColor>,
    mut last: Local<Option<f32>>,
) {
    // Components at rest must not be marked as changed.
    if last.replace(clock.now) == Some(clock.now) {
        return;
    }
    let sun = sun_at(clock.now);
    let [r, g, b] = (SUN * air_transmittance(sun)).to_array();
    let (light, transform) = &mut *light;
    let max = r.max(g).max(b);
    light.illuminance = max;
    light.color = match max > 0.0 {
        true => Color::linear_rgb(r / max, g / max, b / max),
        false => Color::BLACK,
    };
    **transform = Transform::default().looking_to(-sun, Vec3::Y);
    environment.sky = sky_coefficients(sun).without_ringing().into();
    let exposure = exposure(sun);
    for (camera, transform) in &cameras {
        commands.entity(camera).insert(exposure);
        // The background above the roofs is about as bright as the sky there.
        let above = (*transform.forward() + 0.4 * Vec3::Y).normalize();
        let [r, g, b] = (sky(sun, above) * exposure.exposure()).to_array();
        clear.0 = Color::linear_rgb(r, g, b);
    }
}
