//! Decisions of a plan, one per kind, and a log that reports each change once.
//!
//! Passes start and stop with every light that moves and stops. [`DecisionLog`] reports that an
//! effect runs when it first runs, and that it stopped when it has not run for
//! [`LOG_DEBOUNCE_FRAMES`] frames. After a report about a kind follows a silence, which doubles
//! with each report and returns to [`LOG_DEBOUNCE_FRAMES`] frames when nothing changed for as long.
//! The number of reports of a kind that alternates grows with the logarithm of the time.

use super::{Cost, DisplayUse, FrameStage, Pass, Plan, SceneId, SkipReason, TimingScope, ViewId};
use std::collections::BTreeMap;
use std::fmt;

/// Frames without a pass after which an effect counts as stopped, and length of the first silence
/// about a kind.
pub const LOG_DEBOUNCE_FRAMES: u64 = 120;

/// Looks up the name of a scene or a view by its number. `None` prints the number.
pub type NameOf<'a> = &'a dyn Fn(u64) -> Option<String>;

/// Subject of a decision.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
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
#[non_exhaustive]
pub struct Decision {
    /// Subject of the choice.
    pub kind: DecisionKind,
    /// The choice.
    pub choice: String,
    /// The reason. Figures in it may change from frame to frame.
    pub reason: String,
    /// Setting that decided alone. `None` if the plan decided.
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
        let mut out = format!(
            "{}: {} ({})",
            self.kind.words(name),
            self.choice,
            self.reason
        );
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
    /// Setting that alone keeps this from running. `None` if the reason is in the world or the
    /// device.
    #[must_use]
    pub fn forced_reason(self) -> Option<&'static str> {
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
        let mut push = |kind: DecisionKind, choice: String, reason: String, forced| {
            if !out.iter().any(|d: &Decision| d.kind == kind) {
                let costs = self.costs_of(&kind);
                out.push(Decision {
                    kind,
                    choice,
                    reason,
                    forced,
                    costs,
                });
            }
        };
        for (scene, selection) in &self.tiers {
            let choice = format!("{} of {}", selection.tier, selection.tiers);
            let forced = selection.forced.then_some("the quality setting");
            push(
                DecisionKind::Tier(*scene),
                choice,
                selection.reason.clone(),
                forced,
            );
        }
        for (scene, selection) in &self.channels {
            let kind = DecisionKind::Channels(*scene);
            let forced = selection.forced.then_some("the channel setting");
            push(
                kind,
                selection.choice().into(),
                selection.reason.into(),
                forced,
            );
        }
        for (scene, selection) in &self.reflections {
            let kind = DecisionKind::Bounces(*scene);
            let forced = selection.forced.then_some("the bounce setting");
            push(
                kind,
                selection.bounces.to_string(),
                selection.reason(),
                forced,
            );
        }
        for (scene, reason) in &self.linked {
            let kind = DecisionKind::Octree(*scene);
            push(kind, "links".into(), reason.to_string(), None);
        }
        for (scene, sky) in &self.skies {
            let reason = "the sky of the scene".into();
            push(DecisionKind::Sky(*scene), sky.to_string(), reason, None);
        }
        for &(view, display) in &self.displays {
            let forced = (display == DisplayUse::Full).then_some("the display setting");
            let kind = DecisionKind::Display(view);
            push(
                kind,
                display.choice().into(),
                display.description().into(),
                forced,
            );
        }
        for pass in &self.passes {
            let kind = DecisionKind::Effect(pass.effect, pass.scene, pass.view);
            push(kind, "runs".into(), pass.reason.to_string(), None);
        }
        for &(scene, view, reason) in &self.skipped {
            if reason != SkipReason::AtRest {
                let kind = DecisionKind::Skipped(scene, view, reason);
                push(
                    kind,
                    "off".into(),
                    reason.to_string(),
                    reason.forced_reason(),
                );
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
struct DecisionHistory {
    /// Choice that was reported last. `None` after its end was reported.
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
    history: BTreeMap<DecisionKind, DecisionHistory>,
    frame: u64,
}

impl DecisionLog {
    /// Creates a log without a report.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds one frame's decisions. Returns one line per change, with names of scenes and views.
    /// Most frames return none.
    pub fn observe(&mut self, decisions: Vec<Decision>, name: NameOf<'_>) -> Vec<String> {
        self.frame += 1;
        let now = self.frame;
        for decision in decisions {
            let history = (self.history.entry(decision.kind.clone())).or_insert(DecisionHistory {
                reported: None,
                last: decision.clone(),
                seen: now,
                quiet_until: 0,
                silence: LOG_DEBOUNCE_FRAMES,
            });
            history.last = decision;
            history.seen = now;
        }
        let mut lines = Vec::new();
        self.history.retain(|kind, history| {
            let here = now - history.seen < LOG_DEBOUNCE_FRAMES;
            let choice = here.then(|| history.last.choice.clone());
            if choice != history.reported && now >= history.quiet_until {
                lines.push(match here {
                    true => history.last.words(name),
                    false => format!("{}: ended", kind.words(name)),
                });
                history.reported = choice;
                history.quiet_until = now + history.silence;
                history.silence = history.silence.saturating_mul(2);
            }
            // Without a change for the length of the silence, the next change is reported in its
            // frame.
            let calm = history.quiet_until.saturating_add(history.silence);
            let settled = history.reported.is_some() == here;
            if settled && now >= calm {
                history.silence = LOG_DEBOUNCE_FRAMES;
            }
            here || history.reported.is_some() || now < calm
        });
        lines
    }
}

#[cfg(test)]
mod tests;
