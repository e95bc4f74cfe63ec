//! Light in free space: a ball that moves through a level, beside the reference integrator; sealed rooms; closed forms; the file.
#![cfg(feature = "cli")]

use bevy_meshless_gi::accuracy::{
    BOUNCES, Bounces, Errors, Evaluator, ReferenceSettings, errors, irradiance_at_all,
};
use bevy_meshless_gi::asset::{BakedScene, Limits, Probes};
use bevy_meshless_gi::bake::{
    FreeSpaceLight, Preset, Progress, Recipe, RecipeError, Rule, bake_level,
};
use bevy_meshless_gi::frame::{CpuFrame, FrameLight, FrameSettings};
use bevy_meshless_gi::samples::{Random, lattice, uniform_sphere};
use bevy_meshless_gi::scene::{
    Geometry, Light, Material, Quad, SceneDescription, TriangleMesh, cornell_box, load_gltf,
    mesh_of_quads,
};
use glam::{Vec2, Vec3};
use std::path::Path;

fn baked(mesh: &TriangleMesh, recipe: Recipe) -> BakedScene {
    bake_level(mesh, &recipe, 0, &Progress::default())
        .unwrap()
        .scene
}

fn draft() -> Recipe {
    Recipe {
        preset: Preset::Draft,
        probes: Some(FreeSpaceLight::default()),
        ..Recipe::default()
    }
}

/// Places on balls of `radius` around `centers`, with their outward normals.
fn balls(centers: &[Vec3], radius: f32, each: u32) -> Vec<(Vec3, Vec3)> {
    centers
        .iter()
        .enumerate()
        .flat_map(|(i, &c)| {
            (0..each).map(move |k| {
                let shift = Vec2::new(i as f32 * 0.618, i as f32 * 0.755).fract();
                let n = uniform_sphere(lattice(k, each, shift)).normalize();
                (c + radius * n, n)
            })
        })
        .collect()
}

/// Indirect light of `lights` at `places`: ours, beside the reference's after four reflections.
fn compare(
    scene: &BakedScene,
    mesh: &TriangleMesh,
    lights: &[Light],
    places: &[(Vec3, Vec3)],
) -> (Errors, usize) {
    let meshes = std::slice::from_ref(mesh);
    let ours = Evaluator::new(scene, meshes, lights, Bounces::Count(4));
    let settings = ReferenceSettings {
        paths: 8192,
        bounces: BOUNCES[2],
        seed: 17,
    };
    assert_eq!(settings.bounces, Some(4));
    let right = irradiance_at_all(mesh, lights, places, &settings);
    let found: Vec<Option<Vec3>> = places.iter().map(|&(x, n)| ours.in_space(x, n)).collect();
    let missing = found.iter().filter(|e| e.is_none()).count();
    let values: Vec<Vec3> = found.iter().map(|e| e.unwrap_or(Vec3::ZERO)).collect();
    let (right, noise): (Vec<Vec3>, Vec<Vec3>) =
        right.iter().map(|e| (e.indirect, e.indirect_error)).unzip();
    (errors(&values, &right, &noise), missing)
}

#[test]
fn a_ball_through_two_rooms_is_lit_as_the_reference_has_it() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/rooms_open");
    let description = SceneDescription::read(folder.join("L0.json")).unwrap();
    let mesh = load_gltf(&description.geometry[0]).unwrap().mesh;
    let scene = baked(&mesh, draft());
    // From the far corner of one room through the door, up and down, to the other's.
    let centers: Vec<Vec3> = (0..100)
        .map(|k| {
            let t = k as f32 / 99.0;
            let door = (-((t - 0.5) * 9.0).powi(2)).exp();
            let z = 0.5 + 3.0 * (0.5 + 0.5 * (t * 21.0).sin());
            let y = 0.4 + 1.8 * (0.5 + 0.5 * (t * 33.0).sin());
            Vec3::new(0.4 + 7.2 * t, y + door * (1.0 - y), z + door * (1.95 - z))
        })
        .collect();
    let places = balls(&centers, 0.15, 8);
    let (found, missing) = compare(&scene, &mesh, &description.lights, &places);
    let probes = scene.probes.as_ref().unwrap();
    println!(
        "{} probes, {} links, {} kB: {found:?}",
        probes.points.len(),
        probes.links.len(),
        probes.bytes() / 1024
    );
    assert_eq!(missing, 0);
    assert!(found.nrmse <= 0.10, "{found:?}");
    // Must fail: light from another place.
    let moved: Vec<Light> = description
        .lights
        .iter()
        .map(|light| match *light {
            Light::Point {
                position,
                intensity,
                range,
            } => Light::Point {
                position: position + Vec3::X,
                intensity,
                range,
            },
            ref other => other.clone(),
        })
        .collect();
    let meshes = std::slice::from_ref(&mesh);
    let wrong = Evaluator::new(&scene, meshes, &moved, Bounces::Count(4));
    let right = Evaluator::new(&scene, meshes, &description.lights, Bounces::Count(4));
    let value = |e: &Evaluator<'_>| -> Vec<Vec3> {
        let at = |&(x, n): &(Vec3, Vec3)| e.in_space(x, n).unwrap();
        places.iter().map(at).collect()
    };
    let none = vec![Vec3::ZERO; places.len()];
    assert!(errors(&value(&wrong), &value(&right), &none).nrmse > 0.15);
}
