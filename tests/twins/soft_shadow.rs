//! Comparison of `soft_shadow`, and of `flatten` after it, with their twins, on a small baked box
//! with a rectangle, a sphere and a point.

use super::compare::{Scale, differing};
use super::harness;
use bevy_meshless_gi::gpu::{KernelPipelines, SceneBuffers};
use bevy_meshless_gi::internals::gpu::{EntryPoint, SoftShadowBuffers};
use glam::Vec3;
use meshless_gi::internals::frame::project::extent;
use meshless_gi::internals::frame::{SoftLight, SoftShadowParams, VectorIrradiance, soft_shadow};
use meshless_gi::{
    BakedScene, Preset, Progress, Quad, Recipe, TriangleMesh, VisibilityRecipe, bake_scene,
};

/// Bakes the box with visibility data of the senders.
pub fn baked() -> BakedScene {
    let mesh: TriangleMesh = TriangleMesh::from_quads(&Quad::cornell_box());
    let recipe = Recipe {
        preset: Preset::Draft,
        levels: Some(4),
        sender_levels: Some(2),
        rays_per_point: Some(64),
        soft_shadows: Some(VisibilityRecipe {
            directions: 252,
            coefficients: 21,
            cluster_size: 60,
            max_cluster_error: 0.02,
        }),
        ..Recipe::default()
    };
    bake_scene(&mesh, &recipe, 2, &Progress::default())
        .unwrap()
        .scene
}

/// Returns a rectangle, a sphere, a point and an empty light.
pub fn lights() -> [SoftLight; 4] {
    [
        SoftLight::rectangle(
            Vec3::new(0.1, 1.9, 0.0),
            Vec3::X * 0.3,
            Vec3::Z * 0.2,
            Vec3::new(5.0, 4.0, 3.0),
            25,
        )
        .with_range(6.0),
        SoftLight::sphere(Vec3::new(-0.5, 1.2, 0.5), 0.15, Vec3::ONE, 5.0, 9),
        SoftLight::sphere(Vec3::new(0.6, 0.9, 0.7), 0.0, Vec3::X, f32::INFINITY, 1),
        SoftLight::default(),
    ]
}

#[test]
fn soft_shadows_match_twin() {
    let harness = harness();
    let scene = baked();
    let visibility = scene.data().visibility.as_ref().unwrap();
    let lights = lights();
    let kernels = KernelPipelines::new(&harness.device).unwrap();
    let buffers = SceneBuffers::new(&harness.device, &harness.queue, &scene, 1).unwrap();
    let mut soft_buffers =
        SoftShadowBuffers::new(&harness.device, &harness.queue, &buffers, visibility, 1).unwrap();
    harness
        .run(|encoder| {
            soft_buffers
                .record(&kernels, &harness.queue, encoder, &buffers, &lights)
                .unwrap();
        })
        .unwrap();
    assert_eq!(
        soft_buffers
            .counters()
            .dispatches_of(EntryPoint::SoftShadow),
        1
    );
    assert!(soft_buffers.count() == 10 && soft_buffers.bytes() > visibility.bytes() as u64 / 2);
    let gpu: Vec<VectorIrradiance> = harness
        .read(
            soft_buffers.occluded_irradiances(),
            scene.data().points.len(),
        )
        .unwrap();
    let cpu = soft_shadow::occluded_irradiances(scene.data(), &lights);
    // Thresholds amplify the last bits of a depth, which is a sum of twenty products.
    let tolerance = 2e-3;
    let found = differing(&gpu, &cpu, 12, tolerance, Scale::Rms);
    assert!(
        found.is_empty(),
        "{} of {} differ, the first {:?} {:?}",
        found.len(),
        cpu.len(),
        gpu[found[0]],
        cpu[found[0]]
    );
    // Must fail: a light two centimeters off, no second light, another cluster mean, a missing
    // coefficient. Also other errors of points, another unit of depths, and no `flatten` after the
    // kernel.
    let assert_detected = |what: &str, wrong: &[VectorIrradiance]| {
        let found = differing(&gpu, wrong, 12, tolerance, Scale::Rms);
        assert!(!found.is_empty(), "{what} is not detected");
    };
    let mut others = lights;
    others[0].center[0] += 0.02;
    assert_detected(
        "another position",
        &soft_shadow::occluded_irradiances(scene.data(), &others),
    );
    let mut others = lights;
    others[1] = SoftLight::default();
    assert_detected(
        "a missing light",
        &soft_shadow::occluded_irradiances(scene.data(), &others),
    );
    let mut perturbed = scene.clone();
    let perturbed_visibility = perturbed.data_mut().visibility.as_mut().unwrap();
    for cluster in &perturbed_visibility.clusters {
        perturbed_visibility.scales[cluster.scales as usize] *= 0.8;
    }
    assert_detected(
        "other means",
        &soft_shadow::occluded_irradiances(perturbed.data(), &lights),
    );
    let mut perturbed = scene.clone();
    for point in &mut perturbed.data_mut().visibility.as_mut().unwrap().points {
        point.mask[0] &= !1;
    }
    assert_detected(
        "a missing coefficient",
        &soft_shadow::occluded_irradiances(perturbed.data(), &lights),
    );
    let mut perturbed = scene.clone();
    for point in &mut perturbed.data_mut().visibility.as_mut().unwrap().points {
        point.error *= 4;
    }
    assert_detected(
        "other errors",
        &soft_shadow::occluded_irradiances(perturbed.data(), &lights),
    );
    let mut perturbed = scene.clone();
    for cluster in &mut perturbed.data_mut().visibility.as_mut().unwrap().clusters {
        cluster.near *= 1.5;
    }
    assert_detected(
        "another unit",
        &soft_shadow::occluded_irradiances(perturbed.data(), &lights),
    );
    let mut without_flatten = cpu.clone();
    assert!(visibility.points.len() < scene.data().points.len());
    without_flatten[visibility.points.len()..].fill(VectorIrradiance::default());
    assert_detected("no parents' mean", &without_flatten);
    let params = SoftShadowParams::new(visibility, extent(scene.data()), lights.len());
    assert!(params.points > 0 && params.lights == 4);
}
