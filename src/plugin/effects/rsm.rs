//! Effect `bounce_from_dynamic`: reflective shadow maps of dynamic objects, and the virtual point
//! lights chosen from them.
//!
//! Reads: the lights with reflective shadow maps, the views that they may light, and whether the
//! device holds their virtual lights. Bevy draws a camera for each map, and
//! [`crate::plugin::rsm_render`] reads it there. Kernels: `rsm`, then `vpl` in each view.

use super::{Effect, PassKind, Record, Recording};
use crate::gpu;
use crate::plan::{
    BounceState, FrameStage, FrameState, Pass, Plan, RunReason, SceneId, ViewId, Work,
};
use crate::plugin::record::{Layer, ViewContext};

pub(super) const EFFECT: Effect = Effect {
    name: "bounce_from_dynamic",
    summary: "draws dynamic objects from the lights that ask for it, and creates virtual point lights",
    schedule,
    passes: &[
        PassKind {
            stage: FrameStage::RSM,
            per_view: false,
            timed_with: None,
            work: |_, _| Work::Uncounted,
            record: Recording {
                kernels: &[
                    gpu::Pass::RsmTexels,
                    gpu::Pass::RsmShadow,
                    gpu::Pass::RsmSelect,
                ],
                draws: None,
                how: Record::System,
            },
        },
        PassKind {
            stage: FrameStage::VPL,
            per_view: true,
            timed_with: Some(FrameStage::SPLAT),
            work: |state, pass| Work::Pixels(state.pixels(pass.view)),
            record: Recording {
                kernels: &[gpu::Pass::Vpl, gpu::Pass::VplOver, gpu::Pass::VplNodes],
                draws: None,
                how: Record::Layer(add_layer),
            },
        },
    ],
};

fn schedule(state: &FrameState, plan: &mut Plan) {
    for light in &state.bounces {
        match state.maps_of(light) {
            Ok(_) if state.bounces_held => plan.resting.push(light.id),
            Ok(maps) => {
                let (stage, reason) = (FrameStage::RSM, RunReason::Moving(maps));
                plan.push(EFFECT.name, stage, SceneId::WORLD, reason).light = Some(light.id);
            }
            Err(reason) => plan.dark.push((light.id, reason)),
        }
    }
}

/// Adds one pass for all virtual lights of a view. Returns `true` if there are any.
pub(super) fn schedule_in_view(state: &FrameState, view: ViewId, plan: &mut Plan) -> bool {
    let lights = |light: &BounceState| light.views.contains(&view) && plan.bounces(light.id);
    let any = state.bounces.iter().any(lights);
    if any {
        let (stage, reason) = (FrameStage::VPL, RunReason::InView);
        plan.push(EFFECT.name, stage, SceneId::WORLD, reason).view = Some(view);
    }
    any
}

fn add_layer(ctx: &mut ViewContext<'_>, _: &Pass) {
    if ctx.reflections.is_some() {
        ctx.layers.push(Layer::VirtualLights);
    }
}
