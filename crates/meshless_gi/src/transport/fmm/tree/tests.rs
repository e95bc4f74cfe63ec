//! Tests of `tree`.

use super::*;
use crate::samples::Random;
use glam::Vec3;

fn points(count: usize, normal: impl Fn(Vec3) -> Vec3) -> Vec<FmmPoint> {
    let mut random = Random::new(1, 1, 1);
    (0..count)
        .map(|_| {
            let v = Vec3::from_array(std::array::from_fn(|_| random.unit() - 0.5));
            FmmPoint {
                position: 7.0 * v.normalize() - Vec3::new(100.0, 0.0, 3.0),
                normal: normal(v),
                weight: 0.5,
                receives: true,
            }
        })
        .collect()
}

/// Checks all invariants of a tree.
fn check(tree: &Tree, input: &[FmmPoint], leaf: usize) {
    let mut seen = vec![false; input.len()];
    for (p, &i) in tree.points.iter().zip(&tree.order) {
        assert!(!std::mem::replace(&mut seen[i as usize], true));
        let meters = p.position * tree.side + tree.corner;
        let off = meters.distance(input[i as usize].position.as_dvec3());
        assert!(off <= 1e-12 * tree.corner.length().max(tree.side));
    }
    for (at, node) in tree.nodes.iter().enumerate() {
        let deepest = node.radius <= COINCIDENT;
        assert!(!node.is_leaf() || node.len() <= leaf || deepest, "{node:?}");
        let mut next = node.start;
        for c in node.child_range() {
            let child = &tree.nodes[c];
            assert_eq!((child.start, child.parent), (next, at as u32));
            assert!(!child.is_empty());
            next = child.end;
        }
        assert!(node.is_leaf() || next == node.end);
        for p in &tree.points[node.points()] {
            assert!(p.position.distance(node.center) <= node.radius * (1.0 + 1e-12));
            assert!(p.normal.distance(node.axis) <= node.spread + 1e-12 || node.spread == 2.0);
            let h = p.position.dot(node.axis);
            assert!(node.slab[0] <= h && h <= node.slab[1]);
        }
        let d = DVec3::new(0.3, -0.5, 0.8);
        let own = tree.points[node.points()].iter();
        let lowest = own.fold(f64::INFINITY, |l, p| l.min(d.dot(p.position)));
        assert!(tree.all_beyond(at, d, lowest) && !tree.all_beyond(at, d, lowest + 1e-9));
    }
    assert!(tree.levels() <= 3 + MAX_DEPTH as usize);
}

#[test]
fn octree_leaves_are_bounded_and_contain_all_points() {
    for (count, leaf) in [(0, 4), (1, 1), (2, 1), (9, 4), (3000, 10)] {
        for normal in [|v: Vec3| v.normalize(), |_| Vec3::Y] {
            let input = points(count, normal);
            let tree = Tree::new(&input, leaf);
            assert_eq!(tree.points.len(), count);
            check(&tree, &input, leaf);
        }
    }
}

#[test]
fn octree_coincident_points_share_leaf_and_zero_normals_are_skipped() {
    let mut input = points(1000, |v| v.normalize());
    for p in &mut input[100..600] {
        (p.position, p.normal) = (Vec3::ONE, Vec3::Z);
    }
    for p in &mut input[600..700] {
        p.normal = Vec3::ZERO;
    }
    // Points 1e-7 apart at the origin, where single precision distinguishes them.
    for (i, p) in input[700..800].iter_mut().enumerate() {
        (p.position, p.normal) = (Vec3::splat(i as f32 * 1e-12), Vec3::Z);
    }
    let tree = Tree::new(&input, 8);
    assert_eq!(tree.points.len(), 900);
    check(&tree, &input, 8);
    assert!(tree.nodes.iter().any(|n| n.is_leaf() && n.len() >= 500));
}

#[test]
fn octree_splits_differing_directions_but_not_directions_near_an_axis() {
    let mut random = Random::new(3, 1, 1);
    let mut noise = || 1e-6 * (random.unit() - 0.5);
    for axis in [Vec3::X, Vec3::NEG_Y, Vec3::Z] {
        let near: Vec<_> = (0..50)
            .map(|_| (axis + Vec3::new(noise(), noise(), noise())).as_dvec3())
            .collect();
        assert!(
            near.iter()
                .all(|n| face(*n) == face(near[0]) && ninth_of_face(*n) == 4)
        );
    }
    let input = points(5000, |v| v.normalize());
    let tree = Tree::new(&input, 10);
    let wide = tree.nodes.iter().filter(|n| n.is_leaf() && n.spread > 0.6);
    assert_eq!(wide.count(), 0);
    assert_eq!(tree.nodes[0].children, 6);
}
