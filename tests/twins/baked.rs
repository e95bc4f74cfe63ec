//! Bakes of the Cornell box with recipes of a game.

use glam::Vec3;
use meshless_gi::{
    BakeSource, BakedScene, BounceMode, FmmRecipe, FrameLight, Light, Preset, Progress, Recipe,
    TransportMethod, bake, load_gltf,
};

/// Bakes the Cornell box quickly.
pub fn cornell(rule: TransportMethod, bounce_mode: BounceMode) -> BakedScene {
    bake_box(&recipe(rule, bounce_mode))
}

/// Returns the recipe of a quick bake.
pub fn recipe(rule: TransportMethod, bounce_mode: BounceMode) -> Recipe {
    Recipe {
        preset: Preset::Draft,
        rays_per_point: Some(32),
        levels: Some(3),
        sender_levels: Some(2),
        refinement_levels: Some(0),
        bounces: Some(3),
        transport: match rule {
            TransportMethod::Fmm(fmm) => TransportMethod::Fmm(FmmRecipe {
                fallback_links: true,
                ..fmm
            }),
            other => other,
        },
        bounce_mode,
        ..Recipe::default()
    }
}

pub fn bake_box(recipe: &Recipe) -> BakedScene {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/tests/data/cornell/cornell.glb"
    );
    let level = load_gltf(path).unwrap();
    let source = BakeSource {
        geometry: &level.mesh,
        bvh: level.mesh.bvh(),
        primitives: level.mesh.len() as u64,
        content_hash: level.mesh.content_hash(),
        occluders: Vec::new(),
    };
    bake(&source, recipe, &Progress::default()).unwrap().scene
}

/// Returns the box's light, one next to it, and a bright window.
pub fn lights() -> Vec<FrameLight> {
    let light_source = Light::Spot {
        position: Vec3::new(2.78, 5.4, 2.795),
        direction: Vec3::NEG_Y,
        intensity: Vec3::new(10.0, 9.0, 7.0),
        inner: 45f32.to_radians(),
        outer: 65f32.to_radians(),
        range: f32::INFINITY,
    };
    let bulb = Light::Point {
        position: Vec3::new(1.0, 3.0, 1.5),
        intensity: Vec3::splat(3.0),
        range: 12.0,
    };
    let window = Light::Rect {
        center: Vec3::new(2.8, 4.0, 0.3),
        u: Vec3::X,
        v: Vec3::Y,
        radiance: Vec3::new(1.0, 1.5, 2.0),
    };
    [light_source, bulb, window]
        .iter()
        .flat_map(|l| FrameLight::expand(l, 9))
        .collect()
}
