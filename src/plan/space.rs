//! The effects `free_space` and `volume`: light off the surfaces, for what moves, and the same in a
//! texture that the engine reads, for cameras without a G-buffer and for fog. Bakes that know no
//! light in free space have the one as little as scenes without a volume, or without such a camera
//! and without fog, have the other.

use super::effect::active_scenes;
use super::{FrameState, Plan, Reason, Skip, Stage};

/// Carries the light on to the probes of the bakes that have them. Over a view `display` lays it.
pub(super) fn free_space(state: &FrameState, plan: &mut Plan) {
    for scene in active_scenes(state).filter(|s| s.probes) {
        if let Some(reason) = plan.find(Stage::Apply, scene.id).map(|p| p.reason.clone()) {
            plan.push("free_space", Stage::Probe, scene.id, reason);
        }
    }
}

/// Puts the light in free space into a scene's volume, where it changed and a camera without a
/// G-buffer, or one with fog, sees it.
pub(super) fn volume(state: &FrameState, plan: &mut Plan) {
    for scene in active_scenes(state).filter(|s| s.volume.asked && s.volume.seen) {
        let solved = plan.find(Stage::Apply, scene.id).map(|p| p.reason.clone());
        if !scene.probes {
            plan.skipped.push((scene.id, None, Skip::NoFreeSpace));
        } else if let Some(reason) = solved {
            plan.push("volume", Stage::Volume, scene.id, reason);
        } else if !scene.volume.held {
            plan.push("volume", Stage::Volume, scene.id, Reason::NewVolume);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::{
        DisplayUse, SceneId, SceneState, SlotChange, ViewId, ViewState, VolumeState,
    };

    const A: SceneId = SceneId(1);

    /// A scene on the device with light in free space, and no view with a G-buffer.
    fn at_rest() -> FrameState {
        FrameState {
            scenes: vec![SceneState {
                resident: true,
                probes: true,
                slots: vec![SlotChange::None; 2],
                ..SceneState::new(A)
            }],
            ..FrameState::default()
        }
    }

    fn deferred() -> ViewState {
        ViewState {
            id: ViewId(3),
            gloss: false,
            lit: true,
            enabled: true,
            has_gbuffer: true,
            pixels: 1000,
            display: DisplayUse::Subsplats,
            sees: vec![A],
        }
    }

    fn stages(state: &FrameState) -> Vec<Stage> {
        Plan::new(state).passes.iter().map(|p| p.stage).collect()
    }

    #[test]
    fn probe_passes_run_for_bakes_with_probes() {
        use Stage::*;
        let mut state = at_rest();
        state.views.push(deferred());
        state.scenes[0].probes = false;
        assert_eq!(stages(&state), [Splat, Composite]);
        state.scenes[0].probes = true;
        assert_eq!(stages(&state), [Splat, Probe, Composite]);
        state.scenes[0].slots[1] = SlotChange::Geometry;
        assert_eq!(
            stages(&state),
            [
                Project, PullPush, Apply, Flatten, Probe, Splat, Probe, Composite
            ]
        );
    }

    #[test]
    fn volume_is_written_on_light_change() {
        use Stage::*;
        let mut state = at_rest();
        // Nobody asks, and no camera is there.
        assert_eq!(stages(&state), []);
        assert_eq!(Plan::new(&state).skipped, [(A, None, Skip::NotInView)]);
        // Asked for, but out of view; in view, but not asked for.
        state.scenes[0].volume.asked = true;
        assert_eq!(stages(&state), []);
        state.scenes[0].volume = VolumeState {
            seen: true,
            ..VolumeState::default()
        };
        assert_eq!(stages(&state), []);
        // A new volume of a scene at rest, and one that is written.
        state.scenes[0].volume.asked = true;
        assert_eq!(stages(&state), [Volume]);
        let plan = Plan::new(&state);
        assert_eq!(plan.find(Volume, A).unwrap().reason, Reason::NewVolume);
        state.scenes[0].volume.held = true;
        assert_eq!(stages(&state), []);
        // A lamp moves: one more pass than what carries its light on.
        state.scenes[0].slots[1] = SlotChange::Geometry;
        assert_eq!(
            stages(&state),
            [Project, PullPush, Apply, Flatten, Probe, Volume]
        );
        // A deferred camera beside it has its own display.
        state.views.push(deferred());
        state.scenes[0].slots[1] = SlotChange::None;
        assert_eq!(stages(&state), [Splat, Probe, Composite]);
        // A bake without light in free space says so.
        state.scenes[0].probes = false;
        state.scenes[0].volume.held = false;
        assert_eq!(stages(&state), [Splat, Composite]);
        let why = (A, None, Skip::NoFreeSpace);
        assert!(Plan::new(&state).skipped.contains(&why));
    }
}
