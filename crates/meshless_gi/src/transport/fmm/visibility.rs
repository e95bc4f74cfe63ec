//! Visibility between two nodes of the octree (\[G08\] §3 step 3), by rays between their points.
//! \[G08\] uses a binary result of another method. Here it is the part, between 0 and 1, of the
//! unoccluded light between the nodes.

use super::settings::FmmPoint;
use super::tree::{Tree, TreeNode};
use crate::samples::Random;
use crate::scene::Geometry;
use glam::{DVec3, Vec3};
use std::ops::Range;

/// Casts rays between nodes.
pub struct Visibility<'a> {
    /// Geometry that rays intersect.
    pub geometry: &'a dyn Geometry,
    /// The points as they were given, meters.
    pub points: &'a [FmmPoint],
    /// Rays a pair of nodes.
    pub rays: u32,
    /// Seed of the random numbers.
    pub seed: u64,
}

impl Visibility<'_> {
    /// True where nothing lies between the two points of the tree. Nearer than rays can start
    /// apart, nothing does.
    fn open(&self, tree: &Tree, a: usize, b: usize) -> bool {
        let lifted = |i: usize| {
            let p = &self.points[tree.order[i] as usize];
            let n = tree.points[i].normal.as_vec3();
            let lift = self.geometry.ray_offset(p.position);
            (p.position + n * lift, lift)
        };
        let ((from, la), (to, lb)): ((Vec3, f32), (Vec3, f32)) = (lifted(a), lifted(b));
        from.distance(to) <= 2.0 * (la + lb) || !self.geometry.occluded(from, to)
    }

    /// The part of the light from the sources of node `b` that arrives at the receivers of `a`, in
    /// [0, 1]: the kernel's mean over pairs of points that see each other, by its mean over all; 0
    /// where no light would go even so. Also how many rays it took. The same for any order of
    /// calls.
    #[must_use]
    pub fn part(&self, tree: &Tree, a: usize, b: usize) -> (f32, u64) {
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
            // Pairs that look away from each other, or the wrong way round, say nothing: others are
            // drawn instead.
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
        // Few pairs, or so few that look at each other that none of them was drawn: all of those,
        // or as many as there are rays, evenly.
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

    /// Adds a receiver and a source, if light goes between them where nothing is in the way.
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
        if self.open(tree, i, j) {
            sum.seen += weight;
        }
    }
}

/// The kernel between a receiver and a source and the source's surface, within bounds: near
/// neighbors are not to outweigh all. None where no light goes between them.
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

/// Pairs of points that are looked at one after another, at most, where none of those drawn
/// exchange light. Leaves have fewer, but where points coincide.
const MAX_PAIRS: u64 = 1 << 16;

/// Result of the rays of a pair of nodes.
#[derive(Default)]
struct Sum {
    /// The kernel between the pairs that see each other.
    seen: f64,
    /// Between all.
    whole: f64,
    /// Number of pairs, one ray each.
    rays: u64,
}

fn radius_square(a: &TreeNode, b: &TreeNode) -> f64 {
    (a.radius + b.radius).powi(2)
}
