//! The effects `soft_shadows` and `penumbrae`: lamps with soft shadows, on bakes whose points
//! remember what they see. Without such a lamp, or such a bake, neither does anything.

use super::effect::active_scenes;
use super::{FrameState, Plan, Reason, SceneState, Skip, Stage, ViewState};

/// Whether soft shadows can fall in a scene that has such lamps; or why not.
fn falls(state: &FrameState, scene: &SceneState) -> Result<(), Skip> {
    if !scene.soft.remembers {
        Err(Skip::NoVisibility)
    } else if scene.soft.largest_buffer > state.largest_binding {
        Err(Skip::TooLarge {
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
                plan.push("soft_shadows", Stage::SoftShadow, scene.id, Reason::NewBake);
            }
            Ok(()) if !scene.soft.held => {
                let reason = Reason::SoftLightsChanged(scene.soft.lights);
                plan.push("soft_shadows", Stage::SoftShadow, scene.id, reason);
            }
            Ok(()) => {}
        }
    }
}

/// Takes the light that does not get there from the picture of each view.
pub(super) fn penumbrae(state: &FrameState, plan: &mut Plan) {
    for view in state.views.iter().filter(|view| view.lit) {
        for scene in active_scenes(state).filter(|s| s.soft.lights > 0) {
            let splatted = plan
                .passes
                .iter()
                .any(|p| p.stage == Stage::Splat && p.scene == scene.id && p.view == Some(view.id));
            if splatted && falls(state, scene).is_ok() {
                plan.push("penumbrae", Stage::SubtractShadow, scene.id, Reason::InView)
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

    fn stages(state: &FrameState) -> Vec<Stage> {
        let plan = Plan::new(state);
        let all = plan.passes.iter().map(|p| p.stage);
        let transport = [Stage::PullPush, Stage::Apply, Stage::Flatten];
        all.filter(|s| !transport.contains(s)).collect()
    }

    #[test]
    fn soft_shadows_run_once_for_casting_lights() {
        let mut state = at_rest();
        // A bake that could, and no lamp that asks.
        state.scenes[0].soft.remembers = true;
        let none = Plan::new(&state);
        assert_eq!(
            none.count(Stage::SoftShadow) + none.count(Stage::SubtractShadow),
            0
        );
        // A lamp that asks, and has moved.
        state.scenes[0].soft.lights = 2;
        let plan = Plan::new(&state);
        use Stage::*;
        assert_eq!(
            stages(&state),
            [SoftShadow, Splat, Composite, SubtractShadow]
        );
        assert_eq!(
            plan.find(SoftShadow, A).unwrap().reason,
            Reason::SoftLightsChanged(2)
        );
        assert_eq!(plan.find(SubtractShadow, A).unwrap().view, Some(ViewId(7)));
        // At rest: what is missing is held, and taken from every view that shows the picture.
        state.scenes[0].soft.held = true;
        state.views.push(view(8, true));
        state.views.push(view(9, false));
        let plan = Plan::new(&state);
        assert_eq!(
            [SoftShadow, Splat, SubtractShadow].map(|s| plan.count(s)),
            [0, 3, 2]
        );
        // A bake that comes back has nothing of it.
        state.scenes[0].resident = false;
        assert_eq!(
            Plan::new(&state).find(SoftShadow, A).unwrap().reason,
            Reason::NewBake
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
        let cases: [(Change, Option<Skip>); 3] = [
            (
                |s| s.scenes[0].soft.remembers = false,
                Some(Skip::NoVisibility),
            ),
            (
                |s| s.scenes[0].soft.largest_buffer = 1 << 40,
                Some(Skip::TooLarge {
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
            assert_eq!(stages(&state), [Stage::Splat, Stage::Composite], "{plan}");
            let said = why.is_none_or(|why| plan.skipped.contains(&(A, None, why)));
            assert!(said, "{plan}");
        }
    }
}
