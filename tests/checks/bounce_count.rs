//! Number of reflections that a scene's surfaces need, compared with all of them: truncation error
//! and cost, on the two rooms with references.

use bevy_meshless_gi::GiBounceCount;
use bevy_meshless_gi::internals::plan::{
    BounceSelector, MAX_TRUNCATED_FRACTION, bounces_for_spectral_radius,
};
use glam::Vec3;
use meshless_gi::internals::scene::SceneDescription;
use meshless_gi::{
    BakedScene, CpuFrame, FrameLight, FrameSettings, Material, Preset, Progress, Quad, Recipe,
    TriangleMesh, bake_scene, load_gltf,
};
use std::path::Path;
use std::time::Instant;

fn draft() -> Recipe {
    Recipe {
        preset: Preset::Draft,
        ..Recipe::default()
    }
}

/// Returns the sum of the irradiance of all points, each at its own normal.
fn light(frame: &CpuFrame, scene: &BakedScene) -> f64 {
    (frame.vector_irradiance().iter().zip(&scene.data().points))
        .map(|(e, point)| f64::from(e.dot(point.n()).element_sum()))
        .sum()
}

#[test]
fn automatic_bounce_count_truncation_is_small() {
    for (name, fixed) in [("cornell", 0.05), ("rooms_open", 0.12)] {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/data/{name}"));
        let description = SceneDescription::read(folder.join("L0.json")).unwrap();
        let mesh = load_gltf(&description.geometry[0]).unwrap().mesh;
        let bake = bake_scene(&mesh, &draft(), 0, &Progress::default()).unwrap();
        let scene = bake.scene;
        let lights: Vec<FrameLight> = (description.lights.iter())
            .flat_map(|light| FrameLight::expand(light, 4))
            .collect();
        let mut frame = CpuFrame::new(&scene);
        frame.set_lights(&scene, &lights);
        frame.converge(&scene, &FrameSettings::default(), 1e-4);
        let all = light(&frame, &scene);
        let selection = BounceSelector::new()
            .select(GiBounceCount::Auto, &scene, &[])
            .unwrap();
        println!("{name}: {selection}");
        let missing: Vec<f64> = (1..=selection.bounces)
            .map(|bounces| {
                let mut frame = CpuFrame::new(&scene);
                frame.set_lights(&scene, &lights);
                let start = Instant::now();
                frame.solve(&scene, &FrameSettings::bounces(bounces));
                let took = start.elapsed().as_secs_f64();
                let missing = 1.0 - light(&frame, &scene) / all;
                println!(
                    "  {bounces} reflections: {:.1} % of the light missing, {:.1} ms",
                    100.0 * missing,
                    1e3 * took
                );
                missing
            })
            .collect();
        assert!(missing.is_sorted_by(|a, b| a > b), "{missing:?}");
        let left = *missing.last().unwrap();
        assert!(
            (0.0..=f64::from(MAX_TRUNCATED_FRACTION)).contains(&left),
            "{name}: {left}"
        );
        // A number that is large enough for one scene is too small for another.
        assert!(missing[3] > fixed, "{name}: {}", missing[3]);
    }
}

/// Tests that a box of albedo 0.1 needs at most two reflections. `GiBounceCount::Fixed` sets the
/// number, clamped to the limits of a frame.
#[test]
fn bounce_count_of_dark_scene_is_small_and_setting_overrides() {
    let wall = |origin: Vec3, [u, v]: [Vec3; 2]| Quad {
        corners: [origin, origin + u, origin + u + v, origin + v],
        material: Material::diffuse(Vec3::splat(0.1)),
    };
    let quads: Vec<Quad> = (0..3)
        .flat_map(|axis| {
            let (u, v) = (Vec3::AXES[(axis + 1) % 3], Vec3::AXES[(axis + 2) % 3]);
            [wall(Vec3::ZERO, [u, v]), wall(Vec3::AXES[axis], [v, u])]
        })
        .collect();
    let mesh = TriangleMesh::from_quads(&quads);
    let bake = bake_scene(&mesh, &draft(), 0, &Progress::default()).unwrap();
    let scene = bake.scene;
    let select = |requested| {
        BounceSelector::new()
            .select(requested, &scene, &[])
            .unwrap()
    };
    let dark = select(GiBounceCount::Auto);
    println!("{dark}");
    assert!(dark.bounces <= 2 && !dark.forced, "{dark}");
    assert_eq!(
        dark.bounces,
        bounces_for_spectral_radius(scene.info().energy.spectral_radius_bound)
    );
    for (requested, taken) in [(0, 1), (1, 1), (40, 40), (u32::MAX, 256)] {
        let selection = select(GiBounceCount::Fixed(requested));
        assert_eq!((selection.bounces, selection.forced), (taken, true));
    }
}
