//! Effect `probes`: probe irradiance of bakes with probes, for dynamic objects.
//!
//! Reads: whether the bake has probes, and whether the scene is solved in this frame. Kernels:
//! `apply` with the operator's rows of the probes, then `probe` in each view.

use super::transport::{links_work, solve_reason};
use super::{Effect, PassKind, Record, Recording};
use crate::gpu;
use crate::gpu::{GpuError, SplatTargets};
use crate::plan::{FrameStage, FrameState, Pass, Plan, Timing, Work};
use crate::plugin::record::{LayerRecording, SceneContext, ViewContext};

pub(super) const EFFECT: Effect = Effect {
    name: "probes",
    summary: "updates the probe irradiance of bakes with probes, for dynamic objects",
    schedule,
    passes: &[
        PassKind {
            stage: FrameStage::PROBE,
            per_view: false,
            timing: Timing::Solve(FrameStage::APPLY),
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
            stage: FrameStage::PROBE_PIXELS,
            per_view: true,
            timing: Timing::With(FrameStage::SPLAT),
            work: |_, _| Work::Uncounted,
            record: Recording {
                kernels: &[gpu::EntryPoint::ProbeNodes, gpu::EntryPoint::ProbeOver],
                draws: None,
                how: Record::Layer(LayerRecording {
                    prepare,
                    splat,
                    // The subsplats of the scene read its probes.
                    add_to_subsplats: |_, _, _| Some(()),
                }),
            },
        },
    ],
};

fn schedule(state: &FrameState, plan: &mut Plan) {
    for scene in state.active_scenes().filter(|s| s.probes) {
        if let Some(reason) = solve_reason(scene) {
            plan.push(EFFECT.name, FrameStage::PROBE, scene.id, reason);
        }
        for view in state.views.iter().filter(|view| view.shows(scene.id)) {
            plan.push_layer(EFFECT.name, FrameStage::PROBE_PIXELS, scene.id, view);
        }
    }
}

fn record(ctx: &mut SceneContext<'_>, _: &Pass) -> Result<Option<()>, GpuError> {
    let Some(frame) = &mut ctx.runtime.frame else {
        return Ok(None);
    };
    frame.apply_probes(ctx.kernels, ctx.encoder, &ctx.scene.frame_settings());
    Ok(Some(()))
}

/// Checks that the view shows the scene, whose layer has written the parameters.
fn prepare(ctx: &mut ViewContext<'_>, pass: &Pass) -> Option<()> {
    ctx.shown.contains(&pass.scene).then_some(())
}

/// Adds the probe irradiance of a scene.
fn splat(ctx: &mut ViewContext<'_>, pass: &Pass, targets: &SplatTargets<'_>) -> Option<()> {
    let frame = ctx.scenes.get_mut(&pass.scene)?.frame.as_mut()?;
    let buffers = ctx.runtime.buffers.get(&pass.scene)?;
    frame.probe(ctx.kernels, ctx.encoder, buffers, targets);
    Some(())
}
