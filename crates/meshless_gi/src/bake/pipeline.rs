//! Stages of a bake. Each is a function from the result of the previous stage to its own.

use super::assembly::{assemble, describe, estimate};
use super::bounces::bake_bounces;
use super::closed_form::row_deviation;
use super::context::BakeContext;
use super::energy::bound_energy;
use super::fmm::build_octree;
use super::packing::pack_rows;
use super::point_set::build_points;
use super::quality_level::QualityParameters;
use super::survey::survey;
use super::transport_stage::build_transport;
use super::visibility::bake_soft_shadows;
use super::{BakeError, BakeOrigin, BakeSource, BakeStats, Baked, Progress, Recipe, StageSeconds};
use crate::asset::BakedScene;
use std::time::Instant;

/// Bakes until the recipe's target error is met. Bakes once without a target.
pub(super) fn bake_to_target(
    source: &BakeSource<'_>,
    recipe: &Recipe,
    origin: &BakeOrigin,
    progress: &Progress,
) -> Result<Baked, BakeError> {
    let context = BakeContext {
        source,
        recipe,
        origin,
        progress,
    };
    let Some(target) = recipe.target_nrmse else {
        return bake_once(&context, &recipe.preset.parameters());
    };
    let began = Instant::now();
    let mut best: Option<Baked> = None;
    let error = |baked: &Baked| baked.scene.info().estimated_nrmse;
    for quality in QualityParameters::refinement_steps(target) {
        let baked = bake_once(&context, &quality)?;
        let met = error(&baked) <= target;
        // A recipe that fixes every parameter of the quality levels repeats the same bake.
        let repeats =
            best.as_ref().map(|b| &b.scene.info().recipe) == Some(&baked.scene.info().recipe);
        if best.as_ref().is_none_or(|best| error(&baked) < error(best)) {
            best = Some(baked);
        }
        if met || repeats {
            break;
        }
    }
    let mut baked = best.ok_or(BakeError::Canceled)?;
    if error(&baked) > target {
        baked.stats.warnings.push(format!(
            "the estimated error is {:.2} %, above the target of {:.2} %; this is the best of all quality levels up to the finest",
            100.0 * error(&baked),
            100.0 * target
        ));
    }
    baked.stats.seconds.total = began.elapsed().as_secs_f64();
    Ok(baked)
}

/// Runs all stages once.
fn bake_once(context: &BakeContext<'_>, quality: &QualityParameters) -> Result<Baked, BakeError> {
    let began = Instant::now();
    let (survey, survey_cost) = survey(context, quality)?;
    let (points, points_cost) = build_points(context, &survey)?;
    let (transport, transport_cost) = build_transport(context, &survey, points)?;
    let (octree, octree_cost) = build_octree(context, &survey, &transport)?;
    let (packed, packing_cost) = pack_rows(context, &survey, transport, octree.as_ref())?;
    let (bounded, energy_cost) = bound_energy(&packed, octree.as_ref());
    let settings = &survey.settings;
    let (bounces, bounces_cost) = bake_bounces(context, settings, &packed, &bounded)?;
    let (visibility, visibility_cost) = bake_soft_shadows(context, settings, &packed.linked)?;
    let octree_deviation = octree.as_ref().map_or([0.0; 2], |octree| octree.deviation);
    let (source, surfaces) = (context.source, bounded.surfaces);
    let (scene, missed, facts) = assemble(source, packed, surfaces, octree, bounces, visibility);
    let rows = row_deviation(&scene, &missed);
    let energy = (bounded.gain).energy([0, 1].map(|k| f32::max(rows[k], octree_deviation[k])));
    // The estimate is in proportion to the bake of points and rows.
    let row_costs = [&survey_cost, &points_cost, &transport_cost, &packing_cost];
    let row_rays = row_costs.iter().map(|cost| cost.rays).sum();
    let (estimates, estimate_cost) = estimate(context, &survey, &scene, row_rays)?;
    let other_costs = [
        &octree_cost,
        &energy_cost,
        &bounces_cost,
        &visibility_cost,
        &estimate_cost,
    ];
    let costs = row_costs.into_iter().chain(other_costs);
    let rays = costs.clone().map(|cost| cost.rays).sum();
    let warnings = costs.flat_map(|cost| cost.warnings.clone()).collect();
    let info = describe(context, &survey, &scene, &facts, energy, &estimates, rays);
    let seconds = StageSeconds {
        points: survey_cost.seconds + points_cost.seconds,
        gather: facts.gather_share * transport_cost.seconds,
        refine: (1.0 - facts.gather_share) * transport_cost.seconds,
        bounces: bounces_cost.seconds,
        visibility: visibility_cost.seconds,
        probes: facts.probe_seconds,
        octree: octree_cost.seconds,
        estimate: estimate_cost.seconds,
        total: began.elapsed().as_secs_f64(),
        ..StageSeconds::default()
    };
    let stats = BakeStats::new(&scene, &info, facts, warnings, seconds);
    Ok(Baked {
        scene: BakedScene::new(scene, info),
        stats,
    })
}
