//! The effects `soft_shadows` and `penumbrae`: lamps with soft shadows, on bakes whose points
//! remember what they see. Without such a lamp, or such a bake, neither does anything.

use super::effect::active_scenes;
use super::{FrameStage, FrameState, Plan, RunReason, SceneState, SkipReason, ViewState};

/// Whether soft shadows can fall in a scene that has such lamps; or why not.
fn falls(state: &FrameState, scene: &SceneState) -> Result<(), SkipReason> {
    if !scene.soft.remembers {
        Err(SkipReason::NoVisibility)
    } else if scene.soft.largest_buffer > state.largest_binding {
        Err(SkipReason::TooLarge {
            needs: scene.soft.largest_buffer,
            has: state.largest_binding,
        })
    } else {
        Ok(())
    }
}

/// Finds what lamps with soft shadows do not reach, where one of them changed and a view shows it.
pub(super) fn soft_shadows(state: &FrameState, plan: &mut Plan) {
    for scene in active_scenes(state).filter(|s| s.soft.lights > 0) {
        let shown =
            |v: &ViewState| v.lit && v.enabled && v.has_gbuffer && v.sees.contains(&scene.id);
        match falls(state, scene) {
            Err(why) => plan.skipped.push((scene.id, None, why)),
            Ok(()) if !state.views.iter().any(shown) => {}
            Ok(()) if !scene.resident => {
                plan.push(
                    "soft_shadows",
                    FrameStage::SOFT_SHADOW,
                    scene.id,
                    RunReason::NewBake,
                );
            }
            Ok(()) if !scene.soft.held => {
                let reason = RunReason::SoftLightsChanged(scene.soft.lights);
                plan.push("soft_shadows", FrameStage::SOFT_SHADOW, scene.id, reason);
            }
            Ok(()) => {}
        }
    }
}

/// Takes the light that does not get there from the picture of each view.
pub(super) fn penumbrae(state: &FrameState, plan: &mut Plan) {
    for view in state.views.iter().filter(|view| view.lit) {
        for scene in active_scenes(state).filter(|s| s.soft.lights > 0) {
            let splatted = plan.passes.iter().any(|p| {
                p.stage == FrameStage::SPLAT && p.scene == scene.id && p.view == Some(view.id)
            });
            if splatted && falls(state, scene).is_ok() {
                plan.push(
                    "penumbrae",
                    FrameStage::SUBTRACT_SHADOW,
                    scene.id,
                    RunReason::InView,
                )
                .view = Some(view.id);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::{DisplayUse, SceneId, SoftState, ViewId};

    const A: SceneId = SceneId(1);

    fn view(id: u64, lit: bool) -> ViewState {
        ViewState {
            id: ViewId(id),
            gloss: false,
            lit,
            enabled: true,
            has_gbuffer: true,
            pixels: 1000,
            display: DisplayUse::Subsplats,
            sees: vec![A],
        }
    }

    /// A scene on the device, a view of it, and no lights.
    fn at_rest() -> FrameState {
        FrameState {
            scenes: vec![SceneState {
                resident: true,
                ..SceneState::new(A)
            }],
            views: vec![view(7, true)],
            ..FrameState::default()
        }
    }

    fn stages(state: &FrameState) -> Vec<FrameStage> {
        let plan = Plan::new(state);
        let all = plan.passes.iter().map(|p| p.stage);
        let transport = [
            FrameStage::PULL_PUSH,
            FrameStage::APPLY,
            FrameStage::FLATTEN,
        ];
        all.filter(|s| !transport.contains(s)).collect()
    }

    #[test]
    fn soft_shadows_run_once_for_casting_lights() {
        let mut state = at_rest();
        // A bake that could, and no lamp that asks.
        state.scenes[0].soft.remembers = true;
        let none = Plan::new(&state);
        assert_eq!(
            none.count(FrameStage::SOFT_SHADOW) + none.count(FrameStage::SUBTRACT_SHADOW),
            0
        );
        // A lamp that asks, and has moved.
        state.scenes[0].soft.lights = 2;
        let plan = Plan::new(&state);
        assert_eq!(
            stages(&state),
            [
                FrameStage::SOFT_SHADOW,
                FrameStage::SPLAT,
                FrameStage::COMPOSITE,
                FrameStage::SUBTRACT_SHADOW
            ]
        );
        assert_eq!(
            plan.find(FrameStage::SOFT_SHADOW, A).unwrap().reason,
            RunReason::SoftLightsChanged(2)
        );
        assert_eq!(
            plan.find(FrameStage::SUBTRACT_SHADOW, A).unwrap().view,
            Some(ViewId(7))
        );
        // At rest: what is missing is held, and taken from every view that shows the picture.
        state.scenes[0].soft.held = true;
        state.views.push(view(8, true));
        state.views.push(view(9, false));
        let plan = Plan::new(&state);
        assert_eq!(
            [
                FrameStage::SOFT_SHADOW,
                FrameStage::SPLAT,
                FrameStage::SUBTRACT_SHADOW
            ]
            .map(|s| plan.count(s)),
            [0, 3, 2]
        );
        // A bake that comes back has nothing of it.
        state.scenes[0].resident = false;
        assert_eq!(
            Plan::new(&state)
                .find(FrameStage::SOFT_SHADOW, A)
                .unwrap()
                .reason,
            RunReason::NewBake
        );
    }

    #[test]
    fn soft_shadows_without_data_state_reason() {
        type Change = fn(&mut FrameState);
        let asked = SoftState {
            lights: 1,
            remembers: true,
            ..SoftState::default()
        };
        let cases: [(Change, Option<SkipReason>); 3] = [
            (
                |s| s.scenes[0].soft.remembers = false,
                Some(SkipReason::NoVisibility),
            ),
            (
                |s| s.scenes[0].soft.largest_buffer = 1 << 40,
                Some(SkipReason::TooLarge {
                    needs: 1 << 40,
                    has: 128 << 20,
                }),
            ),
            (|s| s.views[0].lit = false, None),
        ];
        for (change, why) in cases {
            let mut state = at_rest();
            state.scenes[0].soft = asked;
            change(&mut state);
            let plan = Plan::new(&state);
            assert_eq!(
                stages(&state),
                [FrameStage::SPLAT, FrameStage::COMPOSITE],
                "{plan}"
            );
            let said = why.is_none_or(|why| plan.skipped.contains(&(A, None, why)));
            assert!(said, "{plan}");
        }
    }
}
