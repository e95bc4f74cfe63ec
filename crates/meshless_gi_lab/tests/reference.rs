//! The reference integrator against the laws of lights and sky (more closed forms:
//! `tests/lab/closed_forms.rs`), and against path-traced ground truth that another program computed
//! (`tests/data`). Every comparison is also made with a wrong input and must fail there.

use glam::Vec3;
use meshless_gi::internals::eval::irradiance_at_all;
use meshless_gi::internals::scene::{ImplicitObject, ImplicitScene, SceneDescription, Shape};
use meshless_gi::{Irradiance, Light, Material, ReferenceSettings, TriangleMesh, load_gltf};
use meshless_gi_lab::accuracy::{
    BOUNCES, Estimates, GroundTruth, TestStatistics, errors, test_equality,
};
use meshless_gi_lab::fixtures::data::{published, unpublished};
use std::f32::consts::PI;
use std::path::Path;

fn settings(paths: u32, bounces: Option<u32>) -> ReferenceSettings {
    ReferenceSettings {
        paths,
        bounces,
        seed: 1,
    }
}

/// Returns two triangles that face `u` × `v`.
fn parallelogram(corner: Vec3, u: Vec3, v: Vec3) -> [[Vec3; 3]; 2] {
    [
        [corner, corner + u, corner + u + v],
        [corner, corner + u + v, corner + v],
    ]
}

#[test]
fn lights_over_plane_match_closed_forms() {
    let floor = parallelogram(Vec3::new(-10.0, 0.0, 10.0), 20.0 * Vec3::X, -20.0 * Vec3::Z);
    // A small roof that shades points left of x = -2.
    let roof = parallelogram(Vec3::new(-10.0, 1.0, 5.0), 8.5 * Vec3::X, -10.0 * Vec3::Z);
    let mesh = TriangleMesh::new(
        [floor, roof].concat(),
        vec![0; 4],
        vec![Material::diffuse(Vec3::ZERO)],
    );
    let intensity = Vec3::new(1.0, 2.0, 3.0);
    let position = Vec3::new(0.0, 4.0, 0.0);
    let point = |range| Light::Point {
        position,
        intensity,
        range,
    };
    let at = |light: Light, x: f32| {
        irradiance_at_all(
            &mesh,
            &[light],
            &[(Vec3::new(x, 0.0, 0.0), Vec3::Y)],
            &settings(2, Some(0)),
        )[0]
    };
    // Light is received where rays start: a lift of 0.2 mm above this floor of 20 m.
    let close = |e: Irradiance, right: Vec3| {
        (e.direct - right).length() <= 1e-3 * right.length()
            && e.direct_error.max_element() <= 1e-5 * right.max_element()
    };
    // E = I cos θ / d², cos θ = h / d.
    assert!(close(at(point(f32::INFINITY), 0.0), intensity / 16.0));
    assert!(close(
        at(point(f32::INFINITY), 3.0),
        intensity * 4.0 / 125.0
    ));
    assert!(!close(
        at(point(f32::INFINITY), 3.0),
        intensity * 4.01 / 125.0
    ));
    assert_eq!(at(point(f32::INFINITY), -4.0).direct, Vec3::ZERO);
    // The window at half the range: (1 - 1/16)².
    assert!(close(
        at(point(10.0), 3.0),
        intensity * 4.0 / 125.0 * (15.0f32 / 16.0).powi(2)
    ));
    assert_eq!(at(point(4.5), 3.0).direct, Vec3::ZERO);
    let spot = Light::Spot {
        position,
        direction: Vec3::NEG_Y,
        intensity,
        inner: 0.6f32.acos(),
        outer: 0.4f32.acos(),
        range: f32::INFINITY,
    };
    // cos θ = 4 / √(16 + 48) = 1/2: half way, squared.
    assert!(close(
        at(spot, 48.0f32.sqrt()),
        intensity * 0.5 / 64.0 * 0.25
    ));
    assert!(close(at(spot, 3.0), intensity * 4.0 / 125.0));
    assert_eq!(at(spot, 30.0).direct, Vec3::ZERO);
    let sun = Light::Directional {
        direction: Vec3::new(0.6, -0.8, 0.0),
        irradiance: intensity,
    };
    assert!(close(at(sun, 5.0), intensity * 0.8));
    assert_eq!(at(sun, -1.0).direct, Vec3::ZERO, "in the roof's shadow");
}

#[test]
fn reference_any_thread_count_has_equal_result() {
    let furnace = ImplicitScene::new(vec![ImplicitObject {
        shape: Shape::Cavity {
            center: Vec3::new(1.0, 0.0, 0.0),
            radius: 2.0,
        },
        albedo: Vec3::new(0.5, 0.8, 0.2),
        radiance: Vec3::new(1.0, 0.5, 0.25),
    }]);
    let positions = [
        (Vec3::new(3.0, 0.0, 0.0), Vec3::NEG_X),
        (Vec3::new(1.0, -2.0, 0.0), Vec3::Y),
    ];
    let run = || irradiance_at_all(&furnace, &[], &positions, &settings(1000, None));
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .unwrap();
    assert_eq!(pool.install(run), run());
}

/// Sky light on an open plane is π L. It is half of that under a very large wall.
#[test]
fn sky_over_open_plane_matches_closed_form() {
    let floor = parallelogram(Vec3::new(-1e4, 0.0, 1e4), 2e4 * Vec3::X, -2e4 * Vec3::Z);
    let wall = parallelogram(Vec3::new(-1e4, 0.0, 0.0), 2e4 * Vec3::X, 1e4 * Vec3::Y);
    let mesh =
        |t: Vec<[Vec3; 3]>| TriangleMesh::new(t, vec![0; 4], vec![Material::diffuse(Vec3::ZERO)]);
    let sky = [Light::Sky {
        radiance: Vec3::new(1.0, 2.0, 3.0).into(),
    }];
    let points = [(Vec3::new(0.0, 0.0, 1.0), Vec3::Y)];
    let open = irradiance_at_all(
        &mesh(floor.to_vec()),
        &sky,
        &points,
        &settings(100, Some(0)),
    )[0];
    assert!((open.direct - PI * Vec3::new(1.0, 2.0, 3.0)).length() < 1e-4);
    let half = irradiance_at_all(
        &mesh([floor, wall].concat()),
        &sky,
        &points,
        &settings(40_000, Some(0)),
    )[0];
    let right = 0.5 * PI * Vec3::new(1.0, 2.0, 3.0);
    assert!(
        (half.direct - right)
            .abs()
            .cmple(4.5 * half.direct_error)
            .all(),
        "{half:?}"
    );
    assert!(half.direct_error.cmplt(0.01 * right).all());
}

/// Returns every twentieth row of a table of ground truth.
fn some(truth: &GroundTruth) -> GroundTruth {
    fn thin<T: Copy>(all: &[T]) -> Vec<T> {
        all.iter().copied().step_by(20).collect()
    }
    GroundTruth {
        positions: thin(&truth.positions),
        direct: thin(&truth.direct),
        indirect: truth.indirect.each_ref().map(|(v, e)| (thin(v), thin(e))),
    }
}

/// Compares estimates of indirect light with the table's, each with its noise. Additional known
/// errors are single precision and the eight bits of the textures.
fn compare(ours: &[Irradiance], (values, errors): &(Vec<Vec3>, Vec<Vec3>)) -> TestStatistics {
    let (found, noise): (Vec<Vec3>, Vec<Vec3>) =
        ours.iter().map(|e| (e.indirect, e.indirect_error)).unzip();
    let ours = Estimates {
        values: &found,
        errors: &noise,
    };
    test_equality(ours, Estimates { values, errors }, 1e-3)
}

/// Returns the lights, one part in ten brighter.
fn brighter(lights: &[Light]) -> Vec<Light> {
    let mut lights = lights.to_vec();
    for light in &mut lights {
        match light {
            Light::Point { intensity, .. } | Light::Spot { intensity, .. } => *intensity *= 1.1,
            Light::Directional { irradiance, .. } => *irradiance *= 1.1,
            Light::Rect { radiance, .. } => *radiance *= 1.1,
            Light::Sky { radiance } => *radiance = *radiance * 1.1,
            other => panic!("{other:?}"),
        }
    }
    lights
}

/// Tests the integrator against every table in a folder.
fn agrees(folder: &Path) {
    for light in (0..).map(|i| folder.join(format!("L{i}.json"))) {
        if !light.exists() {
            break;
        }
        let name = light.display();
        let scene = SceneDescription::read(&light).unwrap();
        let level = load_gltf(&scene.geometry[0]).unwrap();
        let truth = some(&GroundTruth::read(light.with_extension("csv")).unwrap());
        let run = |lights: &[Light], bounces| {
            irradiance_at_all(
                &level.mesh,
                lights,
                &truth.positions,
                &settings(2000, bounces),
            )
        };
        for (k, bounces) in BOUNCES.into_iter().enumerate() {
            let ours = run(&scene.lights, bounces);
            let found = compare(&ours, &truth.indirect[k]);
            println!(
                "{name}, {bounces:?}: p {:.4}, mean z {:.2?}, mean z² {:.2?}, largest {:.1}",
                found.p, found.mean_z, found.mean_square_z, found.largest
            );
            assert!(found.p >= 1e-3, "{name}, {bounces:?}: {found:?}");
            if k == 0 {
                let direct: Vec<Vec3> = ours.iter().map(|e| e.direct).collect();
                let none = vec![Vec3::ZERO; direct.len()];
                let off = errors(&direct, &truth.direct, &none).nrmse;
                assert!(off < 1e-3, "{name}: direct light is off by {off}");
            }
        }
        // The same test detects lights that are a tenth too bright.
        let wrong = compare(&run(&brighter(&scene.lights), Some(4)), &truth.indirect[2]);
        assert!(wrong.p < 1e-6, "{name}: too bright lights: {wrong:?}");
    }
}

#[test]
fn reference_matches_external_ground_truth() {
    for name in ["cornell", "rooms_open"] {
        agrees(&published(name));
    }
}

/// Ground truth that may not be published: every folder of [`unpublished`].
#[test]
#[ignore = "needs unpublished scenes: ../shared/reference or MESHLESS_GI_REFERENCE"]
fn reference_matches_unpublished_ground_truth() {
    for entry in std::fs::read_dir(unpublished()).unwrap().flatten() {
        agrees(&entry.path());
    }
}
