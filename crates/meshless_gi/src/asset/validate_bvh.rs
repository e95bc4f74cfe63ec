//! Validation of a BVH. Part of [`validate`](super::validate) (design D10).

use super::scene_data::SceneData;
use super::violation::Check;
use glam::Vec3;

/// Largest depth of a BVH: the stack of a shadow ray's traversal has as many nodes.
const MAX_BVH_DEPTH: u8 = 62;

impl SceneData {
    /// Checks that the nodes are a tree and that leaves share no triangle. A traversal then visits
    /// each node and each triangle at most once. Returns the depth.
    pub(super) fn check_bvh(&self, check: &mut Check) -> u64 {
        let (nodes, triangles) = (&self.bvh.nodes, &self.bvh.triangles);
        check.section(!nodes.is_empty() || triangles.is_empty(), "bvh", || {
            format!("{} triangles, but no node", triangles.len())
        });
        // Depth plus one of each node that a parent refers to.
        let mut depths = vec![0u8; nodes.len()];
        if let Some(root) = depths.first_mut() {
            *root = 1;
        }
        let (mut deepest, mut leaves) = (0, 0u64);
        for (i, node) in nodes.iter().enumerate() {
            let depth = depths[i];
            deepest = deepest.max(depth);
            check.item(depth > 0, "bvh nodes", i, || {
                "has no parent before it".into()
            });
            let (min, max) = (Vec3::from_array(node.min), Vec3::from_array(node.max));
            check.item(
                min.is_finite() && max.is_finite() && min.cmple(max).all(),
                "bvh nodes",
                i,
                || format!("box from {min} to {max}"),
            );
            let first = node.first as usize;
            if node.count > 0 {
                leaves += u64::from(node.count);
                let end = first as u64 + u64::from(node.count);
                check.item(end <= triangles.len() as u64, "bvh nodes", i, || {
                    format!("triangles {first}..{end} of {}", triangles.len())
                });
            } else {
                let behind = first > i && first + 1 < nodes.len();
                check.item(behind, "bvh nodes", i, || format!("children at {first}"));
                check.item(depth <= MAX_BVH_DEPTH, "bvh nodes", i, || {
                    "is too deep".into()
                });
                if behind && depth <= MAX_BVH_DEPTH {
                    for child in [first, first + 1] {
                        check.item(depths[child] == 0, "bvh nodes", child, || {
                            "has two parents".into()
                        });
                        depths[child] = depth + 1;
                    }
                }
            }
            if check.is_full() {
                return 0;
            }
        }
        check.section(leaves <= triangles.len() as u64, "bvh", || {
            format!(
                "leaves have {leaves} triangles, but there are {}",
                triangles.len()
            )
        });
        for (i, t) in triangles.iter().enumerate() {
            let finite = [t.a, t.b, t.c].iter().flatten().all(|c| c.is_finite());
            check.item(finite, "bvh triangles", i, || {
                "a vertex is not finite".into()
            });
        }
        u64::from(deepest)
    }
}
