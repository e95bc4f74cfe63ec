//! Tests of `decision`.

use super::*;
use crate::plan::{
    ColorModeSelection, FrameState, SceneState, SkyUse, SlotChange, TierSelection, ViewState,
};
use crate::plugin::effects::plan_frame;
use meshless_gi::Channels;

const A: SceneId = SceneId(1);

fn state() -> FrameState {
    FrameState {
        scenes: vec![SceneState {
            resident: true,
            slots: vec![SlotChange::None; 2],
            sky: SkyUse::Terms,
            tier: Some(TierSelection {
                tier: 2,
                tiers: 4,
                reason: "requested".into(),
                forced: true,
                ..TierSelection::default()
            }),
            ..SceneState::new(A)
        }],
        views: vec![ViewState {
            pixels: 100,
            sees: vec![A],
            ..ViewState::new(ViewId(7))
        }],
        ..FrameState::default()
    }
}

fn decisions(state: &FrameState) -> Vec<Decision> {
    plan_frame(state).decisions()
}

fn moved(yes: bool) -> FrameState {
    let mut state = state();
    if yes {
        state.scenes[0].slots[0] = SlotChange::Geometry;
    }
    state
}

#[test]
fn decision_forced_by_setting_states_it() {
    let found = decisions(&state());
    let tier = found.iter().find(|d| d.kind == DecisionKind::Tier(A));
    let tier = tier.expect("a tier").to_string();
    assert_eq!(
        tier,
        "tier of scene 1: 2 of 4 (requested); set by the quality setting"
    );
    // No pass runs at rest. A light that moves costs the transport.
    let tier_of = |plan: &Plan| {
        let found = plan.decisions();
        let tier = found.iter().find(|d| d.kind == DecisionKind::Tier(A));
        tier.expect("a tier").to_string()
    };
    let mut plan = plan_frame(&moved(true));
    assert_eq!(
        tier_of(&plan),
        "tier of scene 1: 2 of 4 (requested); set by the quality setting"
    );
    let apply = plan
        .costs
        .iter_mut()
        .find(|(t, _)| t.stage == FrameStage::APPLY);
    let (_, cost) = apply.expect("it is timed");
    (cost.predicted, cost.measured) = (Some(1.5), Some(1.25));
    assert_eq!(
        tier_of(&plan),
        "tier of scene 1: 2 of 4 (requested); apply: 0 links, 1.50 ms expected, 1.25 ms measured; \
         set by the quality setting"
    );
    // Passes over a view's pixels. The composite is an entry of its own.
    let shown = plan.decisions();
    let shown = |of: &DecisionKind| {
        let shown = shown.iter().find(|d| d.kind == *of).expect("decided");
        shown.costs.iter().map(|(t, _)| t.stage).collect::<Vec<_>>()
    };
    assert_eq!(
        shown(&DecisionKind::Display(ViewId(7))),
        [FrameStage::SPLAT]
    );
    let lights = DecisionKind::Effect("lights", A, None);
    assert_eq!(shown(&lights), [FrameStage::PROJECT]);
    // All other decisions follow from the scene.
    let forced = found.iter().filter(|d| d.forced.is_some()).count();
    assert_eq!(forced, 1);
    let mut off = state();
    off.views[0].enabled = false;
    off.views.push(ViewState {
        id: ViewId(8),
        enabled: true,
        ..off.views[0].clone()
    });
    let found = decisions(&off);
    let left = DecisionKind::Skipped(A, Some(ViewId(7)), SkipReason::ViewDisabled);
    let left = found.iter().find(|d| d.kind == left).expect("left out");
    assert_eq!(left.forced, Some("the camera setting"));
    let shown = |d: &&Decision| matches!(d.kind, DecisionKind::Effect("display", A, _));
    let shown: Vec<&Decision> = found.iter().filter(shown).collect();
    assert_eq!(shown.len(), 1);
    assert_eq!(
        shown[0].kind,
        DecisionKind::Effect("display", A, Some(ViewId(8)))
    );
}

#[test]
fn decision_of_moving_light_changes_nothing_else() {
    let standing = |moves| {
        let mut found = decisions(&moved(moves));
        found.retain(|d| !matches!(d.kind, DecisionKind::Effect("lights" | "transport", ..)));
        // The cost of a choice in a frame is not compared.
        found.iter_mut().for_each(|d| d.costs.clear());
        found
    };
    assert_eq!(standing(true), standing(false));
    assert!(decisions(&moved(true)).len() > decisions(&moved(false)).len());
}

#[test]
fn decision_change_is_logged_once_and_end_debounced() {
    let mut log = DecisionLog::new();
    let first = log.observe(decisions(&moved(false)), &|_| None);
    assert_eq!(first.len(), 4, "{first:?}");
    assert!(log.observe(decisions(&moved(false)), &|_| None).is_empty());
    let started = log.observe(decisions(&moved(true)), &|_| None);
    assert_eq!(started.len(), 2, "{started:?}");
    assert!(
        started[0].contains("runs (1 light slot(s) new or moved)"),
        "{started:?}"
    );
    // It moves and stops in turn, and nothing is reported.
    for k in 0..50 {
        assert!(
            log.observe(decisions(&moved(k % 3 == 0)), &|_| None)
                .is_empty()
        );
    }
    let ends: Vec<String> = (0..3 * LOG_DEBOUNCE_FRAMES)
        .flat_map(|_| log.observe(decisions(&moved(false)), &|_| None))
        .collect();
    assert_eq!(
        ends,
        [
            "effect lights of scene 1: ended",
            "effect transport of scene 1: ended"
        ]
    );
}

#[test]
fn decision_flicker_is_logged_logarithmically() {
    for period in [2, 7, 130, 500] {
        let mut log = DecisionLog::new();
        let mut logged = 0;
        for k in 0..20_000u64 {
            let mut now = moved(k % period == 0);
            let tier = now.scenes[0].tier.as_mut().expect("a tier");
            tier.tier = 1 + u32::from(k % period < period / 2);
            logged += log.observe(decisions(&now), &|_| None).len();
        }
        // Two effects, one tier, one sky, one display at its pixels.
        assert!((5..=40).contains(&logged), "{period}: {logged}");
    }
    // Changes at long intervals are all reported.
    let mut log = DecisionLog::new();
    let mut logged = 0;
    for k in 0..20_000u64 {
        let mut now = moved(false);
        let tier = now.scenes[0].tier.as_mut().expect("a tier");
        tier.tier = 1 + (k / 2000 % 2) as u32;
        logged += log.observe(decisions(&now), &|_| None).len();
    }
    assert_eq!(logged, 3 + 10);
}

#[test]
fn decision_with_changed_figures_is_not_logged() {
    let mut log = DecisionLog::new();
    let mut now = state();
    log.observe(decisions(&now), &|_| None);
    now.scenes[0].tier.as_mut().expect("a tier").reason = "4.31 ms a solve".into();
    assert!(log.observe(decisions(&now), &|_| None).is_empty());
}

#[test]
fn decision_line_with_names_has_no_numbers() {
    let names = |id: u64| {
        Some(format!(
            "\"{}\"",
            ["", "Room"].get(id as usize).unwrap_or(&"Eye")
        ))
    };
    let mut log = DecisionLog::new();
    let lines = log.observe(decisions(&moved(true)), &names);
    let display = "effect display of \"Room\" in \"Eye\": runs (the scene is in the view)";
    assert!(lines.contains(&display.to_string()), "{lines:?}");
    let numbered = |line: &&String| line.contains("scene 1") || line.contains("view 7");
    assert!(!lines.iter().any(|line| numbered(&line)), "{lines:?}");
    assert!(
        !lines.iter().any(|line| line.contains("measured")),
        "{lines:?}"
    );
}

#[test]
fn decision_of_color_mode_requires_links() {
    let mut now = state();
    let selection = ColorModeSelection {
        channels: Channels::One(glam::Vec3::ONE),
        forced: true,
        reason: "requested",
    };
    now.scenes[0].channels = Some(selection);
    let kind = DecisionKind::Channels(A);
    let found = decisions(&now);
    let decision = found.iter().find(|d| d.kind == kind);
    assert_eq!(
        decision.expect("decided").to_string(),
        "channels of scene 1: one channel (requested); set by the channel setting"
    );
    assert!(
        plan_frame(&now)
            .to_string()
            .contains("use  scene 1 in one channel: requested")
    );
    // An octree takes all three channels.
    now.scenes[0].tier.as_mut().expect("a tier").octree = true;
    assert!(decisions(&now).iter().all(|d| d.kind != kind));
}

#[test]
fn decision_of_view_names_pixel_mode() {
    let mut now = state();
    let logged = |state: &FrameState| {
        let found = decisions(state);
        let mine = found
            .iter()
            .find(|d| d.kind == DecisionKind::Display(ViewId(7)));
        mine.map(ToString::to_string)
    };
    let of_it = "display of view 7: ";
    let by = |what: &str| Some(format!("{of_it}{what}"));
    assert_eq!(
        logged(&now),
        by("subsplats (light varies less than pixels do)")
    );
    now.views[0].display = DisplayUse::BuffersTooLarge;
    assert_eq!(
        logged(&now),
        by("every pixel (the subsplat buffers exceed a limit of the device)")
    );
    now.views[0].display = DisplayUse::Full;
    assert_eq!(
        logged(&now),
        by("every pixel (requested); set by the display setting")
    );
    assert!(
        plan_frame(&now)
            .to_string()
            .contains("use  view 7 with every pixel")
    );
    // A view without a scene has no decisions.
    now.views[0].sees.clear();
    assert_eq!(logged(&now), None);
}
