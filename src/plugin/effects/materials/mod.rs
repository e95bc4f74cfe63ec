//! Effect `materials`: uploads sender albedo and emission after a material change.
//!
//! Reads: whether the factors of a scene's materials differ from the uploaded ones. Copies buffers,
//! without a kernel.

pub(crate) mod dynamic_materials;

use super::{Effect, PassKind, Record, Recording};
use crate::gpu::GpuError;
use crate::plan::{FrameStage, FrameState, Pass, Plan, RunReason, Timing, Work};
use crate::plugin::record::SceneContext;

pub(super) const EFFECT: Effect = Effect {
    name: "materials",
    summary: "uploads sender albedo and emission after a material change",
    schedule,
    passes: &[PassKind {
        stage: FrameStage::MATERIALS,
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
    for scene in state.active_scenes().filter(|s| s.materials_changed) {
        let (stage, reason) = (FrameStage::MATERIALS, RunReason::MaterialsChanged);
        plan.push(EFFECT.name, stage, scene.id, reason);
    }
}

fn record(ctx: &mut SceneContext<'_>, _: &Pass) -> Result<(), GpuError> {
    let factors = &ctx.scene.materials;
    if let Some(frame) = &mut ctx.runtime.frame {
        frame.set_materials(ctx.queue, &ctx.runtime.bake, factors);
        ctx.runtime.changes.factors.clone_from(factors);
    }
    Ok(())
}
