//! Tiers of the operator (design D11). A prefix of the links is an operator of equal brightness,
//! lower cost and slightly larger error.

use glam::Vec3;
use meshless_gi::internals::frame::VectorIrradiance;
use meshless_gi::internals::samples::trace_particles;
use meshless_gi::internals::scene::SceneDescription;
use meshless_gi::internals::transport::{Row, TIERS};
use meshless_gi::{
    BakedScene, CpuFrame, FrameLight, FrameSettings, Preset, Progress, Recipe, TransportMethod,
    TriangleMesh, bake_scene, load_gltf,
};
use std::path::Path;

struct TestScene {
    mesh: TriangleMesh,
    lights: Vec<FrameLight>,
}

fn test_scene(name: &str) -> TestScene {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
        .join("tests/data")
        .join(name);
    let scene = SceneDescription::read(folder.join("L0.json")).unwrap();
    let lights = scene.lights.iter();
    TestScene {
        mesh: load_gltf(&scene.geometry[0]).unwrap().mesh,
        lights: lights.flat_map(|l| FrameLight::expand(l, 16)).collect(),
    }
}

fn baked(test: &TestScene, recipe: Recipe) -> BakedScene {
    bake_scene(&test.mesh, &recipe, 0, &Progress::default())
        .unwrap()
        .scene
}

fn draft() -> Recipe {
    Recipe {
        preset: Preset::Draft,
        ..Recipe::default()
    }
}

fn solve(scene: &BakedScene, lights: &[FrameLight], tier: u32) -> CpuFrame {
    let mut frame = CpuFrame::new(scene);
    frame.set_lights(scene, lights);
    let settings = FrameSettings {
        tier,
        ..FrameSettings::bounces(4)
    };
    frame.solve(scene, &settings);
    frame
}

/// Returns the irradiance at positions that importance particles reach, independent of the bake's
/// points.
fn sample_irradiance(scene: &BakedScene, test: &TestScene, tier: u32) -> Vec<Vec3> {
    let viewpoints: Vec<Vec3> = scene.info().viewpoints.iter().map(|&v| v.into()).collect();
    let frame = solve(scene, &test.lights, tier);
    trace_particles(&test.mesh, &viewpoints, 0..2048, 0x7469_6572, false)
        .candidates
        .iter()
        .map(|c| (c.surface.position, c.surface.normal))
        .map(|(x, n)| frame.irradiance(scene, x, n).unwrap_or_default())
        .collect()
}

/// Returns the mean difference to `whole`, and its root mean square. They are relative to the mean
/// and the root mean square of `whole`.
fn compare(part: &[Vec3], whole: &[Vec3]) -> (f64, f64) {
    let (mut bias, mut mean, mut square, mut power) = (0.0, 0.0, 0.0, 0.0);
    for (a, b) in part.iter().zip(whole) {
        bias += f64::from((*a - *b).element_sum());
        mean += f64::from(b.element_sum());
        square += f64::from((*a - *b).length_squared());
        power += f64::from(b.length_squared());
    }
    (bias / mean, (square / power).sqrt())
}

/// Checks that every tier is as bright as the whole within 0.5 %, and that a higher tier is closer
/// to it.
fn assert_tiers_match_whole(name: &str) {
    let test = test_scene(name);
    let scene = baked(&test, draft());
    assert_eq!(scene.data().operator.tiers(), TIERS);
    let whole = sample_irradiance(&scene, &test, TIERS);
    let mut last = f64::INFINITY;
    for (tier, info) in (1..TIERS).zip(&scene.info().tiers) {
        let (bias, rms) = compare(&sample_irradiance(&scene, &test, tier), &whole);
        let share = info.links as f64 / scene.data().operator.links.len() as f64;
        println!(
            "{name}, tier {tier}, {:.1} % of the links: bias {:+.3} %, difference {:.2} %",
            100.0 * share,
            100.0 * bias,
            100.0 * rms
        );
        assert!(bias.abs() <= 0.005, "{name}, tier {tier}: {bias}");
        assert!(rms < last && rms > 0.0, "{name}, tier {tier}: {rms}");
        // About an eighth, a quarter and half of the links.
        let expected = 0.5f64.powi((TIERS - tier) as i32);
        assert!((share / expected - 1.0).abs() < 0.1, "tier {tier}: {share}");
        last = rms;
    }
    // Must fail: rows are omitted without compensation.
    let mut orphans = scene.clone();
    orphans.data_mut().operator.rows.iter_mut().for_each(|row| {
        if row.tier > 1 {
            *row = Row {
                tier: 1,
                ..Row::default()
            };
        }
    });
    let (bias, _) = compare(&sample_irradiance(&orphans, &test, 1), &whole);
    assert!(bias < -0.05, "{name}: missing rows not detected: {bias}");
}

#[test]
fn tiers_of_cornell_box_are_within_error_bounds() {
    assert_tiers_match_whole("cornell");
}

#[test]
fn tiers_of_open_rooms_are_within_error_bounds() {
    assert_tiers_match_whole("rooms_open");
}

/// The links that a frame of a tier reads are a prefix of all links.
#[test]
fn tier_operator_is_prefix_of_links() {
    let test = test_scene("cornell");
    let recipe = Recipe {
        levels: Some(4),
        refinement_levels: Some(1),
        rays_per_point: Some(64),
        ..draft()
    };
    let scene = baked(&test, recipe.clone());
    for (tier, info) in (1..).zip(&scene.info().tiers) {
        let mut part = scene.clone();
        let operator = &mut part.data_mut().operator;
        operator.links.truncate(info.links as usize);
        let rows = &mut operator.rows;
        for (row, step) in rows.iter_mut().zip(&mut operator.steps) {
            if row.tier > tier {
                (*row, *step) = (Row::default(), 0);
            }
        }
        assert_eq!(
            rows.iter().filter(|row| row.tier > 0).count() as u64,
            info.rows
        );
        part.info_mut().tiers.truncate(tier as usize);
        part.validate().unwrap();
        let values = |scene: &BakedScene, t: u32| -> Vec<VectorIrradiance> {
            solve(scene, &test.lights, t).vector_irradiance().to_vec()
        };
        assert!(values(&part, FrameSettings::ALL_TIERS) == values(&scene, tier));
        if tier > 1 {
            assert!(values(&part, FrameSettings::ALL_TIERS) != values(&scene, tier - 1));
        }
    }
    // Tiers above the last are equal to the last, and tier 0 is equal to tier 1.
    let values = |t| solve(&scene, &test.lights, t).vector_irradiance().to_vec();
    assert!(values(99) == values(TIERS) && values(0) == values(1));
    // The tiers do not depend on the number of threads.
    let alone = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .unwrap();
    assert!(alone.install(|| baked(&test, recipe)).data().operator == scene.data().operator);
}

/// Operators of differences have a single tier.
#[test]
fn l08_bake_has_one_tier() {
    let recipe = Recipe {
        transport: TransportMethod::L08,
        levels: Some(3),
        rays_per_point: Some(64),
        ..draft()
    };
    let scene = baked(&test_scene("cornell"), recipe);
    assert_eq!(
        (scene.data().operator.tiers(), scene.info().tiers.len()),
        (1, 1)
    );
}
