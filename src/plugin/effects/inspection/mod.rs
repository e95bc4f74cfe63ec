//! Effect `inspection`: copies coefficients to the CPU for the gizmos.
//!
//! Reads: whether the gizmos show coefficients. Copies a buffer, without a kernel.

pub(crate) mod coefficients;

use super::{Effect, PassKind, Record, Recording};
use crate::gpu;
use crate::gpu::GpuError;
use crate::plan::{FrameStage, FrameState, Pass, Plan, RunReason, Timing, Work};
use crate::plugin::effects::inspection::coefficients::CoefficientReadback;
use crate::plugin::record::SceneContext;

pub(super) const EFFECT: Effect = Effect {
    name: "inspection",
    summary: "copies coefficients to the CPU for the gizmos",
    schedule,
    passes: &[PassKind {
        stage: FrameStage::READ_BACK,
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
    for scene in state.active_scenes().filter(|s| s.read_back) {
        let (stage, reason) = (FrameStage::READ_BACK, RunReason::ReadBackRequested);
        plan.push(EFFECT.name, stage, scene.id, reason);
    }
}

fn record(ctx: &mut SceneContext<'_>, _: &Pass) -> Result<Option<()>, GpuError> {
    let frame = ctx.runtime.frame.as_ref();
    let values = frame.and_then(|f| f.buffers().output(gpu::EntryPoint::Apply));
    let Some(values) = values else {
        return Ok(None);
    };
    let (device, size) = (ctx.kernels.device(), values.size());
    let earlier = ctx.earlier.take::<CoefficientReadback>();
    let (scene, shared) = (ctx.scene.id, ctx.coefficients);
    let mut copy = earlier.unwrap_or_else(|| CoefficientReadback::new(device, size, scene, shared));
    copy.copy(ctx.encoder, values);
    ctx.runtime.states.insert(copy);
    Ok(Some(()))
}
