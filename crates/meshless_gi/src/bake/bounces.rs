//! Seventh stage: baked bounces.

use super::context::{BakeContext, StageCost};
use super::energy::Bounded;
use super::packing::Packed;
use super::{BakeError, BakeSettings, BakeStage, BounceMode};
use crate::transport::{BounceOperator, BounceScene, bounce_operator};
use std::time::Instant;

/// Bakes later bounces if the settings have them.
pub(super) fn bake_bounces(
    context: &BakeContext<'_>,
    settings: &BakeSettings,
    packed: &Packed,
    bounded: &Bounded,
) -> Result<(Option<BounceOperator>, StageCost), BakeError> {
    if settings.bounce_mode != BounceMode::Baked || settings.bounces <= 1 {
        return Ok(Default::default());
    }
    let began = Instant::now();
    context.report(BakeStage::Bounces, 0.0)?;
    let linked = &packed.linked;
    let coarsest = linked.level(0);
    let albedos = bounded.surfaces[coarsest.clone()].iter();
    let albedo: Vec<_> = albedos.map(|s| s.albedo.into()).collect();
    let normals: Vec<_> = linked.points[coarsest].iter().map(|p| p.n()).collect();
    let bounces = bounce_operator(
        &BounceScene {
            rows: &packed.rows,
            normals: &normals,
            albedo: &albedo,
            parents: &linked.parents,
            senders: linked.senders(),
        },
        settings.bounces - 1,
        0.02 * settings.truncation_error,
    );
    Ok((Some(bounces), StageCost::new(began, 0)))
}
