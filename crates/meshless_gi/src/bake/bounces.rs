//! Fifth stage: energy bound, then baked bounces.

use super::assembly::Assembled;
use super::context::BakeContext;
use super::{BakeError, BakeSettings, BakeStage, BakeStats, BounceMode, energy};
use crate::asset::{BakeInfo, SceneData};
use crate::transport::{BounceScene, bounce_operator};
use std::time::Instant;

/// Enforces the energy bound on a scene's links and bakes later bounces if the settings have them.
pub(super) fn bound_and_bounce(
    context: &BakeContext<'_>,
    settings: &BakeSettings,
    assembled: Assembled,
    stats: &mut BakeStats,
) -> Result<SceneData, BakeError> {
    let Assembled {
        mut scene,
        rows,
        missed,
        coarse_normals,
    } = assembled;
    let energy = energy::enforce_energy_bound(&mut scene, &missed);
    stats
        .warnings
        .extend(energy::warning(&energy, stats.senders));
    stats.energy = energy;
    let began = Instant::now();
    let baked = settings.bounce_mode == BounceMode::Baked && settings.bounces > 1;
    let bounces = baked.then(|| {
        context.progress.set(BakeStage::Bounces, 0.0);
        let coarsest = scene.surfaces[scene.level(0)].iter();
        let albedo: Vec<_> = coarsest.map(|s| s.albedo.into()).collect();
        bounce_operator(
            &BounceScene {
                rows: &rows,
                normals: &coarse_normals,
                albedo: &albedo,
                parents: &scene.parents,
                senders: scene.senders(),
            },
            settings.bounces - 1,
            0.02 * settings.truncation_error,
        )
    });
    stats.seconds.bounces = began.elapsed().as_secs_f64();
    if context.progress.is_canceled() {
        return Err(BakeError::Canceled);
    }
    let info = BakeInfo {
        energy,
        ..scene.info
    };
    Ok(SceneData {
        bounces,
        info,
        ..scene
    })
}
