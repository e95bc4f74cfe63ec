//! Stages of a bake. Each is a function from the result of the previous stage to its own.

use super::assembly::assemble;
use super::bounces::bound_and_bounce;
use super::context::BakeContext;
use super::finish::estimate;
use super::fmm::add_octree;
use super::point_set::build_points;
use super::quality_level::QualityParameters;
use super::survey::survey;
use super::transport_stage::build_transport;
use super::visibility::add_visibility;
use super::{BakeError, BakeSource, BakeStats, Baked, Progress, Recipe};
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
    let error = |baked: &Baked| baked.scene.data().info.estimated_nrmse;
    for quality in QualityParameters::refinement_steps(target) {
        let baked = bake_once(&context, &quality)?;
        let met = error(&baked) <= target;
        // A recipe that fixes every parameter of the quality levels repeats the same bake.
        let repeats = best.as_ref().map(|b| &b.scene.data().info.recipe)
            == Some(&baked.scene.data().info.recipe);
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
    let mut stats = BakeStats {
        triangles: context.source.primitives,
        threads: rayon::current_num_threads() as u64,
        ..BakeStats::default()
    };
    let survey = survey(context, quality, &mut stats)?;
    let points = build_points(context, &survey, &mut stats)?;
    stats.seconds.points = began.elapsed().as_secs_f64();
    let mut transport = build_transport(context, &survey, points, &mut stats)?;
    let cells = transport.cells.take();
    let assembled = assemble(context, &survey, transport, &mut stats)?;
    let settings = &survey.settings;
    let scene = bound_and_bounce(context, settings, assembled, &mut stats)?;
    let scene = add_octree(context, settings, cells, scene, &mut stats)?;
    let scene = add_visibility(context, settings, scene, &mut stats)?;
    let scene = estimate(context, scene, &mut stats)?;
    stats.seconds.total = began.elapsed().as_secs_f64();
    Ok(Baked { scene, stats })
}
