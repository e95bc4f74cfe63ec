//! The effect `fog`: light in free space that fog sends to the eye. A world without fog, or whose
//! fog lies in no scene with a volume, has no pass of it.

use super::effect::active_scenes;
use super::{FrameStage, FrameState, Plan, RunReason};

/// Adds the light of the fog in each view, scene by scene. A scene whose bake knows no light in
/// free space has none: `volume` says so.
pub(super) fn fog(state: &FrameState, plan: &mut Plan) {
    for fog in state.fogs.iter().filter(|f| f.volumes > 0) {
        let scene = active_scenes(state).find(|s| s.id == fog.scene);
        if scene.is_some_and(|s| s.volume.asked && s.probes) {
            let reason = RunReason::FogInView(fog.volumes);
            plan.push("fog", FrameStage::FOG, fog.scene, reason).view = Some(fog.view);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::{
        FogState, SceneId, SceneState, SkipReason, SlotChange, TimingScope, ViewId, VolumeState,
        Work,
    };

    const A: SceneId = SceneId(1);

    /// A scene on the device with a volume that is written, and fog in it that a camera without
    /// display settings sees.
    fn at_rest() -> FrameState {
        FrameState {
            scenes: vec![SceneState {
                resident: true,
                probes: true,
                slots: vec![SlotChange::None; 2],
                volume: VolumeState {
                    asked: true,
                    seen: true,
                    held: true,
                    voxels: 100,
                },
                ..SceneState::new(A)
            }],
            fogs: vec![FogState {
                view: ViewId(7),
                scene: A,
                volumes: 2,
                pixels: 1000,
            }],
            ..FrameState::default()
        }
    }

    fn stages(state: &FrameState) -> Vec<FrameStage> {
        Plan::new(state).passes.iter().map(|p| p.stage).collect()
    }

    #[test]
    fn fog_is_composited_every_frame_and_lit_on_change() {
        let mut state = at_rest();
        assert_eq!(stages(&state), [FrameStage::FOG]);
        let plan = Plan::new(&state);
        assert_eq!(plan.passes[0].view, Some(ViewId(7)));
        assert_eq!(plan.passes[0].reason, RunReason::FogInView(2));
        let words = plan.to_string();
        let line = "fog of scene 1 in view 7 (fog): 2 fog volume(s) of the view lie in the scene";
        assert!(words.contains(line), "{words}");
        // Once for each of them; a second scene is timed with it.
        let timed = TimingScope {
            stage: FrameStage::FOG,
            scene: SceneId::WORLD,
            view: Some(ViewId(7)),
        };
        assert_eq!(plan.costs[0].0, timed);
        assert_eq!(plan.costs[0].1.work, Work::Pixels(2000));
        let mut second = state.clone();
        second.scenes.push(SceneState {
            id: SceneId(2),
            ..state.scenes[0].clone()
        });
        second.fogs.push(FogState {
            scene: SceneId(2),
            volumes: 1,
            ..state.fogs[0]
        });
        let plan = Plan::new(&second);
        assert_eq!((plan.count(FrameStage::FOG), plan.costs.len()), (2, 1));
        assert_eq!(plan.costs[0].1.work, Work::Pixels(3000));
        // A lamp moves: its light is in the fog of the same frame.
        state.scenes[0].slots[1] = SlotChange::Geometry;
        assert_eq!(
            stages(&state),
            [
                FrameStage::PROJECT,
                FrameStage::PULL_PUSH,
                FrameStage::APPLY,
                FrameStage::FLATTEN,
                FrameStage::PROBE,
                FrameStage::VOLUME,
                FrameStage::FOG
            ]
        );
    }

    #[test]
    fn fog_without_light_runs_no_pass() {
        type Change = fn(&mut FrameState);
        let cases: [Change; 6] = [
            |s| s.fogs.clear(),
            |s| s.fogs[0].volumes = 0,
            |s| s.fogs[0].scene = SceneId(9),
            |s| s.scenes[0].volume.asked = false,
            |s| s.scenes[0].probes = false,
            |s| s.device_able = false,
        ];
        for (k, change) in cases.into_iter().enumerate() {
            let mut state = at_rest();
            change(&mut state);
            assert_eq!(stages(&state), [], "{k}");
        }
        // A bake without light in free space says so.
        let mut state = at_rest();
        state.scenes[0].probes = false;
        let why = (A, None, SkipReason::NoFreeSpace);
        assert!(Plan::new(&state).skipped.contains(&why));
    }
}
