//! Stages of a bake. Each is a function from the result of the previous stage to its own.

use super::assembly::{Measured, Optional, assemble, describe, estimate};
use super::bounces::bake_bounces;
use super::closed_form::row_deviation;
use super::context::BakeContext;
use super::costs::Costs;
use super::energy::bound_energy;
use super::fmm::build_octree;
use super::packing::{Packed, pack_rows};
use super::point_set::build_points;
use super::quality_level::QualityParameters;
use super::survey::survey;
use super::transport_stage::build_transport;
use super::visibility::bake_soft_shadows;
use super::{BakeError, BakeSource, BakeStats, Baked, Progress, Recipe};
use crate::asset::BakedScene;
use std::time::Instant;

/// Bakes until the recipe's target error is met. Bakes once without a target.
pub(super) fn bake_to_target(
    source: &BakeSource<'_>,
    recipe: &Recipe,
    progress: &Progress,
) -> Result<Baked, BakeError> {
    let context = BakeContext {
        source,
        recipe,
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
    let optional = Optional {
        octree,
        bounces,
        visibility,
    };
    let Packed {
        linked,
        extras,
        missed,
        facts,
        ..
    } = packed;
    let scene = assemble(context.source, linked, bounded.surfaces, extras, optional);
    let rows = row_deviation(&scene, &missed);
    let deviation = [0, 1].map(|k| f32::max(rows[k], octree_deviation[k]));
    // Octree and visibility have methods of their own. Their rays do not enlarge the estimate.
    let counted = [&survey_cost, &points_cost, &transport_cost, &packing_cost];
    let rays = counted.iter().map(|cost| cost.rays).sum();
    let (estimates, estimate_cost) = estimate(context, &survey, &scene, rays)?;
    let costs = Costs {
        survey: survey_cost,
        points: points_cost,
        transport: transport_cost,
        octree: octree_cost,
        packing: packing_cost,
        energy: energy_cost,
        bounces: bounces_cost,
        visibility: visibility_cost,
        estimate: estimate_cost,
    };
    let measured = Measured {
        energy: bounded.gain.energy(deviation),
        estimates,
        rays: costs.rays(),
    };
    let info = describe(context, &survey, &scene, &facts, &measured);
    let seconds = costs.seconds(began, facts.gather_share, facts.probe_seconds);
    let stats = BakeStats::new(&scene, &info, facts, costs.warnings(), seconds);
    Ok(Baked {
        scene: BakedScene::new(scene, info),
        stats,
    })
}
