//! The effects of what moves: the maps of the lights that ask for its bounce, and its gloss. Rows
//! of the table in [`effect`](super::effect).

use super::{FrameStage, FrameState, Pass, Plan, RunReason, SceneId};

pub(super) fn bounce_from_dynamic(state: &FrameState, plan: &mut Plan) {
    for light in &state.bounces {
        match state.maps_of(light) {
            Ok(_) if state.bounces_held => plan.resting.push(light.id),
            Ok(maps) => {
                let reason = RunReason::Moving(maps);
                plan.push(
                    "bounce_from_dynamic",
                    FrameStage::RSM,
                    SceneId::WORLD,
                    reason,
                )
                .light = Some(light.id);
            }
            Err(why) => plan.dark.push((light.id, why)),
        }
    }
}

pub(super) fn gloss_from_dynamic(state: &FrameState, plan: &mut Plan) {
    for view in state.views.iter().filter(|view| view.gloss) {
        let lit = |p: &Pass| p.stage == FrameStage::VPL && p.view == Some(view.id);
        if plan.passes.iter().any(lit) {
            let world = SceneId::WORLD;
            plan.push(
                "gloss_from_dynamic",
                FrameStage::VPL_SPECULAR,
                world,
                RunReason::InView,
            )
            .view = Some(view.id);
        }
    }
}
