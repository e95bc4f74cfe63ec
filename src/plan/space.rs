//! The effects `free_space` and `volume`: light off the surfaces, for what moves, and the same in a
//! texture that the engine reads, for cameras without a G-buffer and for fog. Bakes that know no
//! light in free space have the one as little as scenes without a volume, or without such a camera
//! and without fog, have the other.

use super::effect::active_scenes;
use super::{FrameStage, FrameState, Plan, RunReason, SkipReason};

/// Carries the light on to the probes of the bakes that have them. Over a view `display` lays it.
pub(super) fn free_space(state: &FrameState, plan: &mut Plan) {
    for scene in active_scenes(state).filter(|s| s.probes) {
        if let Some(reason) = plan
            .find(FrameStage::APPLY, scene.id)
            .map(|p| p.reason.clone())
        {
            plan.push("free_space", FrameStage::PROBE, scene.id, reason);
        }
    }
}

/// Puts the light in free space into a scene's volume, where it changed and a camera without a
/// G-buffer, or one with fog, sees it.
pub(super) fn volume(state: &FrameState, plan: &mut Plan) {
    for scene in active_scenes(state).filter(|s| s.volume.asked && s.volume.seen) {
        let solved = plan
            .find(FrameStage::APPLY, scene.id)
            .map(|p| p.reason.clone());
        if !scene.probes {
            plan.skipped.push((scene.id, None, SkipReason::NoFreeSpace));
        } else if let Some(reason) = solved {
            plan.push("volume", FrameStage::VOLUME, scene.id, reason);
        } else if !scene.volume.held {
            plan.push("volume", FrameStage::VOLUME, scene.id, RunReason::NewVolume);
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

    fn stages(state: &FrameState) -> Vec<FrameStage> {
        Plan::new(state).passes.iter().map(|p| p.stage).collect()
    }

    #[test]
    fn probe_passes_run_for_bakes_with_probes() {
        let mut state = at_rest();
        state.views.push(deferred());
        state.scenes[0].probes = false;
        assert_eq!(stages(&state), [FrameStage::SPLAT, FrameStage::COMPOSITE]);
        state.scenes[0].probes = true;
        assert_eq!(
            stages(&state),
            [FrameStage::SPLAT, FrameStage::PROBE, FrameStage::COMPOSITE]
        );
        state.scenes[0].slots[1] = SlotChange::Geometry;
        assert_eq!(
            stages(&state),
            [
                FrameStage::PROJECT,
                FrameStage::PULL_PUSH,
                FrameStage::APPLY,
                FrameStage::FLATTEN,
                FrameStage::PROBE,
                FrameStage::SPLAT,
                FrameStage::PROBE,
                FrameStage::COMPOSITE
            ]
        );
    }

    #[test]
    fn volume_is_written_on_light_change() {
        let mut state = at_rest();
        // Nobody asks, and no camera is there.
        assert_eq!(stages(&state), []);
        assert_eq!(
            Plan::new(&state).skipped,
            [(A, None, SkipReason::NotInView)]
        );
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
        assert_eq!(stages(&state), [FrameStage::VOLUME]);
        let plan = Plan::new(&state);
        assert_eq!(
            plan.find(FrameStage::VOLUME, A).unwrap().reason,
            RunReason::NewVolume
        );
        state.scenes[0].volume.held = true;
        assert_eq!(stages(&state), []);
        // A lamp moves: one more pass than what carries its light on.
        state.scenes[0].slots[1] = SlotChange::Geometry;
        assert_eq!(
            stages(&state),
            [
                FrameStage::PROJECT,
                FrameStage::PULL_PUSH,
                FrameStage::APPLY,
                FrameStage::FLATTEN,
                FrameStage::PROBE,
                FrameStage::VOLUME
            ]
        );
        // A deferred camera beside it has its own display.
        state.views.push(deferred());
        state.scenes[0].slots[1] = SlotChange::None;
        assert_eq!(
            stages(&state),
            [FrameStage::SPLAT, FrameStage::PROBE, FrameStage::COMPOSITE]
        );
        // A bake without light in free space says so.
        state.scenes[0].probes = false;
        state.scenes[0].volume.held = false;
        assert_eq!(stages(&state), [FrameStage::SPLAT, FrameStage::COMPOSITE]);
        let why = (A, None, SkipReason::NoFreeSpace);
        assert!(Plan::new(&state).skipped.contains(&why));
    }
}
