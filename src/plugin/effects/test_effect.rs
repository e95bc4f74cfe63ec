//! Effect of the test `effect_row_is_planned_counted_and_recorded`: clears the irradiance of each
//! scene.
//!
//! Reads: the active scenes. Copies a buffer of zeros that it keeps for each scene, without a
//! kernel.

use super::{Effect, PassKind, Record, Recording};
use crate::gpu;
use crate::gpu::GpuError;
use crate::plan::{FrameStage, FrameState, Pass, Plan, RunReason, Work};
use crate::plugin::effect_states::EffectState;
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
    if let Some(values) = frame.and_then(|f| f.buffers().output(gpu::EntryPoint::Apply)) {
        let zeros = ctx.runtime.states.take().unwrap_or_else(|| {
            Zeros(ctx.kernels.device().create_buffer(&wgpu::BufferDescriptor {
                label: Some("zeros"),
                size: values.size(),
                usage: wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            }))
        });
        (ctx.encoder).copy_buffer_to_buffer(&zeros.0, 0, values, 0, values.size());
        ctx.runtime.states.insert(zeros);
    }
    Ok(())
}

/// Buffer of zeros, one per scene.
struct Zeros(wgpu::Buffer);

impl EffectState for Zeros {
    fn size(&self) -> (u32, u64) {
        (1, self.0.size())
    }
}
