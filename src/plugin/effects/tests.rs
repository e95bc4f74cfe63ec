//! Plans of the table of effects.

use super::*;
use crate::gpu::{HeadlessDevice, KernelPipelines};
use crate::plan::LightKind;
use crate::plan::{
    BounceState, CostModel, DisplayUse, FmmLimit, LightId, RunReason, SceneId, SceneState,
    SkipReason, SlotChange, SoftShadowState, Timing, ViewId, ViewState, Work,
};
use crate::plugin::effect_states::EffectStates;
use crate::plugin::effects::inspection::coefficients::SharedCoefficients;
use crate::plugin::effects::volume::irradiance_volume::ExtractedVolumes;
use crate::plugin::extract::ExtractedScene;
use crate::plugin::record::{SceneContext, record_scene};
use crate::plugin::render_state::{SceneRuntime, bounds};
use bevy::math::Vec3;
use bevy::utils::default;
use meshless_gi::{
    FrameLight, Light, Progress, Quad, Recipe, SkyRadiance, TriangleMesh, bake_scene,
};
use std::sync::Arc;

const A: SceneId = SceneId(1);
const B: SceneId = SceneId(2);

fn view(id: u64, sees: &[SceneId]) -> ViewState {
    ViewState {
        pixels: 1000,
        sees: sees.to_vec(),
        ..ViewState::new(ViewId(id))
    }
}

/// A scene on the device with eight slots at rest, and a view of it.
fn static_state() -> FrameState {
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
    let plan = plan_frame(&static_state());
    assert_eq!(stages(&plan), [FrameStage::SPLAT, FrameStage::COMPOSITE]);
    assert!(plan.skipped.contains(&(A, None, SkipReason::AtRest)));
}

#[test]
fn one_moved_light_projects_only_its_slot() {
    let mut state = static_state();
    state.scenes[0].slots[5] = SlotChange::Geometry;
    let plan = plan_frame(&state);
    assert_eq!(pass_of(&plan, FrameStage::PROJECT, A).slots, [5]);
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
    let mut state = static_state();
    state.scenes[0].slots[2] = SlotChange::Color;
    let plan = plan_frame(&state);
    assert_eq!(plan.count(FrameStage::PROJECT), 0);
    assert_eq!(
        pass_of(&plan, FrameStage::APPLY, A).reason,
        RunReason::LightsRecolored(1)
    );
}

#[test]
fn changed_occluder_runs_transport() {
    let mut state = static_state();
    state.scenes[0].occluders_changed = 1;
    let plan = plan_frame(&state);
    assert_eq!(
        stages(&plan)[..2],
        [FrameStage::OCCLUDE, FrameStage::PULL_PUSH]
    );
    let reason = &pass_of(&plan, FrameStage::APPLY, A).reason;
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
        let mut state = static_state();
        set(&mut state.scenes[0]);
        let plan = plan_frame(&state);
        assert_eq!(plan.count(FrameStage::PROJECT), 0);
        assert_eq!(pass_of(&plan, FrameStage::PULL_PUSH, A).reason, reason);
    }
}

#[test]
fn empty_plan_runs_no_pass() {
    type Change = fn(&mut FrameState);
    let cases: [(Change, SkipReason); 7] = [
        (
            |s| s.is_device_supported = false,
            SkipReason::DeviceUnsupported,
        ),
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
    for (change, reason) in cases {
        // Neither for a scene on the device with a light that moved, nor for one that was never
        // uploaded.
        for resident in [true, false] {
            let mut state = static_state();
            state.scenes[0].resident = resident;
            state.scenes[0].slots[0] = SlotChange::Geometry;
            change(&mut state);
            let plan = plan_frame(&state);
            assert!(plan.is_empty(), "{reason}: {plan}");
            assert_eq!(plan.skipped, [(A, None, reason)]);
        }
    }
}

#[test]
fn disabled_view_or_view_without_gbuffer_runs_no_pass() {
    for change in [
        |v: &mut ViewState| v.enabled = false,
        |v: &mut ViewState| v.has_gbuffer = false,
    ] {
        let mut state = static_state();
        change(&mut state.views[0]);
        assert!(plan_frame(&state).is_empty());
    }
    // The disabled view is named next to a view that shows the scene.
    let mut state = static_state();
    state.views.push(ViewState {
        enabled: false,
        ..view(8, &[A])
    });
    let plan = plan_frame(&state);
    assert_eq!(plan.count(FrameStage::COMPOSITE), 1);
    assert!(
        plan.skipped
            .contains(&(A, Some(ViewId(8)), SkipReason::ViewDisabled))
    );
}

#[test]
fn view_without_picture_has_layers_and_no_composite() {
    let mut state = static_state();
    assert_eq!(plan_frame(&state).count(FrameStage::COMPOSITE), 1);
    state.views[0].has_picture = false;
    let plan = plan_frame(&state);
    assert_eq!(plan.count(FrameStage::SPLAT), 1);
    assert_eq!(plan.count(FrameStage::COMPOSITE), 0);
}

#[test]
fn refused_stages_of_view_are_skipped_with_reason() {
    let mut state = static_state();
    state.views[0].specular = true;
    state.scenes[0].soft = SoftShadowState {
        lights: 1,
        has_visibility: true,
        held: true,
        ..SoftShadowState::default()
    };
    state.bounces = vec![BounceState {
        id: LightId(1, 0),
        maps: Ok(1),
        texels_per_map: 4,
        views: vec![ViewId(7)],
    }];
    let stages = [FrameStage::SUBTRACT_SHADOW, FrameStage::VPL_SPECULAR];
    let plan = plan_frame(&state);
    assert_eq!(stages.map(|stage| plan.count(stage)), [1, 1]);
    state.views[0].refused = stages.into();
    let plan = plan_frame(&state);
    assert_eq!(stages.map(|stage| plan.count(stage)), [0, 0]);
    for scene in [A, SceneId::WORLD] {
        let skip = (scene, Some(ViewId(7)), SkipReason::ViewBeyondLimits);
        assert!(plan.skipped.contains(&skip), "{plan}");
    }
}

#[test]
fn new_bake_runs_all_passes_once_and_views_composite_visible_scenes() {
    let mut state = static_state();
    state.scenes[0].resident = false;
    // The device holds no scene. Lights that are on are new to it, and lights that are off need no
    // projection.
    state.scenes[0].slots = vec![SlotChange::Geometry; 8];
    state.scenes[0].slots[3] = SlotChange::None;
    state.scenes.push(SceneState {
        resident: true,
        ..SceneState::new(B)
    });
    state.views = vec![view(7, &[A, B]), view(8, &[A])];
    let plan = plan_frame(&state);
    assert_eq!(
        pass_of(&plan, FrameStage::UPLOAD, A).reason,
        RunReason::NewBake
    );
    assert_eq!(
        pass_of(&plan, FrameStage::PROJECT, A).slots,
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
fn state_with_dynamic_objects() -> FrameState {
    FrameState {
        views: vec![view(7, &[])],
        bounces: vec![BounceState {
            id: LightId(5, 0),
            maps: Ok(2),
            texels_per_map: 64 * 64,
            views: vec![ViewId(7)],
        }],
        ..FrameState::default()
    }
}

#[test]
fn dynamic_objects_need_no_bake() {
    let plan = plan_frame(&state_with_dynamic_objects());
    assert_eq!(
        stages(&plan),
        [FrameStage::RSM, FrameStage::VPL, FrameStage::COMPOSITE]
    );
    assert!(plan.active_scenes().is_empty());
    assert_eq!(
        plan.of_light(LightId(5, 0)).next().unwrap().reason,
        RunReason::ObjectsInRange(2)
    );
    let timed = plan.of_light(LightId(5, 0)).next().unwrap().timing.unwrap();
    assert_eq!(timed.span(), "rsm_5_0");
    let cost = plan.costs.iter().find(|(scope, _)| *scope == timed);
    assert_eq!(cost.unwrap().1.work, Work::Texels(2 * 64 * 64));
    let words = plan.to_string();
    assert!(words.contains("rsm of light 5.0 (rsm): dynamic objects are in range"));
    assert!(
        words.contains("composite of the world in view 7"),
        "{words}"
    );
}

#[test]
fn specular_runs_where_requested_with_dynamic_objects() {
    let mut state = state_with_dynamic_objects();
    assert_eq!(plan_frame(&state).count(FrameStage::VPL_SPECULAR), 0);
    state.views[0].specular = true;
    let plan = plan_frame(&state);
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
    assert!(plan_frame(&state).is_empty());
}

#[test]
fn static_reflectors_are_not_redrawn_and_stay_visible() {
    let mut state = state_with_dynamic_objects();
    state.virtual_lights_valid = true;
    let plan = plan_frame(&state);
    assert_eq!(stages(&plan), [FrameStage::VPL, FrameStage::COMPOSITE]);
    assert_eq!(plan.without_maps, [(LightId(5, 0), SkipReason::AtRest)]);
    let words = plan.to_string();
    assert!(
        words.contains("skip maps of light 5.0: nothing changed"),
        "{words}"
    );
    state.bounces[0].maps = Err(SkipReason::NothingMoves);
    assert!(plan_frame(&state).is_empty());
}

#[test]
fn moving_reflectors_are_drawn_once_and_composited_in_every_view() {
    let mut state = static_state();
    state.bounces = state_with_dynamic_objects().bounces;
    assert_eq!(
        stages(&plan_frame(&state)),
        [
            FrameStage::RSM,
            FrameStage::SPLAT,
            FrameStage::VPL,
            FrameStage::COMPOSITE
        ]
    );
    state.views.push(view(8, &[A]));
    state.bounces[0].views.push(ViewId(8));
    let plan = plan_frame(&state);
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
    let plan = plan_frame(&state);
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
        (
            |s| s.is_device_supported = false,
            SkipReason::DeviceUnsupported,
        ),
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
    for (change, reason) in cases {
        let mut state = state_with_dynamic_objects();
        change(&mut state);
        let plan = plan_frame(&state);
        assert!(plan.is_empty(), "{reason}: {plan}");
        assert_eq!(plan.without_maps, [(LightId(5, 0), reason)]);
        assert!(plan.to_string().contains("skip maps of light 5.0"));
    }
    let mut nobody_asks = state_with_dynamic_objects();
    nobody_asks.bounces.clear();
    assert!(plan_frame(&nobody_asks).is_empty());
}

#[test]
fn buffers_are_released_after_delay_or_with_asset() {
    let mut state = static_state();
    state.views.clear();
    assert!(plan_frame(&state).release.is_empty());
    state.scenes[0].idle_frames = state.unload_after_frames;
    assert_eq!(plan_frame(&state).release, [A]);
    state.scenes[0].idle_frames = 0;
    state.scenes[0].loaded = false;
    assert_eq!(plan_frame(&state).release, [A]);
}

#[test]
fn coefficients_are_read_back_only_on_request() {
    let mut state = static_state();
    assert_eq!(plan_frame(&state).count(FrameStage::READ_BACK), 0);
    state.scenes[0].read_back = true;
    assert_eq!(
        pass_of(&plan_frame(&state), FrameStage::READ_BACK, A).effect,
        "inspection"
    );
}

#[test]
fn plan_reports_octree_above_device_limit() {
    let mut state = static_state();
    assert!(plan_frame(&state).linked.is_empty());
    let reason = FmmLimit::Order { have: 6, need: 9 };
    state.scenes[0].no_octree = Some(reason);
    let plan = plan_frame(&state);
    assert_eq!(plan.linked, [(A, reason)]);
    let text = plan.to_string();
    assert!(text.contains("order is 9, the kernels take 6"), "{text}");
}

#[test]
fn effect_names_are_unique() {
    let mut names: Vec<_> = EFFECTS.iter().map(|e| e.name).collect();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), EFFECTS.len());
}

#[test]
fn every_kernel_counts_as_one_stage() {
    let kinds = || EFFECTS.iter().flat_map(|effect| effect.passes);
    for kernel in gpu::EntryPoint::ALL {
        let stages = kinds().filter(|kind| kind.record.kernels.contains(&kernel));
        assert_eq!(stages.count(), 1, "{kernel:?}");
    }
    // Each names the shader of its kernels.
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    for kernel in &gpu::KERNELS {
        let shader = root.join("shaders").join(format!("{}.wgsl", kernel.name));
        assert!(shader.exists(), "{}", shader.display());
    }
}

/// A small bake, as extracted in a scene with one light.
fn extracted() -> ExtractedScene {
    let recipe = Recipe {
        coarse_radius: Some(0.8),
        levels: Some(2),
        sender_levels: Some(1),
        rays_per_point: Some(16),
        ..Recipe::default()
    };
    let bake = bake_scene(
        &TriangleMesh::from_quads(&Quad::cornell_box()),
        &recipe,
        0,
        &Progress::default(),
    );
    ExtractedScene {
        id: A,
        bake: Some(Arc::new(bake.expect("a small bake").scene)),
        placement: None,
        shown: true,
        layers: default(),
        solver: default(),
        emissive_luminance: 0.0,
        sky: SkyRadiance::BLACK,
        materials: Vec::new(),
        transmittances: Vec::new(),
        tier: None,
        channels: None,
        bounces: None,
    }
}

/// Plans and records a frame of a new scene with a table of effects. Returns the plan, the sum of
/// the scene's irradiance, and the number of buffers that the effects keep.
fn run(effects: &[Effect], scene: &ExtractedScene, device: &HeadlessDevice) -> (Plan, f32, u32) {
    let bake = scene.bake.clone().expect("a bake");
    let mut runtime = SceneRuntime::new(bake.clone());
    let light_source = FrameLight::expand(
        &Light::Point {
            position: bounds(&bake).center(),
            intensity: Vec3::ONE,
            range: f32::INFINITY,
        },
        1,
    );
    let lights = [((1, LightKind::Point), light_source)];
    let slots = runtime.changes.slots.update(&lights, bounds(&bake));
    let state = FrameState {
        scenes: vec![SceneState {
            slots: slots.changes,
            rays: bake.data().rays_per_slot(),
            ..SceneState::new(A)
        }],
        views: vec![view(7, &[A])],
        ..FrameState::default()
    };
    let plan = Plan::new(effects, &state);
    let kernels = KernelPipelines::new(&device.device).expect("kernels");
    let volumes = ExtractedVolumes::default();
    device
        .run(|encoder| {
            let mut ctx = SceneContext {
                kernels: &kernels,
                queue: &device.queue,
                encoder,
                scene,
                volumes: &volumes,
                coefficients: &SharedCoefficients::default(),
                earlier: EffectStates::default(),
                runtime: &mut runtime,
            };
            record_scene(effects, &plan, &mut ctx, None).expect("recorded");
        })
        .expect("a frame");
    let (buffers, _) = runtime.states.size();
    let frame = runtime.frame.expect("uploaded");
    let values = frame
        .buffers()
        .output(gpu::EntryPoint::Apply)
        .expect("values");
    let count = (values.size() / 4) as usize;
    let values: Vec<f32> = device.read(values, count).expect("read");
    (plan, values.iter().map(|v| v.abs()).sum(), buffers)
}

/// A table of effects with `test_effect.rs` as one more row. The effect is planned with a reason,
/// priced by its work, counted, and recorded in order with the passes of the other effects. Its
/// buffer is kept and counted.
#[test]
fn effect_row_is_planned_counted_and_recorded() {
    let rows = EFFECTS.iter().copied().chain([test_effect::EFFECT]);
    let table: Vec<Effect> = rows.collect();
    let (scene, device) = (extracted(), HeadlessDevice::new().expect("a device"));
    let (_, lit, without) = run(EFFECTS, &scene, &device);
    let (mut plan, dark, buffers) = run(&table, &scene, &device);
    assert!(lit > 0.0, "{lit}");
    assert_eq!((dark, buffers), (0.0, without + 1));

    let pass = pass_of(&plan, test_effect::BLACKOUT, A).clone();
    assert_eq!(
        (pass.effect, &pass.reason),
        ("blackout", &RunReason::InView)
    );
    assert_eq!(
        plan.to_string().matches("run  blackout of scene 1").count(),
        1,
        "{plan}"
    );
    let scope = pass.timing.expect("it is timed");
    let mut costs = CostModel::new();
    for _ in 0..3 {
        costs.record_plan(&plan);
        costs.record_time(scope, 2.0);
    }
    costs.write_costs(&mut plan);
    let cost = plan.cost_of(&pass).expect("it has a cost");
    assert!(matches!(cost.work, Work::Rays(n) if n > 0));
    assert_eq!(cost.predicted, Some(2.0));
    assert!(super::stages(&table).contains(&test_effect::BLACKOUT));
}

/// All layers are recorded in one span, that of the first.
#[test]
fn layers_are_timed_with_the_splat() {
    let kinds = EFFECTS.iter().flat_map(|effect| effect.passes);
    let mut of_views: Vec<_> = kinds.filter(|kind| kind.per_view).collect();
    of_views.sort_by_key(|kind| kind.stage);
    let is_layer = |kind: &&&PassKind| matches!(kind.record.how, Record::Layer(_));
    let layers: Vec<_> = of_views.iter().filter(is_layer).collect();
    assert!(layers.len() > 1, "the search finds nothing");
    let splat = Timing::With(FrameStage::SPLAT);
    assert!(layers.iter().all(|kind| kind.timing == splat));
    // No pass of a view comes between its layers.
    let first = of_views.iter().take_while(is_layer).count();
    assert_eq!(first, layers.len());
}

/// A table of effects with a layer as its first row. The layer is planned and timed with those of
/// other effects, in the order of the stages, and its view has a composite without a scene.
#[test]
fn layer_row_is_planned_without_a_scene() {
    let table: Vec<Effect> = [test_effect::LAYER]
        .into_iter()
        .chain(EFFECTS.iter().copied())
        .collect();
    let mut state = state_with_dynamic_objects();
    state.bounces.clear();
    assert!(Plan::new(EFFECTS, &state).is_empty());
    let plan = Plan::new(&table, &state);
    assert_eq!(stages(&plan), [test_effect::AMBIENT, FrameStage::COMPOSITE]);
    assert_eq!(plan.displays, [(ViewId(7), DisplayUse::Subsplats)]);

    let mut state = static_state();
    state.bounces = state_with_dynamic_objects().bounces;
    let plan = Plan::new(&table, &state);
    let layers = [FrameStage::SPLAT, test_effect::AMBIENT, FrameStage::VPL];
    assert_eq!(stages(&plan)[1..4], layers);
    let scope = plan.passes[1].timing;
    assert!(scope.is_some() && plan.passes[1..4].iter().all(|pass| pass.timing == scope));
}
