//! Tests of areas against true areas, of leaks in closed rooms, of self-intersection at ray starts,
//! and of invalid clouds.

use super::*;
use crate::samples::{Random, uniform_sphere};
use crate::scene::{Geometry, Ray};
use glam::Vec2;

fn unit_square(i: u64) -> Vec2 {
    let mut r = Random::new(9, 2, i);
    Vec2::new(r.unit(), r.unit())
}

fn cloud(positions: Vec<Vec3>, normals: Vec<Vec3>) -> PointCloud {
    let points = PlyPoints {
        positions,
        normals: Some(normals),
        ..PlyPoints::default()
    };
    PointCloud::new(points, &[]).expect("a cloud")
}

fn sphere(count: u64, radius: f32) -> PointCloud {
    let normals: Vec<Vec3> = (0..count).map(|i| uniform_sphere(unit_square(i))).collect();
    cloud(normals.iter().map(|n| radius * *n).collect(), normals)
}

/// Returns random points on a square of edge 1.
fn square(count: u64) -> PointCloud {
    let at = |i| unit_square(i).extend(0.0);
    cloud((0..count).map(at).collect(), vec![Vec3::Z; count as usize])
}

#[test]
fn point_without_normal_does_not_replace_oriented_point() {
    let at: Vec<Vec3> = (0..200).map(|i| unit_square(i).extend(0.0)).collect();
    // Each position occurs twice, first without a normal. The given normals differ from an
    // estimate.
    let known = Vec3::new(0.6, 0.0, 0.8);
    let positions = at.iter().flat_map(|x| [*x, *x]).collect();
    let normals = at.iter().flat_map(|_| [Vec3::ZERO, known]).collect();
    let found = cloud(positions, normals);
    assert_eq!(found.positions.len(), at.len());
    assert!(found.normals.iter().all(|n| n.abs_diff_eq(known, 1e-6)));
    let problems = found.problems;
    assert_eq!((problems.coincident, problems.normal_estimated), (200, 0));
}

/// Returns points on the faces of a box, with normals inwards (`side` -1) or outwards (1). `even`
/// selects a jittered grid per face instead of random points.
fn boxed(count: u64, half: Vec3, side: f32, even: bool) -> (Vec<Vec3>, Vec<Vec3>) {
    let (mut positions, mut normals) = (Vec::new(), Vec::new());
    let total = 8.0 * (half.x * half.y + half.y * half.z + half.z * half.x);
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for sign in [-1.0f32, 1.0] {
            let expected = count as f32 * 4.0 * half[u] * half[v] / total;
            let rows = (expected * half[u] / half[v]).sqrt().round().max(1.0) as u64;
            let columns = (expected / rows as f32).round().max(1.0) as u64;
            for i in 0..rows * columns {
                let r = unit_square(i + 1_000_000 * (axis as u64 * 2 + u64::from(sign > 0.0)));
                let cell = Vec2::new((i % rows) as f32, (i / rows) as f32);
                let at = if even {
                    (cell + r) / Vec2::new(rows as f32, columns as f32)
                } else {
                    r
                };
                let mut x = Vec3::ZERO;
                x[axis] = sign * half[axis];
                x[u] = (2.0 * at.x - 1.0) * half[u];
                x[v] = (2.0 * at.y - 1.0) * half[v];
                let mut n = Vec3::ZERO;
                n[axis] = sign * side;
                positions.push(x);
                normals.push(n);
            }
        }
    }
    (positions, normals)
}

fn total(cloud: &PointCloud) -> f32 {
    cloud.areas.iter().sum()
}

/// Returns the fraction of the directions from `from` without a hit.
fn leak(cloud: &PointCloud, from: Vec3) -> f64 {
    let (mesh, _) = cloud.mesh();
    let rays = 100_000;
    let lost = (0..rays)
        .filter(|i| {
            mesh.cast(&Ray::new(from, uniform_sphere(unit_square(*i))))
                .is_none()
        })
        .count();
    lost as f64 / rays as f64
}

#[test]
fn point_areas_sum_to_sampled_surface() {
    let half = Vec3::new(1.0, 2.0, 1.5);
    for (count, within) in [(100, 0.05), (1000, 0.02), (10_000, 0.01)] {
        let (p, n) = boxed(count, half, -1.0, true);
        let even = total(&cloud(p, n)) / 52.0;
        let (p, n) = boxed(count, half, 1.0, false);
        let uneven = total(&cloud(p, n)) / 52.0;
        let round = total(&sphere(count, 2.0)) / (16.0 * core::f32::consts::PI);
        let open = total(&square(count));
        for (what, found) in [
            ("box", even),
            ("random box", uneven),
            ("sphere", round),
            ("square with a border", open),
        ] {
            assert!(
                (found - 1.0).abs() < within,
                "{count} points, {what}: {found}"
            );
            // The bound rejects areas that are 10 % too large.
            assert!((1.1 * found - 1.0).abs() > within);
        }
    }
}

#[test]
fn point_density_changes_areas_but_not_sum() {
    // Nine of ten points are on the left half.
    let at = |i: u64| {
        let r = unit_square(i);
        let x = if i.is_multiple_of(10) {
            0.5 + 0.5 * r.x
        } else {
            0.5 * r.x
        };
        Vec3::new(x, r.y, 0.0)
    };
    let cloud = cloud((0..5000).map(at).collect(), vec![Vec3::Z; 5000]);
    let left: f32 = (0..5000)
        .filter(|i| cloud.positions[*i].x < 0.5)
        .map(|i| cloud.areas[i])
        .sum();
    // Cells at the density step get the areas of their denser neighbors. Three percent of the area
    // is missing in total.
    assert!(
        (left - 0.5).abs() < 0.02 && (total(&cloud) - 1.0).abs() < 0.04,
        "{left} of {}",
        total(&cloud)
    );
}

#[test]
fn point_cloud_closed_surface_blocks_all_rays() {
    let from = Vec3::new(0.3, 0.1, 0.2);
    let (p, n) = boxed(10_000, Vec3::new(1.0, 2.0, 1.5), -1.0, true);
    let even = leak(&cloud(p.clone(), n.clone()), from);
    let (q, m) = boxed(10_000, Vec3::new(1.0, 2.0, 1.5), -1.0, false);
    let uneven = leak(&cloud(q, m), from);
    let round = leak(&sphere(10_000, 2.0), from);
    // Noise of a tenth of the spacing in each coordinate, and estimated normals.
    let noisy: Vec<Vec3> = p
        .iter()
        .enumerate()
        .map(|(i, x)| *x + 0.007 * uniform_sphere(unit_square(7_000_000 + i as u64)))
        .collect();
    let noisy = PlyPoints {
        positions: noisy,
        ..PlyPoints::default()
    };
    let noisy = leak(&PointCloud::new(noisy, &[]).unwrap(), from);
    println!("leaks: even {even:.6}, random {uneven:.6}, sphere {round:.6}, noisy {noisy:.6}");
    assert!(
        even < 1e-4 && uneven < 1e-3 && round < 1e-3 && noisy < 1e-2,
        "{even} {uneven} {round} {noisy}"
    );
    // A wall without one square meter has a visible hole.
    let stays = |x: &Vec3| x.x < 0.99 || x.y.abs() > 0.5 || x.z.abs() > 0.5;
    let (q, m) = p.iter().zip(&n).filter(|(x, _)| stays(x)).unzip();
    let hole = leak(&cloud(q, m), from);
    assert!(hole > 1e-2, "{hole}");
}

#[test]
fn point_cloud_ray_origins_clear_neighbor_cells() {
    // No cell blocks rays that leave a sphere outwards.
    let s = sphere(5000, 1.0);
    let (mesh, point_of) = s.mesh();
    assert_eq!(point_of.len(), mesh.len());
    let (mut met, mut blocked, mut unlifted) = (0, 0, 0);
    for i in 0..50_000 {
        let to = uniform_sphere(unit_square(i));
        let from = 3.0 * uniform_sphere(unit_square(900_000 + i));
        let ray = Ray::new(from, (to - from).normalize());
        let Some(hit) = mesh.cast(&ray) else { continue };
        let seen = mesh.surface(&ray, &hit);
        let at = seen.position.normalize();
        // A direction at least 17 degrees above the horizon.
        let up = (at + 0.95 * uniform_sphere(unit_square(1_800_000 + i))).normalize();
        if seen.normal.dot(up) < 0.3 {
            continue;
        }
        met += 1;
        let leaves = |lift: f32| {
            mesh.cast(&Ray::new(seen.position + seen.normal * lift, up))
                .is_none()
        };
        blocked += u32::from(!leaves(mesh.ray_offset(seen.position)));
        unlifted += u32::from(!leaves(1e-7));
    }
    println!("{blocked} of {met} blocked, {unlifted} without the lift");
    assert!(unlifted > 10 * blocked, "the lift removes too few hits");
    assert!(met > 10_000 && blocked * 1000 < met, "{blocked} of {met}");
}

#[test]
fn point_cloud_degenerate_input_builds() {
    let of = |positions: Vec<Vec3>, normals: Option<Vec<Vec3>>| {
        PointCloud::new(
            PlyPoints {
                positions,
                normals,
                ..PlyPoints::default()
            },
            &[],
        )
    };
    let check = |what: &str, result: Result<PointCloud, PointsError>| {
        let cloud = result.unwrap_or_else(|error| panic!("{what}: {error}"));
        for i in 0..cloud.len() {
            assert!(
                cloud.areas[i].is_finite() && cloud.areas[i] >= 0.0,
                "{what}: area {}",
                cloud.areas[i]
            );
            assert!(
                (cloud.normals[i].length() - 1.0).abs() < 1e-4,
                "{what}: normal {}",
                cloud.normals[i]
            );
            assert!(cloud.outline(i).iter().all(|x| x.is_finite()), "{what}");
            assert!(cloud.albedo[i].min_element() >= 0.0 && cloud.albedo[i].max_element() <= 1.0);
        }
        let (mesh, _) = cloud.mesh();
        let ray = Ray::new(Vec3::splat(5.0), Vec3::splat(-0.577_350_26));
        assert!(mesh.cast(&ray).is_none_or(|hit| hit.t.is_finite()));
        assert!(mesh.ray_offset(cloud.positions[0]).is_finite());
    };
    let random = |i: u64| unit_square(i).extend(unit_square(i + 77).x);
    assert!(matches!(
        of(vec![], None),
        Err(PointsError::TooFew { usable: 0, .. })
    ));
    assert!(matches!(
        of(vec![Vec3::ONE], Some(vec![Vec3::Y])),
        Err(PointsError::TooFew { usable: 1, .. })
    ));
    let spot = of(vec![Vec3::ONE; 1_000_000], None);
    assert!(matches!(
        spot,
        Err(PointsError::TooFew {
            usable: 1,
            coincident: 999_999,
            ..
        })
    ));
    let bad = vec![Vec3::NAN, Vec3::INFINITY, Vec3::splat(1e30), Vec3::ONE];
    assert!(matches!(
        of(bad, None),
        Err(PointsError::TooFew {
            usable: 1,
            not_finite: 3,
            ..
        })
    ));
    assert!(matches!(
        of(vec![Vec3::ONE; 3], Some(vec![])),
        Err(PointsError::Lengths { .. })
    ));
    // Points at one position with normals in all directions: the cells have no area.
    let turned: Vec<Vec3> = (0..100_000)
        .map(|i| uniform_sphere(unit_square(i)))
        .collect();
    let spot = of(vec![Vec3::ONE; 100_000], Some(turned));
    assert!(matches!(spot, Err(PointsError::NoArea)));
    // A hundred thousand points within a few roundings of one position, and one far point.
    let mut dense: Vec<Vec3> = (0..100_000).map(|i| Vec3::ONE + 3e-7 * random(i)).collect();
    dense.push(Vec3::splat(1e6));
    check("a spot and one far away", of(dense.clone(), None));
    check(
        "a spot with normals",
        of(dense, Some(vec![Vec3::Y; 100_001])),
    );
    check(
        "a line",
        of((0..1000).map(|i| Vec3::X * i as f32).collect(), None),
    );
    check(
        "a plane",
        of(
            (0..1000).map(|i| unit_square(i).extend(0.0)).collect(),
            None,
        ),
    );
    check(
        "two and a half positions",
        of(vec![Vec3::ZERO, Vec3::X, Vec3::Y], None),
    );
    for scale in [1e-18, 1e-12, 1e-6, 1e3, 1e6, 9e8] {
        check(
            "wild scale",
            of(
                (0..2000)
                    .map(|i| scale * uniform_sphere(unit_square(i)))
                    .collect(),
                None,
            ),
        );
    }
    for scale in [1e-6f32, 1e6] {
        let area = total(&sphere(2000, scale)) / (4.0 * core::f32::consts::PI * scale * scale);
        assert!((area - 1.0).abs() < 0.02, "scale {scale}: {area}");
    }
    let zero = of(
        (0..1000).map(|i| unit_square(i).extend(0.0)).collect(),
        Some([vec![Vec3::ZERO; 500], vec![Vec3::NEG_Z; 500]].concat()),
    );
    let zero = zero.expect("a cloud");
    assert_eq!(zero.problems.normal_estimated, 500);
    assert!(
        zero.normals.iter().all(|n| n.z < -0.99),
        "turned like their neighbors"
    );
    let albedo = Some(vec![Vec3::new(f32::NAN, -1.0, 7.0); 100]);
    let wild = PlyPoints {
        positions: (0..100).map(random).collect(),
        normals: None,
        albedo,
        faces: 0,
    };
    let wild = PointCloud::new(wild, &[]).expect("a cloud");
    assert_eq!(
        (wild.albedo[0], wild.problems.albedo_clamped),
        (Vec3::new(0.0, 0.0, 1.0), 100)
    );
    check("noise without a surface", Ok(wild));
}

#[test]
fn point_cell_corners_interpolate_normals() {
    // On a sphere the normal of a corner is its direction. It is more accurate than the cell's
    // normal.
    let ball = sphere(5000, 2.0);
    let smooth = ball.corner_normals();
    let (mut at, mut own, mut shared) = (0, 0.0f64, 0.0f64);
    for i in 0..ball.len() {
        for corner in ball.outline(i) {
            let right = corner.normalize();
            assert!((smooth[at].length() - 1.0).abs() < 1e-4);
            own += f64::from(ball.normals[i].distance_squared(right));
            shared += f64::from(smooth[at].distance_squared(right));
            at += 1;
        }
    }
    assert_eq!(at, smooth.len());
    let (own, shared) = ((own / at as f64).sqrt(), (shared / at as f64).sqrt());
    println!("off by {shared:.4}, by the cell's own {own:.4}");
    assert!(shared < 0.5 * own, "{shared} and {own}");
    // Normals are not averaged across a crease.
    let (positions, normals) = boxed(6000, Vec3::ONE, 1.0, true);
    let boxed = cloud(positions, normals);
    let smooth = boxed.corner_normals();
    let mut corners = smooth.iter();
    for i in 0..boxed.len() {
        for normal in corners.by_ref().take(boxed.outline(i).len()) {
            assert!(normal.dot(boxed.normals[i]) > 0.9999, "{normal}");
        }
    }
}

#[test]
fn point_cloud_any_thread_count_is_equal() {
    let points = || PlyPoints {
        positions: (0..40_000)
            .map(|i| uniform_sphere(unit_square(i)))
            .collect(),
        ..PlyPoints::default()
    };
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            PointCloud::new(points(), &[])
                .unwrap()
                .mesh()
                .0
                .content_hash()
        })
    };
    assert_eq!(on(1), on(3));
}
