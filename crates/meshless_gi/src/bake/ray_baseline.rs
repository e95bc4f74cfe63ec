//! Gather rays of a bake alone: a lower bound of its time.

use super::BakeSettings;
use crate::asset::SceneData;
use crate::scene::Geometry;
use crate::transport::{ReceiverRays, trace_gather_rays};
use rayon::prelude::*;

/// Casts the rays of the operator's gather and nothing else. Returns the number of rays.
#[must_use]
pub fn cast_gather_rays(
    geometry: &dyn Geometry,
    scene: &SceneData,
    settings: &BakeSettings,
) -> u64 {
    let rows = &scene.operator.rows;
    scene
        .level_starts
        .windows(2)
        .enumerate()
        .map(|(level, bounds)| {
            let rays = settings.rays_of_level(level);
            let active = (bounds[0] as usize..bounds[1] as usize)
                .into_par_iter()
                .filter(|&i| rows[i].tier != 0)
                .map(|i| {
                    let p = &scene.points[i];
                    let at = (p.x(), p.n());
                    let rays = ReceiverRays::at_center(geometry, at, i, rays, settings.seed);
                    // The hits are used, so that compilers do not remove the work.
                    std::hint::black_box(trace_gather_rays(geometry, &rays));
                })
                .count();
            active as u64 * u64::from(rays)
        })
        .sum()
}
