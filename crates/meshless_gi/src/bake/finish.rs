//! Last stage: the estimated error.

use super::context::BakeContext;
use super::{BakeError, BakeStats, estimate_errors};
use crate::asset::{BakeInfo, BakedScene, SceneData};
use std::time::Instant;

/// Estimates the error of each tier.
pub(super) fn estimate(
    context: &BakeContext<'_>,
    scene: SceneData,
    stats: &mut BakeStats,
) -> Result<BakedScene, BakeError> {
    let began = Instant::now();
    let scene = BakedScene::from(scene);
    let (geometry, seed) = (context.source.geometry, context.recipe.seed);
    let (estimates, rays) =
        estimate_errors(&scene, geometry, seed, context.progress).ok_or(BakeError::Canceled)?;
    stats.rays += rays;
    let data = scene.into_data();
    let mut tiers = data.info.tiers;
    for (tier, estimate) in tiers.iter_mut().zip(&estimates) {
        tier.estimated_nrmse = estimate.nrmse;
        tier.estimated_nrmse_interval = estimate.interval;
    }
    let all_links = estimates.last().copied().unwrap_or_default();
    stats.tiers.clone_from(&tiers);
    stats.estimated_nrmse = f64::from(all_links.nrmse);
    stats.estimated_nrmse_interval = f64::from(all_links.interval);
    stats.seconds.estimate = began.elapsed().as_secs_f64();
    Ok(BakedScene::from(SceneData {
        info: BakeInfo {
            estimated_nrmse: all_links.nrmse,
            estimated_nrmse_interval: all_links.interval,
            rays: stats.rays,
            tiers,
            ..data.info
        },
        ..data
    }))
}
