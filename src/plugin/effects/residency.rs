//! Effect `residency`: uploads a bake that came into view, and releases one that left it.
//!
//! Reads: asset, visibility, buffer sizes and idle frames of each scene. Runs once a bake. Copies
//! buffers, without a kernel.

use super::{Effect, PassKind, Record, Recording};
use crate::gpu::{GpuError, GpuFrame};
use crate::plan::{FrameStage, FrameState, Pass, Plan, RunReason, Timing, Work};
use crate::plugin::record::SceneContext;

pub(super) const EFFECT: Effect = Effect {
    name: "residency",
    summary: "uploads a bake that came into view",
    schedule,
    passes: &[PassKind {
        stage: FrameStage::UPLOAD,
        per_view: false,
        timing: Timing::None,
        work: |_, _| Work::Uncounted,
        record: Recording {
            kernels: &[],
            draws: None,
            how: Record::Scene(record),
        },
    }],
};

fn schedule(state: &FrameState, plan: &mut Plan) {
    for scene in &state.scenes {
        match state.check_active(scene) {
            Ok(()) if !scene.resident => {
                let (stage, reason) = (FrameStage::UPLOAD, RunReason::NewBake);
                plan.push(EFFECT.name, stage, scene.id, reason);
            }
            Ok(()) => {}
            Err(reason) => {
                plan.skipped.push((scene.id, None, reason));
                if !scene.loaded || scene.idle_frames >= state.unload_after_frames {
                    plan.release.push(scene.id);
                }
            }
        }
    }
}

fn record(ctx: &mut SceneContext<'_>, _: &Pass) -> Result<Option<()>, GpuError> {
    let slots = ctx.runtime.changes.slots.len() as u32;
    let frame = GpuFrame::new(ctx.kernels, ctx.queue, &ctx.runtime.bake, slots)?;
    ctx.runtime.frame = Some(frame);
    Ok(Some(()))
}
