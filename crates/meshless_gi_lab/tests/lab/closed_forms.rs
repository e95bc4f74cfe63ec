//! The reference integrator against light that is known in closed form: every kind of light source,
//! any number of reflections, reflectances up to 0.99. All comparisons are z-tests that use the
//! noise, and each is made a second time with a wrong input, where it must fail.

use glam::{DVec3, Vec3};
use meshless_gi::internals::eval::irradiance_at_all;
use meshless_gi::internals::samples::Random;
use meshless_gi::internals::scene::{ImplicitObject, ImplicitScene, Shape};
use meshless_gi::{Geometry, Irradiance, Light, Material, Quad, ReferenceSettings, TriangleMesh};
use meshless_gi_lab::accuracy::{Estimates, TestStatistics, closed_form, test_equality};
use std::f32::consts::PI;

/// Least probability that passes. There are some forty comparisons here, all with fixed random
/// numbers.
const MIN_PROBABILITY: f64 = 1e-3;
/// Tolerance for rays that start slightly above the surface.
const OFFSET_TOLERANCE: f64 = 1e-3;

fn settings(paths: u32, bounces: Option<u32>) -> ReferenceSettings {
    ReferenceSettings {
        paths,
        bounces,
        seed: 11,
    }
}

/// Tests estimates against exact values. Values times `wrong` must fail the test.
fn check(what: &str, found: &[(Vec3, Vec3)], right: &[Vec3], wrong: f32) {
    let (values, errors): (Vec<Vec3>, Vec<Vec3>) = found.iter().copied().unzip();
    let none = vec![Vec3::ZERO; right.len()];
    let against = |right: &[Vec3]| -> TestStatistics {
        let ours = Estimates {
            values: &values,
            errors: &errors,
        };
        let theirs = Estimates {
            values: right,
            errors: &none,
        };
        test_equality(ours, theirs, OFFSET_TOLERANCE)
    };
    let found = against(right);
    println!(
        "{what}: p {:.3}, mean z {:.2?}, mean z² {:.2?}, largest {:.1}",
        found.p, found.mean_z, found.mean_square_z, found.largest
    );
    assert!(
        found.p >= MIN_PROBABILITY,
        "{what}: {found:?}, {values:?}, {right:?}"
    );
    let off: Vec<Vec3> = right.iter().map(|r| wrong * *r).collect();
    let off = against(&off);
    assert!(off.p < MIN_PROBABILITY, "{what}, {wrong} of it: {off:?}");
}

fn direct(all: &[Irradiance]) -> Vec<(Vec3, Vec3)> {
    all.iter().map(|e| (e.direct, e.direct_error)).collect()
}

fn indirect(all: &[Irradiance]) -> Vec<(Vec3, Vec3)> {
    all.iter().map(|e| (e.indirect, e.indirect_error)).collect()
}

/// Computes a closed form for each channel.
fn channels(f: impl Fn(usize) -> f64) -> Vec3 {
    Vec3::from_array([0, 1, 2].map(|c| f(c) as f32))
}

/// Returns the inner surface of a sphere of 2 m around the origin.
fn cavity(albedo: Vec3, radiance: Vec3) -> ImplicitScene {
    ImplicitScene::new(vec![ImplicitObject {
        shape: Shape::Cavity {
            center: Vec3::ZERO,
            radius: 2.0,
        },
        albedo,
        radiance,
    }])
}

/// Returns positions on the inside of a sphere of 2 m around the origin.
fn on_the_cavity(count: u64) -> Vec<(Vec3, Vec3)> {
    (0..count)
        .map(|k| {
            let mut r = Random::new(4, 4, k);
            let z = 2.0 * r.unit() - 1.0;
            let (sin, cos) = (2.0 * PI * r.unit()).sin_cos();
            let n = Vec3::new(cos, sin, 0.0) * (1.0 - z * z).sqrt() + Vec3::Z * z;
            (2.0 * n, -n)
        })
        .collect()
}

/// Returns a closed hall of 3 x 1.5 x 2 m with surfaces that face inward.
fn hall(albedo: Vec3, radiance: Vec3) -> TriangleMesh {
    let size = Vec3::new(3.0, 1.5, 2.0);
    let at = |x: u8, y: u8, z: u8| size * Vec3::new(x.into(), y.into(), z.into());
    let walls = [
        [at(0, 0, 0), at(0, 0, 1), at(1, 0, 1), at(1, 0, 0)],
        [at(0, 1, 0), at(1, 1, 0), at(1, 1, 1), at(0, 1, 1)],
        [at(0, 0, 0), at(1, 0, 0), at(1, 1, 0), at(0, 1, 0)],
        [at(0, 0, 1), at(0, 1, 1), at(1, 1, 1), at(1, 0, 1)],
        [at(0, 0, 0), at(0, 1, 0), at(0, 1, 1), at(0, 0, 1)],
        [at(1, 0, 0), at(1, 0, 1), at(1, 1, 1), at(1, 1, 0)],
    ];
    let quads = walls.map(|corners| Quad {
        corners,
        material: Material::emissive(albedo, radiance),
    });
    TriangleMesh::from_quads(&quads)
}

/// Sphere and hall with uniform emission and reflection: the light is M Σ ρ^i. At ρ = 0.99 it is a
/// hundred times the emission.
#[test]
fn emitting_enclosures_match_geometric_series() {
    let radiance = Vec3::new(1.0, 0.5, 2.0);
    let in_the_hall = [
        (Vec3::new(1.0, 0.0, 0.7), Vec3::Y),
        (Vec3::new(0.0, 1.2, 1.9), Vec3::X),
        (Vec3::new(2.99, 1.5, 0.01), Vec3::NEG_Y),
    ];
    for (albedo, bounces, paths, wrong) in [
        (Vec3::new(0.5, 0.8, 0.2), Some(1), 64, 1.01),
        (Vec3::new(0.5, 0.8, 0.2), Some(5), 64, 1.01),
        (Vec3::new(0.5, 0.8, 0.2), None, 20_000, 1.03),
        (Vec3::splat(0.95), None, 8000, 1.05),
        (Vec3::splat(0.99), Some(40), 64, 1.01),
        (Vec3::new(0.99, 0.9, 0.0), None, 4000, 1.08),
    ] {
        let sphere = cavity(albedo, radiance);
        let hall = hall(albedo, radiance);
        let right = channels(|c| {
            let emitted = f64::from(PI * radiance[c]);
            closed_form::enclosure_reflected(emitted, albedo[c].into(), bounces)
        });
        let emitted = PI * radiance;
        let positions = on_the_cavity(3);
        for (what, geometry, positions) in [
            ("sphere", &sphere as &dyn Geometry, &positions[..]),
            ("hall", &hall, &in_the_hall[..]),
        ] {
            let all = irradiance_at_all(geometry, &[], positions, &settings(paths, bounces));
            let what = format!("{what}, {albedo}, {bounces:?}");
            check(&what, &indirect(&all), &vec![right; all.len()], wrong);
            check(&what, &direct(&all), &vec![emitted; all.len()], 1.01);
        }
    }
}

/// Lights inside a sphere: reflected light is the same everywhere, for any direction of the lights.
#[test]
fn lights_in_sphere_give_uniform_irradiance() {
    let albedo = Vec3::new(0.8, 0.5, 0.9);
    let sphere = cavity(albedo, Vec3::ZERO);
    let intensity = Vec3::new(1.0, 2.0, 0.5);
    let (inner, outer) = (0.3f32, 0.8f32);
    let position = Vec3::new(0.4, -0.9, 0.3);
    let (u, v) = (Vec3::new(0.3, 0.0, 0.0), Vec3::new(0.0, 0.2, 0.1));
    let area = f64::from(4.0 * u.cross(v).length());
    let light_sources = [
        (
            "point",
            Light::Point {
                position,
                intensity,
                range: f32::INFINITY,
            },
            4.0 * std::f64::consts::PI,
        ),
        (
            "spot",
            Light::Spot {
                position,
                direction: Vec3::new(0.6, 0.0, 0.8),
                intensity,
                inner,
                outer,
                range: f32::INFINITY,
            },
            closed_form::spot_power(1.0, inner.into(), outer.into()),
        ),
        (
            "rectangle",
            Light::Rect {
                center: position,
                u,
                v,
                radiance: intensity,
            },
            std::f64::consts::PI * area,
        ),
    ];
    for (what, light_source, power) in light_sources {
        for (bounces, paths) in [(Some(1), 20_000), (Some(3), 20_000), (None, 10_000)] {
            let positions = on_the_cavity(4);
            let all = irradiance_at_all(
                &sphere,
                &[light_source],
                &positions,
                &settings(paths, bounces),
            );
            let right = channels(|c| {
                let power = power * f64::from(intensity[c]);
                closed_form::integrating_sphere(power, 2.0, albedo[c].into(), bounces)
            });
            let what = format!("{what} in a sphere, {bounces:?}");
            check(&what, &indirect(&all), &[right; 4], 1.12);
        }
    }
}

/// A light between an infinite floor and an infinite ceiling.
#[test]
fn light_under_ceiling_matches_closed_form() {
    let (room, below) = (3.0f32, 0.8f32);
    let albedo = Vec3::new(0.9, 0.5, 0.2);
    let half_space = |normal: Vec3, offset: f32, albedo: Vec3| ImplicitObject {
        shape: Shape::HalfSpace { normal, offset },
        albedo,
        radiance: Vec3::ZERO,
    };
    let scene = ImplicitScene::new(vec![
        half_space(Vec3::Y, 0.0, Vec3::ZERO),
        half_space(Vec3::NEG_Y, -room, albedo),
    ]);
    let light_source = Light::Point {
        position: Vec3::new(0.0, room - below, 0.0),
        intensity: Vec3::splat(3.0),
        range: f32::INFINITY,
    };
    let aside = [0.0f32, 0.5, 4.0];
    let positions = aside.map(|s| (Vec3::new(s, 0.0, 0.0), Vec3::Y));
    let all = irradiance_at_all(
        &scene,
        &[light_source],
        &positions,
        &settings(20_000, Some(3)),
    );
    let straight =
        aside.map(|s| closed_form::light_over_plane(3.0, (room - below).into(), s.into()));
    let straight = straight.map(|e| Vec3::splat(e as f32));
    check("light over a floor", &direct(&all), &straight, 1.01);
    // The floor is black: only one reflection exists.
    let returned = channels(|c| {
        closed_form::light_below_ceiling(3.0, albedo[c].into(), below.into(), room.into())
    });
    check("ceiling", &indirect(&all)[..1], &[returned], 1.1);
}

/// Emitting rectangles, as surfaces and as lights, at tilted and aligned positions.
#[test]
fn rectangle_emitters_match_polygon_formula() {
    let nothing = TriangleMesh::new(
        Vec::new(),
        Vec::new(),
        vec![Material::diffuse(Vec3::splat(0.5))],
    );
    let (center, u, v) = (
        Vec3::new(0.2, 2.0, -0.1),
        Vec3::new(0.5, 0.2, 0.0),
        Vec3::new(0.0, 0.1, 0.8),
    );
    let radiance = Vec3::new(1.0, 2.0, 4.0);
    let corners = [
        center - u - v,
        center + u - v,
        center + u + v,
        center - u + v,
    ];
    let facing = u.cross(v).normalize();
    assert!(facing.y < 0.0, "the light must face down");
    let glowing = TriangleMesh::from_quads(&[Quad {
        corners,
        material: Material::emissive(Vec3::ZERO, radiance),
    }]);
    let light_source = [Light::Rect {
        center,
        u,
        v,
        radiance,
    }];
    let positions: Vec<(Vec3, Vec3)> = (0..12)
        .map(|k| {
            let mut r = Random::new(8, 8, k);
            let mut unit = || r.unit() - 0.5;
            let x = Vec3::new(unit(), unit(), unit());
            (x, Vec3::new(0.8 * unit(), 1.0, 0.8 * unit()).normalize())
        })
        .collect();
    let exact = |c: usize, &(x, n): &(Vec3, Vec3)| {
        let corners = corners.map(|c| c.as_dvec3());
        let n: DVec3 = n.as_dvec3().normalize();
        closed_form::polygon(x.as_dvec3(), n, &corners, radiance[c].into())
    };
    let right: Vec<Vec3> = positions
        .iter()
        .map(|p| channels(|c| exact(c, p)))
        .collect();
    let of = |geometry: &dyn Geometry, lights: &[Light]| {
        direct(&irradiance_at_all(
            geometry,
            lights,
            &positions,
            &settings(20_000, Some(0)),
        ))
    };
    check(
        "rectangle as a light",
        &of(&nothing, &light_source),
        &right,
        1.02,
    );
    check("rectangle as a surface", &of(&glowing, &[]), &right, 1.04);
}

/// Mean irradiance over a rectangle from another one of radiosity 1, with its standard error.
fn form_factor(
    geometry: &dyn Geometry,
    lights: &[Light],
    corner: Vec3,
    u: Vec3,
    v: Vec3,
) -> (Vec3, Vec3) {
    let mut r = Random::new(9, 9, 9);
    let n = u.cross(v).normalize();
    let positions: Vec<_> = (0..20_000)
        .map(|_| (corner + u * r.unit() + v * r.unit(), n))
        .collect();
    let all = irradiance_at_all(geometry, lights, &positions, &settings(16, Some(0)));
    let count = all.len() as f64;
    let mean = all.iter().map(|e| f64::from(e.direct.x)).sum::<f64>() / count;
    let off = all.iter().map(|e| (f64::from(e.direct.x) - mean).powi(2));
    let error = (off.sum::<f64>() / count / (count - 1.0)).sqrt();
    (Vec3::splat(mean as f32), Vec3::splat(error as f32))
}

#[test]
fn rectangle_form_factors_match_closed_forms() {
    let black = Material::diffuse(Vec3::ZERO);
    // The receiver lies at y = 0, `u` along x and `v` along -z; emitters face it.
    for (what, size, corner, u, v, right) in [
        (
            "parallel squares",
            [1.0, 1.0],
            Vec3::Y,
            Vec3::X,
            Vec3::Z,
            closed_form::parallel_rectangles(1.0, 1.0, 1.0),
        ),
        (
            "parallel rectangles",
            [2.0, 0.5],
            0.7 * Vec3::Y,
            2.0 * Vec3::X,
            0.5 * Vec3::Z,
            closed_form::parallel_rectangles(2.0, 0.5, 0.7),
        ),
        (
            "perpendicular squares",
            [1.0, 1.0],
            Vec3::ZERO,
            Vec3::X,
            Vec3::Y,
            closed_form::perpendicular_rectangles(1.0, 1.0, 1.0),
        ),
        (
            "perpendicular rectangles",
            [2.0, 0.5],
            Vec3::ZERO,
            2.0 * Vec3::X,
            3.0 * Vec3::Y,
            closed_form::perpendicular_rectangles(2.0, 0.5, 3.0),
        ),
    ] {
        let [width, depth] = size;
        let emitter = TriangleMesh::from_quads(&[Quad {
            corners: [corner, corner + u, corner + u + v, corner + v],
            material: Material::emissive(Vec3::ZERO, Vec3::splat(1.0 / PI)),
        }]);
        let nothing = TriangleMesh::new(Vec::new(), Vec::new(), vec![black.clone()]);
        let light_source = [Light::Rect {
            center: corner + 0.5 * (u + v),
            u: 0.5 * u,
            v: 0.5 * v,
            radiance: Vec3::splat(1.0 / PI),
        }];
        let of = |geometry: &dyn Geometry, lights: &[Light]| {
            let start = Vec3::new(0.0, 0.0, depth);
            form_factor(geometry, lights, start, width * Vec3::X, -depth * Vec3::Z)
        };
        let right = Vec3::splat(right as f32);
        check(
            &format!("{what}, surface"),
            &[of(&emitter, &[])],
            &[right],
            1.03,
        );
        // Where they touch, the variance of 1/d² is unbounded for points on a light. The variance
        // of rays is bounded.
        if corner.y > 0.0 {
            check(
                &format!("{what}, light"),
                &[of(&nothing, &light_source)],
                &[right],
                1.03,
            );
        }
    }
}
