//! A baked scene at single points, compared with the reference integrator.

use glam::Vec3;
use meshless_gi::internals::eval::irradiance_at_all;
use meshless_gi::{
    Bounces, Evaluator, Light, Preset, Progress, Quad, Recipe, ReferenceSettings, TriangleMesh,
    bake_scene,
};
use meshless_gi_lab::accuracy::errors;

#[test]
fn emission_counts_as_direct_light() {
    let mut quads = Quad::cornell_box();
    // The top of the tall block glows.
    quads[9].material.emissive = Vec3::new(5.0, 4.0, 3.0);
    let mesh = TriangleMesh::from_quads(&quads);
    let recipe = Recipe {
        preset: Preset::Draft,
        ..Recipe::default()
    };
    let scene = bake_scene(&mesh, &recipe, 0, &Progress::default())
        .unwrap()
        .scene;
    let lights = [Light::Sky {
        radiance: Vec3::new(0.1, 0.2, 0.4).into(),
    }];
    let positions: Vec<(Vec3, Vec3)> = (0..40)
        .map(|k| {
            let t = k as f32 / 40.0;
            let back = Vec3::new(1.8 * t - 0.9, (1.6 * 7.0 * t) % 1.6 + 0.1, -1.0);
            let floor = Vec3::new(1.8 * t - 0.9, 0.0, 0.85);
            if k % 2 == 0 {
                (back, Vec3::Z)
            } else {
                (floor, Vec3::Y)
            }
        })
        .collect();
    let settings = ReferenceSettings {
        paths: 8192,
        bounces: Some(3),
        seed: 5,
    };
    let reference = irradiance_at_all(&mesh, &lights, &positions, &settings);
    // The block's top is small and paths hit it by chance. Many paths are needed.
    let unreflected = ReferenceSettings {
        paths: 1 << 16,
        bounces: Some(0),
        ..settings
    };
    let straight = irradiance_at_all(&mesh, &lights, &positions, &unreflected);
    let meshes = [mesh];
    let ours = Evaluator::new(&scene, &meshes, &lights, Bounces::Count(3));
    let (mut direct, mut indirect) = (Vec::new(), Vec::new());
    for (k, (x, n)) in positions.iter().enumerate() {
        let found = ours.at(*x, *n, k as u64);
        direct.push(found.direct);
        indirect.push(found.indirect.expect("covered"));
    }
    let pick = |of: fn(&meshless_gi::Irradiance) -> Vec3, from: &[_]| -> Vec<Vec3> {
        from.iter().map(of).collect()
    };
    let compare = |values: &[Vec3]| {
        let (right, noise) = (
            pick(|i| i.indirect, &reference),
            pick(|i| i.indirect_error, &reference),
        );
        errors(values, &right, &noise)
    };
    let none = vec![Vec3::ZERO; positions.len()];
    let straight = errors(&direct, &pick(|i| i.direct, &straight), &none);
    assert!(straight.nrmse < 0.01, "{straight:?}");
    let reflected = compare(&indirect);
    assert!(
        reflected.nrmse < 0.15 && reflected.bias.abs() < 0.05,
        "{reflected:?}"
    );
    // The wrong assignment would be far off.
    let together: Vec<Vec3> = direct.iter().zip(&indirect).map(|(d, i)| *d + *i).collect();
    assert!(compare(&together).nrmse > 0.5, "{:?}", compare(&together));
}

#[test]
fn light_types_match_reference_near_and_far() {
    let mesh = TriangleMesh::from_quads(&Quad::cornell_box());
    let recipe = Recipe {
        preset: Preset::Draft,
        levels: Some(2),
        sender_levels: Some(1),
        coarse_radius: Some(0.4),
        refinement_levels: Some(0),
        rays_per_point: Some(16),
        ..Recipe::default()
    };
    let scene = bake_scene(&mesh, &recipe, 0, &Progress::default())
        .unwrap()
        .scene;
    // A long panel that hangs half a meter before the back wall and shines down and at the wall.
    let lights = [Light::Rect {
        center: Vec3::new(0.0, 1.7, -0.5),
        u: Vec3::new(0.5, 0.0, 0.0),
        v: Vec3::new(0.0, -0.1, 0.1),
        radiance: Vec3::new(3.0, 2.0, 1.0),
    }];
    let positions: Vec<(Vec3, Vec3)> = (0..64)
        .map(|k| {
            let (a, b) = ((k % 8) as f32 / 4.0 - 0.875, (k / 8) as f32 / 4.0 - 0.875);
            match k % 2 {
                0 => (Vec3::new(a, 1.0 + b, -1.0), Vec3::Z),
                _ => (Vec3::new(a, 2.0, b), Vec3::NEG_Y),
            }
        })
        .collect();
    let settings = ReferenceSettings {
        paths: 1 << 15,
        bounces: Some(0),
        seed: 5,
    };
    let right: Vec<Vec3> = irradiance_at_all(&mesh, &lights, &positions, &settings)
        .iter()
        .map(|e| e.direct)
        .collect();
    let meshes = [mesh];
    let ours = Evaluator::new(&scene, &meshes, &lights, Bounces::Count(1));
    let mut found: Vec<Vec3> = (0..)
        .zip(&positions)
        .map(|(k, (x, n))| ours.at(*x, *n, k).direct)
        .collect();
    let none = vec![Vec3::ZERO; positions.len()];
    let e = errors(&found, &right, &none);
    assert!(e.nrmse < 0.005 && e.p99 < 0.02, "{e:?}");
    found.iter_mut().for_each(|e| *e *= 1.01);
    assert!(errors(&found, &right, &none).nrmse > 0.005);
}

#[test]
fn automatic_bounces_converge() {
    let mesh = TriangleMesh::from_quads(&Quad::cornell_box());
    let recipe = Recipe {
        preset: Preset::Draft,
        levels: Some(4),
        rays_per_point: Some(64),
        ..Recipe::default()
    };
    let scene = bake_scene(&mesh, &recipe, 0, &Progress::default())
        .unwrap()
        .scene;
    let light = [Light::Point {
        position: Vec3::new(0.0, 1.8, 0.2),
        intensity: Vec3::ONE,
        range: f32::INFINITY,
    }];
    let at = |bounces| {
        Evaluator::new(&scene, &[], &light, bounces)
            .at(Vec3::new(0.0, 0.0, 0.8), Vec3::Y, 0)
            .indirect
            .expect("covered")
            .y
    };
    let [one, four, many, all] = [
        Bounces::Count(1),
        Bounces::Count(4),
        Bounces::Count(200),
        Bounces::All,
    ]
    .map(at);
    assert!(one < 0.9 * four && four < 0.999 * all, "{one} {four} {all}");
    assert!((many / all - 1.0).abs() < 1e-3, "{many} {all}");
}
