//! The two hierarchies of a triangle mesh: the flat [`Bvh`] of the frame's shadow rays, and the one
//! with a single triangle per leaf for the bake's rays. Both are built as binary trees of obvhs.
//! Its types are private to the scene module. Vectors are converted to arrays, because its glam may
//! be another version.
//!
//! Boxes are padded so that the box test is conservative for the watertight triangle test.
//! Contrived input can produce trees that are too deep for the fixed traversal stack. These are
//! replaced by balanced trees.

use super::bvh::{Bvh, BvhNode, BvhTriangle};
use glam::Vec3;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::{Boundable, BvhBuildParams};
use std::time::Duration;

/// Vertices of a triangle, meters.
pub(super) type Corners = [Vec3; 3];

/// Padding of a box on each side, relative to the scene's largest coordinate. The vertices of the
/// triangle test and the slabs of the box test are both rounded relative to that coordinate.
const PADDING: f32 = 4.0 * f32::EPSILON;
/// Largest depth of a binary tree that fits the traversal stack of [`Bvh::is_occluded`].
const MAX_DEPTH: usize = 60;
/// Largest number of triangles in a leaf of the frame's tree.
const LEAF: u32 = 4;

/// Padded box in the format of obvhs.
struct Padded(Aabb);

impl Boundable for Padded {
    fn aabb(&self) -> Aabb {
        self.0
    }
}

fn padded(triangles: &[Corners]) -> Vec<Padded> {
    let largest = triangles
        .iter()
        .flatten()
        .fold(0.0f32, |m, v| m.max(v.abs().max_element()));
    let pad = Vec3::splat(PADDING * largest.max(f32::MIN_POSITIVE / PADDING));
    let boxed = |[a, b, c]: &Corners| {
        let (min, max) = (a.min(*b).min(*c) - pad, a.max(*b).max(*c) + pad);
        Padded(Aabb::new(min.to_array().into(), max.to_array().into()))
    };
    triangles.iter().map(boxed).collect()
}

/// Builds a binary tree over triangles with at most `leaf` triangles per leaf. The tree is empty
/// without triangles, and every traversal of it finds no hit.
pub(super) fn build_binary(triangles: &[Corners], leaf: u32) -> Bvh2 {
    let boxes = padded(triangles);
    if boxes.is_empty() {
        return Bvh2::default();
    }
    if boxes.len() <= 2 {
        return balanced(&boxes, leaf);
    }
    let params = BvhBuildParams {
        max_prims_per_leaf: leaf,
        ..BvhBuildParams::medium_build()
    };
    let binary = build_bvh2(&boxes, params, &mut Duration::default());
    if depth(&binary) > MAX_DEPTH {
        return balanced(&boxes, leaf);
    }
    binary
}

impl Bvh {
    /// Builds a BVH over triangles. Returns it with the index into `triangles` of each of its
    /// triangles. The same triangles give the same BVH on any machine. Vertices must be finite.
    #[must_use]
    pub fn build(triangles: &[[Vec3; 3]]) -> (Self, Vec<u32>) {
        flatten(&build_binary(triangles, LEAF), triangles)
    }
}

impl Bvh {
    /// Returns this BVH with the triangles of occluders after its own. The `k`-th entry of
    /// `occluders` gets the number k and is open. The depth of the tree increases by one: one child
    /// of the root has the static geometry and the other has the occluders.
    #[must_use]
    pub fn with_occluders(self, occluders: &[Vec<[Vec3; 3]>]) -> Self {
        let all: Vec<Corners> = occluders.iter().flatten().copied().collect();
        let numbers: Vec<u32> = (1..)
            .zip(occluders)
            .flat_map(|(k, own)| std::iter::repeat_n(k, own.len()))
            .collect();
        let (mut moving, order) = Self::build(&all);
        for (triangle, &i) in moving.triangles.iter_mut().zip(&order) {
            triangle.occluder = numbers[i as usize];
            triangle.transmittance = 1.0;
        }
        match (self.nodes.as_slice(), moving.nodes.as_slice()) {
            (_, []) => self,
            ([], _) => moving,
            ([a, ..], [b, ..]) => {
                let corner = |f: fn(f32, f32) -> f32, a: [f32; 3], b: [f32; 3]| {
                    std::array::from_fn(|c| f(a[c], b[c]))
                };
                let root = BvhNode {
                    min: corner(f32::min, a.min, b.min),
                    first: 1,
                    max: corner(f32::max, a.max, b.max),
                    count: 0,
                };
                // The two old roots are siblings, followed by the nodes below the first and those
                // below the second.
                let (staying, count) = (self.nodes.len() as u32, self.triangles.len() as u32);
                let moved = |node: &BvhNode, nodes: u32, triangles: u32| BvhNode {
                    first: node.first + if node.count == 0 { nodes } else { triangles },
                    ..*node
                };
                let own = |node| moved(node, 2, 0);
                let other = |node| moved(node, staying + 1, count);
                let nodes = [root, own(a), other(b)].into_iter();
                let nodes = nodes.chain(self.nodes[1..].iter().map(own));
                let nodes = nodes.chain(moving.nodes[1..].iter().map(other));
                Self {
                    nodes: nodes.collect(),
                    triangles: [self.triangles, moving.triangles].concat(),
                }
            }
        }
    }
}

/// Flattens a tree: nodes breadth first, siblings after their parent, triangles in leaf order.
fn flatten(binary: &Bvh2, triangles: &[Corners]) -> (Bvh, Vec<u32>) {
    let mut bvh = Bvh {
        nodes: Vec::with_capacity(binary.nodes.len()),
        triangles: Vec::with_capacity(triangles.len()),
    };
    let mut order = Vec::with_capacity(triangles.len());
    // An empty tree has no root.
    let mut sources: Vec<usize> = (0..binary.nodes.len().min(1)).collect();
    let mut at = 0;
    while at < sources.len() {
        let node = &binary.nodes[sources[at]];
        let first = if node.prim_count == 0 {
            let child = node.first_index as usize;
            sources.extend([child, child + 1]);
            sources.len() as u32 - 2
        } else {
            let first = order.len() as u32;
            let leaf = node.first_index as usize..(node.first_index + node.prim_count) as usize;
            order.extend_from_slice(&binary.primitive_indices[leaf]);
            first
        };
        let min: [f32; 3] = node.aabb().min.to_array();
        let max: [f32; 3] = node.aabb().max.to_array();
        bvh.nodes.push(BvhNode {
            min,
            first,
            max,
            count: node.prim_count,
        });
        at += 1;
    }
    bvh.triangles.extend(order.iter().map(|&i| {
        let [a, b, c] = triangles[i as usize];
        BvhTriangle {
            a: a.to_array(),
            b: b.to_array(),
            c: c.to_array(),
            ..BvhTriangle::default()
        }
    }));
    (bvh, order)
}

/// Returns the number of nodes on the longest path from the root to a leaf.
fn depth(binary: &Bvh2) -> usize {
    let mut deepest = 0;
    let mut open = vec![(0usize, 1usize)];
    while let Some((index, depth)) = open.pop() {
        let node = &binary.nodes[index];
        deepest = deepest.max(depth);
        if node.prim_count == 0 {
            let child = node.first_index as usize;
            open.extend([(child, depth + 1), (child + 1, depth + 1)]);
        }
    }
    deepest
}

/// Builds a tree of depth ⌈log₂ n⌉ + 1 by splits at the median box center along the longest axis.
fn balanced(boxes: &[Padded], leaf: u32) -> Bvh2 {
    let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
    let mut nodes = vec![Bvh2Node::default()];
    let mut open = vec![(0usize, 0usize, boxes.len())];
    while let Some((index, from, to)) = open.pop() {
        let part = &mut order[from..to];
        let around = part
            .iter()
            .fold(Aabb::empty(), |b, &i| b.union(&boxes[i as usize].0));
        if part.len() as u32 <= leaf {
            nodes[index] = Bvh2Node::new(around, part.len() as u32, from as u32);
            continue;
        }
        let axis = around.largest_axis();
        let key = |i: u32| boxes[i as usize].0.center_axis(axis);
        part.sort_unstable_by(|&a, &b| key(a).total_cmp(&key(b)).then(a.cmp(&b)));
        let middle = from + part.len() / 2;
        let child = nodes.len();
        nodes[index] = Bvh2Node::new(around, 0, child as u32);
        nodes.extend([Bvh2Node::default(); 2]);
        open.extend([(child, from, middle), (child + 1, middle, to)]);
    }
    Bvh2 {
        nodes,
        primitive_indices: order,
        ..Bvh2::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Ray;

    /// Returns triangles with sizes and distances that grow by powers of two. Greedy builders
    /// create unbalanced trees from them.
    fn lopsided(count: usize) -> Vec<Corners> {
        let at = |i: usize| f32::powi(1.5, i as i32 % 40) + (i / 40) as f32 * 1e-3;
        (0..count)
            .map(|i| {
                [
                    Vec3::X * at(i),
                    Vec3::new(at(i), at(i) * 0.1, 0.0),
                    Vec3::new(at(i), 0.0, at(i) * 0.1),
                ]
            })
            .collect()
    }

    fn check(triangles: &[Corners], bvh: &Bvh, order: &[u32]) {
        // Each triangle occurs once, inside its leaf and all boxes above it. Siblings are adjacent
        // and come after their parent.
        let mut sorted = order.to_vec();
        sorted.sort_unstable();
        assert!(sorted.iter().copied().eq(0..triangles.len() as u32));
        let mut open = vec![(0usize, Vec3::NEG_INFINITY, Vec3::INFINITY, 1usize)];
        let mut seen = 0;
        while let Some((index, min, max, depth)) = open.pop() {
            assert!(depth <= MAX_DEPTH, "depth {depth}");
            let node = &bvh.nodes[index];
            let (a, b) = (Vec3::from_array(node.min), Vec3::from_array(node.max));
            assert!(a.cmpge(min).all() && b.cmple(max).all());
            if node.count == 0 {
                let child = node.first as usize;
                assert!(child > index && child + 1 < bvh.nodes.len());
                open.extend([(child, a, b, depth + 1), (child + 1, a, b, depth + 1)]);
            }
            for k in node.first..node.first + node.count {
                let own = triangles[order[k as usize] as usize];
                let stored = &bvh.triangles[k as usize];
                assert_eq!(own.map(|v| v.to_array()), [stored.a, stored.b, stored.c]);
                assert!(own.iter().all(|v| v.cmpgt(a).all() && v.cmplt(b).all()));
                seen += 1;
            }
        }
        assert_eq!(seen, triangles.len());
    }

    #[test]
    fn bvh_contains_all_triangles_and_has_bounded_depth() {
        for count in [0usize, 1, 2, 3, 4, 5, 9, 100, 5000] {
            let triangles = lopsided(count);
            let (bvh, order) = Bvh::build(&triangles);
            if count == 0 {
                assert!(bvh.nodes.is_empty());
                continue;
            }
            check(&triangles, &bvh, &order);
            let (fallback, order) = flatten(&balanced(&padded(&triangles), LEAF), &triangles);
            check(&triangles, &fallback, &order);
            let (single, order) = flatten(&build_binary(&triangles, 1), &triangles);
            check(&triangles, &single, &order);
            assert!(single.nodes.iter().all(|node| node.count <= 1));
            assert!(depth(&balanced(&padded(&triangles), 1)) <= 2 + count.ilog2() as usize);
            assert_eq!(Bvh::build(&triangles).0, bvh, "two builds differ");
        }
    }

    #[test]
    fn bvh_orders_occluders_after_static_triangles() {
        let wall = |x: f32, from: f32, to: f32| {
            let at = |y, z| Vec3::new(x, y, z);
            vec![
                [at(0.0, from), at(2.0, from), at(0.0, to)],
                [at(2.0, from), at(2.0, to), at(0.0, to)],
            ]
        };
        let level: Vec<Corners> = (0..9).flat_map(|i| wall(i as f32, 2.0, 4.0)).collect();
        let doors = [
            wall(1.5, 0.0, 2.0),
            [wall(3.25, 0.0, 2.0), wall(3.75, 0.0, 2.0)].concat(),
        ];
        let mut bvh = Bvh::build(&level).0.with_occluders(&doors);
        assert_eq!(bvh.first_occluder(), 18);
        let from = |z: f32, length| Ray::segment(Vec3::new(-1.0, 0.9, z), Vec3::X, length);
        for (length, crossed) in [(2.0, 0b00), (3.0, 0b01), (4.5, 0b11), (9.0, 0b11)] {
            assert_eq!(
                bvh.crossed_occluders(&from(1.1, length)),
                crossed,
                "{length} m"
            );
            assert_eq!(bvh.transmittance(&from(1.1, length)), 1.0);
        }
        assert_eq!(bvh.transmittance(&from(3.1, 0.5)), 1.0);
        assert_eq!(bvh.transmittance(&from(3.1, 1.5)), 0.0);
        // The ray hits two sides of the second occluder, which attenuates only once.
        bvh.set_transmittances(&[0.5, 0.25]);
        assert_eq!(bvh.transmittance(&from(1.1, 3.0)), 0.5);
        assert_eq!(bvh.transmittance(&from(1.1, 9.0)), 0.125);
        bvh.set_transmittances(&[0.0]);
        assert!(bvh.is_occluded(&from(1.1, 3.0)) && bvh.is_occluded(&from(1.1, 9.0)));
        let alone = Bvh::default().with_occluders(&doors);
        assert_eq!(alone.crossed_occluders(&from(1.1, 9.0)), 0b11);
        assert_eq!(
            Bvh::build(&level).0.with_occluders(&[]),
            Bvh::build(&level).0
        );
    }

    #[test]
    fn bvh_coincident_triangles_build_balanced_tree() {
        let triangles = vec![[Vec3::ZERO, Vec3::X, Vec3::Y]; 3000];
        let (bvh, order) = Bvh::build(&triangles);
        check(&triangles, &bvh, &order);
        let (single, order) = flatten(&build_binary(&triangles, 1), &triangles);
        check(&triangles, &single, &order);
    }
}
