//! Tests of `cost`.

use super::*;
use crate::plan::{
    ColorModeSelection, SceneState, SlotChange, SoftShadowState, TierSelection, ViewState,
    VolumeState,
};
use crate::plugin::effects::plan_frame;
use meshless_gi::Channels;

/// Two scenes on the device with four slots each, and a view of both.
fn state() -> FrameState {
    let scene = |id: u64, links: u64| SceneState {
        resident: true,
        rays: 1000,
        slots: vec![SlotChange::None; 4],
        tier: Some(TierSelection {
            work: links,
            ..TierSelection::default()
        }),
        ..SceneState::new(SceneId(id))
    };
    FrameState {
        scenes: vec![scene(1, 50_000), scene(2, 200_000)],
        views: vec![ViewState {
            pixels: 10_000,
            sees: vec![SceneId(1), SceneId(2)],
            ..ViewState::new(ViewId(7))
        }],
        ..FrameState::default()
    }
}

fn moving(mut state: FrameState, scene: usize, slots: usize) -> FrameState {
    state.scenes[scene].slots[..slots].fill(SlotChange::Geometry);
    state
}

fn cost(plan: &Plan, stage: FrameStage) -> Cost {
    *plan
        .cost_of(
            plan.passes
                .iter()
                .find(|p| p.stage == stage)
                .expect("it runs"),
        )
        .expect("it is timed")
}

#[test]
fn stage_work_counts_read_items() {
    let plan = plan_frame(&moving(state(), 1, 3));
    assert_eq!(cost(&plan, FrameStage::PROJECT).work, Work::Rays(3000));
    assert_eq!(cost(&plan, FrameStage::APPLY).work, Work::Links(200_000));
    assert_eq!(
        cost(&plan, FrameStage::PULL_PUSH),
        cost(&plan, FrameStage::APPLY)
    );
    // Both scenes are splatted over the pixels, and the composite runs once.
    assert_eq!(cost(&plan, FrameStage::SPLAT).work, Work::Pixels(20_000));
    assert_eq!(
        cost(&plan, FrameStage::COMPOSITE).work,
        Work::Pixels(10_000)
    );
    let groups: Vec<FrameStage> = plan.costs.iter().map(|(t, _)| t.stage).collect();
    assert_eq!(
        groups,
        [
            FrameStage::PROJECT,
            FrameStage::APPLY,
            FrameStage::SPLAT,
            FrameStage::COMPOSITE
        ]
    );
    // The rows of the probes are applied with the others, and timed with them.
    let mut in_space = moving(state(), 1, 3);
    (in_space.scenes[1].probes, in_space.scenes[1].probe_links) = (true, 3000);
    let both = plan_frame(&in_space);
    assert_eq!(cost(&both, FrameStage::APPLY).work, Work::Links(203_000));
    assert_eq!(both.costs.len(), plan.costs.len());
    let words = plan.to_string();
    assert!(
        words.contains(
            "flatten of scene 2 (transport): 3 light slot(s) new or moved; timed with pull_push"
        ),
        "{words}"
    );
    assert!(!words.contains(" ms "), "{words}");
}

#[test]
fn cost_measured_on_one_scene_predicts_other() {
    let mut model = CostModel::new();
    let mut first = plan_frame(&moving(state(), 0, 1));
    model.write_costs(&mut first);
    assert_eq!(cost(&first, FrameStage::APPLY).predicted, None);
    for _ in 0..5 {
        model.record_plan(&first);
        for (timed, _) in &first.costs {
            model.record_time(*timed, 2.0);
        }
    }
    model.write_costs(&mut first);
    let Cost {
        predicted,
        measured,
        ..
    } = cost(&first, FrameStage::APPLY);
    assert_eq!((predicted, measured), (Some(2.0), Some(2.0)));
    // Four times the links and three times the rays: never run, so not measured.
    let mut second = plan_frame(&moving(state(), 1, 3));
    model.write_costs(&mut second);
    let Cost {
        predicted,
        measured,
        ..
    } = cost(&second, FrameStage::APPLY);
    assert_eq!((predicted, measured), (Some(8.0), None));
    assert_eq!(cost(&second, FrameStage::PROJECT).predicted, Some(6.0));
    // The same pixels as before.
    assert_eq!(cost(&second, FrameStage::SPLAT).measured, Some(2.0));
    assert!(
        second.to_string().contains("8.00 ms expected\n"),
        "{second}"
    );
}

#[test]
fn cost_rate_with_delayed_timings_and_changed_slots_is_correct() {
    let mut model = CostModel::new();
    // One microsecond per ray, and one to four slots in turn. Timestamps arrive three frames late.
    let mut late = std::collections::VecDeque::new();
    for k in 0..200 {
        let plan = plan_frame(&moving(state(), 0, 1 + k % 4));
        model.record_plan(&plan);
        late.push_back(1 + k % 4);
        if late.len() > 3 {
            let slots = late.pop_front().expect("four") as f32;
            model.record_time(plan.costs[0].0, slots);
        }
    }
    let mut plan = plan_frame(&moving(state(), 0, 4));
    model.write_costs(&mut plan);
    let predicted = cost(&plan, FrameStage::PROJECT)
        .predicted
        .expect("measured");
    assert!((predicted / 4.0 - 1.0).abs() < 0.35, "{predicted}");
}

#[test]
fn cost_of_removed_scene_is_dropped_and_invalid_time_skipped() {
    let mut model = CostModel::new();
    let plan = plan_frame(&moving(state(), 0, 1));
    let project = plan.costs[0].0;
    model.record_time(project, 1.0);
    assert!(model.rates.is_empty(), "no plan had it yet");
    model.record_plan(&plan);
    model.record_time(project, f32::NAN);
    model.record_time(project, -1.0);
    assert!(model.rates.is_empty());
    model.record_time(project, 1.0);
    assert_eq!(model.rates.len(), 1);
    let rest = plan_frame(&state());
    for _ in 0..=MAX_UNUSED_PLANS {
        model.record_plan(&rest);
    }
    assert_eq!(model.groups.len(), rest.costs.len());
    // The rate stays, because it belongs to the device.
    assert_eq!(model.rates.len(), 1);
}

#[test]
fn cost_rate_of_monochrome_is_separate() {
    let mut model = CostModel::new();
    let in_one = |mut state: FrameState| {
        state.scenes[0].channels = Some(ColorModeSelection {
            channels: Channels::One(glam::Vec3::ONE),
            forced: false,
            reason: "",
        });
        state
    };
    let mut three = plan_frame(&moving(state(), 0, 1));
    let mut one = plan_frame(&moving(in_one(state()), 0, 1));
    assert_eq!(cost(&one, FrameStage::APPLY).work, Work::OneChannel(50_000));
    let run = |model: &mut CostModel, plan: &mut Plan, ms: f32| {
        for _ in 0..20 {
            model.record_plan(plan);
            let timed = plan.costs.iter().map(|(t, _)| *t);
            let apply = timed.into_iter().find(|t| t.stage == FrameStage::APPLY);
            model.record_time(apply.expect("it runs"), ms);
        }
        model.write_costs(plan);
        cost(plan, FrameStage::APPLY)
    };
    let close = |found: Option<f32>, ms: f32| found.is_some_and(|f| (f / ms - 1.0).abs() < 1e-3);
    assert!(close(run(&mut model, &mut three, 4.0).predicted, 4.0));
    // Timestamps still belong to three channels.
    let late = Cost {
        work: Work::OneChannel(50_000),
        ..Cost::default()
    };
    for _ in 0..MAX_LATE_MEASUREMENTS {
        model.record_plan(&one);
        let timed = one
            .costs
            .iter()
            .map(|(t, _)| *t)
            .find(|t| t.stage == FrameStage::APPLY);
        model.record_time(timed.expect("it runs"), 4.0);
    }
    model.write_costs(&mut one);
    assert_eq!(cost(&one, FrameStage::APPLY), late);
    // An octree takes all three channels.
    let mut octree = in_one(state());
    octree.scenes[0].tier.as_mut().expect("a tier").octree = true;
    let octree = plan_frame(&moving(octree, 0, 1));
    assert_eq!(cost(&octree, FrameStage::APPLY).work, Work::Links(50_000));
    let first = run(&mut model, &mut one, 2.0);
    assert!(
        close(first.predicted, 2.0) && close(first.measured, 2.0),
        "{first}"
    );
    // Another scene in three channels is predicted from measurements of three channels.
    let mut other = plan_frame(&moving(state(), 1, 1));
    model.write_costs(&mut other);
    assert!(close(cost(&other, FrameStage::APPLY).predicted, 16.0));
}

#[test]
fn cost_of_occluders_volumes_and_soft_shadows_has_own_units() {
    let mut state = state();
    let scene = &mut state.scenes[0];
    (scene.occluders_changed, scene.occluded_link_terms) = (1, 5000);
    scene.probes = true;
    scene.volume = VolumeState {
        requested: true,
        is_visible: true,
        held: false,
        voxels: 4096,
    };
    scene.soft = SoftShadowState {
        lights: 2,
        has_visibility: true,
        points: 300,
        ..SoftShadowState::default()
    };
    let plan = plan_frame(&state);
    assert_eq!(
        cost(&plan, FrameStage::OCCLUDE).work,
        Work::OccludedLinkTerms(5000)
    );
    assert_eq!(cost(&plan, FrameStage::VOLUME).work, Work::Voxels(4096));
    assert_eq!(cost(&plan, FrameStage::SOFT_SHADOW).work, Work::Sights(600));
    assert_eq!(
        cost(&plan, FrameStage::SUBTRACT_SHADOW).work,
        Work::Pixels(10_000)
    );
    let counted = |(_, cost): &(TimingScope, Cost)| cost.work != Work::Uncounted;
    assert!(plan.costs.iter().all(counted), "{plan}");
}
