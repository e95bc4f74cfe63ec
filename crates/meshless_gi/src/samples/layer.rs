//! Layer of a surface position: the space between the surface and the geometry in front of it, and
//! the solid behind it.
//!
//! The distances of [L08] Eqs. (10) and (11) separate parallel surfaces by F_squash only. A picture
//! 5 cm in front of a wall lies within the support of the wall's functions. The wall behind it then
//! gets no points of its own. Layers separate them (our addition). A layer ends half-way to the
//! first surface on either side of its position. Two positions of one layer have similar free
//! heights above them. Open occluders do not end a layer.

use crate::scene::{Geometry, Ray};
use glam::{Vec3, Vec4};

/// Largest ratio of the free heights of two positions in one layer.
const MAX_HEIGHT_RATIO: f32 = 4.0;
/// Height difference, relative to the reach, up to which only free heights separate two layers,
/// because surfaces of one solid are uneven. Rough surfaces are uneven by their relief.
const EVEN_HEIGHT: f32 = 0.15;

/// Layer of a surface position.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceLayer {
    /// Position, meters, and unit normal.
    position: Vec3,
    normal: Vec3,
    /// Height difference up to which only free heights separate it from another layer, meters.
    even_height: f32,
    /// Planes (n, d) at which the layer ends. A position p is inside if n·p + d ≥ 0. `None` if the
    /// side has no surface within reach.
    planes: [Option<Vec4>; 2],
    /// Free height above the position, meters, at most the reach.
    height: f32,
}

impl SurfaceLayer {
    /// Number of rays that [`SurfaceLayer::new`] casts.
    pub const RAYS: u64 = 2;

    /// Computes the layer of position `x` with unit normal `n`. Surfaces farther than `reach`
    /// meters along the normal do not end it.
    #[must_use]
    pub fn new(geometry: &dyn Geometry, x: Vec3, n: Vec3, reach: f32) -> Self {
        let height = free_height(geometry, x, n, reach);
        let depth = free_height(geometry, x, -n, reach);
        let end = |side: Vec3, distance: f32| {
            (distance < reach).then(|| (-side).extend(side.dot(x) + 0.5 * distance))
        };
        Self {
            position: x,
            normal: n,
            even_height: (EVEN_HEIGHT * reach).max(geometry.surface_relief(x)),
            planes: [end(n, height), end(-n, depth)],
            height,
        }
    }

    /// Returns `true` if a position with this free height, in meters with the same reach, can
    /// belong to the layer.
    #[must_use]
    pub fn has_similar_height(&self, height: f32) -> bool {
        has_similar_height(self.height, height)
    }

    /// Returns `true` if the position `x` with unit normal `n` has about the same height as the
    /// layer's position.
    #[must_use]
    pub fn is_level_with(&self, x: Vec3, n: Vec3) -> bool {
        let way = x - self.position;
        way.dot(n).abs().max(way.dot(self.normal).abs()) <= self.even_height
    }

    /// Returns `true` if both layers are the same. Their reaches must be equal.
    #[must_use]
    pub fn is_shared_with(&self, other: &Self) -> bool {
        has_similar_height(self.height, other.height)
            && (self.is_level_with(other.position, other.normal)
                || self.contains(other.position) && other.contains(self.position))
    }

    /// Returns the planes (n, d) at which the layer ends.
    pub fn planes(&self) -> impl Iterator<Item = Vec4> + '_ {
        self.planes.iter().copied().flatten()
    }

    /// Returns `true` if `p` (meters) lies between the ends of the layer.
    #[must_use]
    pub fn contains(&self, p: Vec3) -> bool {
        self.planes().all(|plane| plane.dot(p.extend(1.0)) >= 0.0)
    }
}

/// Computes the distance in meters from a surface at `x` to the first surface in the direction `n`,
/// at most `reach`. The relief of a rough surface around `x` does not count.
#[must_use]
pub fn free_height(geometry: &dyn Geometry, x: Vec3, n: Vec3, reach: f32) -> f32 {
    let lift = geometry.ray_offset(x) + geometry.surface_relief(x);
    let ray = Ray::segment(x + n * lift, n, reach);
    let hit = geometry.cast(&ray);
    hit.map_or(reach, |hit| (lift + hit.t).min(reach))
}

/// Returns `true` if positions with free heights `a` and `b`, in meters with the same reach, can
/// belong to one layer.
#[must_use]
pub fn has_similar_height(a: f32, b: f32) -> bool {
    a.max(b) <= MAX_HEIGHT_RATIO * a.min(b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Material, TriangleMesh};

    /// Creates squares of 2 m by 2 m that face up, at these heights.
    fn squares(heights: &[f32]) -> TriangleMesh {
        let corner = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
        let triangles: Vec<[Vec3; 3]> = heights
            .iter()
            .flat_map(|&y| {
                let [a, b] = [corner(-1.0, y, 1.0), corner(1.0, y, 1.0)];
                let [c, d] = [corner(1.0, y, -1.0), corner(-1.0, y, -1.0)];
                [[a, b, c], [a, c, d]]
            })
            .collect();
        let count = triangles.len();
        TriangleMesh::new(triangles, vec![0; count], vec![Material::default()])
    }

    #[test]
    fn layer_ends_half_way_to_surfaces_in_front_and_behind() {
        let mesh = squares(&[-0.1, 0.0, 0.2]);
        let layer = SurfaceLayer::new(&mesh, Vec3::ZERO, Vec3::Y, 0.5);
        assert!((layer.height - 0.2).abs() < 1e-4, "{}", layer.height);
        assert_eq!(layer.planes().count(), 2);
        for (y, inside) in [(-0.06, false), (-0.04, true), (0.09, true), (0.11, false)] {
            assert_eq!(layer.contains(Vec3::new(0.3, y, 0.0)), inside, "{y}");
        }
    }

    #[test]
    fn layer_does_not_end_at_surfaces_out_of_reach() {
        let mesh = squares(&[-0.1, 0.0, 0.2]);
        let layer = SurfaceLayer::new(&mesh, Vec3::ZERO, Vec3::Y, 0.05);
        assert_eq!((layer.height, layer.planes().count()), (0.05, 0));
        assert!(layer.contains(Vec3::Y));
    }

    #[test]
    fn layers_of_even_surface_are_shared() {
        let mesh = squares(&[-0.1, 0.0, 0.2]);
        let layer = |x: f32, y: f32| SurfaceLayer::new(&mesh, Vec3::new(x, y, 0.0), Vec3::Y, 0.5);
        let own = layer(0.0, 0.0);
        assert!(own.is_shared_with(&layer(0.3, 0.0)));
        assert!(
            !own.is_shared_with(&layer(0.3, 0.2)),
            "the top of the surface above"
        );
        assert!(!own.is_shared_with(&layer(0.3, -0.1)), "under the floor");
    }

    #[test]
    fn free_heights_are_similar_up_to_fourfold_ratio() {
        assert!(has_similar_height(0.1, 0.39) && has_similar_height(0.39, 0.1));
        assert!(!has_similar_height(0.1, 0.41) && !has_similar_height(0.41, 0.1));
    }
}
