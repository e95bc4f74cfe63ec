//! Senders of the light that leaves a surface position.
//!
//! Positions that no function of the finest sender level covers have coarser senders (design D1).
//! The coarser functions are wider than the layers between the position and their centers. Only
//! functions whose center is visible from the position count. A gap then does not send the light of
//! the open surface next to it. The same holds for hits near the receiver, which can lie in gaps.
//! The back of a single-sided surface is black and has zero senders.

use super::visibility::Viewer;
use super::weight::{kernel, reach};
use super::{Hierarchy, LevelBasis, WeightEntry};
use crate::scene::Geometry;
use glam::Vec3;

/// Ray length, relative to the radius of the functions at the hit, below which visibility from the
/// hit is tested. A near hit can lie in a gap that its functions do not reach into.
const NEAR: f32 = 0.5;

/// Hit of a gather ray.
#[derive(Clone, Copy, Debug)]
pub struct GatherHit {
    /// Position, meters.
    pub position: Vec3,
    /// Unit normal on the side of the ray.
    pub normal: Vec3,
    /// Length of the ray, meters.
    pub distance: f32,
    /// `true` if the hit belongs to the senders on emitters.
    pub is_emitter: bool,
    /// `false` on the back of a single-sided surface.
    pub is_lit: bool,
}

impl Hierarchy {
    /// Computes the senders of a hit among the first `levels` levels, with weights that sum to one.
    /// They belong to the finest level that covers the hit. `near` is the list of the finest
    /// level's grid at the position. Replaces `out` by indices among all points. Returns `false` if
    /// the hit has zero senders.
    #[inline]
    pub fn hit_senders(
        &self,
        geometry: &dyn Geometry,
        levels: usize,
        near: &[u32],
        hit: &GatherHit,
        out: &mut Vec<WeightEntry>,
    ) -> bool {
        if !hit.is_lit {
            out.clear();
            return false;
        }
        let finest = levels - 1;
        let (x, n) = (hit.position, hit.normal);
        if self.sender_weights(finest, near, x, n, hit.is_emitter, out) {
            let radius = self.senders[finest].radius();
            if hit.distance < NEAR * radius {
                let viewer = Viewer::new(geometry, x, n, radius);
                self.retain_visible(geometry, finest, &viewer, out);
            }
            if !out.is_empty() {
                self.offset(finest, out);
                return true;
            }
        }
        self.coarse_senders(geometry, levels, hit, out)
    }

    /// Computes the senders of a hit on each of the first `levels` levels (\[L08\] Eq. (16)). See
    /// [`hit_senders`](Self::hit_senders). Weights sum to one on each level that covers the
    /// position.
    pub fn senders_of_levels(
        &self,
        levels: usize,
        hit: &GatherHit,
        out: &mut Vec<WeightEntry>,
    ) -> bool {
        let (x, n) = (hit.position, hit.normal);
        let mut level = Vec::new();
        out.clear();
        if !hit.is_lit {
            return false;
        }
        for l in (0..levels).rev() {
            let near = self.senders[l].grid.indices_near(x);
            if self.sender_weights(l, near, x, n, hit.is_emitter, &mut level) {
                self.offset(l, &mut level);
                out.append(&mut level);
            }
        }
        !out.is_empty()
    }

    /// Implements [`hit_senders`](Self::hit_senders) for a position that the finest level does not
    /// cover.
    #[cold]
    fn coarse_senders(
        &self,
        geometry: &dyn Geometry,
        levels: usize,
        hit: &GatherHit,
        out: &mut Vec<WeightEntry>,
    ) -> bool {
        let (x, n) = (hit.position, hit.normal);
        let radii = self.senders[..levels].iter().map(LevelBasis::radius);
        let viewer = Viewer::new(geometry, x, n, radii.fold(0.0, f32::max));
        for l in (0..levels - 1).rev() {
            self.raw_sender_weights(
                l,
                self.senders[l].grid.indices_near(x),
                x,
                n,
                hit.is_emitter,
                out,
            );
            self.retain_visible(geometry, l, &viewer, out);
            if !out.is_empty() {
                self.offset(l, out);
                return true;
            }
        }
        out.clear();
        out.extend(self.nearest_visible_sender(geometry, levels, hit, &viewer));
        !out.is_empty()
    }

    /// Returns the visible sender with the largest weight without clip planes, on the finest level
    /// that has one.
    fn nearest_visible_sender(
        &self,
        geometry: &dyn Geometry,
        levels: usize,
        hit: &GatherHit,
        viewer: &Viewer,
    ) -> Option<WeightEntry> {
        let (x, n) = (hit.position, hit.normal);
        (0..levels).rev().find_map(|l| {
            let level = &self.senders[l];
            let first = self.level_starts[l];
            let mut near: Vec<(f32, u32)> = Vec::new();
            for &j in level.grid.indices_near(x) {
                let point = &level.points[j as usize];
                let (cosine, squared, inside) = reach(point, x, n);
                if inside && self.is_on_emitter((first + j) as usize) == hit.is_emitter {
                    let weight = kernel(squared.sqrt() / point.radius) * cosine * cosine;
                    near.push((weight, j));
                }
            }
            near.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            let origin = viewer.origin(level.radius());
            let is_visible = |&(_, j): &(f32, u32)| {
                let end = self.origins[(first + j) as usize];
                !geometry.is_occluded(origin, end)
            };
            near.into_iter().find(is_visible).map(|(_, j)| WeightEntry {
                index: first + j,
                weight: 1.0,
            })
        })
    }

    /// Removes the senders of level `l` that are not visible from the viewer, and normalizes the
    /// remaining weights to a sum of one.
    fn retain_visible(
        &self,
        geometry: &dyn Geometry,
        l: usize,
        viewer: &Viewer,
        out: &mut Vec<WeightEntry>,
    ) {
        let origin = viewer.origin(self.senders[l].radius());
        let origins = &self.origins[self.level_starts[l] as usize..];
        out.retain(|w| !geometry.is_occluded(origin, origins[w.index as usize]));
        super::hierarchy::normalize(out);
    }

    /// Converts indices on level `l` to indices among all points.
    fn offset(&self, l: usize, out: &mut [WeightEntry]) {
        for w in out {
            w.index += self.level_starts[l];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::basis::LevelBasis;
    use crate::basis::hierarchy::origins;
    use crate::samples::Point;
    use crate::scene::{Material, TriangleMesh};

    /// Floor with a thin wall at x = 0, and two levels of functions. The wide ones are on either
    /// side of the wall, the fine one is far away.
    fn wall_between_functions() -> (TriangleMesh, Hierarchy) {
        let v = Vec3::new;
        let floor = [
            v(-3.0, 0.0, 2.0),
            v(3.0, 0.0, 2.0),
            v(3.0, 0.0, -2.0),
            v(-3.0, 0.0, -2.0),
        ];
        let wall = [
            v(0.0, 0.0, 2.0),
            v(0.0, 0.0, -2.0),
            v(0.0, 1.0, -2.0),
            v(0.0, 1.0, 2.0),
        ];
        let triangles: Vec<_> = [floor, wall]
            .into_iter()
            .flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]])
            .collect();
        let mesh = TriangleMesh::new(triangles, vec![0; 4], vec![Material::default()]);
        let level = |xs: &[f32], radius: f32| {
            let at = |&x: &f32| Point::new(v(x, 0.0, 0.0), Vec3::Y, radius);
            LevelBasis::new(xs.iter().map(at).collect(), Vec::new())
        };
        // Without planes: the weights ignore the wall.
        let senders = vec![level(&[-0.2, 0.5], 1.0), level(&[2.0], 0.3)];
        let origins = senders.iter().flat_map(|l| origins(&mesh, l)).collect();
        let hierarchy = Hierarchy {
            origins,
            levels: senders.clone(),
            senders,
            surfaces: Vec::new(),
            level_starts: vec![0, 2, 3],
            rays: 0,
            truncated: Vec::new(),
            emissive: Vec::new(),
        };
        (mesh, hierarchy)
    }

    fn far_hit(position: Vec3) -> GatherHit {
        GatherHit {
            position,
            normal: Vec3::Y,
            distance: 10.0,
            is_emitter: false,
            is_lit: true,
        }
    }

    #[test]
    fn back_of_single_sided_surface_has_no_sender() {
        let (mesh, hierarchy) = wall_between_functions();
        let front = far_hit(Vec3::new(0.1, 0.0, 0.0));
        let near = hierarchy.senders[0].grid.indices_near(front.position);
        let mut found = Vec::new();
        let mut count = |is_lit: bool| {
            let hit = GatherHit { is_lit, ..front };
            let covered = hierarchy.hit_senders(&mesh, 1, near, &hit, &mut found);
            assert_eq!(covered, !found.is_empty());
            let of_one_level = found.len();
            hierarchy.senders_of_levels(1, &hit, &mut found);
            [of_one_level, found.len()]
        };
        assert_eq!(count(true), [2, 2]);
        assert_eq!(count(false), [0, 0]);
    }

    #[test]
    fn near_hit_has_visible_senders() {
        let (mesh, hierarchy) = wall_between_functions();
        // Grid list of the coarse level alone.
        let near = hierarchy.senders[0].grid.indices_near(Vec3::ZERO);
        let mut found = Vec::new();
        let mut count = |distance: f32| {
            let hit = GatherHit {
                distance,
                ..far_hit(Vec3::new(0.1, 0.0, 0.0))
            };
            hierarchy.hit_senders(&mesh, 1, near, &hit, &mut found);
            found.len()
        };
        assert_eq!(count(10.0), 2);
        assert_eq!(count(0.1), 1, "not the one behind the wall");
    }

    #[test]
    fn coarse_senders_are_visible_from_hit() {
        let (mesh, hierarchy) = wall_between_functions();
        let mut found = Vec::new();
        let mut senders = |x: f32| {
            let hit = far_hit(Vec3::new(x, 0.0, 0.0));
            let near = hierarchy.senders[1].grid.indices_near(hit.position);
            hierarchy.hit_senders(&mesh, 2, near, &hit, &mut found);
            let sum: f32 = found.iter().map(|w| w.weight).sum();
            assert!(found.is_empty() || (sum - 1.0).abs() < 1e-5);
            found.iter().map(|w| w.index).collect::<Vec<_>>()
        };
        assert_eq!(senders(2.1), [2], "the finest level");
        assert_eq!(senders(0.1), [1], "the wall hides the nearer function");
        assert_eq!(senders(-0.1), [0]);
        assert!(senders(-2.5).is_empty());
    }

    #[test]
    fn position_without_function_takes_nearest_visible_sender() {
        let (mesh, mut hierarchy) = wall_between_functions();
        // A plane that cuts off everything except the centers.
        for level in &mut hierarchy.senders {
            level.planes = vec![[0.0, 0.0, -1.0, 0.01]];
            for point in &mut level.points {
                point.planes = 1 << 24;
            }
        }
        let hit = far_hit(Vec3::new(0.2, 0.0, 0.1));
        let near = hierarchy.senders[1].grid.indices_near(hit.position);
        let mut found = Vec::new();
        assert!(hierarchy.hit_senders(&mesh, 2, near, &hit, &mut found));
        assert_eq!(
            found,
            [WeightEntry {
                index: 1,
                weight: 1.0
            }]
        );
    }
}
