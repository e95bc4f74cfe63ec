//! Visibility between surface positions.

use crate::scene::{Geometry, Ray};
use glam::Vec3;

/// Height above the surface, in radii, from which a function looks: over gravel, not over walls.
pub(super) const ORIGIN_HEIGHT: f32 = 0.1;

/// Height of the visibility origin above the center (x, n) of a function with this radius, in
/// meters. It sees over gravel and around bends, and is at most half-way to the geometry above.
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

/// Height from which the center (x, n) of a function with this radius looks at its own support, in
/// meters. It is [`visibility_origin_height`] on a rough surface, where the next cell of a bend
/// would hide all that lies behind it. On triangles it is the surface itself: a higher origin would
/// see over sills and ledges to surfaces with other light.
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
    /// Viewer at surface position `x` with unit normal `n`, for functions up to this radius. Casts
    /// one ray.
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

    /// Visibility origin for a function of this radius, meters.
    pub fn origin(&self, radius: f32) -> Vec3 {
        self.position + self.normal * self.height(radius)
    }

    /// Height of the origin above the surface, meters. See [`visibility_origin_height`].
    fn height(&self, radius: f32) -> f32 {
        let high = (ORIGIN_HEIGHT * radius).max(self.lift);
        match self.free < 2.0 * high {
            true => 0.5 * self.free,
            false => high,
        }
    }
}
