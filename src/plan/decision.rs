//! What a plan has decided, one line a subject, and when that is worth telling: at a change, once, and not again for what only goes back and forth.
//!
//! Passes come and go with every lamp that moves and stops. The log is told that an effect runs when it first does, and that it stopped when it has not run for [`PATIENCE`] frames. A subject that has
//! changed is told again after a silence, which doubles with each telling and ends where nothing changed for as long: what flickers is told a number of times that grows with the logarithm of the time.

use super::{Cost, DisplayUse, Pass, Plan, SceneId, Skip, Stage, Timed, ViewId};
use std::collections::BTreeMap;
use std::fmt;

/// Frames that an effect rests before that is told, and the first silence about a subject.
pub const PATIENCE: u64 = 120;

/// What is decided.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Subject {
    /// Which tier of the operator lights a scene.
    Tier(SceneId),
    /// In how many channels links do.
    Channels(SceneId),
    /// With how many reflections.
    Bounces(SceneId),
    /// Whether an octree or links do.
    Octree(SceneId),
    /// What becomes of its sky.
    Sky(SceneId),
    /// At which pixels a view evaluates light.
    Display(ViewId),
    /// Whether an effect ([`EFFECTS`](super::EFFECTS)) runs, for a scene and a view.
    Effect(&'static str, SceneId, Option<ViewId>),
    /// Why a scene is not lit, or not in a view.
    Left(SceneId, Option<ViewId>, Skip),
}

impl fmt::Display for Subject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Self::Display(view) = self {
            return write!(f, "display of view {:x}", view.0);
        }
        let (what, scene, view) = match self {
            Self::Tier(scene) => ("tier", scene, &None),
            Self::Channels(scene) => ("channels", scene, &None),
            Self::Bounces(scene) => ("reflections", scene, &None),
            Self::Octree(scene) => ("octree", scene, &None),
            Self::Sky(scene) => ("sky", scene, &None),
            Self::Display(_) => return Ok(()),
            Self::Effect(name, scene, view) => (*name, scene, view),
            Self::Left(scene, view, _) => ("left out", scene, view),
        };
        write!(f, "{what}, {scene}")?;
        match view {
            Some(view) => write!(f, " in view {:x}", view.0),
            None => Ok(()),
        }
    }
}

/// What was decided, why, and what that costs.
#[derive(Clone, Debug, PartialEq)]
pub struct Decision {
    /// About what.
    pub subject: Subject,
    /// What.
    pub choice: String,
    /// Why. It may hold figures that change from frame to frame.
    pub why: String,
    /// The setting that decided alone, where one did.
    pub forced: Option<&'static str>,
    /// What the passes that follow from it cost in this frame, with all that the device's clock times as one with them; none where nothing of it runs, or no clock times it.
    pub costs: Vec<(Timed, Cost)>,
}

impl fmt::Display for Decision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}, because {}", self.subject, self.choice, self.why)?;
        for (timed, cost) in &self.costs {
            write!(f, "; {}: {cost}", timed.stage.name())?;
        }
        match self.forced {
            Some(setting) => write!(f, " [forced by {setting}]"),
            None => Ok(()),
        }
    }
}

impl Skip {
    /// The setting that alone keeps this from running; none where the plan found the reason in the world or the device.
    #[must_use]
    pub fn forced(self) -> Option<&'static str> {
        match self {
            Self::Hidden => Some("the scene's visibility"),
            Self::ViewDisabled => Some("the view's settings"),
            _ => None,
        }
    }
}

impl Plan {
    /// All that this frame's plan has decided, one entry a subject.
    #[must_use]
    pub fn decisions(&self) -> Vec<Decision> {
        let mut out: Vec<Decision> = Vec::new();
        let mut push = |subject: Subject, choice: String, why: String, forced| {
            if !out.iter().any(|d: &Decision| d.subject == subject) {
                let costs = self.costs_of(&subject);
                out.push(Decision {
                    subject,
                    choice,
                    why,
                    forced,
                    costs,
                });
            }
        };
        for (scene, picked) in &self.tiers {
            let choice = format!("{} of {}", picked.tier, picked.tiers);
            let forced = picked.forced.then_some("the quality asked for");
            push(Subject::Tier(*scene), choice, picked.why.clone(), forced);
        }
        for (scene, picked) in &self.channels {
            let subject = Subject::Channels(*scene);
            let forced = picked.forced.then_some("the channels asked for");
            push(subject, picked.choice().into(), picked.why.into(), forced);
        }
        for (scene, picked) in &self.reflections {
            let subject = Subject::Bounces(*scene);
            let forced = picked.forced.then_some("the bounces asked for");
            push(subject, picked.bounces.to_string(), picked.why(), forced);
        }
        for (scene, why) in &self.linked {
            let subject = Subject::Octree(*scene);
            push(subject, "links".into(), why.to_string(), None);
        }
        for (scene, sky) in &self.skies {
            let why = "the scene's sky says so".into();
            push(Subject::Sky(*scene), sky.to_string(), why, None);
        }
        for &(view, display) in &self.displays {
            let forced = (display == DisplayUse::Full).then_some("the camera's display");
            let subject = Subject::Display(view);
            push(
                subject,
                display.choice().into(),
                display.why().into(),
                forced,
            );
        }
        for pass in &self.passes {
            let subject = Subject::Effect(pass.effect, pass.scene, pass.view);
            push(subject, "runs".into(), pass.reason.to_string(), None);
        }
        for &(scene, view, why) in &self.skipped {
            if why != Skip::AtRest {
                let subject = Subject::Left(scene, view, why);
                push(subject, "left out".into(), why.to_string(), why.forced());
            }
        }
        out
    }

    /// What the passes that follow from a decision cost, one entry for all that is timed as one.
    fn costs_of(&self, subject: &Subject) -> Vec<(Timed, Cost)> {
        let carries = |p: &Pass, of: SceneId| p.stage == Stage::Apply && p.scene == of;
        let lays = |p: &Pass, of: ViewId| p.stage == Stage::Splat && p.view == Some(of);
        let follows = |p: &&Pass| match subject {
            Subject::Tier(scene)
            | Subject::Channels(scene)
            | Subject::Bounces(scene)
            | Subject::Octree(scene) => carries(p, *scene),
            // One more link a row at most.
            Subject::Sky(_) | Subject::Left(..) => false,
            Subject::Display(view) => lays(p, *view),
            Subject::Effect(name, scene, view) => {
                (p.effect, p.scene, p.view) == (*name, *scene, *view)
            }
        };
        let mut out: Vec<(Timed, Cost)> = Vec::new();
        for timed in self.passes.iter().filter(follows).filter_map(Timed::of) {
            if out.iter().all(|(t, _)| *t != timed) {
                out.extend(self.costs.iter().find(|(t, _)| *t == timed).copied());
            }
        }
        out
    }
}

/// What the log was told of a subject.
#[derive(Clone, Debug)]
struct Standing {
    /// The choice that was told; none for an end.
    told: Option<String>,
    /// The last decision, and the frame that had it.
    last: Decision,
    seen: u64,
    /// Not before this frame is anything told.
    quiet_until: u64,
    /// How long the next silence is.
    silence: u64,
}

/// Follows decisions frame by frame, and says which changes are worth telling.
#[derive(Clone, Debug, Default)]
pub struct DecisionLog {
    standing: BTreeMap<Subject, Standing>,
    frame: u64,
}

impl DecisionLog {
    /// Nothing told yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// One frame's decisions. Answers lines for the log: none in most frames.
    pub fn observe(&mut self, decisions: Vec<Decision>) -> Vec<String> {
        self.frame += 1;
        let now = self.frame;
        for decision in decisions {
            let standing = (self.standing.entry(decision.subject.clone())).or_insert(Standing {
                told: None,
                last: decision.clone(),
                seen: now,
                quiet_until: 0,
                silence: PATIENCE,
            });
            standing.last = decision;
            standing.seen = now;
        }
        let mut lines = Vec::new();
        self.standing.retain(|subject, standing| {
            let here = now - standing.seen < PATIENCE;
            let choice = here.then(|| standing.last.choice.clone());
            if choice != standing.told && now >= standing.quiet_until {
                lines.push(match here {
                    true => standing.last.to_string(),
                    false => format!("{subject}: no more"),
                });
                standing.told = choice;
                standing.quiet_until = now + standing.silence;
                standing.silence = standing.silence.saturating_mul(2);
            }
            // As long at peace as the silence was: the next change is news again.
            let calm = standing.quiet_until.saturating_add(standing.silence);
            let settled = standing.told.is_some() == here;
            if settled && now >= calm {
                standing.silence = PATIENCE;
            }
            here || standing.told.is_some() || now < calm
        });
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Channels;
    use crate::plan::{
        FrameState, Picked, PickedChannels, SceneState, SkyUse, SlotChange, ViewState,
    };

    const A: SceneId = SceneId(1);

    fn state() -> FrameState {
        FrameState {
            scenes: vec![SceneState {
                resident: true,
                slots: vec![SlotChange::None; 2],
                sky: SkyUse::Terms,
                tier: Some(Picked {
                    tier: 2,
                    tiers: 4,
                    why: "it was asked for".into(),
                    forced: true,
                    ..Picked::default()
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
        Plan::new(state).decisions()
    }

    fn moved(yes: bool) -> FrameState {
        let mut state = state();
        if yes {
            state.scenes[0].slots[0] = SlotChange::Geometry;
        }
        state
    }

    #[test]
    fn what_a_setting_forces_says_so() {
        let found = of(&state());
        let tier = found.iter().find(|d| d.subject == Subject::Tier(A));
        let tier = tier.expect("a tier").to_string();
        assert_eq!(
            tier,
            "tier, scene 1: 2 of 4, because it was asked for [forced by the quality asked for]"
        );
        // Nothing of it runs at rest. Where a lamp moves, it costs what carries its light on.
        let tier_of = |plan: &Plan| {
            let found = plan.decisions();
            let tier = found.iter().find(|d| d.subject == Subject::Tier(A));
            tier.expect("a tier").to_string()
        };
        let mut plan = Plan::new(&moved(true));
        assert_eq!(
            tier_of(&plan),
            "tier, scene 1: 2 of 4, because it was asked for; apply: 0 links, cost unknown, not measured \
             [forced by the quality asked for]"
        );
        let apply = plan.costs.iter_mut().find(|(t, _)| t.stage == Stage::Apply);
        let (_, cost) = apply.expect("it is timed");
        (cost.predicted, cost.measured) = (Some(1.5), Some(1.25));
        assert!(tier_of(&plan).contains("1.50 ms expected, 1.25 ms measured"));
        // What goes over a view's pixels; the composite is an entry of its own.
        let shown = plan.decisions();
        let shown = |of: &Subject| {
            let shown = shown.iter().find(|d| d.subject == *of).expect("decided");
            shown.costs.iter().map(|(t, _)| t.stage).collect::<Vec<_>>()
        };
        assert_eq!(shown(&Subject::Display(ViewId(7))), [Stage::Splat]);
        let lights = Subject::Effect("lights", A, None);
        assert_eq!(shown(&lights), [Stage::Project]);
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
        let left = Subject::Left(A, Some(ViewId(7)), Skip::ViewDisabled);
        let left = found.iter().find(|d| d.subject == left).expect("left out");
        assert_eq!(left.forced, Some("the view's settings"));
        let shown = |d: &&Decision| matches!(d.subject, Subject::Effect("display", A, _));
        let shown: Vec<&Decision> = found.iter().filter(shown).collect();
        assert_eq!(shown.len(), 1);
        assert_eq!(
            shown[0].subject,
            Subject::Effect("display", A, Some(ViewId(8)))
        );
    }

    #[test]
    fn a_lamp_that_moves_decides_nothing_else() {
        let standing = |moves| {
            let mut found = of(&moved(moves));
            found.retain(|d| !matches!(d.subject, Subject::Effect("lights" | "transport", ..)));
            // What a choice costs in a frame is no choice.
            found.iter_mut().for_each(|d| d.costs.clear());
            found
        };
        assert_eq!(standing(true), standing(false));
        assert!(of(&moved(true)).len() > of(&moved(false)).len());
    }

    #[test]
    fn a_change_is_told_once_and_an_end_with_patience() {
        let mut log = DecisionLog::new();
        let first = log.observe(of(&moved(false)));
        assert_eq!(first.len(), 4, "{first:?}");
        assert!(log.observe(of(&moved(false))).is_empty());
        let started = log.observe(of(&moved(true)));
        assert_eq!(started.len(), 2, "{started:?}");
        assert!(
            started[0].contains("because 1 light slot(s) new or moved"),
            "{started:?}"
        );
        // It moves and stops in turn: nothing is said.
        for k in 0..50 {
            assert!(log.observe(of(&moved(k % 3 == 0))).is_empty());
        }
        let ends: Vec<String> = (0..3 * PATIENCE)
            .flat_map(|_| log.observe(of(&moved(false))))
            .collect();
        assert_eq!(
            ends,
            ["lights, scene 1: no more", "transport, scene 1: no more"]
        );
    }

    #[test]
    fn what_flickers_is_told_as_often_as_the_logarithm_of_the_time() {
        for period in [2, 7, 130, 500] {
            let mut log = DecisionLog::new();
            let mut told = 0;
            for k in 0..20_000u64 {
                let mut now = moved(k % period == 0);
                let tier = now.scenes[0].tier.as_mut().expect("a tier");
                tier.tier = 1 + u32::from(k % period < period / 2);
                told += log.observe(of(&now)).len();
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
            told += log.observe(of(&now)).len();
        }
        assert_eq!(told, 3 + 10);
    }

    #[test]
    fn figures_in_a_reason_are_no_news() {
        let mut log = DecisionLog::new();
        let mut now = state();
        log.observe(of(&now));
        now.scenes[0].tier.as_mut().expect("a tier").why = "4.31 ms a solve".into();
        assert!(log.observe(of(&now)).is_empty());
    }

    #[test]
    fn channels_are_decided_where_links_are() {
        let mut now = state();
        let picked = PickedChannels {
            channels: Channels::One(glam::Vec3::ONE),
            forced: true,
            why: "it is asked for",
        };
        now.scenes[0].channels = Some(picked);
        let subject = Subject::Channels(A);
        let found = of(&now);
        let decision = found.iter().find(|d| d.subject == subject);
        assert_eq!(
            decision.expect("decided").to_string(),
            "channels, scene 1: one channel, because it is asked for [forced by the channels asked for]"
        );
        assert!(
            Plan::new(&now)
                .to_string()
                .contains("use  scene 1 in one channel: it is asked for")
        );
        // An octree carries the light in all three.
        now.scenes[0].tier.as_mut().expect("a tier").octree = true;
        assert!(of(&now).iter().all(|d| d.subject != subject));
    }

    #[test]
    fn views_say_at_which_pixels() {
        let mut now = state();
        let told = |state: &FrameState| {
            let found = of(state);
            let mine = found
                .iter()
                .find(|d| d.subject == Subject::Display(ViewId(7)));
            mine.map(ToString::to_string)
        };
        let of_it = "display of view 7: ";
        // No clock has measured it yet.
        let cost = "; splat: 100 pixels, cost unknown, not measured";
        let by = |what: &str| Some(format!("{of_it}{what}{cost}"));
        assert_eq!(
            told(&now),
            by("subsplats, because light varies less than pixels do")
        );
        now.views[0].display = DisplayUse::NoRoom;
        assert_eq!(
            told(&now),
            by("every pixel, because the device has no room for subsplats")
        );
        now.views[0].display = DisplayUse::Full;
        assert_eq!(
            told(&now),
            Some(format!(
                "{of_it}every pixel, because it is asked for{cost} [forced by the camera's display]"
            ))
        );
        assert!(
            Plan::new(&now)
                .to_string()
                .contains("use  view 7 with every pixel")
        );
        // A view that shows nothing decides nothing.
        now.views[0].sees.clear();
        assert_eq!(told(&now), None);
    }
}
