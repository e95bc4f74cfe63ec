//! The table of effects, which make the [plan](Plan) together.
//!
//! An effect is a part of the simulation that a scene may or may not call for. It looks at the
//! frame's state and appends the passes that it needs, each with a reason. Effects run in the order
//! of [`EFFECTS`], so a later one may look at what the earlier ones decided. To add one
//! (multiresolution splatting, shadows of area lights, point models, dynamic objects): write a
//! `fn(&FrameState, &mut Plan)` and add a row.

use super::{
    BounceState, FrameStage, FrameState, Plan, RunReason, SceneId, SceneState, SkipReason,
    SlotChange, ViewState,
};
use std::fmt;

/// A row of the table.
pub struct Effect {
    /// Its name, as it appears in [`Pass::effect`](super::Pass::effect).
    pub name: &'static str,
    /// What it does, in one sentence.
    pub summary: &'static str,
    /// Appends the passes that this frame calls for.
    pub schedule: fn(&FrameState, &mut Plan),
}

impl fmt::Debug for Effect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Effect")
            .field("name", &self.name)
            .finish_non_exhaustive()
    }
}

/// Every effect, in the order in which they are asked. The one place where effects register.
pub const EFFECTS: &[Effect] = &[
    Effect {
        name: "residency",
        summary: "brings a bake that came into view to the device",
        schedule: residency,
    },
    Effect {
        name: "materials",
        summary: "tells the device the senders' surfaces after materials changed",
        schedule: super::transport::materials,
    },
    Effect {
        name: "occluders",
        summary: "opens and shuts the links that doors and lifts are in the way of, where one of those moved",
        schedule: super::transport::occluders,
    },
    Effect {
        name: "lights",
        summary: "projects the light slots that are new or moved",
        schedule: lights,
    },
    Effect {
        name: "transport",
        summary: "carries the light on by the operator when anything that feeds it changed",
        schedule: super::transport::transport,
    },
    Effect {
        name: "free_space",
        summary: "carries the light on to the probes of bakes that have them, for what moves",
        schedule: super::space::free_space,
    },
    Effect {
        name: "volume",
        summary: "puts the light in free space into a volume, for cameras without a G-buffer and for fog",
        schedule: super::space::volume,
    },
    Effect {
        name: "soft_shadows",
        summary: "finds what lamps with soft shadows do not reach, where one of them changed",
        schedule: super::soft_shadows::soft_shadows,
    },
    Effect {
        name: "bounce_from_dynamic",
        summary: "draws what moves from the lights that ask for it, and makes virtual point lights of it",
        schedule: super::dynamic_objects::bounce_from_dynamic,
    },
    Effect {
        name: "display",
        summary: "lays the indirect light over the pixels of each view",
        schedule: display,
    },
    Effect {
        name: "gloss_from_dynamic",
        summary: "shows what moves in glossy surfaces, in the views that ask for it",
        schedule: super::dynamic_objects::gloss_from_dynamic,
    },
    Effect {
        name: "penumbrae",
        summary: "takes the light that does not get there from the picture of each view",
        schedule: super::soft_shadows::penumbrae,
    },
    Effect {
        name: "fog",
        summary: "adds the light in free space that fog sends to the eye, in each view that sees fog in a scene with a volume",
        schedule: super::fog::fog,
    },
    Effect {
        name: "inspection",
        summary: "brings coefficients back to the CPU for the gizmos",
        schedule: inspection,
    },
];

/// Whether a scene takes part in the frame at all. Every effect asks this first.
fn active(state: &FrameState, scene: &SceneState) -> Result<(), SkipReason> {
    if !state.device_able {
        Err(SkipReason::DeviceUnable)
    } else if !scene.loaded {
        Err(SkipReason::AssetMissing)
    } else if scene.largest_buffer == u64::MAX {
        Err(SkipReason::BeyondLimits)
    } else if scene.largest_buffer > state.largest_binding {
        Err(SkipReason::TooLarge {
            needs: scene.largest_buffer,
            has: state.largest_binding,
        })
    } else if !scene.shown {
        Err(SkipReason::Hidden)
    } else if !displayed(state, scene) {
        Err(SkipReason::NotInView)
    } else {
        Ok(())
    }
}

/// Whether a view shows the scene over its G-buffer, or a camera without one, or with fog, by its
/// volume.
fn displayed(state: &FrameState, scene: &SceneState) -> bool {
    let shows = |v: &ViewState| v.enabled && v.has_gbuffer && v.sees.contains(&scene.id);
    scene.volume.asked && scene.volume.seen || state.views.iter().any(shows)
}

/// The active scenes; without a note about the others.
pub(super) fn active_scenes(state: &FrameState) -> impl Iterator<Item = &SceneState> {
    state.scenes.iter().filter(|s| active(state, s).is_ok())
}

fn residency(state: &FrameState, plan: &mut Plan) {
    for scene in &state.scenes {
        match active(state, scene) {
            Ok(()) if !scene.resident => {
                plan.push(
                    "residency",
                    FrameStage::UPLOAD,
                    scene.id,
                    RunReason::NewBake,
                );
            }
            Ok(()) => {}
            Err(why) => {
                plan.skipped.push((scene.id, None, why));
                if !scene.loaded || scene.idle_frames >= state.unload_after_frames {
                    plan.release.push(scene.id);
                }
            }
        }
    }
}

fn lights(state: &FrameState, plan: &mut Plan) {
    for scene in active_scenes(state) {
        let slots: Vec<u32> = (0..scene.slots.len())
            .filter(|&i| scene.slots[i] == SlotChange::Geometry)
            .map(|i| i as u32)
            .collect();
        if !slots.is_empty() {
            let reason = match scene.occluders_changed {
                0 => RunReason::LightsMoved(slots.len()),
                moved => RunReason::OccludersMoved(moved),
            };
            plan.push("lights", FrameStage::PROJECT, scene.id, reason)
                .slots = slots;
        }
    }
}

fn display(state: &FrameState, plan: &mut Plan) {
    for view in &state.views {
        let mut first = None;
        for scene in active_scenes(state).filter(|s| view.sees.contains(&s.id)) {
            if !view.enabled {
                plan.skipped
                    .push((scene.id, Some(view.id), SkipReason::ViewDisabled));
            } else if !view.has_gbuffer {
                plan.skipped
                    .push((scene.id, Some(view.id), SkipReason::NoGbuffer));
            } else {
                plan.push("display", FrameStage::SPLAT, scene.id, RunReason::InView)
                    .view = Some(view.id);
                if scene.probes {
                    plan.push("free_space", FrameStage::PROBE, scene.id, RunReason::InView)
                        .view = Some(view.id);
                }
                first = first.or(Some(scene.id));
            }
        }
        // All lights that bounce make one list.
        let bounced =
            |light: &BounceState| light.views.contains(&view.id) && plan.bounces(light.id);
        if view.enabled && view.has_gbuffer && state.bounces.iter().any(bounced) {
            let world = SceneId::WORLD;
            plan.push(
                "bounce_from_dynamic",
                FrameStage::VPL,
                world,
                RunReason::InView,
            )
            .view = Some(view.id);
            first = first.or(Some(world));
        }
        // All that lights a view goes into one picture, which is added once.
        if let Some(scene) = first {
            plan.displays.push((view.id, view.display));
            plan.push("display", FrameStage::COMPOSITE, scene, RunReason::InView)
                .view = Some(view.id);
        }
    }
}

fn inspection(state: &FrameState, plan: &mut Plan) {
    for scene in active_scenes(state).filter(|s| s.read_back) {
        plan.push(
            "inspection",
            FrameStage::READ_BACK,
            scene.id,
            RunReason::Asked,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::{BounceState, DisplayUse, FmmLimit, LightId, ViewId};

    const A: SceneId = SceneId(1);
    const B: SceneId = SceneId(2);

    fn view(id: u64, sees: &[SceneId]) -> ViewState {
        ViewState {
            id: ViewId(id),
            gloss: false,
            lit: true,
            enabled: true,
            has_gbuffer: true,
            pixels: 1000,
            display: DisplayUse::Subsplats,
            sees: sees.to_vec(),
        }
    }

    /// A scene on the device with eight slots at rest, and a view of it.
    fn at_rest() -> FrameState {
        FrameState {
            scenes: vec![SceneState {
                resident: true,
                slots: vec![SlotChange::None; 8],
                ..SceneState::new(A)
            }],
            views: vec![view(7, &[A])],
            ..FrameState::default()
        }
    }

    fn stages(plan: &Plan) -> Vec<FrameStage> {
        plan.passes.iter().map(|p| p.stage).collect()
    }

    #[test]
    fn static_lights_run_only_display_passes() {
        let plan = Plan::new(&at_rest());
        assert_eq!(stages(&plan), [FrameStage::SPLAT, FrameStage::COMPOSITE]);
        assert!(plan.skipped.contains(&(A, None, SkipReason::AtRest)));
    }

    #[test]
    fn one_moved_light_projects_only_its_slot() {
        let mut state = at_rest();
        state.scenes[0].slots[5] = SlotChange::Geometry;
        let plan = Plan::new(&state);
        assert_eq!(plan.find(FrameStage::PROJECT, A).unwrap().slots, [5]);
        assert_eq!(plan.projected_slots(), 1);
        assert_eq!(
            stages(&plan),
            [
                FrameStage::PROJECT,
                FrameStage::PULL_PUSH,
                FrameStage::APPLY,
                FrameStage::FLATTEN,
                FrameStage::SPLAT,
                FrameStage::COMPOSITE
            ]
        );
    }

    #[test]
    fn changed_light_color_projects_nothing() {
        let mut state = at_rest();
        state.scenes[0].slots[2] = SlotChange::Color;
        let plan = Plan::new(&state);
        assert_eq!(plan.count(FrameStage::PROJECT), 0);
        assert_eq!(
            plan.find(FrameStage::APPLY, A).unwrap().reason,
            RunReason::LightsRecolored(1)
        );
    }

    #[test]
    fn changed_occluder_runs_transport() {
        let mut state = at_rest();
        state.scenes[0].occluders_changed = 1;
        let plan = Plan::new(&state);
        assert_eq!(
            stages(&plan)[..2],
            [FrameStage::OCCLUDE, FrameStage::PULL_PUSH]
        );
        let reason = &plan.find(FrameStage::APPLY, A).unwrap().reason;
        assert_eq!(*reason, RunReason::OccludersMoved(1));
    }

    #[test]
    fn changed_settings_or_removed_light_run_transport() {
        for (set, reason) in [
            (
                (|s| s.settings_changed = true) as fn(&mut SceneState),
                RunReason::SettingsChanged,
            ),
            (|s| s.stale = true, RunReason::LightRemoved),
        ] {
            let mut state = at_rest();
            set(&mut state.scenes[0]);
            let plan = Plan::new(&state);
            assert_eq!(plan.count(FrameStage::PROJECT), 0);
            assert_eq!(plan.find(FrameStage::PULL_PUSH, A).unwrap().reason, reason);
        }
    }

    #[test]
    fn empty_plan_runs_no_pass() {
        type Change = fn(&mut FrameState);
        let cases: [(Change, SkipReason); 7] = [
            (|s| s.device_able = false, SkipReason::DeviceUnable),
            (|s| s.scenes[0].loaded = false, SkipReason::AssetMissing),
            (|s| s.scenes[0].shown = false, SkipReason::Hidden),
            (|s| s.views.clear(), SkipReason::NotInView),
            (|s| s.views[0].sees.clear(), SkipReason::NotInView),
            (
                |s| s.scenes[0].largest_buffer = u64::MAX,
                SkipReason::BeyondLimits,
            ),
            (
                |s| s.scenes[0].largest_buffer = 1 << 40,
                SkipReason::TooLarge {
                    needs: 1 << 40,
                    has: 128 << 20,
                },
            ),
        ];
        for (change, why) in cases {
            // Neither for a scene on the device with a light that moved, nor for one that was never
            // uploaded.
            for resident in [true, false] {
                let mut state = at_rest();
                state.scenes[0].resident = resident;
                state.scenes[0].slots[0] = SlotChange::Geometry;
                change(&mut state);
                let plan = Plan::new(&state);
                assert!(plan.is_empty(), "{why}: {plan}");
                assert_eq!(plan.skipped, [(A, None, why)]);
            }
        }
    }

    #[test]
    fn disabled_view_or_view_without_gbuffer_runs_no_pass() {
        for change in [
            |v: &mut ViewState| v.enabled = false,
            |v: &mut ViewState| v.has_gbuffer = false,
        ] {
            let mut state = at_rest();
            change(&mut state.views[0]);
            assert!(Plan::new(&state).is_empty());
        }
        // Beside a view that shows the scene the disabled one is named.
        let mut state = at_rest();
        state.views.push(ViewState {
            enabled: false,
            ..view(8, &[A])
        });
        let plan = Plan::new(&state);
        assert_eq!(plan.count(FrameStage::COMPOSITE), 1);
        assert!(
            plan.skipped
                .contains(&(A, Some(ViewId(8)), SkipReason::ViewDisabled))
        );
    }

    #[test]
    fn new_bake_runs_all_passes_once_and_views_composite_visible_scenes() {
        let mut state = at_rest();
        state.scenes[0].resident = false;
        // The device holds nothing: what shines is new to it, and what is dark needs no projection.
        state.scenes[0].slots = vec![SlotChange::Geometry; 8];
        state.scenes[0].slots[3] = SlotChange::None;
        state.scenes.push(SceneState {
            resident: true,
            ..SceneState::new(B)
        });
        state.views = vec![view(7, &[A, B]), view(8, &[A])];
        let plan = Plan::new(&state);
        assert_eq!(
            plan.find(FrameStage::UPLOAD, A).unwrap().reason,
            RunReason::NewBake
        );
        assert_eq!(
            plan.find(FrameStage::PROJECT, A).unwrap().slots,
            [0, 1, 2, 4, 5, 6, 7]
        );
        assert_eq!(plan.count(FrameStage::APPLY), 1, "B is at rest");
        assert_eq!(plan.count(FrameStage::SPLAT), 3);
        assert_eq!(plan.count(FrameStage::COMPOSITE), 2, "one a view");
        assert_eq!(plan.active_scenes(), [A, B]);
        assert!(
            plan.to_string()
                .contains("upload of scene 1 (residency): the device does not hold this bake")
        );
    }

    /// A light that draws two maps for view 7, without any baked scene.
    fn something_moves() -> FrameState {
        FrameState {
            views: vec![view(7, &[])],
            bounces: vec![BounceState {
                id: LightId(5, 0),
                maps: Ok(2),
                views: vec![ViewId(7)],
            }],
            ..FrameState::default()
        }
    }

    #[test]
    fn dynamic_objects_need_no_bake() {
        let plan = Plan::new(&something_moves());
        assert_eq!(
            stages(&plan),
            [FrameStage::RSM, FrameStage::VPL, FrameStage::COMPOSITE]
        );
        assert!(plan.active_scenes().is_empty());
        assert_eq!(
            plan.find_light(LightId(5, 0)).unwrap().reason,
            RunReason::Moving(2)
        );
        let words = plan.to_string();
        assert!(words.contains("rsm of light 5.0 (bounce_from_dynamic): what moves is in reach"));
        assert!(
            words.contains("composite of the world in view 7"),
            "{words}"
        );
    }

    #[test]
    fn specular_runs_where_requested_with_dynamic_objects() {
        let mut state = something_moves();
        assert_eq!(Plan::new(&state).count(FrameStage::VPL_SPECULAR), 0);
        state.views[0].gloss = true;
        let plan = Plan::new(&state);
        assert_eq!(
            stages(&plan),
            [
                FrameStage::RSM,
                FrameStage::VPL,
                FrameStage::COMPOSITE,
                FrameStage::VPL_SPECULAR
            ]
        );
        assert_eq!(plan.passes[3].view, Some(ViewId(7)));
        state.bounces.clear();
        assert!(Plan::new(&state).is_empty());
    }

    #[test]
    fn static_reflectors_are_not_redrawn_and_stay_visible() {
        let mut state = something_moves();
        state.bounces_held = true;
        let plan = Plan::new(&state);
        assert_eq!(stages(&plan), [FrameStage::VPL, FrameStage::COMPOSITE]);
        assert!(plan.bounces(LightId(5, 0)) && plan.find_light(LightId(5, 0)).is_none());
        let words = plan.to_string();
        assert!(
            words.contains("skip maps of light 5.0: nothing changed"),
            "{words}"
        );
        state.bounces[0].maps = Err(SkipReason::NothingMoves);
        assert!(Plan::new(&state).is_empty());
    }

    #[test]
    fn moving_reflectors_are_drawn_once_and_composited_in_every_view() {
        let mut state = at_rest();
        state.bounces = something_moves().bounces;
        assert_eq!(
            stages(&Plan::new(&state)),
            [
                FrameStage::RSM,
                FrameStage::SPLAT,
                FrameStage::VPL,
                FrameStage::COMPOSITE
            ]
        );
        state.views.push(view(8, &[A]));
        state.bounces[0].views.push(ViewId(8));
        let plan = Plan::new(&state);
        assert_eq!(
            [
                FrameStage::RSM,
                FrameStage::SPLAT,
                FrameStage::VPL,
                FrameStage::COMPOSITE
            ]
            .map(|s| plan.count(s)),
            [1, 2, 2, 2]
        );
        // The second view does not show that light's layer.
        state.bounces[0].views.pop();
        let plan = Plan::new(&state);
        assert_eq!(
            [
                FrameStage::RSM,
                FrameStage::SPLAT,
                FrameStage::VPL,
                FrameStage::COMPOSITE
            ]
            .map(|s| plan.count(s)),
            [1, 2, 1, 2]
        );
    }

    #[test]
    fn plan_without_reflectors_skips_rsm_with_reason() {
        type Change = fn(&mut FrameState);
        let cases: [(Change, SkipReason); 7] = [
            (|s| s.device_able = false, SkipReason::DeviceUnable),
            (
                |s| s.bounces[0].maps = Err(SkipReason::NothingMoves),
                SkipReason::NothingMoves,
            ),
            (
                |s| s.bounces[0].maps = Err(SkipReason::OutOfReach),
                SkipReason::OutOfReach,
            ),
            (
                |s| s.bounces[0].maps = Err(SkipReason::LightDark),
                SkipReason::LightDark,
            ),
            (|s| s.bounces[0].views.clear(), SkipReason::NotInView),
            (|s| s.views[0].enabled = false, SkipReason::NotInView),
            (|s| s.views[0].has_gbuffer = false, SkipReason::NotInView),
        ];
        for (change, why) in cases {
            let mut state = something_moves();
            change(&mut state);
            let plan = Plan::new(&state);
            assert!(plan.is_empty(), "{why}: {plan}");
            assert_eq!(plan.dark, [(LightId(5, 0), why)]);
            assert!(plan.to_string().contains("skip maps of light 5.0"));
        }
        let mut nobody_asks = something_moves();
        nobody_asks.bounces.clear();
        assert!(Plan::new(&nobody_asks).is_empty());
    }

    #[test]
    fn buffers_are_released_after_delay_or_with_asset() {
        let mut state = at_rest();
        state.views.clear();
        assert!(Plan::new(&state).release.is_empty());
        state.scenes[0].idle_frames = state.unload_after_frames;
        assert_eq!(Plan::new(&state).release, [A]);
        state.scenes[0].idle_frames = 0;
        state.scenes[0].loaded = false;
        assert_eq!(Plan::new(&state).release, [A]);
    }

    #[test]
    fn coefficients_are_read_back_only_on_request() {
        let mut state = at_rest();
        assert_eq!(Plan::new(&state).count(FrameStage::READ_BACK), 0);
        state.scenes[0].read_back = true;
        assert_eq!(
            Plan::new(&state)
                .find(FrameStage::READ_BACK, A)
                .unwrap()
                .effect,
            "inspection"
        );
    }

    #[test]
    fn plan_reports_octree_above_device_limit() {
        let mut state = at_rest();
        assert!(Plan::new(&state).linked.is_empty());
        let why = FmmLimit::Order { have: 6, need: 9 };
        state.scenes[0].no_octree = Some(why);
        let plan = Plan::new(&state);
        assert_eq!(plan.linked, [(A, why)]);
        let said = plan.to_string();
        assert!(said.contains("order is 9, the kernels take 6"), "{said}");
    }

    #[test]
    fn effect_names_are_unique() {
        let mut names: Vec<_> = EFFECTS.iter().map(|e| e.name).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), EFFECTS.len());
    }
}
