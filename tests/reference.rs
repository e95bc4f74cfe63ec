//! The reference integrator against closed forms, and against path-traced ground truth that another program computed
//! (`tests/data`). Every comparison is also made with a wrong input and must fail there.
#![cfg(feature = "cli")]

use bevy_meshless_gi::accuracy::{
    BOUNCES, Irradiance, ReferenceSettings, Truth, irradiance_at_all,
};
use bevy_meshless_gi::samples::Random;
use bevy_meshless_gi::scene::{
    Geometry, ImplicitObject, ImplicitScene, Light, Material, SceneDescription, Shape,
    TriangleMesh, load_gltf,
};
use glam::Vec3;
use std::f32::consts::PI;
use std::path::{Path, PathBuf};

fn settings(paths: u32, bounces: Option<u32>) -> ReferenceSettings {
    ReferenceSettings {
        paths,
        bounces,
        seed: 1,
    }
}

/// Two triangles that face `u` × `v`.
fn parallelogram(corner: Vec3, u: Vec3, v: Vec3) -> [[Vec3; 3]; 2] {
    [
        [corner, corner + u, corner + u + v],
        [corner, corner + u + v, corner + v],
    ]
}

#[test]
fn lamps_over_a_plane_follow_their_laws() {
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

/// Inside a sphere that emits M and reflects ρ everywhere, E = M (1 + ρ + ρ² + …) at every point of the wall.
#[test]
fn a_furnace_sums_the_geometric_series() {
    let (radiance, albedo) = (Vec3::new(1.0, 0.5, 0.25), Vec3::new(0.5, 0.8, 0.2));
    let furnace = ImplicitScene::new(vec![ImplicitObject {
        shape: Shape::Cavity {
            center: Vec3::new(1.0, 0.0, 0.0),
            radius: 2.0,
        },
        albedo,
        radiance,
    }]);
    let points = [
        (Vec3::new(3.0, 0.0, 0.0), Vec3::NEG_X),
        (Vec3::new(1.0, -2.0, 0.0), Vec3::Y),
    ];
    let emitted = PI * radiance;
    let indirect =
        |bounces, samples| irradiance_at_all(&furnace, &[], &points, &settings(samples, bounces));
    for k in [0u32, 1, 2, 4] {
        let series: Vec3 = (1..=k).map(|i| albedo.powf(i as f32)).sum();
        for e in indirect(Some(k), 16) {
            assert!((e.direct - emitted).length() < 1e-4 * emitted.length());
            assert!(
                (e.indirect - emitted * series).length() < 1e-4,
                "{k}: {e:?}"
            );
        }
    }
    let right = emitted * albedo / (Vec3::ONE - albedo);
    for e in indirect(None, 40_000) {
        let off = (e.indirect - right).abs();
        assert!(
            off.cmple(4.5 * e.indirect_error + 1e-4 * right).all(),
            "{e:?}, {right} is right"
        );
        assert!(
            e.indirect_error.cmplt(0.02 * right).all(),
            "precise enough to mean something: {e:?}"
        );
    }
    let again = indirect(None, 1000);
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .unwrap();
    assert_eq!(
        pool.install(|| indirect(None, 1000)),
        again,
        "for any number of threads"
    );
}

/// Sky light on an open plane is π L; half of it under a wall that is very large.
#[test]
fn sky_is_what_rays_find_where_there_is_nothing() {
    let floor = parallelogram(Vec3::new(-1e4, 0.0, 1e4), 2e4 * Vec3::X, -2e4 * Vec3::Z);
    let wall = parallelogram(Vec3::new(-1e4, 0.0, 0.0), 2e4 * Vec3::X, 1e4 * Vec3::Y);
    let mesh =
        |t: Vec<[Vec3; 3]>| TriangleMesh::new(t, vec![0; 4], vec![Material::diffuse(Vec3::ZERO)]);
    let sky = [Light::Sky {
        radiance: Vec3::new(1.0, 2.0, 3.0),
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

/// Mean irradiance over a unit square from another one of radiosity 1: the form factor. Returns it with its standard error.
fn form_factor(
    geometry: &dyn Geometry,
    lights: &[Light],
    corner: Vec3,
    u: Vec3,
    v: Vec3,
) -> (f64, f64) {
    let mut r = Random::new(9, 9, 9);
    let n = u.cross(v).normalize();
    let points: Vec<_> = (0..20_000)
        .map(|_| (corner + u * r.unit() + v * r.unit(), n))
        .collect();
    let all = irradiance_at_all(geometry, lights, &points, &settings(16, Some(0)));
    let count = all.len() as f64;
    let mean = all.iter().map(|e| f64::from(e.direct.x)).sum::<f64>() / count;
    let square = all
        .iter()
        .map(|e| (f64::from(e.direct.x) - mean).powi(2))
        .sum::<f64>();
    (mean, (square / count / (count - 1.0)).sqrt())
}

#[test]
fn form_factors_of_unit_squares() {
    // Howell's catalogue, C-11 and C-14, for unit squares: opposite at distance 1, and at right angles with a common edge.
    let cases = [
        (
            "parallel",
            Vec3::new(0.0, 1.0, 0.0),
            Vec3::X,
            Vec3::Z,
            0.199_825,
        ),
        ("perpendicular", Vec3::ZERO, Vec3::X, Vec3::Y, 0.200_044),
    ];
    let black = Material::diffuse(Vec3::ZERO);
    for (name, corner, u, v, right) in cases {
        // Both emitters face the receiver, which lies at y = 0, 0 ≤ x, z ≤ 1.
        let receiver = (Vec3::new(0.0, 0.0, 1.0), Vec3::X, -Vec3::Z);
        let emitter = Material::emissive(Vec3::ZERO, Vec3::splat(1.0 / PI));
        let mesh = TriangleMesh::new(
            parallelogram(corner, u, v).to_vec(),
            vec![0; 2],
            vec![emitter],
        );
        let nothing = TriangleMesh::new(Vec::new(), Vec::new(), vec![black.clone()]);
        let rectangle = [Light::Rect {
            center: corner + 0.5 * (u + v),
            u: 0.5 * u,
            v: 0.5 * v,
            radiance: Vec3::splat(1.0 / PI),
        }];
        for (how, (mean, error)) in [
            (
                "emitting mesh",
                form_factor(&mesh, &[], receiver.0, receiver.1, receiver.2),
            ),
            (
                "rectangle",
                form_factor(&nothing, &rectangle, receiver.0, receiver.1, receiver.2),
            ),
        ] {
            let off = (mean - right).abs();
            assert!(
                off < 4.0 * error,
                "{name}, {how}: {mean} ± {error}, {right} is right"
            );
            // Where the squares touch, 1/d² has no bounded variance for points on a rectangle; rays have no such trouble.
            let limit = if (name, how) == ("perpendicular", "rectangle") {
                0.02
            } else {
                0.01
            };
            assert!(
                error < limit * right,
                "{name}, {how}: ± {error} lets too much pass"
            );
        }
    }
}

/// Every twentieth row of a table of ground truth.
fn some(truth: &Truth) -> Truth {
    fn thin<T: Copy>(all: &[T]) -> Vec<T> {
        all.iter().copied().step_by(20).collect()
    }
    Truth {
        places: thin(&truth.places),
        direct: thin(&truth.direct),
        indirect: truth.indirect.each_ref().map(|(v, e)| (thin(v), thin(e))),
    }
}

/// Our estimates against the truth: mean square of the standardised differences, and the largest of them.
fn disagreement(ours: &[Irradiance], (values, errors): &(Vec<Vec3>, Vec<Vec3>)) -> (f64, f64) {
    let (mut sum, mut largest, mut count) = (0.0, 0.0f64, 0.0);
    for ((e, value), error) in ours.iter().zip(values).zip(errors) {
        for c in 0..3 {
            let variance = f64::from(e.indirect_error[c]).powi(2) + f64::from(error[c]).powi(2);
            if variance > 0.0 {
                let z = f64::from(e.indirect[c] - value[c]) / variance.sqrt();
                sum += z * z;
                largest = largest.max(z.abs());
                count += 1.0;
            }
        }
    }
    (sum / count, largest)
}

#[test]
fn ground_truth_of_another_program_agrees() {
    for name in ["cornell", "rooms_open"] {
        let folder: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("tests/data")
            .join(name);
        let scene = SceneDescription::read(folder.join("L0.json")).unwrap();
        let level = load_gltf(&scene.geometry[0]).unwrap();
        let truth = some(&Truth::read(folder.join("L0.csv")).unwrap());
        let run = |lights: &[Light], bounces| {
            irradiance_at_all(&level.mesh, lights, &truth.places, &settings(1500, bounces))
        };
        for (k, bounces) in BOUNCES.into_iter().enumerate() {
            let ours = run(&scene.lights, bounces);
            let (mean, largest) = disagreement(&ours, &truth.indirect[k]);
            println!("{name}, {bounces:?}: mean z² {mean:.2}, largest |z| {largest:.1}");
            assert!(
                mean < 1.5 && largest < 6.0,
                "{name}, {bounces:?}: mean z² {mean}, largest |z| {largest}"
            );
            if k == 0 {
                let (mut off, mut all) = (0.0, 0.0);
                for (e, right) in ours.iter().zip(&truth.direct) {
                    off += (e.direct - right).length_squared();
                    all += right.length_squared();
                }
                assert!(
                    (off / all).sqrt() < 1e-3,
                    "{name}: direct light is off by {}",
                    (off / all).sqrt()
                );
            }
        }
        // The same test finds a lamp that is a tenth too strong.
        let brighter: Vec<Light> = scene
            .lights
            .iter()
            .map(|light| match *light {
                Light::Point {
                    position,
                    intensity,
                    range,
                } => Light::Point {
                    position,
                    intensity: 1.1 * intensity,
                    range,
                },
                Light::Spot {
                    position,
                    direction,
                    intensity,
                    inner,
                    outer,
                    range,
                } => Light::Spot {
                    position,
                    direction,
                    intensity: 1.1 * intensity,
                    inner,
                    outer,
                    range,
                },
                other => other,
            })
            .collect();
        let (mean, _) = disagreement(&run(&brighter, Some(4)), &truth.indirect[2]);
        assert!(
            mean > 2.0,
            "{name}: a lamp that is too bright goes unnoticed: mean z² {mean}"
        );
    }
}
