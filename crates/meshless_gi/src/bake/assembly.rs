//! Last stage: the scene from the results of all stages, its measured errors, and its description.

use super::context::{BakeContext, StageCost};
use super::estimate::{EstimateInputs, estimate_tiers};
use super::fmm::Octree;
use super::packing::{Packed, RowFacts};
use super::staleness::{fingerprint_of, hex};
use super::survey::Survey;
use super::{BAKE_VERSION, BakeError, BakeSource, ErrorEstimate, canonical_recipe};
use crate::asset::{BakeInfo, EnergyInfo, PointSurface, SceneData, TierInfo};
use crate::transport::BounceOperator;
use crate::transport::pca::Visibility;
use std::time::Instant;

/// Assembles the scene with the surfaces of the energy stage. Also returns the remaining results of
/// packing: [`Packed::missed`] and [`Packed::facts`].
pub(super) fn assemble(
    source: &BakeSource<'_>,
    packed: Packed,
    surfaces: Vec<PointSurface>,
    octree: Option<Octree>,
    bounces: Option<BounceOperator>,
    visibility: Option<Visibility>,
) -> (SceneData, Vec<f32>, RowFacts) {
    let bounds = source.geometry.bounds();
    let linked = packed.linked;
    let scene = SceneData {
        points: linked.points,
        surfaces,
        level_starts: linked.level_starts,
        sender_levels: linked.sender_levels,
        light_samples: packed.light_samples,
        pull: linked.pull,
        parents: linked.parents,
        operator: linked.operator,
        fmm: octree.map(|octree| octree.operator),
        bounces,
        illumination: Vec::new(),
        visibility,
        sky: packed.sky,
        materials: packed.materials,
        probes: packed.probes,
        occluders: packed.occluders,
        display: packed.display,
        bvh: source.bvh.clone(),
        bounds: [bounds.min.to_array(), bounds.max.to_array()],
    };
    (scene, packed.missed, packed.facts)
}

/// Estimates the error of each tier. The estimate is in proportion to a bake of `rays` rays.
pub(super) fn estimate(
    context: &BakeContext<'_>,
    survey: &Survey,
    scene: &SceneData,
    rays: u64,
) -> Result<(Vec<ErrorEstimate>, StageCost), BakeError> {
    let began = Instant::now();
    let inputs = EstimateInputs {
        viewpoints: survey.viewpoints.clone(),
        bounces: survey.settings.bounces,
        rays,
        seed: context.recipe.seed,
    };
    let estimates = estimate_tiers(scene, context.source.geometry, &inputs, context.progress);
    let (estimates, rays) = estimates.ok_or(BakeError::Canceled)?;
    Ok((estimates, StageCost::new(began, rays)))
}

/// Describes a bake that cast `rays` rays and has the measured `energy` and errors of its tiers.
pub(super) fn describe(
    context: &BakeContext<'_>,
    survey: &Survey,
    scene: &SceneData,
    facts: &RowFacts,
    energy: EnergyInfo,
    estimates: &[ErrorEstimate],
    rays: u64,
) -> BakeInfo {
    let (source, recipe, origin) = (context.source, context.recipe, context.origin);
    let settings = survey.settings.to_ron();
    let all_links = estimates.last().copied().unwrap_or_default();
    let sizes = scene.tier_sizes().into_iter();
    BakeInfo {
        version: env!("CARGO_PKG_VERSION").into(),
        bake_version: BAKE_VERSION,
        fingerprint: fingerprint_of(&source.content_hash, &settings, &recipe.viewpoints),
        content_hash: hex(&source.content_hash),
        scene: recipe.scene.clone(),
        scene_digest: origin.scene_digest.clone(),
        given_recipe: canonical_recipe(recipe),
        recipe: settings,
        triangles: source.primitives,
        rays,
        bounds: scene.bounds,
        viewpoints: survey.viewpoints.iter().map(|v| v.to_array()).collect(),
        estimated_nrmse: all_links.nrmse,
        estimated_nrmse_interval: all_links.interval,
        tiers: (sizes.zip(estimates))
            .map(|((rows, links), estimate)| TierInfo {
                rows,
                links,
                estimated_nrmse: estimate.nrmse,
                estimated_nrmse_interval: estimate.interval,
            })
            .collect(),
        bounces: survey.settings.bounces,
        link_error: facts.link_error,
        uncovered: facts.uncovered as f32,
        largest_row_sum: facts.largest_row_sum,
        energy,
        request: origin.request.clone(),
    }
}
