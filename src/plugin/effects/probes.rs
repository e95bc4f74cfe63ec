//! Effect `probes`: probe irradiance of bakes with probes, for dynamic objects.
//!
//! Reads: whether the bake has probes, and whether the scene is solved in this frame. Kernels:
//! `apply` with the operator's rows of the probes, then `probe` in each view.

use super::transport::{links_work, solve_reason};
use super::{Effect, PassKind, Record, Recording};
use crate::gpu;
use crate::gpu::GpuError;
use crate::plan::{FrameStage, FrameState, Pass, Plan, RunReason, SceneState, ViewId, Work};
use crate::plugin::record::{Layer, SceneContext, ViewContext};

pub(super) const EFFECT: Effect = Effect {
    name: "probes",
    summary: "updates the probe irradiance of bakes with probes, for dynamic objects",
    schedule,
    passes: &[
        PassKind {
            stage: FrameStage::PROBE,
            per_view: false,
            timed_with: Some(FrameStage::APPLY),
            work: |state, pass| {
                let scene = state.scene(pass.scene);
                scene.map_or(Work::Uncounted, |s| links_work(s, s.probe_links))
            },
            record: Recording {
                // The rows count as `apply`.
                kernels: &[],
                draws: None,
                how: Record::Scene(record),
            },
        },
        PassKind {
            stage: FrameStage::PROBE,
            per_view: true,
            timed_with: Some(FrameStage::SPLAT),
            work: |_, _| Work::Uncounted,
            record: Recording {
                kernels: &[gpu::EntryPoint::ProbeNodes, gpu::EntryPoint::ProbeOver],
                draws: None,
                how: Record::Layer(add_layer),
            },
        },
    ],
};

fn schedule(state: &FrameState, plan: &mut Plan) {
    for scene in state.active_scenes().filter(|s| s.probes) {
        if let Some(reason) = solve_reason(scene) {
            plan.push(EFFECT.name, FrameStage::PROBE, scene.id, reason);
        }
    }
}

/// Adds the pass of a scene in a view to the passes of the effect `display`.
pub(super) fn schedule_in_view(scene: &SceneState, view: ViewId, plan: &mut Plan) {
    if scene.probes {
        let (stage, reason) = (FrameStage::PROBE, RunReason::InView);
        plan.push(EFFECT.name, stage, scene.id, reason).view = Some(view);
    }
}

fn record(ctx: &mut SceneContext<'_>, _: &Pass) -> Result<(), GpuError> {
    if let Some(frame) = &mut ctx.runtime.frame {
        frame.apply_probes(ctx.kernels, ctx.encoder, &ctx.scene.frame_settings());
    }
    Ok(())
}

fn add_layer(ctx: &mut ViewContext<'_>, pass: &Pass) -> Option<()> {
    // The layer of the scene wrote the parameters.
    let own = ctx.layers.contains(&Layer::Scene(pass.scene));
    own.then(|| ctx.layers.push(Layer::Probes(pass.scene)))
}
