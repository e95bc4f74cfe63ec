//! Soft shadows of rectangles from baked visibility, compared with the reference integrator. The
//! error in the penumbra is at most ten percent with fifty coefficients, for panels of several
//! sizes and positions. It is larger with five coefficients. The bake has half of the points of its
//! preset. `examples/pca` measures bakes of the usual size and a scene with penumbrae behind a
//! door.

use glam::Vec3;
use meshless_gi::internals::frame::soft_shadow::{self, SoftLight};
use meshless_gi::internals::transport::pca::Visibility;
use meshless_gi::{
    BakedScene, Light, Preset, Progress, Recipe, TriangleMesh, VisibilityRecipe, bake_scene,
};
use meshless_gi_lab::accuracy::{
    PenumbraSample, occluded_irradiances_by_rays, penumbra_samples, shadow_errors,
};
use meshless_gi_lab::fixtures::data::published_mesh;

/// Bound of the NRMSE.
const BOUND: f64 = 0.10;
/// Particle paths that select the measured positions.
const PATHS: u64 = 1200;

fn panel(center: [f32; 3], u: f32, v: f32) -> Light {
    Light::Rect {
        center: center.into(),
        u: Vec3::X * u,
        v: Vec3::Z * v,
        radiance: Vec3::ONE,
    }
}

fn baked(name: &str) -> (TriangleMesh, BakedScene) {
    let mesh = published_mesh(name);
    let recipe = Recipe {
        preset: Preset::Medium,
        // Half of the points of the preset.
        coarse_radius: Some(0.36),
        levels: Some(3),
        sender_levels: Some(2),
        refinement_levels: Some(0),
        rays_per_point: Some(16),
        soft_shadows: Some(VisibilityRecipe {
            cluster_size: 200,
            ..VisibilityRecipe::default()
        }),
        ..Recipe::default()
    };
    let baked = bake_scene(&mesh, &recipe, 0, &Progress::default()).expect("a bake");
    (mesh, baked.scene)
}

/// NRMSE from baked visibility, by rays at the same points, and from five coefficients per point.
fn measure(mesh: &TriangleMesh, scene: &BakedScene, few: &Visibility, light: &Light) -> [f64; 3] {
    let visibility = scene.data().visibility.as_ref().expect("visibility");
    let positions: Vec<PenumbraSample> = penumbra_samples(scene, mesh, light, PATHS)
        .into_iter()
        .filter(PenumbraSample::is_in_penumbra)
        .collect();
    assert!(positions.len() > 100, "{} positions", positions.len());
    let soft_light = SoftLight::from_light(light, 25).expect("a rectangle");
    let occluded_irradiances = soft_shadow::occluded_irradiances(scene.data(), &[soft_light]);
    let by_rays = occluded_irradiances_by_rays(scene, mesh, &soft_light, visibility.points.len());
    let error =
        |occluded_irradiances: &[_]| shadow_errors(scene, occluded_irradiances, &positions).nrmse;
    // Must fail: no shadow at all.
    assert!(error(&vec![Default::default(); occluded_irradiances.len()]) > 2.0 * BOUND);
    let by_few = soft_shadow::occluded_irradiances_from(scene.data(), few, &[soft_light]);
    [
        error(&occluded_irradiances),
        error(&by_rays),
        error(&by_few),
    ]
}

fn check(name: &str, panels: &[Light]) {
    let (mesh, scene) = baked(name);
    let visibility = scene.data().visibility.as_ref().expect("visibility");
    assert!(visibility.clusters.iter().all(|c| c.components <= 50));
    let few = visibility.truncated(5);
    assert!(few.bytes() < visibility.bytes() / 2);
    let all: Vec<[f64; 3]> = (panels.iter())
        .map(|p| measure(&mesh, &scene, &few, p))
        .collect();
    println!("{name}, from baked visibility, by rays, from five coefficients: {all:.4?}");
    for (light, [stored, rays, few]) in panels.iter().zip(&all) {
        assert!(
            *stored <= BOUND,
            "{name}: {stored}, by rays {rays}, {light:?}"
        );
        // Must fail: too few coefficients.
        assert!(*few > BOUND, "{name}: {few} from five, {light:?}");
    }
}

#[test]
fn penumbrae_in_box_with_blocks_match_reference() {
    check(
        "cornell",
        &[
            panel([2.78, 5.46, 2.795], 0.65, 0.525),
            panel([1.5, 5.2, 2.0], 0.4, 0.8),
            panel([4.0, 4.9, 3.6], 0.9, 0.3),
            panel([2.0, 4.6, 4.2], 0.5, 0.5),
        ],
    );
}
