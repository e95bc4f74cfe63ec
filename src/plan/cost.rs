//! What passes cost: their work, the milliseconds that it is expected to take on this device, and
//! those that the device's clock said.
//!
//! Passes that are recorded into one another are timed as one ([`TimingScope`]). A group's
//! milliseconds over its work is its rate; the mean over the groups of a stage is the stage's, by
//! which a group that nobody has timed yet is foretold. Before any measurement nothing is known,
//! and the plan says so. Means run over milliseconds and work apart: a clock that answers some
//! frames late still gives the right rate.

use super::{Effect, FrameStage, FrameState, Pass, Plan, SceneId, ViewId, kind_of};
use std::collections::BTreeMap;
use std::fmt;

/// Weight of a new measurement in the running means.
const SMOOTH: f64 = 0.2;
/// Answers of the clock that are not looked at after work came to be counted in another unit: they
/// are some frames late.
const LATE: u32 = 4;
/// A group that no plan of so many had is forgotten.
const KEPT: u64 = 1000;

/// Passes that the device's clock times as one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TimingScope {
    /// The one of them that stands for all: [`FrameStage::APPLY`] for what carries light on (pull,
    /// push, apply, flatten, the probes' rows), [`FrameStage::SPLAT`] for all that lays light over
    /// a view's pixels.
    pub stage: FrameStage,
    /// For which scene; [`SceneId::WORLD`] for what a view takes of all scenes.
    pub scene: SceneId,
    /// For which view; `None` for work that all views share.
    pub view: Option<ViewId>,
}

impl TimingScope {
    /// Creates the scope of a pass that is timed with `stage`.
    #[must_use]
    pub fn new(stage: FrameStage, pass: &Pass) -> Self {
        Self {
            stage,
            scene: match pass.view {
                Some(_) => SceneId::WORLD,
                None => pass.scene,
            },
            view: pass.view,
        }
    }

    /// The name of the span that times it.
    #[must_use]
    pub fn span(&self) -> String {
        let of = self.view.map_or(self.scene.0, |view| view.0);
        format!("{}_{of:x}", self.stage.name())
    }
}

/// How much there is to do, in the unit that a stage's time grows with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Work {
    /// It isn't counted: what it costs shows when it has run.
    #[default]
    Uncounted,
    /// Links of the operator that are read, once a sweep.
    Links(u64),
    /// The same, in one channel of three.
    OneChannel(u64),
    /// Shadow rays.
    Rays(u64),
    /// Parts of links that occluders are in the way of.
    Passages(u64),
    /// Lights with soft shadows, once a point that remembers what it sees.
    Sights(u64),
    /// Voxels of a volume.
    Voxels(u64),
    /// Pixels, once for each scene (or list of virtual lights, or fog volume before a scene) that
    /// is laid over them.
    Pixels(u64),
}

impl Work {
    /// The number; none where it isn't counted or is zero.
    #[must_use]
    pub fn amount(self) -> Option<f64> {
        match self {
            Self::Uncounted => None,
            Self::Links(n)
            | Self::OneChannel(n)
            | Self::Rays(n)
            | Self::Pixels(n)
            | Self::Passages(n)
            | Self::Sights(n)
            | Self::Voxels(n) => (n > 0).then_some(n as f64),
        }
    }

    /// What it is counted in.
    fn unit(self) -> Unit {
        match self {
            Self::Uncounted => Unit::None,
            Self::Links(_) => Unit::Links,
            Self::OneChannel(_) => Unit::OneChannel,
            Self::Rays(_) => Unit::Rays,
            Self::Pixels(_) => Unit::Pixels,
            Self::Passages(_) => Unit::Passages,
            Self::Sights(_) => Unit::Sights,
            Self::Voxels(_) => Unit::Voxels,
        }
    }

    fn add(&mut self, more: Self) {
        *self = match (*self, more) {
            (Self::Links(a), Self::Links(b)) => Self::Links(a + b),
            (Self::OneChannel(a), Self::OneChannel(b)) => Self::OneChannel(a + b),
            (Self::Rays(a), Self::Rays(b)) => Self::Rays(a + b),
            (Self::Pixels(a), Self::Pixels(b)) => Self::Pixels(a + b),
            (Self::Uncounted, other) | (other, _) => other,
        };
    }
}

/// What work is counted in: costs of one unit say nothing of another's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
enum Unit {
    #[default]
    None,
    Links,
    OneChannel,
    Rays,
    Pixels,
    Passages,
    Sights,
    Voxels,
}

impl fmt::Display for Work {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Uncounted => f.write_str("work not counted"),
            Self::Links(n) => write!(f, "{n} links"),
            Self::OneChannel(n) => write!(f, "{n} links in one channel"),
            Self::Rays(n) => write!(f, "{n} rays"),
            Self::Pixels(n) => write!(f, "{n} pixels"),
            Self::Passages(n) => write!(f, "{n} parts of links"),
            Self::Sights(n) => write!(f, "{n} sights of lamps"),
            Self::Voxels(n) => write!(f, "{n} voxels"),
        }
    }
}

/// What a group of passes costs.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cost {
    /// How much there is to do in this frame.
    pub work: Work,
    /// Milliseconds that it is expected to take; none before any measurement of the stage.
    pub predicted: Option<f32>,
    /// Milliseconds that the device's clock said of it, a mean over its last frames; none where it
    /// has no clock, or did not answer yet.
    pub measured: Option<f32>,
}

impl Cost {
    /// Returns `true` if milliseconds are predicted or measured.
    #[must_use]
    pub fn is_known(&self) -> bool {
        self.predicted.is_some() || self.measured.is_some()
    }
}

/// The work, and the milliseconds that are known.
impl fmt::Display for Cost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.work.fmt(f)?;
        if let Some(ms) = self.predicted {
            write!(f, ", {ms:.2} ms expected")?;
        }
        match self.measured {
            Some(ms) => write!(f, ", {ms:.2} ms measured"),
            None => Ok(()),
        }
    }
}

/// Sets the timing scope of each pass and adds up the work of each scope.
pub(super) fn weigh<R>(
    effects: &[Effect<R>],
    state: &FrameState,
    passes: &mut [Pass],
) -> Vec<(TimingScope, Cost)> {
    let mut costs: Vec<(TimingScope, Cost)> = Vec::new();
    for pass in passes {
        let kind = kind_of(effects, pass);
        let Some((kind, stage)) = kind.and_then(|kind| Some((kind, kind.timed_with?))) else {
            continue;
        };
        let scope = TimingScope::new(stage, pass);
        pass.timing = Some(scope);
        let work = (kind.work)(state, pass);
        match costs.iter_mut().find(|(s, _)| *s == scope) {
            Some((_, cost)) => cost.work.add(work),
            None => costs.push((
                scope,
                Cost {
                    work,
                    ..Cost::default()
                },
            )),
        }
    }
    costs
}

/// Running means of milliseconds and of work.
#[derive(Clone, Copy, Debug, Default)]
struct Means {
    unit: Unit,
    /// So many answers of the clock are of before the unit changed.
    late: u32,
    ms: Option<f64>,
    work: Option<f64>,
}

impl Means {
    fn rate(&self) -> Option<f64> {
        Some(self.ms? / self.work.filter(|w| *w > 0.0)?)
    }
}

fn mix(mean: &mut Option<f64>, value: f64) {
    *mean = Some(mean.map_or(value, |m| m + SMOOTH * (value - m)));
}

/// What is known of the costs on one device.
#[derive(Clone, Debug, Default)]
pub struct CostModel {
    groups: BTreeMap<TimingScope, (Means, u64)>,
    /// Milliseconds a unit of work, by stage and unit.
    rates: BTreeMap<(FrameStage, Unit), f64>,
    plans: u64,
}

impl CostModel {
    /// Knows nothing.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// A frame with this plan was recorded.
    pub fn ran(&mut self, plan: &Plan) {
        self.plans += 1;
        for (timed, cost) in &plan.costs {
            let (means, seen) = self.groups.entry(*timed).or_default();
            *seen = self.plans;
            let unit = cost.work.unit();
            if means.unit != unit {
                *means = Means {
                    unit,
                    late: if means.ms.is_some() { LATE } else { 0 },
                    ..Means::default()
                };
            }
            if let Some(work) = cost.work.amount() {
                mix(&mut means.work, work);
            }
        }
        let oldest = self.plans.saturating_sub(KEPT);
        self.groups.retain(|_, (_, seen)| *seen > oldest);
    }

    /// The device's clock said so of one of the last frames. What no plan had, and what is no time,
    /// is left out.
    pub fn measured(&mut self, timed: TimingScope, ms: f32) {
        let Some((means, _)) = self.groups.get_mut(&timed) else {
            return;
        };
        if !(ms.is_finite() && ms >= 0.0) {
            return;
        }
        if means.late > 0 {
            means.late -= 1;
            return;
        }
        mix(&mut means.ms, f64::from(ms));
        if means.rate().is_some() {
            let unit = means.unit;
            let alike = |t: &TimingScope, m: &Means| t.stage == timed.stage && m.unit == unit;
            let of_stage = (self.groups.iter()).filter(|(t, (m, _))| alike(t, m));
            let known: Vec<f64> = of_stage.filter_map(|(_, (m, _))| m.rate()).collect();
            let mean = known.iter().sum::<f64>() / known.len() as f64;
            self.rates.insert((timed.stage, unit), mean);
        }
    }

    /// Writes into the plan what is known.
    pub fn price(&self, plan: &mut Plan) {
        for (timed, cost) in &mut plan.costs {
            let unit = cost.work.unit();
            let means = self.groups.get(timed).map(|(means, _)| *means);
            let means = means.filter(|m| m.unit == unit).unwrap_or_default();
            cost.measured = means.ms.map(|ms| ms as f32);
            let rate = means
                .rate()
                .or_else(|| self.rates.get(&(timed.stage, unit)).copied());
            cost.predicted = match cost.work.amount() {
                Some(work) => rate.map(|rate| (rate * work) as f32),
                None => cost.measured,
            };
        }
    }
}

#[cfg(test)]
mod tests;
