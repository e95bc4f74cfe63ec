//! Effects of the tests `effect_row_is_planned_counted_and_recorded` and
//! `layer_row_is_planned_without_a_scene`.
//!
//! `blackout` clears the irradiance of each scene. Reads: the active scenes. Copies a buffer of
//! zeros that it keeps for each scene, without a kernel. `ambient` adds a layer to each view.
//! Reads: the views.

use super::{Effect, PassKind, Record, Recording};
use crate::gpu;
use crate::gpu::GpuError;
use crate::plan::{FrameStage, FrameState, Pass, Plan, RunReason, SceneId, Timing, Work};
use crate::plugin::effect_states::EffectState;
use crate::plugin::record::{LayerRecording, SceneContext};

/// Stage of the effect, after transport.
pub(super) const BLACKOUT: FrameStage = FrameStage::new(75, "blackout");

pub(super) const EFFECT: Effect = Effect {
    name: "blackout",
    summary: "clears the irradiance of each scene",
    schedule,
    passes: &[PassKind {
        stage: BLACKOUT,
        per_view: false,
        timing: Timing::With(BLACKOUT),
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

/// Stage of the layer, between the layers of other effects.
pub(super) const AMBIENT: FrameStage = FrameStage::new(127, "ambient");

pub(super) const LAYER: Effect = Effect {
    name: "ambient",
    summary: "adds a layer to each view",
    schedule: |state, plan| {
        for view in state.views.iter().filter(|view| view.displays()) {
            plan.push_layer(LAYER.name, AMBIENT, SceneId::WORLD, view);
        }
    },
    passes: &[PassKind {
        stage: AMBIENT,
        per_view: true,
        timing: Timing::With(FrameStage::SPLAT),
        work: |state, pass| Work::Pixels(state.pixels(pass.view)),
        record: Recording {
            kernels: &[],
            draws: None,
            how: Record::Layer(LayerRecording {
                prepare: |_, _| Some(()),
                splat: |_, _, _| Some(()),
                add_to_subsplats: |_, _, _| Some(()),
            }),
        },
    }],
};

fn schedule(state: &FrameState, plan: &mut Plan) {
    for scene in state.active_scenes() {
        plan.push(EFFECT.name, BLACKOUT, scene.id, RunReason::InView);
    }
}

fn record(ctx: &mut SceneContext<'_>, _: &Pass) -> Result<Option<()>, GpuError> {
    let frame = ctx.runtime.frame.as_ref();
    let values = frame.and_then(|f| f.buffers().output(gpu::EntryPoint::Apply));
    let Some(values) = values else {
        return Ok(None);
    };
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
    Ok(Some(()))
}

/// Buffer of zeros, one per scene.
struct Zeros(wgpu::Buffer);

impl EffectState for Zeros {
    fn size(&self) -> (u32, u64) {
        (1, self.0.size())
    }
}
