//! Effect of the test `an_effect_is_one_file_and_one_row`: clears the irradiance of each scene.
//!
//! Reads: the active scenes. Clears a buffer, without a kernel.

use super::{Effect, PassKind, Record, Recording};
use crate::gpu;
use crate::gpu::GpuError;
use crate::plan::{FrameStage, FrameState, Pass, Plan, RunReason, Work};
use crate::plugin::record::SceneContext;

/// Stage of the effect, after transport.
pub(super) const BLACKOUT: FrameStage = FrameStage::new(75, "blackout");

pub(super) const EFFECT: Effect = Effect {
    name: "blackout",
    summary: "clears the irradiance of each scene",
    schedule,
    passes: &[PassKind {
        stage: BLACKOUT,
        per_view: false,
        timed_with: Some(BLACKOUT),
        work: |state, pass| {
            let scene = state.scene(pass.scene);
            Work::Rays(scene.map_or(0, |scene| scene.rays))
        },
        record: Recording {
            kernels: &[],
            draws: None,
            how: Record::Scene(record),
        },
    }],
};

fn schedule(state: &FrameState, plan: &mut Plan) {
    for scene in state.active_scenes() {
        plan.push(EFFECT.name, BLACKOUT, scene.id, RunReason::InView);
    }
}

fn record(ctx: &mut SceneContext<'_>, _: &Pass) -> Result<(), GpuError> {
    let frame = ctx.runtime.frame.as_ref();
    if let Some(values) = frame.and_then(|f| f.buffers().output(gpu::Pass::Apply)) {
        ctx.encoder.clear_buffer(values, 0, None);
    }
    Ok(())
}
