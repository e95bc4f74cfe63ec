//! Decisions of a plan, one per kind, and a log that reports each change once.
//!
//! Passes start and stop with every light that moves and stops. [`DecisionLog`] reports that an
//! effect runs when it first runs, and that it stopped when it has not run for [`LOG_DEBOUNCE_FRAMES`] frames.
//! After a report about a kind follows a silence, which doubles with each report and returns to
//! [`LOG_DEBOUNCE_FRAMES`] frames when nothing changed for as long. The number of reports of a kind that
//! alternates grows with the logarithm of the time.

use super::{Cost, DisplayUse, FrameStage, Pass, Plan, SceneId, SkipReason, TimingScope, ViewId};
use std::collections::BTreeMap;
use std::fmt;

/// Frames without a pass after which an effect counts as stopped, and length of the first silence
/// about a kind.
pub const LOG_DEBOUNCE_FRAMES: u64 = 120;

/// Looks up the name of a scene or a view by its number; `None` prints the number.
pub type NameOf<'a> = &'a dyn Fn(u64) -> Option<String>;

/// Subject of a decision.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DecisionKind {
    /// Operator tier of a scene.
    Tier(SceneId),
    /// Number of color channels in which links are applied.
    Channels(SceneId),
    /// Number of diffuse reflections.
    Bounces(SceneId),
    /// Transport by an octree or by links.
    Octree(SceneId),
    /// Treatment of the sky.
    Sky(SceneId),
    /// Pixels at which a view evaluates light.
    Display(ViewId),
    /// An effect ([`Effect::name`](super::Effect::name)) of a scene and a view.
    Effect(&'static str, SceneId, Option<ViewId>),
    /// A scene that is not lit, or not in a view, with the reason.
    Skipped(SceneId, Option<ViewId>, SkipReason),
}

impl DecisionKind {
    /// The kind in words, with names of scenes and views.
    #[must_use]
    pub fn words(&self, name: NameOf<'_>) -> String {
        let scene = |id: &SceneId| match *id {
            SceneId::WORLD => id.to_string(),
            _ => name(id.0).unwrap_or_else(|| id.to_string()),
        };
        let view = |id: &ViewId| name(id.0).unwrap_or_else(|| format!("view {:x}", id.0));
        let seen = |of: &SceneId, by: &Option<ViewId>| match by {
            Some(by) => format!("{} in {}", scene(of), view(by)),
            None => scene(of),
        };
        match self {
            Self::Tier(id) => format!("tier of {}", scene(id)),
            Self::Channels(id) => format!("channels of {}", scene(id)),
            Self::Bounces(id) => format!("reflections of {}", scene(id)),
            Self::Octree(id) => format!("transport of {}", scene(id)),
            Self::Sky(id) => format!("sky of {}", scene(id)),
            Self::Display(id) => format!("display of {}", view(id)),
            Self::Effect(effect, id, by) => format!("effect {effect} of {}", seen(id, by)),
            Self::Skipped(id, by, _) => format!("light of {}", seen(id, by)),
        }
    }
}

impl fmt::Display for DecisionKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.words(&|_| None))
    }
}

/// A choice, its reason and its cost.
#[derive(Clone, Debug, PartialEq)]
pub struct Decision {
    /// Subject of the choice.
    pub kind: DecisionKind,
    /// The choice.
    pub choice: String,
    /// The reason. Figures in it may change from frame to frame.
    pub why: String,
    /// The setting that decided alone; `None` if the plan decided.
    pub forced: Option<&'static str>,
    /// Cost of the passes that this decision causes, with all passes in the same timing scope.
    /// Empty if none of them ran or none is timed.
    pub costs: Vec<(TimingScope, Cost)>,
}

impl Decision {
    /// The decision in one line, with names of scenes and views. Costs that are neither predicted
    /// nor measured are left out.
    #[must_use]
    pub fn words(&self, name: NameOf<'_>) -> String {
        let mut out = format!("{}: {} ({})", self.kind.words(name), self.choice, self.why);
        for (timed, cost) in self.costs.iter().filter(|(_, cost)| cost.is_known()) {
            out += &format!("; {}: {cost}", timed.stage.name());
        }
        if let Some(setting) = self.forced {
            out += &format!("; set by {setting}");
        }
        out
    }
}

impl fmt::Display for Decision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.words(&|_| None))
    }
}

impl SkipReason {
    /// The setting that alone keeps this from running; `None` if the reason is in the world or the
    /// device.
    #[must_use]
    pub fn forced(self) -> Option<&'static str> {
        match self {
            Self::Hidden => Some("the visibility of the scene"),
            Self::ViewDisabled => Some("the camera setting"),
            _ => None,
        }
    }
}

impl Plan {
    /// Decisions of this frame's plan, one per kind.
    #[must_use]
    pub fn decisions(&self) -> Vec<Decision> {
        let mut out: Vec<Decision> = Vec::new();
        let mut push = |kind: DecisionKind, choice: String, why: String, forced| {
            if !out.iter().any(|d: &Decision| d.kind == kind) {
                let costs = self.costs_of(&kind);
                out.push(Decision {
                    kind,
                    choice,
                    why,
                    forced,
                    costs,
                });
            }
        };
        for (scene, picked) in &self.tiers {
            let choice = format!("{} of {}", picked.tier, picked.tiers);
            let forced = picked.forced.then_some("the quality setting");
            push(
                DecisionKind::Tier(*scene),
                choice,
                picked.why.clone(),
                forced,
            );
        }
        for (scene, picked) in &self.channels {
            let kind = DecisionKind::Channels(*scene);
            let forced = picked.forced.then_some("the channel setting");
            push(kind, picked.choice().into(), picked.why.into(), forced);
        }
        for (scene, picked) in &self.reflections {
            let kind = DecisionKind::Bounces(*scene);
            let forced = picked.forced.then_some("the bounce setting");
            push(kind, picked.bounces.to_string(), picked.why(), forced);
        }
        for (scene, why) in &self.linked {
            let kind = DecisionKind::Octree(*scene);
            push(kind, "links".into(), why.to_string(), None);
        }
        for (scene, sky) in &self.skies {
            let why = "the scene's sky says so".into();
            push(DecisionKind::Sky(*scene), sky.to_string(), why, None);
        }
        for &(view, display) in &self.displays {
            let forced = (display == DisplayUse::Full).then_some("the display setting");
            let kind = DecisionKind::Display(view);
            push(kind, display.choice().into(), display.why().into(), forced);
        }
        for pass in &self.passes {
            let kind = DecisionKind::Effect(pass.effect, pass.scene, pass.view);
            push(kind, "runs".into(), pass.reason.to_string(), None);
        }
        for &(scene, view, why) in &self.skipped {
            if why != SkipReason::AtRest {
                let kind = DecisionKind::Skipped(scene, view, why);
                push(kind, "off".into(), why.to_string(), why.forced());
            }
        }
        out
    }

    /// Costs of the passes that follow from a decision, one entry per timing scope.
    fn costs_of(&self, kind: &DecisionKind) -> Vec<(TimingScope, Cost)> {
        let carries = |p: &Pass, of: SceneId| p.stage == FrameStage::APPLY && p.scene == of;
        let lays = |p: &Pass, of: ViewId| p.stage == FrameStage::SPLAT && p.view == Some(of);
        let follows = |p: &&Pass| match kind {
            DecisionKind::Tier(scene)
            | DecisionKind::Channels(scene)
            | DecisionKind::Bounces(scene)
            | DecisionKind::Octree(scene) => carries(p, *scene),
            // One more link a row at most.
            DecisionKind::Sky(_) | DecisionKind::Skipped(..) => false,
            DecisionKind::Display(view) => lays(p, *view),
            DecisionKind::Effect(name, scene, view) => {
                (p.effect, p.scene, p.view) == (*name, *scene, *view)
            }
        };
        let mut out: Vec<(TimingScope, Cost)> = Vec::new();
        for timed in self
            .passes
            .iter()
            .filter(follows)
            .filter_map(|pass| pass.timing)
        {
            if out.iter().all(|(t, _)| *t != timed) {
                out.extend(self.costs.iter().find(|(t, _)| *t == timed).copied());
            }
        }
        out
    }
}

/// State of the log for one kind.
#[derive(Clone, Debug)]
struct Standing {
    /// The choice that was reported last; `None` after its end was reported.
    reported: Option<String>,
    /// The last decision, and its frame.
    last: Decision,
    seen: u64,
    /// First frame in which a change may be reported.
    quiet_until: u64,
    /// Length of the next silence, frames.
    silence: u64,
}

/// Follows decisions frame by frame and reports their changes.
#[derive(Clone, Debug, Default)]
pub struct DecisionLog {
    standing: BTreeMap<DecisionKind, Standing>,
    frame: u64,
}

impl DecisionLog {
    /// Creates a log without a report.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds one frame's decisions. Returns one line per change, with names of scenes and views;
    /// most frames return none.
    pub fn observe(&mut self, decisions: Vec<Decision>, name: NameOf<'_>) -> Vec<String> {
        self.frame += 1;
        let now = self.frame;
        for decision in decisions {
            let standing = (self.standing.entry(decision.kind.clone())).or_insert(Standing {
                reported: None,
                last: decision.clone(),
                seen: now,
                quiet_until: 0,
                silence: LOG_DEBOUNCE_FRAMES,
            });
            standing.last = decision;
            standing.seen = now;
        }
        let mut lines = Vec::new();
        self.standing.retain(|kind, standing| {
            let here = now - standing.seen < LOG_DEBOUNCE_FRAMES;
            let choice = here.then(|| standing.last.choice.clone());
            if choice != standing.reported && now >= standing.quiet_until {
                lines.push(match here {
                    true => standing.last.words(name),
                    false => format!("{}: ended", kind.words(name)),
                });
                standing.reported = choice;
                standing.quiet_until = now + standing.silence;
                standing.silence = standing.silence.saturating_mul(2);
            }
            // No change for the length of the silence: the next change is reported at once.
            let calm = standing.quiet_until.saturating_add(standing.silence);
            let settled = standing.reported.is_some() == here;
            if settled && now >= calm {
                standing.silence = LOG_DEBOUNCE_FRAMES;
            }
            here || standing.reported.is_some() || now < calm
        });
        lines
    }
}

#[cfg(test)]
mod tests {
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
                    why: "it was asked for".into(),
                    forced: true,
                    ..TierSelection::default()
                }),
                ..SceneState::new(A)
            }],
            views: vec![ViewState {
                id: ViewId(7),
                gloss: false,
                lit: true,
                enabled: true,
                has_gbuffer: true,
                pixels: 100,
                display: DisplayUse::Subsplats,
                sees: vec![A],
            }],
            ..FrameState::default()
        }
    }

    fn of(state: &FrameState) -> Vec<Decision> {
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
        let found = of(&state());
        let tier = found.iter().find(|d| d.kind == DecisionKind::Tier(A));
        let tier = tier.expect("a tier").to_string();
        assert_eq!(
            tier,
            "tier of scene 1: 2 of 4 (it was asked for); set by the quality setting"
        );
        // Nothing of it runs at rest. Where a lamp moves, it costs what carries its light on.
        let tier_of = |plan: &Plan| {
            let found = plan.decisions();
            let tier = found.iter().find(|d| d.kind == DecisionKind::Tier(A));
            tier.expect("a tier").to_string()
        };
        let mut plan = plan_frame(&moved(true));
        assert_eq!(
            tier_of(&plan),
            "tier of scene 1: 2 of 4 (it was asked for); set by the quality setting"
        );
        let apply = plan
            .costs
            .iter_mut()
            .find(|(t, _)| t.stage == FrameStage::APPLY);
        let (_, cost) = apply.expect("it is timed");
        (cost.predicted, cost.measured) = (Some(1.5), Some(1.25));
        assert_eq!(
            tier_of(&plan),
            "tier of scene 1: 2 of 4 (it was asked for); apply: 0 links, 1.50 ms expected, 1.25 ms measured; \
             set by the quality setting"
        );
        // What goes over a view's pixels; the composite is an entry of its own.
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
        // The rest follows from the scene.
        let forced = found.iter().filter(|d| d.forced.is_some()).count();
        assert_eq!(forced, 1);
        let mut off = state();
        off.views[0].enabled = false;
        off.views.push(ViewState {
            id: ViewId(8),
            enabled: true,
            ..off.views[0].clone()
        });
        let found = of(&off);
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
            let mut found = of(&moved(moves));
            found.retain(|d| !matches!(d.kind, DecisionKind::Effect("lights" | "transport", ..)));
            // What a choice costs in a frame is no choice.
            found.iter_mut().for_each(|d| d.costs.clear());
            found
        };
        assert_eq!(standing(true), standing(false));
        assert!(of(&moved(true)).len() > of(&moved(false)).len());
    }

    #[test]
    fn decision_change_is_logged_once_and_end_debounced() {
        let mut log = DecisionLog::new();
        let first = log.observe(of(&moved(false)), &|_| None);
        assert_eq!(first.len(), 4, "{first:?}");
        assert!(log.observe(of(&moved(false)), &|_| None).is_empty());
        let started = log.observe(of(&moved(true)), &|_| None);
        assert_eq!(started.len(), 2, "{started:?}");
        assert!(
            started[0].contains("runs (1 light slot(s) new or moved)"),
            "{started:?}"
        );
        // It moves and stops in turn: nothing is said.
        for k in 0..50 {
            assert!(log.observe(of(&moved(k % 3 == 0)), &|_| None).is_empty());
        }
        let ends: Vec<String> = (0..3 * LOG_DEBOUNCE_FRAMES)
            .flat_map(|_| log.observe(of(&moved(false)), &|_| None))
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
            let mut told = 0;
            for k in 0..20_000u64 {
                let mut now = moved(k % period == 0);
                let tier = now.scenes[0].tier.as_mut().expect("a tier");
                tier.tier = 1 + u32::from(k % period < period / 2);
                told += log.observe(of(&now), &|_| None).len();
            }
            // Two effects, one tier, one sky, one display at its pixels.
            assert!((5..=40).contains(&told), "{period}: {told}");
        }
        // And the same that changes once in long times is told each time.
        let mut log = DecisionLog::new();
        let mut told = 0;
        for k in 0..20_000u64 {
            let mut now = moved(false);
            let tier = now.scenes[0].tier.as_mut().expect("a tier");
            tier.tier = 1 + (k / 2000 % 2) as u32;
            told += log.observe(of(&now), &|_| None).len();
        }
        assert_eq!(told, 3 + 10);
    }

    #[test]
    fn decision_with_changed_figures_is_not_logged() {
        let mut log = DecisionLog::new();
        let mut now = state();
        log.observe(of(&now), &|_| None);
        now.scenes[0].tier.as_mut().expect("a tier").why = "4.31 ms a solve".into();
        assert!(log.observe(of(&now), &|_| None).is_empty());
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
        let lines = log.observe(of(&moved(true)), &names);
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
        let picked = ColorModeSelection {
            channels: Channels::One(glam::Vec3::ONE),
            forced: true,
            why: "it is asked for",
        };
        now.scenes[0].channels = Some(picked);
        let kind = DecisionKind::Channels(A);
        let found = of(&now);
        let decision = found.iter().find(|d| d.kind == kind);
        assert_eq!(
            decision.expect("decided").to_string(),
            "channels of scene 1: one channel (it is asked for); set by the channel setting"
        );
        assert!(
            plan_frame(&now)
                .to_string()
                .contains("use  scene 1 in one channel: it is asked for")
        );
        // An octree carries the light in all three.
        now.scenes[0].tier.as_mut().expect("a tier").octree = true;
        assert!(of(&now).iter().all(|d| d.kind != kind));
    }

    #[test]
    fn decision_of_view_names_pixel_mode() {
        let mut now = state();
        let told = |state: &FrameState| {
            let found = of(state);
            let mine = found
                .iter()
                .find(|d| d.kind == DecisionKind::Display(ViewId(7)));
            mine.map(ToString::to_string)
        };
        let of_it = "display of view 7: ";
        let by = |what: &str| Some(format!("{of_it}{what}"));
        assert_eq!(
            told(&now),
            by("subsplats (light varies less than pixels do)")
        );
        now.views[0].display = DisplayUse::NoRoom;
        assert_eq!(
            told(&now),
            by("every pixel (the device has no room for subsplats)")
        );
        now.views[0].display = DisplayUse::Full;
        assert_eq!(
            told(&now),
            by("every pixel (it is asked for); set by the display setting")
        );
        assert!(
            plan_frame(&now)
                .to_string()
                .contains("use  view 7 with every pixel")
        );
        // A view that shows nothing decides nothing.
        now.views[0].sees.clear();
        assert_eq!(told(&now), None);
    }
}
