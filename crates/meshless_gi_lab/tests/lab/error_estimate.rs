//! A bake's own estimate of its error matches the error measured against another program's ground
//! truth, under that program's light. It rises with a deliberately wrong operator.
//! `examples/accuracy.rs` prints the same for any scene and preset.

use meshless_gi::internals::bake::{ErrorEstimate, estimate_errors};
use meshless_gi::internals::scene::SceneDescription;
use meshless_gi::{
    BakedScene, Bounces, Evaluator, Preset, Progress, Recipe, TriangleMesh, bake_scene, load_gltf,
};
use meshless_gi_lab::accuracy::{BOUNCES, GroundTruth};
use meshless_gi_lab::fixtures::data::published;

struct TestScene {
    name: &'static str,
    mesh: TriangleMesh,
    description: SceneDescription,
    truth: GroundTruth,
}

fn test_scene(name: &'static str) -> TestScene {
    let folder = published(name);
    let description = SceneDescription::read(folder.join("L0.json")).unwrap();
    TestScene {
        name,
        mesh: load_gltf(&description.geometry[0]).unwrap().mesh,
        truth: GroundTruth::read(folder.join("L0.csv")).unwrap(),
        description,
    }
}

/// Returns the NRMSE under the light of the ground truth, four reflections.
fn measured(test: &TestScene, scene: &BakedScene, tier: u32) -> f64 {
    let k = BOUNCES.iter().position(|&b| b == Some(4)).unwrap();
    let (meshes, lights) = (std::slice::from_ref(&test.mesh), &test.description.lights);
    let evaluator = Evaluator::with_tier(scene, meshes, lights, Bounces::Count(4), tier);
    test.truth.compare(&evaluator, k).indirect.nrmse
}

fn estimated(test: &TestScene, scene: &BakedScene, seed: u64) -> Vec<ErrorEstimate> {
    estimate_errors(scene, &test.mesh, seed, &Progress::default())
        .unwrap()
        .0
}

/// Every tier's measured error lies within the interval around its estimate.
fn check_estimates(test: &TestScene, scene: &BakedScene, estimates: &[ErrorEstimate], what: &str) {
    for (estimate, tier) in estimates.iter().zip(1..) {
        let found = measured(test, scene, tier);
        let (e, interval) = (f64::from(estimate.nrmse), f64::from(estimate.interval));
        println!(
            "{}, {what}, tier {tier}: {e:.4} ± {interval:.4}, measured {found:.4}",
            test.name
        );
        assert!(
            (found - e).abs() <= interval,
            "{}, {what}, tier {tier}: {e} ± {interval} does not contain {found}",
            test.name
        );
    }
}

fn check_error_estimate(name: &'static str) {
    let test = test_scene(name);
    let recipe = Recipe {
        preset: Preset::Draft,
        ..Recipe::default()
    };
    let mut scene = bake_scene(&test.mesh, &recipe, 0, &Progress::default())
        .unwrap()
        .scene;
    // The bake's own, as `inspect` shows it, and those of other draws.
    let own: Vec<ErrorEstimate> = (scene.info().tiers.iter())
        .map(|t| ErrorEstimate {
            nrmse: t.estimated_nrmse,
            interval: t.estimated_nrmse_interval,
        })
        .collect();
    assert_eq!(own, estimated(&test, &scene, 0));
    check_estimates(&test, &scene, &own, "as baked");
    check_estimates(&test, &scene, &estimated(&test, &scene, 1), "other lights");
    let whole = own.last().unwrap();
    assert!(
        whole.interval < 1.5 * whole.nrmse,
        "{name}: {whole:?} is too wide"
    );
    // Links a tenth too strong: the first reflection is 10 % too bright, the second 21 %, and so
    // on.
    for row in &mut scene.data_mut().operator.rows {
        row.scale *= 1.1;
    }
    let wrong = estimated(&test, &scene, 0);
    check_estimates(&test, &scene, &wrong, "links times 1.1");
    let wrong = wrong.last().unwrap();
    assert!(
        wrong.nrmse > 0.1 && wrong.nrmse < 0.35 && wrong.nrmse > 2.0 * whole.nrmse,
        "{name}: links times 1.1 change {whole:?} to {wrong:?}"
    );
}

#[test]
fn estimate_interval_contains_true_error_in_cornell_box() {
    check_error_estimate("cornell");
}

#[test]
fn estimate_interval_contains_true_error_in_open_rooms() {
    check_error_estimate("rooms_open");
}

/// A largest error makes a bake as fine as necessary, and not finer.
#[test]
fn target_error_is_met_at_lowest_quality_level() {
    let test = test_scene("cornell");
    let bake = |recipe: &Recipe| bake_scene(&test.mesh, recipe, 0, &Progress::default()).unwrap();
    let draft = Recipe {
        preset: Preset::Draft,
        ..Recipe::default()
    };
    let preset = bake(&draft);
    let [coarse, fine] = [0.16, 0.055].map(|error| {
        let baked = bake(&Recipe {
            target_nrmse: Some(error),
            ..Recipe::default()
        });
        println!(
            "at most {error}: {} links, estimated {:.4}",
            baked.stats.links, baked.stats.estimated_nrmse
        );
        assert!(baked.stats.estimated_nrmse <= f64::from(error));
        assert!(
            baked.stats.warnings.is_empty(),
            "{:?}",
            baked.stats.warnings
        );
        baked.stats
    });
    assert!(coarse.links < fine.links && coarse.gather_rays < fine.gather_rays);
    assert!(fine.estimated_nrmse < coarse.estimated_nrmse);
    assert!(2 * coarse.links < preset.stats.links);
    // An unreachable error is reported: here all quality parameters are fixed.
    let poor = bake(&Recipe {
        target_nrmse: Some(1e-3),
        coarse_radius: Some(1.2),
        levels: Some(3),
        sender_levels: Some(2),
        refinement_levels: Some(0),
        max_refinement_points: Some(0),
        rays_per_point: Some(32),
        samples_per_sender: Some(4),
        truncation_error: Some(0.1),
        receiver_tolerance: Some(0.1),
        ..Recipe::default()
    });
    assert!(poor.stats.estimated_nrmse > 1e-3);
    assert!(
        poor.stats.warnings.iter().any(|w| w.contains("0.10 %")),
        "{:?}",
        poor.stats.warnings
    );
}
