//! The effect `volume`: light in free space for cameras without a G-buffer, in a texture that the engine reads. Without such a camera, or a scene that is to have a volume, it does nothing.

use super::effect::{Plan, active_scenes};
use super::{FrameState, Reason, Skip, Stage};

/// Puts the light in free space into a scene's volume, where it changed and a camera without a G-buffer sees it.
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
    use crate::plan::{SceneId, SceneState, SlotChange, ViewId, ViewState, VolumeState};

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

    #[test]
    fn a_volume_is_written_when_the_light_changed() {
        use Stage::*;
        let stages = |state: &FrameState| -> Vec<Stage> {
            Plan::new(state).passes.iter().map(|p| p.stage).collect()
        };
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
        state.views.push(ViewState {
            id: ViewId(3),
            gloss: false,
            lit: true,
            enabled: true,
            has_gbuffer: true,
            sees: vec![A],
        });
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
