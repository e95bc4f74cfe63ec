//! Openness: the harmonic mean distance to nearby geometry over the hemisphere ([L08] §2.3). Coarse
//! points belong at positions of large openness. Tight corners are left to finer levels.

use super::{Random, gather_direction, tangents};
use crate::scene::{Geometry, Ray};
use glam::{Vec2, Vec3};

/// Number of rays per candidate.
pub const OPENNESS_RAYS: u32 = 32;

/// Computes the harmonic mean distance in meters over the hemisphere of `n` at `x`, with rays of
/// length 3 `radius` (\[L08\] §2.3). Rays without a hit count with their full length.
#[must_use]
pub fn openness(
    geometry: &dyn Geometry,
    x: Vec3,
    n: Vec3,
    radius: f32,
    random: &mut Random,
) -> f32 {
    let reach = 3.0 * radius;
    let (t, b) = tangents(n);
    let start = x + n * geometry.ray_offset(x);
    let shift = Vec2::new(random.unit(), random.unit());
    let mut inverse = 0.0;
    for i in 0..OPENNESS_RAYS {
        let (d, _) = gather_direction(i, OPENNESS_RAYS, shift);
        let ray = Ray::segment(start, (t * d.x + b * d.y + n * d.z).normalize(), reach);
        let distance = geometry.cast(&ray).map_or(reach, |hit| hit.t);
        inverse += 1.0 / distance.max(1e-6 * reach);
    }
    OPENNESS_RAYS as f32 / inverse
}
