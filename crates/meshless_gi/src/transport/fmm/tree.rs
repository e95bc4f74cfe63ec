//! Adaptive octree of \[G08\] §2.5 and §3: one array, sorted by level from the root. Each leaf has
//! at most s points, except if points coincide.
//!
//! Deviation: a node whose normals differ much is divided by normals before it is divided in space.
//! The parts are the six faces of a cube of directions, and nine parts of a face. Each node then
//! has one direction, as the lists require ([`super::lists`]). A corner of a room is three nodes
//! instead of one without a direction. Each set of directions has its own octree on the same cells.
//!
//! All values are in units of the scene: its longest side is one, its smallest corner at the
//! origin.

use super::settings::FmmPoint;
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;

/// Maximum depth of the division in space. Its cells are below the resolution of single precision
/// over the scene.
pub const MAX_DEPTH: u32 = 21;
/// Distance below which two points coincide and exchange no light: six cells of the deepest
/// division. Consider two leaves of one such cell each, farther apart than that. Their radii are at
/// most 0.41 of the distance of their centers. From that separation on, leaves with any number of
/// (nearly) coincident points interact by expansions.
pub const COINCIDENT: f64 = 6.0 / (1u64 << MAX_DEPTH) as f64;
/// Cosine of the spread below which a node is not divided by normals: cos 30°.
const MIN_NORMAL_SPREAD_COSINE: f64 = 0.866;
/// Minimum size of a node. It prevents a division by zero in scaled coordinates.
const MIN_NODE_SIZE: f64 = 1.0 / (1u64 << 24) as f64;

/// Point in units of the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TreePoint {
    /// Position in the unit cube.
    pub position: DVec3,
    /// Unit normal.
    pub normal: DVec3,
    /// Surface area, in units of the scene's side squared. A point with zero area does not emit.
    pub weight: f64,
    /// `true` if the irradiance at the point is computed.
    pub receives: bool,
}

/// Node: a range of the points and their bounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TreeNode {
    /// First of its points.
    pub start: u32,
    /// One past the last.
    pub end: u32,
    /// Its first child. Children are adjacent.
    pub first_child: u32,
    /// Number of children. 0 for a leaf.
    pub children: u32,
    /// Its parent. The root is its own parent.
    pub parent: u32,
    /// Number of its points that emit: the first ones of a leaf.
    pub sources: u32,
    /// Number of its points that receive: the last ones of a leaf.
    pub receivers: u32,
    /// Smallest corner of the bounding box of its points.
    pub min: DVec3,
    /// Largest corner.
    pub max: DVec3,
    /// Center of the box and of the expansions.
    pub center: DVec3,
    /// Radius of the ball about the center that contains the points.
    pub radius: f64,
    /// Unit of length of the expansions: the radius, limited to a positive minimum.
    pub size: f64,
    /// Mean direction of the normals.
    pub axis: DVec3,
    /// Minimum and maximum of axis·y over its points: its extent along the axis.
    pub slab: [f64; 2],
    /// Maximum distance of a unit normal from the axis, as the length of the difference: 2 sin(half
    /// the angle), at most 2.
    pub spread: f64,
}

impl TreeNode {
    /// Returns the range of its points.
    #[must_use]
    pub fn points(&self) -> Range<usize> {
        self.start as usize..self.end as usize
    }

    /// Returns the number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        (self.end - self.start) as usize
    }

    /// Returns `false`: every node has points.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.start == self.end
    }

    /// Returns the points of a leaf that emit.
    #[must_use]
    pub fn source_range(&self) -> Range<usize> {
        self.start as usize..(self.start + self.sources) as usize
    }

    /// Returns the points of a leaf that receive.
    #[must_use]
    pub fn receiver_range(&self) -> Range<usize> {
        (self.end - self.receivers) as usize..self.end as usize
    }

    /// Returns the range of its children.
    #[must_use]
    pub fn child_range(&self) -> Range<usize> {
        self.first_child as usize..(self.first_child + self.children) as usize
    }

    /// Returns `true` if it has no children.
    #[must_use]
    pub fn is_leaf(&self) -> bool {
        self.children == 0
    }
}

/// The octree.
#[derive(Clone, Debug)]
pub struct Tree {
    /// Points in the order of the leaves. Points with a normal of length zero and points that
    /// neither emit nor receive are left out.
    pub points: Vec<TreePoint>,
    /// Index of each point in the input. Points of a leaf that only emit come first, those that
    /// only receive last.
    pub order: Vec<u32>,
    /// Nodes, sorted by level.
    pub nodes: Vec<TreeNode>,
    /// First node of each level, and one past the last node.
    pub level_starts: Vec<u32>,
    /// The scene's side, meters.
    pub side: f64,
    /// The scene's smallest corner, meters.
    pub corner: DVec3,
}

/// Kind of the next division of a node.
#[derive(Clone, Copy)]
enum Division {
    /// Division into the faces of the cube of directions.
    Faces,
    /// Division of a face into nine parts.
    Parts,
    /// Division into the octants of a cell, given by its corner, side and depth.
    Space(DVec3, f64, u32),
}

/// Returns the face of the cube that a direction hits.
fn face(n: DVec3) -> usize {
    let a = n.abs();
    let axis = if a.x >= a.y && a.x >= a.z {
        0
    } else if a.y >= a.z {
        1
    } else {
        2
    };
    2 * axis + usize::from(n[axis] < 0.0)
}

/// Returns the ninth of the face that a direction hits. The middle one contains the axis, so that
/// walls along the axes are not divided.
fn ninth_of_face(n: DVec3) -> usize {
    let axis = face(n) / 2;
    let of = |c: f64| {
        let t = c / n[axis].abs();
        usize::from(t > -1.0 / 3.0) + usize::from(t > 1.0 / 3.0)
    };
    of(n[(axis + 1) % 3]) * 3 + of(n[(axis + 2) % 3])
}

impl Tree {
    /// Builds the tree of points with finite values, with at most `leaf` points per leaf.
    #[must_use]
    pub fn new(input: &[FmmPoint], leaf: usize) -> Self {
        let used = |p: &FmmPoint| {
            p.normal.as_dvec3().length_squared() > 0.0 && (p.receives || p.weight > 0.0)
        };
        let order: Vec<u32> = (0..input.len() as u32)
            .filter(|&i| used(&input[i as usize]))
            .collect();
        let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for &i in &order {
            let p = input[i as usize].position.as_dvec3();
            (min, max) = (min.min(p), max.max(p));
        }
        let side = (max - min).max_element();
        let side = if side > 0.0 && side.is_finite() {
            side
        } else {
            1.0
        };
        let corner = if order.is_empty() { DVec3::ZERO } else { min };
        let points: Vec<_> = order
            .iter()
            .map(|&i| {
                let p = &input[i as usize];
                TreePoint {
                    position: (p.position.as_dvec3() - corner) / side,
                    normal: p.normal.as_dvec3().normalize(),
                    weight: f64::from(p.weight) / (side * side),
                    receives: p.receives,
                }
            })
            .collect();
        let mut tree = Self {
            points,
            order,
            nodes: Vec::new(),
            level_starts: vec![0],
            side,
            corner,
        };
        if !tree.points.is_empty() {
            tree.divide(leaf.max(1));
            tree.sort_leaves();
        }
        tree
    }

    /// Sorts the points of each leaf: those that only emit first, those that only receive last.
    fn sort_leaves(&mut self) {
        let part = |p: &TreePoint| match (p.weight > 0.0, p.receives) {
            (true, false) => 0u8,
            (true, true) => 1,
            (false, _) => 2,
        };
        let leaves = self.nodes.iter().filter(|n| n.is_leaf());
        for range in leaves.map(TreeNode::points) {
            let own = range.clone().map(|i| (self.points[i], self.order[i]));
            let mut own: Vec<_> = own.collect();
            own.sort_by_key(|(p, _)| part(p));
            for (i, (p, at)) in range.zip(own) {
                (self.points[i], self.order[i]) = (p, at);
            }
        }
    }

    /// Divides the nodes level by level.
    fn divide(&mut self, leaf: usize) {
        let whole = 0..self.points.len();
        self.nodes.push(node_of(&self.points, whole, 0));
        let mut level = vec![(0u32, Division::Faces)];
        while !level.is_empty() {
            self.level_starts.push(self.nodes.len() as u32);
            let mut below = Vec::new();
            for &(at, stage) in &level {
                self.divide_node(at as usize, stage, leaf, &mut below);
            }
            // The sums of a node do not depend on the thread that computes them.
            let (points, first) = (&self.points, self.nodes.len());
            let made: Vec<_> = below
                .par_iter()
                .map(|(range, parent, _): &(Range<usize>, u32, Division)| {
                    node_of(points, range.clone(), *parent)
                })
                .collect();
            self.nodes.extend(made);
            level = below
                .into_iter()
                .enumerate()
                .map(|(i, (_, _, stage))| ((first + i) as u32, stage))
                .collect();
        }
    }

    /// Sorts the points of a node by their part and lists the parts.
    fn divide_node(
        &mut self,
        at: usize,
        stage: Division,
        leaf: usize,
        below: &mut Vec<(Range<usize>, u32, Division)>,
    ) {
        let node = self.nodes[at];
        // Division by direction comes first, afterwards only in space. Narrow nodes are divided
        // only in space.
        let narrow = node.spread * node.spread <= 2.0 - 2.0 * MIN_NORMAL_SPREAD_COSINE;
        let mut stage = match stage {
            Division::Faces | Division::Parts if narrow => Division::Space(DVec3::ZERO, 1.0, 0),
            other => other,
        };
        if node.len() <= leaf {
            return;
        }
        let range = node.points();
        loop {
            if let Division::Space(_, _, depth) = stage
                && (depth >= MAX_DEPTH || node.radius == 0.0)
            {
                return;
            }
            let key = |p: &TreePoint| match stage {
                Division::Faces => face(p.normal),
                Division::Parts => ninth_of_face(p.normal),
                Division::Space(corner, side, _) => octant(p.position, corner, side),
            };
            let mut counts = [0usize; 10];
            for p in &self.points[range.clone()] {
                counts[key(p) + 1] += 1;
            }
            for k in 0..9 {
                counts[k + 1] += counts[k];
            }
            let next = |k: usize| match stage {
                Division::Faces => Division::Parts,
                Division::Parts => Division::Space(DVec3::ZERO, 1.0, 0),
                Division::Space(corner, side, depth) => {
                    let bit = |b: usize| if k & b != 0 { 0.5 * side } else { 0.0 };
                    let corner = corner + DVec3::new(bit(1), bit(2), bit(4));
                    Division::Space(corner, 0.5 * side, depth + 1)
                }
            };
            // All points are in one part: it gets no node of its own and is divided further.
            if let Some(k) = (0..9).find(|&k| counts[k + 1] - counts[k] == range.len()) {
                stage = next(k);
                continue;
            }
            let (mut sorted, mut order) = (
                vec![self.points[range.start]; range.len()],
                vec![0u32; range.len()],
            );
            let mut to = counts;
            for (p, &i) in self.points[range.clone()]
                .iter()
                .zip(&self.order[range.clone()])
            {
                let slot = &mut to[key(p)];
                (sorted[*slot], order[*slot]) = (*p, i);
                *slot += 1;
            }
            self.points[range.clone()].copy_from_slice(&sorted);
            self.order[range.clone()].copy_from_slice(&order);
            let first = self.level_starts[self.level_starts.len() - 1] as usize + below.len();
            let parts: Vec<_> = (0..9)
                .filter(|&k| counts[k + 1] > counts[k])
                .map(|k| {
                    let part = range.start + counts[k]..range.start + counts[k + 1];
                    (part, at as u32, next(k))
                })
                .collect();
            self.nodes[at].first_child = first as u32;
            self.nodes[at].children = parts.len() as u32;
            below.extend(parts);
            return;
        }
    }

    /// Returns the number of levels.
    #[must_use]
    pub fn levels(&self) -> usize {
        self.level_starts.len() - 1
    }

    /// Returns the nodes of a level.
    #[must_use]
    pub fn level(&self, l: usize) -> Range<usize> {
        self.level_starts[l] as usize..self.level_starts[l + 1] as usize
    }

    /// Returns `true` if d·x ≥ `min` for all of a node's points. The test is exact. A few boxes
    /// usually decide it.
    #[must_use]
    pub fn all_beyond(&self, node: usize, d: DVec3, min: f64) -> bool {
        let n = &self.nodes[node];
        let (a, b) = (d * n.min, d * n.max);
        if a.min(b).element_sum() >= min {
            return true;
        }
        if a.max(b).element_sum() < min {
            return false;
        }
        if n.is_leaf() || n.len() <= 16 {
            let points = &self.points[n.points()];
            return points.iter().all(|p| d.dot(p.position) >= min);
        }
        n.child_range().all(|c| self.all_beyond(c, d, min))
    }
}

fn octant(p: DVec3, corner: DVec3, side: f64) -> usize {
    let upper = p.cmpge(corner + DVec3::splat(0.5 * side));
    usize::from(upper.x) + 2 * usize::from(upper.y) + 4 * usize::from(upper.z)
}

/// Creates a leaf over a range of the points.
fn node_of(points: &[TreePoint], range: Range<usize>, parent: u32) -> TreeNode {
    let own = &points[range.clone()];
    let (mut min, mut max, mut sum) = (DVec3::INFINITY, DVec3::NEG_INFINITY, DVec3::ZERO);
    for p in own {
        (min, max) = (min.min(p.position), max.max(p.position));
        sum += p.normal;
    }
    let center = 0.5 * (min + max);
    let square = own
        .iter()
        .fold(0.0f64, |r, p| r.max(p.position.distance_squared(center)));
    let axis = sum.normalize_or_zero();
    let spread = match axis == DVec3::ZERO {
        true => 4.0,
        false => own
            .iter()
            .fold(0.0f64, |s, p| s.max(p.normal.distance_squared(axis))),
    };
    let slab = own.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |s, p| {
        let h = axis.dot(p.position);
        [s[0].min(h), s[1].max(h)]
    });
    TreeNode {
        start: range.start as u32,
        end: range.end as u32,
        first_child: 0,
        children: 0,
        parent,
        sources: own.iter().filter(|p| p.weight > 0.0).count() as u32,
        receivers: own.iter().filter(|p| p.receives).count() as u32,
        min,
        max,
        center,
        radius: square.sqrt(),
        size: square.sqrt().max(MIN_NODE_SIZE),
        axis,
        slab,
        spread: spread.sqrt().min(2.0),
    }
}

#[cfg(test)]
mod tests;
