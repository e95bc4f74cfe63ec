//! What the tests of point clouds share: bakes, their light at places, and the reference integrator's beside it.
#![allow(dead_code, reason = "each test uses its part")]

use bevy_meshless_gi::accuracy::{
    Bounces, Evaluator, Irradiance, ReferenceSettings, irradiance_at_all,
};
use bevy_meshless_gi::asset::BakedScene;
use bevy_meshless_gi::bake::{Preset, Progress, Recipe, bake_level};
use bevy_meshless_gi::scene::{Light, TriangleMesh};
use glam::Vec3;

/// Diffuse reflections that count where not all do.
pub const REFLECTIONS: u32 = 4;

/// Two references whose noise is independent.
pub type Truth = [Vec<Irradiance>; 2];

/// Light after [`REFLECTIONS`].
pub fn reference(
    geometry: &TriangleMesh,
    lights: &[Light],
    places: &[(Vec3, Vec3)],
    paths: u32,
) -> Truth {
    [1, 2].map(|seed| {
        let settings = ReferenceSettings {
            paths,
            bounces: Some(REFLECTIONS),
            seed,
        };
        irradiance_at_all(geometry, lights, places, &settings)
    })
}

pub fn baked(level: &TriangleMesh, preset: Preset) -> BakedScene {
    let recipe = Recipe {
        preset,
        ..Recipe::default()
    };
    bake_level(level, &recipe, 0, &Progress::default())
        .expect("a bake")
        .scene
}

/// Direct and indirect light of a bake at places.
pub fn shown(
    scene: &BakedScene,
    level: TriangleMesh,
    lights: &[Light],
    places: &[(Vec3, Vec3)],
    bounces: Bounces,
) -> (Vec<Vec3>, Vec<Vec3>) {
    let meshes = [level];
    let evaluator = Evaluator::new(scene, &meshes, lights, bounces);
    let at = |(k, (x, n)): (usize, &(Vec3, Vec3))| {
        let e = evaluator.at(*x, *n, k as u64);
        (e.direct, e.indirect.unwrap_or_default())
    };
    places.iter().enumerate().map(at).unzip()
}

/// ‖values − truth‖ / ‖truth‖. In products of the one reference with the other their noise cancels; taken from a reference's own estimate of its noise, which
/// knows nothing of its stratified samples, it would hide errors of a few hundredths.
pub fn nrmse(values: &[Vec3], truth: &Truth, of: impl Fn(&Irradiance) -> Vec3) -> f64 {
    let (mut square, mut power) = (0.0f64, 0.0f64);
    for (i, x) in values.iter().enumerate() {
        let [a, b] = [0, 1].map(|k| of(&truth[k][i]));
        square += f64::from((*x - a).dot(*x - b));
        power += f64::from(a.dot(b));
    }
    (square.max(0.0) / power).sqrt()
}

pub fn indirect(i: &Irradiance) -> Vec3 {
    i.indirect
}

pub fn direct(i: &Irradiance) -> Vec3 {
    i.direct
}
