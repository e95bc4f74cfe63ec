//! Estimation of missing normals of points. A normal comes from the plane through the point's
//! neighbors. Its sign is first made consistent with the neighbors and then set to face outwards.
//!
//! Hoppe et al. 1992 ([HDD92] §3.2, §3.3): the normal is the direction of smallest variance of the
//! neighbors. A minimum spanning tree over neighbors propagates the sign along edges where the
//! planes agree best. There are three deviations:
//!
//! - A neighbor's normal is mirrored in the plane between the two points before the comparison. On
//!   a circle, over the edge of a box and in the corner of a room the mirrored normal equals the
//!   point's own normal. The sign is therefore also propagated over creases, where [HDD92] compares
//!   normals of 90 degrees.
//! - The tree is not traversed. Edges are processed in order of their weights with a union-find,
//!   which stores per point whether it is flipped relative to its root.
//! - Planes across creases lie between both surfaces and would round every corner of a room. They
//!   are replaced by the plane of a neighbor that fits its own neighborhood, if the point lies in
//!   it.
//!
//! The data does not contain the visible side of a part (connected through neighbors). A part faces
//! outwards: the sum of (x − center)·n over its points, which is proportional to its volume, is
//! positive. A part around the points of other parts faces them. A part around one of the
//! viewpoints faces that viewpoint.

use super::nearest::{Neighbor, PointTree};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Number of neighbors for the plane of a point.
const PLANE: usize = 16;
/// Number of neighbors with planes that may replace the plane of a point. They lie within nearly
/// twice the distance.
const CANDIDATES: usize = 48;
/// Mean squared distance below which a plane is flat, relative to the square of its size.
const FLAT: f64 = 1e-4;
/// Largest cost of a neighbor's plane that replaces the plane of a point, relative to the variance
/// of the latter. On a curved surface all planes fit about equally well.
const MAX_COST_RATIO: f64 = 0.25;
/// Number of neighbors with which a point compares its sign.
const LINKS: usize = 8;
/// Number of points of other parts that are tested for being inside a part.
const PROBES: usize = 32;

/// Returns a unit normal for each point. `Vec3::ZERO` if a point has fewer than two neighbors at
/// other positions.
pub(super) fn estimate(points: &[Vec3], tree: &PointTree, viewpoints: &[Vec3]) -> Vec<Vec3> {
    let fits: Vec<Fit> = points
        .par_iter()
        .enumerate()
        .map_init(Vec::new, |near, (i, x)| {
            tree.nearest(*x, PLANE, Some(i as u32), near);
            Fit::from_neighbors(*x, near, points)
        })
        .collect();
    let mut normals: Vec<Vec3> = (0..points.len())
        .into_par_iter()
        .map_init(Vec::new, |near, i| {
            sharpen_normal(i, &fits, points, tree, near)
        })
        .collect();
    let squares: Vec<f32> = fits.iter().map(|f| f.square).collect();
    let parts = agree(points, &mut normals, tree);
    outwards(points, &mut normals, &squares, &parts, viewpoints);
    normals
}

/// Plane through a point's neighbors.
#[derive(Clone, Copy)]
struct Fit {
    normal: Vec3,
    /// Point on the plane.
    mean: DVec3,
    /// Mean squared distance from the plane, m².
    variance: f64,
    /// Squared distance of the farthest neighbor, m².
    square: f32,
}

impl Fit {
    /// Fits a plane to `x` and its neighbors. The normal is zero if they are all at one position.
    fn from_neighbors(x: Vec3, near: &[Neighbor], points: &[Vec3]) -> Self {
        let square = near.last().map_or(0.0, |n| n.square);
        let mut fit = Self {
            normal: Vec3::ZERO,
            mean: x.as_dvec3(),
            variance: 0.0,
            square,
        };
        // Scaled by the farthest distance, so that no size underflows or overflows.
        let scale = f64::from(square).sqrt();
        if near.len() < 2 || scale <= 0.0 {
            return fit;
        }
        let offset = |n: &Neighbor| (points[n.index as usize].as_dvec3() - x.as_dvec3()) / scale;
        let count = (near.len() + 1) as f64;
        let mean = near.iter().map(offset).sum::<DVec3>() / count;
        let mut m = [[0.0f64; 3]; 3];
        for d in near.iter().map(offset).chain([DVec3::ZERO]) {
            let d = (d - mean).to_array();
            for (row, a) in m.iter_mut().zip(d) {
                for (cell, b) in row.iter_mut().zip(d) {
                    *cell += a * b / count;
                }
            }
        }
        let (normal, min) = least_direction(m);
        fit.normal = normal;
        fit.mean += mean * scale;
        fit.variance = min.max(0.0) * scale * scale;
        fit
    }
}

/// Returns the normal of point `i`. It is the normal of its own plane, or of a neighbor's plane
/// that has a much lower variance and contains the point. Across a crease the neighbors of a point
/// lie on two surfaces and its own plane lies between them.
fn sharpen_normal(
    i: usize,
    fits: &[Fit],
    points: &[Vec3],
    tree: &PointTree,
    near: &mut Vec<Neighbor>,
) -> Vec3 {
    let own = &fits[i];
    if own.variance <= FLAT * f64::from(own.square) {
        return own.normal;
    }
    tree.nearest(points[i], CANDIDATES, Some(i as u32), near);
    let (mut best, mut min) = (own, MAX_COST_RATIO * own.variance);
    for neighbor in near.iter() {
        let fit = &fits[neighbor.index as usize];
        let height = (points[i].as_dvec3() - fit.mean).dot(fit.normal.as_dvec3());
        let cost = fit.variance + height * height;
        if fit.normal != Vec3::ZERO && cost < min {
            (best, min) = (fit, cost);
        }
    }
    best.normal
}

/// Replaces zero normals among unit normals by those of the plane through the neighbors. The sign
/// is that of the nearest neighbor with a normal. Counts the replaced normals in `estimated`.
pub(super) fn complete(
    points: &[Vec3],
    given: Vec<Vec3>,
    tree: &PointTree,
    estimated: &mut u64,
) -> Vec<Vec3> {
    let mut out = given.clone();
    let mut near = Vec::new();
    for i in (0..points.len()).filter(|i| given[*i] == Vec3::ZERO) {
        tree.nearest(points[i], PLANE, Some(i as u32), &mut near);
        let normal = Fit::from_neighbors(points[i], &near, points).normal;
        let known = near
            .iter()
            .map(|n| n.index as usize)
            .find(|j| given[*j] != Vec3::ZERO);
        let against =
            known.is_some_and(|j| agreement(points[i], normal, points[j], given[j]) < 0.0);
        out[i] = if against { -normal } else { normal };
        *estimated += u64::from(normal != Vec3::ZERO);
    }
    out
}

/// Returns the unit eigenvector of the smallest eigenvalue of a symmetric matrix, and the
/// eigenvalue. Uses Jacobi rotations.
fn least_direction(mut m: [[f64; 3]; 3]) -> (Vec3, f64) {
    let mut axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0f64]];
    for _ in 0..12 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let off = m[p][q];
            if off.abs() < 1e-300 {
                continue;
            }
            let theta = (m[q][q] - m[p][p]) / (2.0 * off);
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let c = 1.0 / (t * t + 1.0).sqrt();
            let s = t * c;
            for row in &mut m {
                let (a, b) = (row[p], row[q]);
                (row[p], row[q]) = (c * a - s * b, s * a + c * b);
            }
            let (a, b) = (m[p], m[q]);
            m[p] = core::array::from_fn(|k| c * a[k] - s * b[k]);
            m[q] = core::array::from_fn(|k| s * a[k] + c * b[k]);
            for axis in &mut axes {
                let (a, b) = (axis[p], axis[q]);
                (axis[p], axis[q]) = (c * a - s * b, s * a + c * b);
            }
        }
    }
    let smallest = (0..3).fold(0, |best, k| if m[k][k] < m[best][best] { k } else { best });
    let axis = DVec3::new(axes[0][smallest], axes[1][smallest], axes[2][smallest]);
    (
        axis.try_normalize().map_or(Vec3::ZERO, DVec3::as_vec3),
        m[smallest][smallest],
    )
}

/// Returns the agreement of two orientations, in [-1, 1]: n_i · n_j, with n_j mirrored in the plane
/// between the points.
fn agreement(x_i: Vec3, n_i: Vec3, x_j: Vec3, n_j: Vec3) -> f32 {
    let along = (x_j - x_i).normalize_or_zero();
    n_i.dot(n_j - 2.0 * along * along.dot(n_j))
}

/// Union-find of points, with a flag per point: `true` if it is flipped relative to its parent.
struct Sides {
    parent: Vec<u32>,
    turned: Vec<bool>,
}

impl Sides {
    /// Returns the root of `i`, and `true` if `i` is flipped relative to it.
    fn root(&mut self, i: u32) -> (u32, bool) {
        let (mut at, mut turned) = (i as usize, false);
        while self.parent[at] as usize != at {
            // Path halving: the grandparent becomes the parent.
            let up = self.parent[at] as usize;
            if self.parent[up] as usize != up {
                self.turned[at] ^= self.turned[up];
                self.parent[at] = self.parent[up];
            }
            turned ^= self.turned[at];
            at = self.parent[at] as usize;
        }
        (at as u32, turned)
    }
}

/// Flips normals so that neighbors agree. Returns the part of each point, named by one of its
/// points.
fn agree(points: &[Vec3], normals: &mut [Vec3], tree: &PointTree) -> Vec<u32> {
    let mut edges: Vec<(u32, u32, u32)> = points
        .par_iter()
        .enumerate()
        .map_init(Vec::new, |near, (i, x)| {
            tree.nearest(*x, LINKS, Some(i as u32), near);
            let edge = |n: &Neighbor| {
                let j = n.index as usize;
                let sure = agreement(*x, normals[i], points[j], normals[j]).abs();
                // The bits of weights in [0, 1] have the same order as the weights.
                ((1.0 - sure.min(1.0)).to_bits(), i as u32, n.index)
            };
            near.iter().map(edge).collect::<Vec<_>>()
        })
        .flatten_iter()
        .collect();
    edges.par_sort_unstable();
    let mut sides = Sides {
        parent: (0..points.len() as u32).collect(),
        turned: vec![false; points.len()],
    };
    for (_, i, j) in edges {
        let ((a, turned_i), (b, turned_j)) = (sides.root(i), sides.root(j));
        if a == b {
            continue;
        }
        let [k, l] = [i as usize, j as usize];
        let against = agreement(points[k], normals[k], points[l], normals[l]) < 0.0;
        let (low, high) = (a.min(b), a.max(b));
        sides.parent[high as usize] = low;
        sides.turned[high as usize] = against ^ turned_i ^ turned_j;
    }
    let found: Vec<(u32, bool)> = (0..points.len() as u32).map(|i| sides.root(i)).collect();
    for (normal, (_, turned)) in normals.iter_mut().zip(&found) {
        if *turned {
            *normal = -*normal;
        }
    }
    found.into_iter().map(|(root, _)| root).collect()
}

/// Returns the solid angle of an oriented point at `from`. The sum over a closed part is 4π inside
/// the part and 0 outside. Positive if the part faces `from`.
fn solid_angle(from: DVec3, x: Vec3, n: Vec3, area: f64) -> f64 {
    let to = from - x.as_dvec3();
    let square = to.length_squared().max(area);
    area * to.dot(n.as_dvec3()) / (square * square.sqrt())
}

/// Orients whole parts toward their visible side.
fn outwards(
    points: &[Vec3],
    normals: &mut [Vec3],
    squares: &[f32],
    parts: &[u32],
    viewpoints: &[Vec3],
) {
    let mut members: Vec<u32> = (0..points.len() as u32).collect();
    members.sort_unstable_by_key(|i| (parts[*i as usize], *i));
    // Area per point: the area of the circle around the neighbors, divided by their number.
    let area = |i: usize| core::f64::consts::PI * f64::from(squares[i]) / PLANE as f64;
    let many = members
        .chunk_by(|a, b| parts[*a as usize] == parts[*b as usize])
        .count()
        > 1;
    for part in members.chunk_by(|a, b| parts[*a as usize] == parts[*b as usize]) {
        let of = |i: &u32| *i as usize;
        let center =
            part.iter().map(|i| points[of(i)].as_dvec3()).sum::<DVec3>() / part.len() as f64;
        let volume = |i: &u32| {
            area(of(i)) * (points[of(i)].as_dvec3() - center).dot(normals[of(i)].as_dvec3())
        };
        let mut outward = part.iter().map(volume).sum::<f64>() >= 0.0;
        let around = |from: DVec3| {
            let seen = |i: &u32| solid_angle(from, points[of(i)], normals[of(i)], area(of(i)));
            part.iter().map(seen).sum::<f64>()
        };
        let inside = |angle: f64| angle.abs() > 2.0 * core::f64::consts::PI;
        let mut faced = (viewpoints.iter())
            .map(|v| around(v.as_dvec3()))
            .find(|a| inside(*a));
        // A small part cannot surround other parts.
        if faced.is_none() && many && part.len() > points.len() / 16 {
            let first = parts[of(&part[0])];
            let others = members.len() - part.len();
            let step = (others / PROBES).max(1);
            let probes = members
                .iter()
                .filter(|i| parts[of(i)] != first)
                .step_by(step);
            let angles: Vec<f64> = probes.map(|i| around(points[of(i)].as_dvec3())).collect();
            let within = angles.iter().filter(|a| inside(**a)).count();
            if 2 * within > angles.len() {
                faced = Some(angles.iter().sum());
            }
        }
        if let Some(angle) = faced {
            outward = angle >= 0.0;
        }
        if !outward {
            for i in part {
                normals[of(i)] = -normals[of(i)];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::{Random, uniform_sphere};
    use glam::Vec2;

    fn estimated(points: &[Vec3], viewpoints: &[Vec3]) -> Vec<Vec3> {
        estimate(points, &PointTree::new(points), viewpoints)
    }

    fn sphere(count: u64, center: Vec3, radius: f32) -> Vec<Vec3> {
        let at = |i| {
            let mut r = Random::new(5, 0, i);
            center + radius * uniform_sphere(Vec2::new(r.unit(), r.unit()))
        };
        (0..count).map(at).collect()
    }

    /// Points on the six faces of a cube of edge 2, with their outward normals.
    fn cube(count: u64) -> (Vec<Vec3>, Vec<Vec3>) {
        (0..count)
            .map(|i| {
                let mut r = Random::new(6, 1, i);
                let axis = r.below(6);
                let mut n = Vec3::ZERO;
                n[axis % 3] = if axis < 3 { 1.0 } else { -1.0 };
                let mut x = Vec3::new(r.unit(), r.unit(), r.unit()) * 2.0 - 1.0;
                x[axis % 3] = n[axis % 3];
                (x, n)
            })
            .unzip()
    }

    /// Returns the mean cosine between estimated and true normals.
    fn mean_cosine(found: &[Vec3], truth: impl Fn(usize) -> Vec3) -> f32 {
        found
            .iter()
            .enumerate()
            .map(|(i, n)| n.dot(truth(i)))
            .sum::<f32>()
            / found.len() as f32
    }

    #[test]
    fn estimated_normals_of_sphere_and_cube_face_outward() {
        for scale in [1e-6f32, 1.0, 1e6] {
            let center = Vec3::new(3.0, -1.0, 2.0) * scale;
            let points = sphere(3000, center, scale);
            let cosine = mean_cosine(&estimated(&points, &[]), |i| (points[i] - center) / scale);
            assert!(cosine > 0.99, "sphere of {scale} m: {cosine}");
        }
        let (points, normals) = cube(6000);
        let found = estimated(&points, &[]);
        assert!(mean_cosine(&found, |i| normals[i]) > 0.95);
        let wrong = found
            .iter()
            .zip(&normals)
            .filter(|(a, b)| a.dot(**b) < 0.0)
            .count();
        // In a corner of three faces the plane through neighbors is arbitrary.
        assert!(
            wrong <= 3,
            "sides are carried over the edges: {wrong} of 6000"
        );
    }

    #[test]
    fn estimated_normals_of_enclosing_cloud_face_inward() {
        let seen_inside = estimated(&sphere(3000, Vec3::ZERO, 1.0), &[Vec3::new(0.2, 0.5, -0.1)]);
        let points = sphere(3000, Vec3::ZERO, 1.0);
        assert!(mean_cosine(&seen_inside, |i| -points[i]) > 0.99);
        let seen_outside = estimated(&points, &[Vec3::new(0.2, 5.0, -0.1)]);
        assert!(mean_cosine(&seen_outside, |i| points[i]) > 0.99);
        // A sphere in a cube: the cube faces it.
        let (mut both, normals) = cube(6000);
        both.extend(sphere(1500, Vec3::splat(0.2), 0.3));
        let found = estimated(&both, &[]);
        assert!(mean_cosine(&found[..6000], |i| -normals[i]) > 0.95);
        assert!(mean_cosine(&found[6000..], |i| (both[6000 + i] - 0.2) / 0.3) > 0.98);
    }

    #[test]
    fn estimated_normals_of_degenerate_points_are_none_or_unit() {
        assert_eq!(estimated(&[Vec3::ONE], &[]), [Vec3::ZERO]);
        assert_eq!(estimated(&[], &[]), []);
        let line: Vec<Vec3> = (0..50).map(|i| Vec3::X * i as f32).collect();
        for n in estimated(&line, &[]) {
            assert!(
                n.is_finite() && (n.length() - 1.0).abs() < 1e-5 && n.x.abs() < 1e-5,
                "{n}"
            );
        }
        assert!(
            estimated(&[Vec3::ONE; 100], &[])
                .iter()
                .all(|n| *n == Vec3::ZERO)
        );
    }
}
