//! Effect `occluders`: updates the links that doors and lifts block, after one of them moved.
//!
//! Reads: the number of occluders that differ from the device's, and the number of link terms that
//! they affect. Kernel: `occlude`.

pub(crate) mod occluder;

use super::{Effect, PassKind, Record, Recording};
use crate::gpu;
use crate::gpu::GpuError;
use crate::plan::{FrameStage, FrameState, Pass, Plan, RunReason, Timing, Work};
use crate::plugin::GiOccluder;
use crate::plugin::record::SceneContext;
use bevy::app::App;

pub(super) const EFFECT: Effect = Effect {
    name: "occluders",
    summary: "updates the links that occluders block, after one of them moved",
    schedule,
    passes: &[PassKind {
        stage: FrameStage::OCCLUDE,
        per_view: false,
        timing: Timing::With(FrameStage::OCCLUDE),
        work: |state, pass| {
            let scene = state.scene(pass.scene);
            scene.map_or(Work::Uncounted, |s| {
                Work::OccludedLinkTerms(s.occluded_link_terms)
            })
        },
        record: Recording {
            kernels: &[gpu::EntryPoint::Occlude],
            draws: None,
            how: Record::Scene(record),
        },
    }],
};

/// Adds the component to the main world.
pub(super) fn add_to_app(app: &mut App) {
    app.register_type::<GiOccluder>();
}

fn schedule(state: &FrameState, plan: &mut Plan) {
    for scene in state.active_scenes().filter(|s| s.occluders_changed > 0) {
        let reason = RunReason::OccludersMoved(scene.occluders_changed);
        plan.push(EFFECT.name, FrameStage::OCCLUDE, scene.id, reason);
    }
}

fn record(ctx: &mut SceneContext<'_>, _: &Pass) -> Result<Option<()>, GpuError> {
    let transmittances = &ctx.scene.transmittances;
    let Some(frame) = &mut ctx.runtime.frame else {
        return Ok(None);
    };
    let bake = &ctx.runtime.bake;
    frame.set_occluders(ctx.kernels, ctx.queue, ctx.encoder, bake, transmittances);
    ctx.runtime
        .changes
        .transmittances
        .clone_from(transmittances);
    Ok(Some(()))
}
