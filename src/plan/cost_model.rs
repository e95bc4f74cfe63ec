//! Costs of passes: their work, the predicted milliseconds on this device, and the milliseconds of
//! its timestamps.
//!
//! Passes that are recorded into one another are timed as one ([`TimingScope`]). The rate of a
//! group is its milliseconds divided by its work. The rate of a stage is the mean over its groups,
//! and it predicts groups without a measurement. The plan has no prediction before the first
//! measurement, and states it. Milliseconds and work have separate running means. Timestamps that
//! arrive some frames late thus still give the right rate.
//!
//! [`SolveCost`] predicts the solves of one scene with other numbers of links, for the selection of
//! its tier.

mod solve_cost;

pub use solve_cost::SolveCost;

use super::{
    Effect, FrameStage, FrameState, LightId, Pass, Plan, SceneId, Timing, ViewId, kind_of,
};
use std::collections::BTreeMap;
use std::fmt;

/// Weight of a new measurement in the running means.
const SMOOTHING_FACTOR: f64 = 0.2;
/// Number of measurements that are ignored after the unit of the work changed. Timestamps arrive
/// some frames late.
const MAX_LATE_MEASUREMENTS: u32 = 4;
/// Number of plans without a group after which the group is removed.
const MAX_UNUSED_PLANS: u64 = 1000;

/// Passes that the device's timestamps measure as one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TimingScope {
    /// Stage that represents all of them. [`FrameStage::APPLY`] represents the transport: pull,
    /// push, apply, flatten, and the rows of the probes. [`FrameStage::SPLAT`] represents all
    /// passes that add light to a view's pixels.
    pub stage: FrameStage,
    /// Scene of the passes. [`SceneId::WORLD`] for work of a view on all scenes.
    pub scene: SceneId,
    /// View of the passes. `None` for work that all views share.
    pub view: Option<ViewId>,
    /// Light of the passes. `None` except for reflective shadow maps.
    pub light: Option<LightId>,
    /// `true` if the passes are part of their scene's solve.
    pub is_solve: bool,
}

impl TimingScope {
    /// Creates the scope of a pass that is timed with `stage` and is part of no solve.
    #[must_use]
    pub fn new(stage: FrameStage, pass: &Pass) -> Self {
        Self {
            stage,
            scene: match pass.view {
                Some(_) => SceneId::WORLD,
                None => pass.scene,
            },
            view: pass.view,
            light: pass.light,
            is_solve: false,
        }
    }

    /// Returns the name of the timestamp span.
    #[must_use]
    pub fn span(&self) -> String {
        let name = self.stage.name();
        match (self.view, self.light) {
            (Some(view), _) => format!("{name}_{:x}", view.0),
            (None, Some(light)) => format!("{name}_{:x}_{}", light.0, light.1),
            (None, None) => format!("{name}_{:x}", self.scene.0),
        }
    }
}

/// Amount of work, in the unit that a stage's time is proportional to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Work {
    /// Work without a count. Its cost is known after it has run.
    #[default]
    Uncounted,
    /// Number of links of the operator that are read, counted once per sweep.
    Links(u64),
    /// Number of links that are read in one channel of three.
    OneChannel(u64),
    /// Shadow rays.
    Rays(u64),
    /// Number of link terms that occluders intersect.
    OccludedLinkTerms(u64),
    /// Number of lights with soft shadows times the number of points with baked visibility.
    Sights(u64),
    /// Number of voxels of a volume.
    Voxels(u64),
    /// Number of texels of reflective shadow maps.
    Texels(u64),
    /// Number of pixels, counted once per layer. A layer is a scene, a list of virtual lights, or a
    /// fog volume in front of a scene.
    Pixels(u64),
}

impl Work {
    /// Returns the number. `None` if it is not counted or zero.
    #[must_use]
    pub fn amount(self) -> Option<f64> {
        match self {
            Self::Uncounted => None,
            Self::Links(n)
            | Self::OneChannel(n)
            | Self::Rays(n)
            | Self::Pixels(n)
            | Self::OccludedLinkTerms(n)
            | Self::Sights(n)
            | Self::Voxels(n)
            | Self::Texels(n) => (n > 0).then_some(n as f64),
        }
    }

    /// Returns the unit of the work.
    fn unit(self) -> Unit {
        match self {
            Self::Uncounted => Unit::None,
            Self::Links(_) => Unit::Links,
            Self::OneChannel(_) => Unit::OneChannel,
            Self::Rays(_) => Unit::Rays,
            Self::Pixels(_) => Unit::Pixels,
            Self::OccludedLinkTerms(_) => Unit::OccludedLinkTerms,
            Self::Sights(_) => Unit::Sights,
            Self::Voxels(_) => Unit::Voxels,
            Self::Texels(_) => Unit::Texels,
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

/// Unit of work. Costs of different units are not comparable.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
enum Unit {
    #[default]
    None,
    Links,
    OneChannel,
    Rays,
    Pixels,
    OccludedLinkTerms,
    Sights,
    Voxels,
    Texels,
}

impl fmt::Display for Work {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Uncounted => f.write_str("work not counted"),
            Self::Links(n) => write!(f, "{n} links"),
            Self::OneChannel(n) => write!(f, "{n} links in one channel"),
            Self::Rays(n) => write!(f, "{n} rays"),
            Self::Pixels(n) => write!(f, "{n} pixels"),
            Self::OccludedLinkTerms(n) => write!(f, "{n} occluded link terms"),
            Self::Sights(n) => write!(f, "{n} pairs of light and point"),
            Self::Voxels(n) => write!(f, "{n} voxels"),
            Self::Texels(n) => write!(f, "{n} texels of maps"),
        }
    }
}

/// Cost of a group of passes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cost {
    /// Amount of work in this frame.
    pub work: Work,
    /// Predicted milliseconds. `None` before any measurement of the stage.
    pub predicted: Option<f32>,
    /// Measured milliseconds, a running mean over the last frames. `None` without timestamps, or
    /// before the first arrives.
    pub measured: Option<f32>,
}

impl Cost {
    /// Returns `true` if milliseconds are predicted or measured.
    #[must_use]
    pub fn is_known(&self) -> bool {
        self.predicted.is_some() || self.measured.is_some()
    }
}

/// Formats the work and the available milliseconds.
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
pub(super) fn compute_work<R>(
    effects: &[Effect<R>],
    state: &FrameState,
    passes: &mut [Pass],
) -> Vec<(TimingScope, Cost)> {
    let mut costs: Vec<(TimingScope, Cost)> = Vec::new();
    for pass in passes {
        let Some(kind) = kind_of(effects, pass) else {
            continue;
        };
        let (stage, is_solve) = match kind.timing {
            Timing::None => continue,
            Timing::With(stage) => (stage, false),
            Timing::Solve(stage) => (stage, true),
        };
        let scope = TimingScope {
            is_solve,
            ..TimingScope::new(stage, pass)
        };
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

/// Running mean. `None` before the first value.
#[derive(Clone, Copy, Debug, Default)]
struct RunningMean(Option<f64>);

impl RunningMean {
    /// Adds a value and returns the mean.
    fn add(&mut self, value: f64) -> f64 {
        let mean = |mean: f64| mean + SMOOTHING_FACTOR * (value - mean);
        *self.0.insert(self.0.map_or(value, mean))
    }
}

/// Running means of milliseconds and of work.
#[derive(Clone, Copy, Debug, Default)]
struct Means {
    unit: Unit,
    /// Number of pending measurements from before the unit changed.
    late: u32,
    ms: RunningMean,
    work: RunningMean,
}

impl Means {
    fn rate(&self) -> Option<f64> {
        Some(self.ms.0? / self.work.0.filter(|w| *w > 0.0)?)
    }
}

/// Model of the costs on one device.
#[derive(Clone, Debug, Default)]
pub struct CostModel {
    groups: BTreeMap<TimingScope, (Means, u64)>,
    /// Milliseconds per unit of work, by stage and unit.
    rates: BTreeMap<(FrameStage, Unit), f64>,
    plans: u64,
}

impl CostModel {
    /// Creates a model without measurements.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Notes that a frame with this plan was recorded.
    pub fn record_plan(&mut self, plan: &Plan) {
        self.plans += 1;
        for (timed, cost) in &plan.costs {
            let (means, seen) = self.groups.entry(*timed).or_default();
            *seen = self.plans;
            let unit = cost.work.unit();
            if means.unit != unit {
                *means = Means {
                    unit,
                    late: if means.ms.0.is_some() {
                        MAX_LATE_MEASUREMENTS
                    } else {
                        0
                    },
                    ..Means::default()
                };
            }
            if let Some(work) = cost.work.amount() {
                means.work.add(work);
            }
        }
        let oldest = self.plans.saturating_sub(MAX_UNUSED_PLANS);
        self.groups.retain(|_, (_, seen)| *seen > oldest);
    }

    /// Adds a measurement of one of the last frames, ms. Ignores scopes that no plan had, and
    /// invalid times.
    pub fn record_time(&mut self, timed: TimingScope, ms: f32) {
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
        means.ms.add(f64::from(ms));
        if means.rate().is_some() {
            let unit = means.unit;
            let alike = |t: &TimingScope, m: &Means| t.stage == timed.stage && m.unit == unit;
            let of_stage = (self.groups.iter()).filter(|(t, (m, _))| alike(t, m));
            let known: Vec<f64> = of_stage.filter_map(|(_, (m, _))| m.rate()).collect();
            let mean = known.iter().sum::<f64>() / known.len() as f64;
            self.rates.insert((timed.stage, unit), mean);
        }
    }

    /// Writes the available costs into the plan.
    pub fn write_costs(&self, plan: &mut Plan) {
        for (timed, cost) in &mut plan.costs {
            let unit = cost.work.unit();
            let means = self.groups.get(timed).map(|(means, _)| *means);
            let means = means.filter(|m| m.unit == unit).unwrap_or_default();
            cost.measured = means.ms.0.map(|ms| ms as f32);
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
