//! Visibility between surface positions.

use crate::scene::{Geometry, Ray};
use glam::Vec3;

/// Height of the visibility origin above the surface, in radii. Rays from it pass over gravel, not
/// over walls.
pub(super) const ORIGIN_HEIGHT: f32 = 0.1;

/// Computes the height of the visibility origin above the center (x, n) of a function with this
/// radius, in meters. Rays from it pass over gravel and around bends. The height is at most half
/// the distance to the geometry above. Adds the rays cast to `rays`.
pub(super) fn visibility_origin_height(
    geometry: &dyn Geometry,
    x: Vec3,
    n: Vec3,
    radius: f32,
    rays: &mut u64,
) -> f32 {
    *rays += 1;
    Viewer::new(geometry, x, n, radius).height(radius)
}

/// Computes the height above the center (x, n) at which rays to a function's own support start, in
/// meters. On a rough surface it is [`visibility_origin_height`]: the next cell of a bend would
/// occlude everything behind it. On triangles it is the surface itself. From a higher origin,
/// surfaces with other light behind sills and ledges would be visible.
pub(super) fn support_origin_height(
    geometry: &dyn Geometry,
    x: Vec3,
    n: Vec3,
    radius: f32,
    rays: &mut u64,
) -> f32 {
    let lift = geometry.ray_offset(x);
    match geometry.surface_relief(x) > 0.0 {
        true => visibility_origin_height(geometry, x, n, radius, rays).max(lift),
        false => lift,
    }
}

/// Surface position with the free height above it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Viewer {
    /// Position, meters, and unit normal.
    position: Vec3,
    normal: Vec3,
    /// Smallest height above the surface at which rays start, meters.
    lift: f32,
    /// Free height above `lift`, meters.
    free: f32,
}

impl Viewer {
    /// Creates a viewer at surface position `x` with unit normal `n`, for functions up to this
    /// radius. Casts one ray.
    pub fn new(geometry: &dyn Geometry, x: Vec3, n: Vec3, radius: f32) -> Self {
        let lift = geometry.ray_offset(x);
        let high = (ORIGIN_HEIGHT * radius).max(lift);
        let hit = geometry.cast(&Ray::segment(x + n * lift, n, 2.0 * high));
        Self {
            position: x,
            normal: n,
            lift,
            free: hit.map_or(f32::INFINITY, |hit| hit.t),
        }
    }

    /// Returns the visibility origin for a function of this radius, meters.
    pub fn origin(&self, radius: f32) -> Vec3 {
        self.position + self.normal * self.height(radius)
    }

    /// Returns the height of the origin above the surface, meters. See
    /// [`visibility_origin_height`].
    fn height(&self, radius: f32) -> f32 {
        let high = (ORIGIN_HEIGHT * radius).max(self.lift);
        match self.free < 2.0 * high {
            true => 0.5 * self.free,
            false => high,
        }
    }
}
