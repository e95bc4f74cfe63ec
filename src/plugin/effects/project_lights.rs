//! Effect `lights`: projects the light slots that are new or moved.
//!
//! Reads: the change of each light slot since its last projection, and the number of occluders that
//! moved. Kernel: `project`.

use super::{Effect, PassKind, Record, Recording};
use crate::gpu;
use crate::gpu::GpuError;
use crate::plan::{FrameStage, FrameState, Pass, Plan, RunReason, SlotChange, Timing, Work};
use crate::plugin::record::SceneContext;

pub(super) const EFFECT: Effect = Effect {
    name: "lights",
    summary: "projects the light slots that are new or moved",
    schedule,
    passes: &[PassKind {
        stage: FrameStage::PROJECT,
        per_view: false,
        timing: Timing::Solve(FrameStage::PROJECT),
        work: |state, pass| {
            let rays = state.scene(pass.scene).map(|scene| scene.rays);
            rays.map_or(Work::Uncounted, |rays| {
                Work::Rays(rays * pass.slots.len() as u64)
            })
        },
        record: Recording {
            kernels: &[gpu::EntryPoint::Project],
            draws: None,
            how: Record::Scene(record),
        },
    }],
};

fn schedule(state: &FrameState, plan: &mut Plan) {
    for scene in state.active_scenes() {
        let slots: Vec<u32> = (0..scene.slots.len())
            .filter(|&i| scene.slots[i] == SlotChange::Geometry)
            .map(|i| i as u32)
            .collect();
        if !slots.is_empty() {
            let reason = match scene.occluders_changed {
                0 => RunReason::LightsMoved(slots.len()),
                moved => RunReason::OccludersMoved(moved),
            };
            plan.push(EFFECT.name, FrameStage::PROJECT, scene.id, reason)
                .slots = slots;
        }
    }
}

fn record(ctx: &mut SceneContext<'_>, pass: &Pass) -> Result<Option<()>, GpuError> {
    upload(ctx)?;
    let Some(frame) = &mut ctx.runtime.frame else {
        return Ok(None);
    };
    frame.project(ctx.kernels, ctx.queue, ctx.encoder, &pass.slots);
    ctx.runtime.changes.slots.mark_projected(&pass.slots);
    Ok(Some(()))
}

/// Uploads the lights with their colors, slot by slot.
pub(super) fn upload(ctx: &mut SceneContext<'_>) -> Result<(), GpuError> {
    match &mut ctx.runtime.frame {
        Some(frame) => {
            frame.set_lights(ctx.kernels, ctx.queue, &ctx.runtime.changes.slots.lights())
        }
        None => Ok(()),
    }
}
