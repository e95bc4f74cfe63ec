//! Closed rooms that reflect nearly all light, which amplify every error of a reflection a
//! hundredfold: the furnace, B = M / (1 − ρ).

use super::support::{baked, closed, irradiances, mean, mesh, small};
use glam::Vec3;
use meshless_gi::{
    BakedScene, BounceMode, Bounces, CpuFrame, Evaluator, FrameLight, FrameSettings, Light,
    Material, Recipe,
};
use std::f32::consts::{FRAC_1_PI, PI};

/// Bakes a room of 2 m with walls that emit 1 W/m² and reflect `albedo`.
fn furnace(albedo: f32, recipe: &Recipe) -> BakedScene {
    let glowing = Material::emissive(Vec3::splat(albedo), Vec3::splat(FRAC_1_PI));
    baked(&closed(glowing), recipe).scene
}

/// Returns Σ ρ^k over the first `count` terms: the light after `count` steps.
fn series(albedo: f32, count: u32) -> f32 {
    (0..count).map(|k| albedo.powi(k as i32)).sum()
}

/// Returns the largest deviation of any point's light from `right`, relative to it.
fn off(frame: &CpuFrame, scene: &BakedScene, right: f32) -> f32 {
    let values = irradiances(frame, scene);
    let off = values
        .iter()
        .map(|e| (*e / right - 1.0).abs().max_element());
    off.fold(0.0, f32::max)
}

#[test]
fn furnace_converges_to_geometric_series() {
    for albedo in [0.95, 0.99] {
        let scene = furnace(albedo, &small());
        let mut frame = CpuFrame::new(&scene);
        for sweeps in [0, 3, 15, 63, 255] {
            let settings = FrameSettings {
                sweeps,
                ..FrameSettings::default()
            };
            frame.solve(&scene, &settings);
            let off = off(&frame, &scene, series(albedo, sweeps + 1));
            assert!(off < 1e-4, "ρ {albedo}, {sweeps} sweeps: off by {off}");
        }
        // A frame's largest number of sweeps is not enough if walls reflect 99 %: 7.6 % are
        // missing.
        let whole = 1.0 / (1.0 - albedo);
        let missing = off(&frame, &scene, whole);
        assert!(
            (missing - albedo.powi(256)).abs() < 1e-3,
            "ρ {albedo}: {missing} missing"
        );
        let sweeps = frame.converge(&scene, &FrameSettings::default(), 1e-4);
        let off = off(&frame, &scene, whole);
        eprintln!("ρ {albedo}: {sweeps} accelerated sweeps, off by {off:.1e}");
        assert!(off < 1e-3 && sweeps < 20, "ρ {albedo}: {off}, {sweeps}");
    }
}

#[test]
fn converged_bounces_match_infinite_series() {
    let glowing = Material::emissive(Vec3::splat(0.99), Vec3::splat(FRAC_1_PI));
    let meshes = [closed(glowing)];
    let scene = baked(&meshes[0], &small()).scene;
    let evaluator = Evaluator::new(&scene, &meshes, &[], Bounces::All);
    for k in 0..20 {
        let x = Vec3::new(0.05 + 0.095 * k as f32, 0.0, 1.3);
        let found = evaluator.at(x, Vec3::Y, k);
        let indirect = found.indirect.expect("covered");
        assert!((found.direct - Vec3::ONE).abs().max_element() < 0.01);
        assert!(
            (indirect / 99.0 - 1.0).abs().max_element() < 0.01,
            "{indirect} at {x}"
        );
    }
}

/// A row keeps its mass under any truncation, and so does the series in the bake.
#[test]
fn truncation_and_baked_bounces_conserve_energy() {
    for (epsilon, bounce_mode) in [(0.5, BounceMode::Runtime), (0.03, BounceMode::Baked)] {
        let recipe = Recipe {
            truncation_error: Some(epsilon),
            bounces: Some(12),
            bounce_mode,
            ..small()
        };
        let scene = furnace(0.99, &recipe);
        assert_eq!(
            scene.data().bounces.is_some(),
            bounce_mode == BounceMode::Baked
        );
        let mut frame = CpuFrame::new(&scene);
        frame.solve(&scene, &FrameSettings::bounces(12));
        let off = off(&frame, &scene, series(0.99, 12));
        let links = scene.data().operator.links.len();
        eprintln!("ε {epsilon}, {bounce_mode:?}: {links} links, off by {off:.1e}");
        assert!(off < 1e-3, "{bounce_mode:?}: {off}");
    }
}

/// Returns a subdivided octahedron of radius 1 with faces toward the inside. Every face is a
/// triangle of `rounds` halvings.
fn sphere(rounds: u32) -> Vec<[Vec3; 3]> {
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    let mut out = Vec::new();
    for (a, b, c) in [(x, y, z), (y, -x, z), (-x, -y, z), (-y, x, z)] {
        out.push([b, a, c]);
        out.push([a, b, -c]);
    }
    for _ in 0..rounds {
        out = out
            .into_iter()
            .flat_map(|[a, b, c]: [Vec3; 3]| {
                let [d, e, f] = [a + b, b + c, c + a].map(Vec3::normalize);
                [[a, d, f], [d, b, e], [f, e, c], [d, e, f]]
            })
            .collect();
    }
    out
}

/// Inside a sphere reflected light is the same everywhere: E = ρ Φ / (A (1 − ρ)) for any position
/// of the light.
#[test]
fn light_in_sphere_gives_uniform_irradiance() {
    let triangles = sphere(4);
    let area: f32 = triangles
        .iter()
        .map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length())
        .sum();
    let level = mesh(triangles, Material::diffuse(Vec3::splat(0.99)));
    let bake = baked(&level, &small());
    let energy = bake.stats.energy;
    assert!(
        (energy.spectral_radius_bound - 0.99).abs() < 1e-5,
        "{energy:?}"
    );
    let scene = bake.scene;
    let right = 0.99 * 4.0 * PI / (area * 0.01);
    let mut frame = CpuFrame::new(&scene);
    frame.set_lights(
        &scene,
        &[FrameLight::point(
            Vec3::new(0.3, 0.2, -0.1),
            Vec3::ONE,
            f32::INFINITY,
        )],
    );
    frame.converge(&scene, &FrameSettings::default(), 1e-4);
    let (whole, uneven) = (
        mean(&irradiances(&frame, &scene), &scene).x / right,
        off(&frame, &scene, right),
    );
    eprintln!("sphere: {whole:.4} of the light, at most {uneven:.4} off anywhere");
    assert!(
        (whole - 1.0).abs() < 0.02 && uneven < 0.04,
        "{whole} {uneven}"
    );
}

/// Lossless reflection has no solution: the bake lowers the albedo of the walls to 99.9 % and
/// reports it.
#[test]
fn lossless_walls_get_lowered_albedo() {
    let white = Material::emissive(Vec3::ONE, Vec3::splat(FRAC_1_PI));
    for bounce_mode in [BounceMode::Runtime, BounceMode::Baked] {
        let recipe = Recipe {
            bounce_mode,
            bounces: Some(12),
            ..small()
        };
        let bake = baked(&closed(white.clone()), &recipe);
        let energy = bake.stats.energy;
        assert_eq!(energy.clamped_senders, bake.stats.senders);
        assert!(
            (energy.spectral_radius_bound - 0.999).abs() < 1e-5,
            "{energy:?}"
        );
        assert!((energy.albedo_scale - 0.999).abs() < 1e-5, "{energy:?}");
        let [warning] = &bake.stats.warnings[..] else {
            panic!("{:?}", bake.stats.warnings);
        };
        assert!(warning.contains("converges too slowly"), "{warning}");
        let scene = bake.scene;
        let mut frame = CpuFrame::new(&scene);
        frame.solve(&scene, &FrameSettings::bounces(12));
        assert!(off(&frame, &scene, series(0.999, 12)) < 1e-3);
        let endless = FrameSettings {
            baked_bounces: false,
            ..FrameSettings::bounces(u32::MAX)
        };
        frame.solve(&scene, &endless);
        assert!(off(&frame, &scene, series(0.999, 256)) < 1e-3);
        frame.converge(&scene, &FrameSettings::default(), 1e-4);
        assert!(off(&frame, &scene, 1000.0) < 1e-2);
    }
}

/// The same walls with one side open: light leaves, and the bake lowers no albedo. The opening is
/// not visible from the back, so the row sums there prove nothing. The iterated bound proves
/// convergence.
#[test]
fn open_room_with_lossless_walls_keeps_albedo() {
    let mut triangles = super::support::room(Vec3::ZERO, Vec3::splat(2.0));
    triangles.truncate(10);
    let bake = baked(&mesh(triangles, Material::diffuse(Vec3::ONE)), &small());
    let energy = bake.stats.energy;
    eprintln!("five white walls: {energy:?}");
    assert_eq!((energy.clamped_senders, energy.albedo_scale), (0, 1.0));
    assert!(
        energy.spectral_radius_bound < 0.95
            && energy.spectral_radius_estimate <= energy.spectral_radius_bound
    );
    assert!(bake.stats.warnings.is_empty());
    let scene = bake.scene;
    let mut frame = CpuFrame::new(&scene);
    let light_source = Light::Point {
        position: Vec3::ONE,
        intensity: Vec3::ONE,
        range: f32::INFINITY,
    };
    frame.set_lights(&scene, &FrameLight::expand(&light_source, 1));
    frame.solve(&scene, &FrameSettings::bounces(256));
    let swept = mean(&irradiances(&frame, &scene), &scene).x;
    frame.converge(&scene, &FrameSettings::default(), 1e-5);
    let converged = mean(&irradiances(&frame, &scene), &scene).x;
    assert!(
        (converged / swept - 1.0).abs() < 1e-3,
        "{converged} {swept}"
    );
}
