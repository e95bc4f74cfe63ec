//! Test if all points of two nodes face each other. \[G08\]'s expansions have no max(0, ·). A pair
//! that faces away from each other would add light: negative if one of the two faces away, positive
//! if both do.
//!
//! Two nodes therefore interact by expansions only if all their points face each other within a
//! `slack`. Nodes whose points all face away are dropped. The rest is divided, down to pairs of
//! points in the near list, where max(0, ·) is exact.
//!
//! For a source at y with n_y = a + e, |e| ≤ spread, and a receiver at x: n_y·(x − y) = a·x − a·y +
//! e·(x − y). The slab of the node bounds a·y, and the receivers themselves bound a·x
//! ([`Tree::all_beyond`]). A wall that touches another wall's plane at any angle is still in front
//! of it.

use super::tree::{Tree, TreeNode};
use glam::DVec3;

/// Heights over a plane below this are rounding errors: points of one wall do not light each other.
/// In units of the scene.
const PLANE_TOLERANCE: f64 = 1e-6;

/// Relative orientation of two nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Facing {
    /// All points of each node are in front of all points of the other, within the slack.
    Front,
    /// All pairs face away from each other and exchange no light.
    Away,
    /// Some pairs face each other.
    Mixed,
}

/// Returns `true` if the boxes prove that no light passes between the nodes. The test is cheap and
/// conservative.
#[must_use]
pub fn boxes_face_away(a: &TreeNode, b: &TreeNode) -> bool {
    let reach = a.center.distance(b.center) + a.radius + b.radius;
    let away = |from: &TreeNode, to: &TreeNode| {
        let d = from.axis;
        let highest = (d * to.min).max(d * to.max).element_sum();
        highest <= from.slab[0] + PLANE_TOLERANCE - from.spread * reach
    };
    away(a, b) || away(b, a)
}

/// Returns the relative orientation of two nodes. It is exact except for the bound on the spread of
/// normals.
#[must_use]
pub fn facing(tree: &Tree, a: usize, b: usize, slack: f64) -> Facing {
    let (na, nb) = (&tree.nodes[a], &tree.nodes[b]);
    let distance = na.center.distance(nb.center);
    let reach = distance + na.radius + nb.radius;
    let mut front = true;
    for (from, to) in [(na, b), (nb, a)] {
        let e = from.spread * reach;
        let highest = from.slab[0] + PLANE_TOLERANCE - e;
        if tree.all_beyond(to, -from.axis, -highest) {
            return Facing::Away;
        }
        let lowest = from.slab[1] + e - PLANE_TOLERANCE - slack * distance;
        front = front && tree.all_beyond(to, from.axis, lowest);
    }
    if front { Facing::Front } else { Facing::Mixed }
}

/// Returns `true` if at least one point of leaf `b` lights one of leaf `a`.
#[must_use]
pub fn any_light(tree: &Tree, a: usize, b: usize) -> bool {
    // A plane separates most pairs that do not face each other. The rest needs all pairs.
    if facing(tree, a, b, 0.0) == Facing::Away {
        return false;
    }
    let (na, nb) = (&tree.nodes[a], &tree.nodes[b]);
    tree.points[na.receiver_range()].iter().any(|x| {
        tree.points[nb.source_range()].iter().any(|y| {
            let r: DVec3 = x.position - y.position;
            y.normal.dot(r) > 0.0 && x.normal.dot(r) < 0.0
        })
    })
}

#[cfg(test)]
mod tests {
    use super::super::settings::FmmPoint;
    use super::*;
    use crate::samples::Random;
    use glam::{Mat3, Vec3};

    /// Adds a square of side 1 about `at`, spanned by `u` and `v`.
    fn square(out: &mut Vec<FmmPoint>, at: Vec3, u: Vec3, v: Vec3, turn: Mat3) {
        let mut random = Random::new(out.len() as u64, 2, 2);
        for _ in 0..100 {
            let p = at + u * (random.unit() - 0.5) + v * (random.unit() - 0.5);
            out.push(FmmPoint {
                position: turn * p,
                normal: turn * u.cross(v),
                weight: 0.01,
                receives: true,
            });
        }
    }

    /// Two walls that meet, one opposite and one adjacent, give the same results for every
    /// rotation.
    #[test]
    fn facing_test_of_walls_is_rotation_invariant() {
        let turn = Mat3::from_axis_angle(Vec3::new(1.0, 2.0, 3.0).normalize(), 0.7);
        for turn in [Mat3::IDENTITY, turn] {
            let mut points = Vec::new();
            let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
            // A floor, a wall with normal +x that meets it, a ceiling, the wall from behind, and a
            // second floor next to the first.
            square(&mut points, 0.5 * x, x, -z, turn);
            square(&mut points, 0.5 * y, y, z, turn);
            square(&mut points, 0.5 * x + 2.0 * y, -x, -z, turn);
            square(&mut points, 3.0 * x + 0.5 * y, y, z, turn);
            square(&mut points, 5.0 * x, x, -z, turn);
            // One leaf each.
            let tree = Tree::new(&points, 100);
            let node = |k: u32| {
                let own =
                    |n: &TreeNode| n.is_leaf() && n.points().all(|i| tree.order[i] / 100 == k);
                tree.nodes.iter().position(own).expect("a leaf")
            };
            let [floor, wall, ceiling, behind, beside] = [0, 1, 2, 3, 4].map(node);
            let of = |a, b| facing(&tree, a, b, 0.0);
            assert_eq!(of(floor, wall), Facing::Front);
            assert_eq!(of(ceiling, floor), Facing::Front);
            assert_eq!(of(wall, ceiling), Facing::Front);
            assert_eq!(of(floor, behind), Facing::Away);
            assert_eq!(of(floor, beside), Facing::Away);
            assert_eq!(of(beside, behind), Facing::Front);
            for (a, b) in [(floor, wall), (floor, behind), (floor, beside)] {
                assert_eq!(any_light(&tree, a, b), of(a, b) == Facing::Front);
            }
            assert!(!boxes_face_away(&tree.nodes[floor], &tree.nodes[wall]));
        }
    }

    #[test]
    fn facing_test_of_sphere_is_mixed_and_slack_widens_it() {
        let mut random = Random::new(5, 5, 5);
        let points: Vec<_> = (0..2000)
            .map(|_| {
                let v = Vec3::from_array(std::array::from_fn(|_| random.unit() - 0.5)).normalize();
                FmmPoint {
                    position: v,
                    normal: -v,
                    weight: 0.01,
                    receives: true,
                }
            })
            .collect();
        // Inside the scene all points face each other.
        let tree = Tree::new(&points, 16);
        let leaves: Vec<_> = (0..tree.nodes.len())
            .filter(|&i| tree.nodes[i].is_leaf())
            .collect();
        let count = |tree: &Tree, slack: f64, what: Facing| {
            let pairs = leaves
                .iter()
                .flat_map(|&a| leaves.iter().map(move |&b| (a, b)));
            pairs
                // A leaf of one point does not light itself.
                .filter(|(a, b)| a != b)
                .filter(|&(a, b)| facing(tree, a, b, slack) == what)
                .count()
        };
        assert_eq!(count(&tree, 0.0, Facing::Away), 0);
        let (none, some) = (
            count(&tree, 0.0, Facing::Mixed),
            count(&tree, 0.2, Facing::Mixed),
        );
        assert!(some < none / 2, "{some} of {none}");
        // Outside, all points face away. At the ends of one leaf the bounds may be too wide.
        let mut outside = points.clone();
        outside.iter_mut().for_each(|p| p.normal = -p.normal);
        let tree = Tree::new(&outside, 16);
        let away = count(&tree, 0.0, Facing::Away);
        assert_eq!(count(&tree, 0.0, Facing::Front), 0);
        assert!(away * 2 > leaves.len().pow(2), "{away}");
    }
}
