//! The fast multipole method on whole scenes: against the sum over all pairs, closed forms, the
//! reference integrator, and hard cases.

use meshless_gi_lab::fixtures::fmm as room;

use glam::Vec3;
use meshless_gi::internals::samples::Random;
use meshless_gi::internals::transport::fmm::{Fmm, FmmError, FmmPoint, FmmSettings, direct};
use meshless_gi::{Light, Quad, ReferenceSettings, TriangleMesh, irradiance};
use meshless_gi_lab::accuracy::errors;
use room::{cornell, lit, varying_radiosity, with_ball};
use std::time::Instant;

/// Returns the root mean square of the difference relative to that of `right`.
fn difference(values: &[Vec3], right: &[Vec3]) -> f64 {
    errors(values, right, &vec![Vec3::ZERO; right.len()]).nrmse
}

fn exact() -> FmmSettings {
    FmmSettings {
        disks: false,
        slack: 0.0,
        ..FmmSettings::default()
    }
}

fn on_a_sphere(count: usize, radius: f32, at: Vec3, inward: bool) -> Vec<FmmPoint> {
    let mut random = Random::new(11, 12, 13);
    let weight = 4.0 * std::f32::consts::PI * radius * radius / count as f32;
    (0..count)
        .map(|_| {
            let z = 2.0 * random.unit() - 1.0;
            let phi = std::f32::consts::TAU * random.unit();
            let s = (1.0 - z * z).max(0.0).sqrt();
            let out = Vec3::new(s * phi.cos(), s * phi.sin(), z);
            FmmPoint {
                position: at + radius * out,
                normal: if inward { -out } else { out },
                weight,
                receives: true,
            }
        })
        .collect()
}

/// The error falls with the order as separation^(order + 1), in a room where a third of all pairs
/// face away from each other.
#[test]
fn fmm_converges_to_direct_sum() {
    let room = with_ball(6000);
    let radiosity = varying_radiosity(&room);
    let all: Vec<u32> = (0..room.points.len() as u32).step_by(3).collect();
    let right = direct(&room.points, &radiosity, &all, false, None);
    let mut last = f64::INFINITY;
    for (order, max) in [(0, 0.1), (2, 2e-2), (4, 3e-3), (8, 1e-4), (12, 5e-6)] {
        let settings = FmmSettings { order, ..exact() };
        let start = Instant::now();
        let fmm = Fmm::new(&room.points, &settings, None).unwrap();
        let (e, times) = fmm.irradiance(&radiosity).unwrap();
        let e: Vec<_> = all.iter().map(|&i| e[i as usize]).collect();
        let error = difference(&e, &right);
        let l = fmm.lists();
        eprintln!(
            "order {order:2}: {error:.1e}, {:?} whole, {times:?}, {} nodes, far {} local {} multipole {} near {}, {:?}",
            start.elapsed(),
            fmm.tree().nodes.len(),
            l.far.entries.len(),
            l.local.entries.len(),
            l.multipole.entries.len(),
            l.near.entries.len(),
            l.counts
        );
        assert!(error < max && error < last, "order {order}: {error:e}");
        last = error;
    }
}

/// Inside a sphere every point is visible from every other, with the same kernel: E = B.
#[test]
fn fmm_inside_of_sphere_is_uniform() {
    let count = 5000;
    let points = on_a_sphere(count, 3.0, Vec3::new(40.0, -7.0, 1.0), true);
    let radiosity = vec![Vec3::new(1.0, 2.0, 0.5); count];
    let settings = FmmSettings {
        order: 6,
        ..exact()
    };
    let fmm = Fmm::new(&points, &settings, None).unwrap();
    let (e, _) = fmm.irradiance(&radiosity).unwrap();
    let right = radiosity[0] * (1.0 - 1.0 / count as f32);
    for e in &e {
        // Positions are single numbers 40 m from the origin.
        assert!(e.abs_diff_eq(right, 2e-3), "{e} and not {right}");
    }
    let error = difference(&e, &vec![right; count]);
    assert!(error < 1e-4, "{error:e}");
    // All bounces: E = ρ B / (1 − ρ) of the emitted radiosity.
    let albedo = vec![Vec3::splat(0.5); count];
    let all = fmm.solve(&albedo, &radiosity, 100, 1e-6).unwrap();
    let right = radiosity[0] * 2.0;
    assert!(difference(&all.irradiance, &vec![right; count]) < 1e-3);
    assert!((15..30).contains(&all.bounces), "{}", all.bounces);
    // [G08] §3.1.6 stops after three.
    let three = fmm.solve(&albedo, &radiosity, 3, 0.0).unwrap();
    assert_eq!(three.bounces, 3);
    let part = difference(&three.irradiance, &vec![right * 0.875; count]);
    assert!(part < 1e-3, "{part}");
}

/// Outside a sphere all points face away from each other. Without the test of the orientation two
/// wrong signs would make B arrive.
#[test]
fn fmm_outside_of_sphere_is_dark() {
    let points = on_a_sphere(4000, 1.0, Vec3::ZERO, false);
    for slack in [0.0, 0.03] {
        let settings = FmmSettings { slack, ..exact() };
        let fmm = Fmm::new(&points, &settings, None).unwrap();
        let (e, _) = fmm.irradiance(&vec![Vec3::ONE; points.len()]).unwrap();
        let mean = e.iter().map(|e| e.x).sum::<f32>() / e.len() as f32;
        assert!(mean <= slack * slack, "{mean} with slack {slack}");
        let entries = fmm.lists().near.entries.len() + fmm.lists().far.entries.len();
        assert!(slack > 0.0 || entries == 0, "{entries}");
    }
}

/// The slack's band of directions holds slack² of a hemisphere's light.
#[test]
fn fmm_slack_saves_pairs_within_error_bound() {
    let room = with_ball(6000);
    let radiosity = varying_radiosity(&room);
    let run = |slack: f32| {
        let settings = FmmSettings {
            slack,
            order: 6,
            ..exact()
        };
        let fmm = Fmm::new(&room.points, &settings, None).unwrap();
        let e = fmm.irradiance(&radiosity).unwrap().0;
        (e, fmm.lists().counts)
    };
    let (right, all) = run(0.0);
    for slack in [0.01, 0.03, 0.1] {
        let (e, counts) = run(slack);
        let error = difference(&e, &right);
        eprintln!(
            "slack {slack}: {error:.1e}, point pairs {} of {}, mixed {} of {}",
            counts.point_pairs, all.point_pairs, counts.mixed, all.mixed
        );
        assert!(error < f64::from(slack * slack).max(1e-3), "{error}");
        assert!(e.iter().all(|e| e.min_element() >= 0.0));
    }
    assert!(run(0.1).1.point_pairs < all.point_pairs);
}

#[test]
fn fmm_any_thread_count_has_equal_bits() {
    let room = cornell(2000);
    let mesh = TriangleMesh::from_quads(&Quad::cornell_box());
    let radiosity = varying_radiosity(&room);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build().unwrap().install(|| {
            let fmm = Fmm::new(&room.points, &FmmSettings::default(), Some(&mesh)).unwrap();
            let e = fmm.irradiance(&radiosity).unwrap().0;
            (fmm.lists().clone(), e)
        })
    };
    let (lists, e) = run(1);
    for threads in [2, 5] {
        let (other, f) = run(threads);
        assert!(lists == other);
        let bits = |e: &[Vec3]| {
            e.iter()
                .map(|e| e.to_array().map(f32::to_bits))
                .collect::<Vec<_>>()
        };
        assert!(bits(&e) == bits(&f));
    }
}

/// The Cornell box as points, with blocks as occluders, lit by a light: many bounces against the
/// reference integrator at the same positions.
#[test]
fn fmm_cornell_box_matches_reference() {
    let room = cornell(8000);
    let mesh = TriangleMesh::from_quads(&Quad::cornell_box());
    let light_source = Light::Point {
        position: Vec3::new(0.0, 1.8, 0.2),
        intensity: Vec3::splat(10.0),
        range: f32::INFINITY,
    };
    let emission = lit(&room, &mesh, &light_source);
    let start = Instant::now();
    let fmm = Fmm::new(&room.points, &FmmSettings::default(), Some(&mesh)).unwrap();
    let built = start.elapsed();
    let solved = fmm.solve(&room.albedo, &emission, 50, 1e-3).unwrap();
    let settings = ReferenceSettings {
        paths: 2048,
        bounces: None,
        seed: 5,
    };
    let positions: Vec<usize> = (0..room.points.len()).step_by(60).collect();
    let right: Vec<_> = positions
        .iter()
        .map(|&i| {
            let p = &room.points[i];
            irradiance(
                &mesh,
                &[light_source],
                p.position,
                p.normal,
                i as u64,
                &settings,
            )
        })
        .collect();
    let reference: Vec<_> = right.iter().map(|r| r.indirect).collect();
    let noise: Vec<_> = right.iter().map(|r| r.indirect_error).collect();
    let of = |e: &[Vec3]| {
        let own: Vec<_> = positions.iter().map(|&i| e[i]).collect();
        errors(&own, &reference, &noise)
    };
    let found = of(&solved.irradiance);
    eprintln!(
        "{found:?}, {} bounces, built in {built:?}, {:?}, {:?}",
        solved.bounces,
        solved.times,
        fmm.lists().counts
    );
    assert!(found.nrmse < 0.1, "{found:?}");
    // Without occluders the result is wrong.
    let open = Fmm::new(&room.points, &FmmSettings::default(), None).unwrap();
    let open = of(&open
        .solve(&room.albedo, &emission, 50, 1e-3)
        .unwrap()
        .irradiance);
    eprintln!("without visibility: {open:?}");
    assert!(open.nrmse > 0.2, "{open:?}");
    // Red light on the floor by the red wall, green by the green one.
    let tint = |sign: f32| {
        let near =
            |p: &FmmPoint| p.normal.y > 0.9 && p.position.y < 0.01 && p.position.x * sign > 0.8;
        let pairs = room.points.iter().zip(&solved.irradiance);
        let sum: Vec3 = pairs.filter(|(p, _)| near(p)).map(|(_, e)| *e).sum();
        sum.x / sum.y
    };
    assert!(tint(-1.0) > 1.3 * tint(1.0), "{} {}", tint(-1.0), tint(1.0));
}

fn finite(points: &[FmmPoint], what: &str) -> Vec<Vec3> {
    let settings = FmmSettings::default();
    let fmm = Fmm::new(points, &settings, None).unwrap();
    let n = points.len();
    let solved = fmm
        .solve(&vec![Vec3::splat(0.9); n], &vec![Vec3::ONE; n], 1, 0.0)
        .unwrap();
    for v in solved.irradiance.iter().chain(&solved.radiosity) {
        assert!(v.is_finite() && v.min_element() >= 0.0, "{what}: {v}");
    }
    solved.irradiance
}

#[test]
fn fmm_degenerate_input_stays_finite() {
    let point = |position: Vec3, normal: Vec3| FmmPoint {
        position,
        normal,
        weight: 0.1,
        receives: true,
    };
    assert!(finite(&[], "nothing").is_empty());
    assert_eq!(finite(&[point(Vec3::ONE, Vec3::X)], "one"), [Vec3::ZERO]);
    let faces = [point(Vec3::ZERO, Vec3::X), point(Vec3::X, Vec3::NEG_X)];
    let pair = finite(&faces, "two");
    assert!(pair[0] == pair[1] && pair[0].x > 0.0, "{pair:?}");
    let mut random = Random::new(1, 2, 3);
    let mut any = || Vec3::from_array([0; 3].map(|_| random.unit() - 0.5));
    // All points at one position with all orientations: they exchange nothing, and a point that
    // faces them lights them evenly.
    let mut spot: Vec<_> = (0..20_000).map(|_| point(Vec3::ONE, any())).collect();
    let dark = finite(&spot, "one position");
    assert!(dark.iter().all(|e| *e == Vec3::ZERO));
    spot.push(point(Vec3::new(1.0, 1.0, 2.0), Vec3::NEG_Z));
    let seen = finite(&spot, "one position and another");
    assert!(seen.iter().filter(|e| e.x > 0.0).count() > 5000);
    // All in one plane.
    let plane: Vec<_> = (0..5000)
        .map(|_| point(any() * Vec3::new(1.0, 1.0, 0.0), Vec3::Z))
        .collect();
    assert!(finite(&plane, "a plane").iter().all(|e| *e == Vec3::ZERO));
    // In one line; normals of no length; weights of zero.
    let line: Vec<_> = (0..3000).map(|_| point(any().x * Vec3::X, any())).collect();
    finite(&line, "a line");
    let mut none: Vec<_> = (0..2000).map(|_| point(any(), any())).collect();
    for (i, p) in none.iter_mut().enumerate() {
        match i % 3 {
            0 => p.normal = Vec3::ZERO,
            1 => p.weight = 0.0,
            _ => {}
        }
    }
    let e = finite(&none, "some without normals");
    assert!((0..none.len()).step_by(3).all(|i| e[i] == Vec3::ZERO));
    assert!(e.iter().any(|e| e.x > 0.0));
    none.iter_mut().for_each(|p| p.normal = Vec3::ZERO);
    assert!(
        finite(&none, "none with normals")
            .iter()
            .all(|e| *e == Vec3::ZERO)
    );
    // Extreme scales: the light is the same, as the kernel has no length of its own.
    let room = cornell(1500);
    let right = finite(&room.points, "a room");
    for scale in [1e-15f32, 1e-6, 1e6, 1e15] {
        let mut scaled = room.points.clone();
        for p in &mut scaled {
            p.position *= scale;
            p.weight *= scale * scale;
        }
        let error = difference(&finite(&scaled, "scaled"), &right);
        assert!(error < 1e-3, "scale {scale}: {error}");
    }
    // A small object next to a very large one.
    let mut both = room.points.clone();
    both.extend(room.points.iter().map(|p| FmmPoint {
        position: p.position * 1e-6,
        weight: p.weight * 1e-12,
        ..*p
    }));
    both.push(point(Vec3::splat(f32::MAX), Vec3::X));
    finite(&both, "dust");
}

#[test]
fn fmm_coincident_points_do_not_overflow() {
    let start = Instant::now();
    let mut points = vec![
        FmmPoint {
            position: Vec3::new(0.3, 0.7, 0.1),
            normal: Vec3::Z,
            weight: 1e-6,
            receives: true,
        };
        1_000_000
    ];
    // And a light above them, of many points.
    points.extend(on_a_sphere(500, 1.0, Vec3::Z * 3.0, false));
    let e = finite(&points, "a million");
    eprintln!("{:?}", start.elapsed());
    assert!(e[0].x > 0.0 && e[..1_000_000].iter().all(|f| *f == e[0]));
}

#[test]
fn fmm_invalid_input_returns_named_error() {
    let room = cornell(100);
    let n = room.points.len();
    let fmm = Fmm::new(&room.points, &FmmSettings::default(), None).unwrap();
    let one = vec![Vec3::ONE; n];
    assert!(matches!(
        fmm.irradiance(&one[1..]),
        Err(FmmError::Count { .. })
    ));
    assert!(matches!(
        fmm.irradiance(&vec![Vec3::NAN; n]),
        Err(FmmError::Point { .. })
    ));
    assert!(matches!(
        fmm.irradiance(&vec![-Vec3::X; n]),
        Err(FmmError::Point { .. })
    ));
    assert!(fmm.solve(&vec![Vec3::splat(1.1); n], &one, 1, 0.0).is_err());
    let mut bad = room.points.clone();
    bad[7].position.x = f32::NAN;
    let error = Fmm::new(&bad, &FmmSettings::default(), None).unwrap_err();
    assert_eq!(
        error.to_string(),
        "point 7: position is NaN, not a finite number"
    );
}
