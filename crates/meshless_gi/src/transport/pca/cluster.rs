//! Clusters of surface points ([P14] §4.1), for principal component analysis of visibility and
//! transfer. Root points are Poisson disks of a larger radius under the 5D distance (\[L08\] Eq.
//! (11)). Each point belongs to the nearest root.
//!
//! \[P14\] prescribes a radius. A recipe here prescribes the number of points per cluster, and
//! bisection determines the radius. Roots are selected among the points, in shuffled order, until
//! no other fits. Every point then has a root nearer than the radius, with a normal less than 90°
//! from its own. A cluster is never empty.

use crate::samples::{Random, distance_5d, thin_out};
use glam::Vec3;
use rayon::prelude::*;

/// Number of bisections of the logarithm of the radius, from 1e-5 to 1e3 of the extent, to 5 %.
const HALVINGS: u32 = 9;
/// Largest number of points for which sets of roots are tried. Larger sets are sampled.
const MAX_TRIED: usize = 1 << 16;

/// Points sorted into clusters. Cluster c has the points `members[starts[c]..starts[c + 1]]`, in
/// ascending order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Clusters {
    /// Root of each cluster, an index of a point.
    pub roots: Vec<u32>,
    /// Start of each cluster's members, and the end of the last.
    pub starts: Vec<u32>,
    /// Points, cluster after cluster.
    pub members: Vec<u32>,
    /// Cluster of each point.
    pub of_point: Vec<u32>,
}

impl Clusters {
    /// Returns the number of clusters.
    #[must_use]
    pub fn len(&self) -> usize {
        self.roots.len()
    }

    /// Returns `true` if there are no points.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.roots.is_empty()
    }

    /// Returns the points of cluster `c`, ascending.
    #[must_use]
    pub fn members_of(&self, c: usize) -> &[u32] {
        &self.members[self.starts[c] as usize..self.starts[c + 1] as usize]
    }
}

/// Sorts `points`, positions in meters and unit normals, into clusters of about `target` points.
/// Surfaces with six orientations give at least six clusters. The result does not depend on the
/// number of threads.
#[must_use]
pub fn cluster(points: &[(Vec3, Vec3)], target: usize, seed: u64) -> Clusters {
    if points.is_empty() {
        return Clusters {
            starts: vec![0],
            ..Clusters::default()
        };
    }
    let order = shuffled(points.len(), seed);
    let tried = &order[..points.len().min(MAX_TRIED)];
    let count = (points.len() / target.max(1)).max(1);
    let size = extent(points).max(f32::MIN_POSITIVE);
    let (mut low, mut high) = (1e-5f32, 1e3f32);
    let mut best: Option<(usize, f32)> = None;
    for _ in 0..HALVINGS {
        let middle = (low * high).sqrt();
        let found = thin_out(points, tried, middle * size).len();
        if best.is_none_or(|(off, _)| found.abs_diff(count) < off) {
            best = Some((found.abs_diff(count), middle));
        }
        if found > count {
            low = middle;
        } else {
            high = middle;
        }
    }
    let radius = best.map_or(1.0, |(_, r)| r) * size;
    assign(points, thin_out(points, &order, radius))
}

/// Returns the numbers below `count` in shuffled order.
fn shuffled(count: usize, seed: u64) -> Vec<u32> {
    let mut order: Vec<u32> = (0..count as u32).collect();
    let mut random = Random::new(seed, 0x63_6c_75_73, 0);
    for i in (1..count).rev() {
        order.swap(i, random.below(i + 1));
    }
    order
}

/// Returns the largest edge of the bounding box of the points, in meters.
fn extent(points: &[(Vec3, Vec3)]) -> f32 {
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for (x, _) in points {
        (low, high) = (low.min(*x), high.max(*x));
    }
    (high - low).max_element()
}

/// Assigns each point to its nearest root.
fn assign(points: &[(Vec3, Vec3)], mut roots: Vec<u32>) -> Clusters {
    roots.sort_unstable();
    let of_point: Vec<u32> = points
        .par_iter()
        .with_min_len(64)
        .map(|&(x, n)| {
            let mut best = (f32::INFINITY, 0);
            for (c, &root) in roots.iter().enumerate() {
                let (y, m) = points[root as usize];
                let d = distance_5d(x, n, y, m);
                if d < best.0 {
                    best = (d, c as u32);
                }
            }
            best.1
        })
        .collect();
    let mut starts = vec![0u32; roots.len() + 1];
    for &c in &of_point {
        starts[c as usize + 1] += 1;
    }
    for c in 0..roots.len() {
        starts[c + 1] += starts[c];
    }
    let mut next = starts.clone();
    let mut members = vec![0; points.len()];
    for (i, &c) in of_point.iter().enumerate() {
        members[next[c as usize] as usize] = i as u32;
        next[c as usize] += 1;
    }
    Clusters {
        roots,
        starts,
        members,
        of_point,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Creates points on the six faces of a box of 4 × 2 × 4 m, with normals that point inward.
    fn room(count: usize) -> Vec<(Vec3, Vec3)> {
        let mut random = Random::new(5, 0, 0);
        let half = Vec3::new(2.0, 1.0, 2.0);
        (0..count)
            .map(|i| {
                let normal = [Vec3::X, Vec3::Y, Vec3::Z][i % 3] * [1.0, -1.0][i / 3 % 2];
                let mut on = || 2.0 * random.unit() - 1.0;
                let p = Vec3::new(on(), on(), on());
                let p = p - normal * p.dot(normal) - normal;
                (p * half, normal)
            })
            .collect()
    }

    #[test]
    fn clusters_have_requested_size_and_common_direction() {
        let points = room(12_000);
        for target in [50, 200, 1000] {
            let found = cluster(&points, target, 1);
            assert_eq!(found, cluster(&points, target, 1));
            let expected = points.len() / target;
            assert!(
                (found.len() as f64 / expected as f64 - 1.0).abs() < 0.3,
                "{target}: {} of {expected}",
                found.len()
            );
            for c in 0..found.len() {
                let (y, m) = points[found.roots[c] as usize];
                let members = found.members_of(c);
                assert!(members.is_sorted() && members.contains(&found.roots[c]));
                for &i in members {
                    let (x, n) = points[i as usize];
                    assert!(n.dot(m) > 0.0);
                    let own = distance_5d(x, n, y, m);
                    let nearest = found
                        .roots
                        .iter()
                        .map(|&r| distance_5d(x, n, points[r as usize].0, points[r as usize].1));
                    assert_eq!(own, nearest.fold(f32::INFINITY, f32::min));
                    assert_eq!(found.of_point[i as usize] as usize, c);
                }
            }
            assert_eq!(*found.starts.last().unwrap() as usize, points.len());
        }
    }

    #[test]
    fn clusters_of_few_points_are_few() {
        assert!(cluster(&[], 10, 0).is_empty());
        let one = cluster(&[(Vec3::ONE, Vec3::Y)], 1000, 0);
        assert_eq!((one.len(), one.members_of(0)), (1, &[0u32][..]));
        // All points at one position: one cluster per orientation.
        let positions: Vec<_> = (0..10)
            .map(|i| (Vec3::ZERO, [Vec3::X, -Vec3::X][i % 2]))
            .collect();
        let two = cluster(&positions, 1000, 0);
        assert_eq!(two.len(), 2);
        assert!((0..2).all(|c| two.members_of(c).len() == 5));
        // There are never more clusters than points.
        assert!(cluster(&room(30), 0, 0).len() <= 30);
    }
}
