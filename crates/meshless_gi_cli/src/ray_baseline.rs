//! Time of a bake's gather rays alone (`--ray-baseline`), a lower bound of its time.

use super::error::ToolError;
use super::progress;
use meshless_gi::internals::bake::{BakeSettings, cast_gather_rays};
use meshless_gi::{BakeStats, BakedScene, TriangleMesh};
use serde::Serialize;
use std::time::Instant;

/// Measured time of the gather rays. The fields are keys of the statistics file.
#[derive(Clone, Copy, Serialize)]
pub struct RayBaseline {
    /// Seconds for the number of rays that the gather cast.
    pub ray_baseline_seconds: f64,
    /// Number of rays that were timed.
    pub ray_baseline_rays: u64,
    /// Total time of the bake divided by the baseline.
    pub total_over_ray_baseline: f64,
}

/// Casts the gather rays of `scene` again and times them.
pub fn measure(
    mesh: &TriangleMesh,
    scene: &BakedScene,
    stats: &BakeStats,
    threads: usize,
) -> Result<RayBaseline, ToolError> {
    let settings = BakeSettings::from_ron(&scene.info().recipe)
        .map_err(|error| ToolError::Input(format!("settings in the bake: {error}")))?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|error| ToolError::Usage(error.to_string()))?;
    let step = progress::Step::new("timing the gather rays");
    let began = Instant::now();
    let rays = pool.install(|| cast_gather_rays(mesh, scene.data(), &settings));
    let seconds = began.elapsed().as_secs_f64();
    drop(step);
    // The gather also covered receivers that got no row.
    let ray_baseline_seconds = seconds * stats.gather_rays as f64 / rays.max(1) as f64;
    Ok(RayBaseline {
        ray_baseline_seconds,
        ray_baseline_rays: rays,
        total_over_ray_baseline: stats.seconds.total / ray_baseline_seconds.max(1e-9),
    })
}
