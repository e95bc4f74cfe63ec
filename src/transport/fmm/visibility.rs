//! What two nodes of the octree see of each other: \[G08\] §3 step 3, by rays between their points. \[G08\] takes an answer of yes or no from a method of its own;
//! here it is a part between 0 and 1, of the light that would go between the nodes if nothing were in the way.

use super::settings::FmmPoint;
use super::tree::{Tree, TreeNode};
use crate::samples::Random;
use crate::scene::Geometry;
use glam::{DVec3, Vec3};

/// Casts rays between nodes.
pub struct Visibility<'a> {
    /// What is in the way.
    pub geometry: &'a dyn Geometry,
    /// The points as they were given, metres.
    pub points: &'a [FmmPoint],
    /// Rays a pair of nodes.
    pub rays: u32,
    /// Seed of the random numbers.
    pub seed: u64,
}

impl Visibility<'_> {
    /// True where nothing lies between the two points of the tree. Nearer than rays can start apart, nothing does.
    fn open(&self, tree: &Tree, a: usize, b: usize) -> bool {
        let lifted = |i: usize| {
            let p = &self.points[tree.order[i] as usize];
            let n = tree.points[i].normal.as_vec3();
            let lift = self.geometry.lift(p.position);
            (p.position + n * lift, lift)
        };
        let ((from, la), (to, lb)): ((Vec3, f32), (Vec3, f32)) = (lifted(a), lifted(b));
        from.distance(to) <= 2.0 * (la + lb) || !self.geometry.occluded(from, to)
    }

    /// The part of the light from the sources of node `b` that arrives at the receivers of `a`, in [0, 1]: the kernel's mean over pairs of points that see each other, by its
    /// mean over all. Also how many rays it took. The same for any order of calls.
    #[must_use]
    pub fn part(&self, tree: &Tree, a: usize, b: usize) -> (f32, u64) {
        let (na, nb) = (&tree.nodes[a], &tree.nodes[b]);
        let wanted = u64::from(na.receivers) * u64::from(nb.sources);
        let pairs = na.len() as u64 * nb.len() as u64;
        let most = 16 * u64::from(self.rays);
        let all = wanted <= u64::from(self.rays) && pairs <= most;
        let mut random = Random::new(self.seed, a as u64, b as u64);
        let (mut seen, mut whole, mut rays) = (0.0, 0.0, 0u64);
        // Pairs that look away from each other, or the wrong way round, say nothing: others are drawn in their place.
        for k in 0..if all { pairs } else { most } {
            if rays == u64::from(self.rays) {
                break;
            }
            let (i, j) = match all {
                true => (
                    (k % na.len() as u64) as usize,
                    (k / na.len() as u64) as usize,
                ),
                false => (random.below(na.len()), random.below(nb.len())),
            };
            let (i, j) = (na.points().start + i, nb.points().start + j);
            let (x, y) = (&tree.points[i], &tree.points[j]);
            if !x.receives || y.weight <= 0.0 {
                continue;
            }
            let r: DVec3 = x.position - y.position;
            let cosines = y.normal.dot(r).max(0.0) * (-x.normal.dot(r)).max(0.0);
            let square = r.length_squared();
            if cosines <= 0.0 || square <= 0.0 {
                continue;
            }
            // The kernel and the sources' surface, within bounds: near neighbours are not to outweigh all.
            let near = square.max(0.25 * radius_square(na, nb));
            let weight = cosines / (near * near) * y.weight;
            rays += 1;
            whole += weight;
            if self.open(tree, i, j) {
                seen += weight;
            }
        }
        if whole <= 0.0 {
            return (1.0, rays);
        }
        ((seen / whole) as f32, rays)
    }
}

fn radius_square(a: &TreeNode, b: &TreeNode) -> f64 {
    (a.radius + b.radius).powi(2)
}
