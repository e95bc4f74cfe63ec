//! Visibility between two nodes of the octree (\[G08\] §3 step 3), by rays between their points.
//! \[G08\] uses a binary result of another method. Here it is the visible fraction, between 0 and
//! 1, of the unoccluded light between the nodes.

use super::settings::FmmPoint;
use super::tree::{Tree, TreeNode};
use crate::samples::Random;
use crate::scene::Geometry;
use glam::{DVec3, Vec3};
use std::ops::Range;

/// Visibility tests between nodes by rays.
pub struct Visibility<'a> {
    /// Geometry that rays intersect.
    pub geometry: &'a dyn Geometry,
    /// Input points, in meters.
    pub points: &'a [FmmPoint],
    /// Number of rays per pair of nodes.
    pub rays: u32,
    /// Seed of the random numbers.
    pub seed: u64,
}

impl Visibility<'_> {
    /// Returns `true` if the segment between two points of the tree is not occluded. Points closer
    /// than twice the sum of their ray offsets are always mutually visible.
    fn is_visible(&self, tree: &Tree, a: usize, b: usize) -> bool {
        let lifted = |i: usize| {
            let p = &self.points[tree.order[i] as usize];
            let n = tree.points[i].normal.as_vec3();
            let lift = self.geometry.ray_offset(p.position);
            (p.position + n * lift, lift)
        };
        let ((from, la), (to, lb)): ((Vec3, f32), (Vec3, f32)) = (lifted(a), lifted(b));
        from.distance(to) <= 2.0 * (la + lb) || !self.geometry.is_occluded(from, to)
    }

    /// Returns the fraction of the light from the sources of node `b` that arrives at the receivers
    /// of `a`, in [0, 1]. Also returns the number of rays. The fraction is the kernel's mean over
    /// mutually visible pairs of points over its mean over all pairs. 0 if the unoccluded light is
    /// zero. The result does not depend on the order of calls.
    #[must_use]
    pub fn visible_fraction(&self, tree: &Tree, a: usize, b: usize) -> (f32, u64) {
        let (na, nb) = (&tree.nodes[a], &tree.nodes[b]);
        let node_pairs = u64::from(na.receivers) * u64::from(nb.sources);
        let range =
            |leaf: bool, some: Range<usize>, all: Range<usize>| if leaf { some } else { all };
        let xs = range(na.is_leaf(), na.receiver_range(), na.points());
        let ys = range(nb.is_leaf(), nb.source_range(), nb.points());
        let pairs = xs.len() as u64 * ys.len() as u64;
        let at = |k: u64| {
            let (i, j) = (k % xs.len() as u64, k / xs.len() as u64);
            (xs.start + i as usize, ys.start + j as usize)
        };
        let max = 16 * u64::from(self.rays);
        let mut sum = Sum::default();
        if node_pairs > u64::from(self.rays) || pairs > max {
            let mut random = Random::new(self.seed, a as u64, b as u64);
            // Pairs that face away from each other or have the wrong roles carry no information.
            // Others are drawn instead.
            for _ in 0..max {
                let pair = (random.below(xs.len()), random.below(ys.len()));
                self.add(
                    &mut sum,
                    tree,
                    (xs.start + pair.0, ys.start + pair.1),
                    (na, nb),
                );
                if sum.rays == u64::from(self.rays) {
                    break;
                }
            }
        }
        // Few pairs, or none of the drawn pairs face each other: all pairs that do, or an even
        // selection of as many as there are rays.
        if sum.rays == 0 {
            let looks = |pair: &(usize, usize)| weight(tree, *pair, (na, nb)).is_some();
            let found: Vec<_> = (0..pairs.min(MAX_PAIRS)).map(at).filter(looks).collect();
            let some = found.len().min(self.rays as usize);
            for k in 0..some {
                let pair = found[k * found.len() / some];
                self.add(&mut sum, tree, pair, (na, nb));
            }
        }
        if sum.whole <= 0.0 {
            return (0.0, sum.rays);
        }
        ((sum.seen / sum.whole) as f32, sum.rays)
    }

    /// Adds a pair of receiver and source if its unoccluded light is positive.
    fn add(
        &self,
        sum: &mut Sum,
        tree: &Tree,
        (i, j): (usize, usize),
        nodes: (&TreeNode, &TreeNode),
    ) {
        let Some(weight) = weight(tree, (i, j), nodes) else {
            return;
        };
        sum.rays += 1;
        sum.whole += weight;
        if self.is_visible(tree, i, j) {
            sum.seen += weight;
        }
    }
}

/// Returns the kernel between a receiver and a source times the source's surface area. It is
/// clamped, so that close neighbors do not dominate. Returns `None` if the pair exchanges no light.
fn weight(tree: &Tree, (i, j): (usize, usize), (na, nb): (&TreeNode, &TreeNode)) -> Option<f64> {
    let (x, y) = (&tree.points[i], &tree.points[j]);
    let r: DVec3 = x.position - y.position;
    let cosines = y.normal.dot(r).max(0.0) * (-x.normal.dot(r)).max(0.0);
    let square = r.length_squared();
    if !x.receives || y.weight <= 0.0 || cosines <= 0.0 || square <= 0.0 {
        return None;
    }
    let near = square.max(0.25 * radius_square(na, nb));
    Some(cosines / (near * near) * y.weight)
}

/// Maximum number of pairs of points that are tested in sequence if none of the drawn pairs
/// exchanges light. Leaves have fewer pairs, except if points coincide.
const MAX_PAIRS: u64 = 1 << 16;

/// Result of the rays of a pair of nodes.
#[derive(Default)]
struct Sum {
    /// Sum of the kernel over mutually visible pairs.
    seen: f64,
    /// Sum over all pairs.
    whole: f64,
    /// Number of pairs, one ray each.
    rays: u64,
}

fn radius_square(a: &TreeNode, b: &TreeNode) -> f64 {
    (a.radius + b.radius).powi(2)
}
