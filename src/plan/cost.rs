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
    /// The one of them that stands for all: [`FrameStage::APPLY`] for what carries light on (pull, push,
    /// apply, flatten, the probes' rows), [`FrameStage::SPLAT`] for all that lays light over a view's
    /// pixels.
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
    /// Lamps with soft shadows, once a point that remembers what it sees.
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
mod tests {
    use super::*;
    use crate::plan::{
        ColorModeSelection, DisplayUse, SceneState, SlotChange, SoftState, TierSelection,
        ViewState, VolumeState,
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
                id: ViewId(7),
                gloss: false,
                lit: true,
                enabled: true,
                has_gbuffer: true,
                pixels: 10_000,
                display: DisplayUse::Subsplats,
                sees: vec![SceneId(1), SceneId(2)],
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
        // Both scenes go over the pixels; the composite goes once.
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
        // The probes' rows are applied with the others, and timed with them.
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
        model.price(&mut first);
        assert_eq!(cost(&first, FrameStage::APPLY).predicted, None);
        for _ in 0..5 {
            model.ran(&first);
            for (timed, _) in &first.costs {
                model.measured(*timed, 2.0);
            }
        }
        model.price(&mut first);
        let Cost {
            predicted,
            measured,
            ..
        } = cost(&first, FrameStage::APPLY);
        assert_eq!((predicted, measured), (Some(2.0), Some(2.0)));
        // Four times the links, three times the rays: never run, so not measured.
        let mut second = plan_frame(&moving(state(), 1, 3));
        model.price(&mut second);
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
        // A microsecond a ray; one to four slots in turn; the answers come three frames late.
        let mut late = std::collections::VecDeque::new();
        for k in 0..200 {
            let plan = plan_frame(&moving(state(), 0, 1 + k % 4));
            model.ran(&plan);
            late.push_back(1 + k % 4);
            if late.len() > 3 {
                let slots = late.pop_front().expect("four") as f32;
                model.measured(plan.costs[0].0, slots);
            }
        }
        let mut plan = plan_frame(&moving(state(), 0, 4));
        model.price(&mut plan);
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
        model.measured(project, 1.0);
        assert!(model.rates.is_empty(), "no plan had it yet");
        model.ran(&plan);
        model.measured(project, f32::NAN);
        model.measured(project, -1.0);
        assert!(model.rates.is_empty());
        model.measured(project, 1.0);
        assert_eq!(model.rates.len(), 1);
        let rest = plan_frame(&state());
        for _ in 0..=KEPT {
            model.ran(&rest);
        }
        assert_eq!(model.groups.len(), rest.costs.len());
        // The rate stays: it is the device's.
        assert_eq!(model.rates.len(), 1);
    }

    #[test]
    fn cost_rate_of_monochrome_is_separate() {
        let mut model = CostModel::new();
        let in_one = |mut state: FrameState| {
            state.scenes[0].channels = Some(ColorModeSelection {
                channels: Channels::One(glam::Vec3::ONE),
                forced: false,
                why: "",
            });
            state
        };
        let mut three = plan_frame(&moving(state(), 0, 1));
        let mut one = plan_frame(&moving(in_one(state()), 0, 1));
        assert_eq!(cost(&one, FrameStage::APPLY).work, Work::OneChannel(50_000));
        let run = |model: &mut CostModel, plan: &mut Plan, ms: f32| {
            for _ in 0..20 {
                model.ran(plan);
                let timed = plan.costs.iter().map(|(t, _)| *t);
                let apply = timed.into_iter().find(|t| t.stage == FrameStage::APPLY);
                model.measured(apply.expect("it runs"), ms);
            }
            model.price(plan);
            cost(plan, FrameStage::APPLY)
        };
        let close =
            |found: Option<f32>, ms: f32| found.is_some_and(|f| (f / ms - 1.0).abs() < 1e-3);
        assert!(close(run(&mut model, &mut three, 4.0).predicted, 4.0));
        // The clock still answers for three channels.
        let late = Cost {
            work: Work::OneChannel(50_000),
            ..Cost::default()
        };
        for _ in 0..LATE {
            model.ran(&one);
            let timed = one
                .costs
                .iter()
                .map(|(t, _)| *t)
                .find(|t| t.stage == FrameStage::APPLY);
            model.measured(timed.expect("it runs"), 4.0);
        }
        model.price(&mut one);
        assert_eq!(cost(&one, FrameStage::APPLY), late);
        // An octree takes all three.
        let mut octree = in_one(state());
        octree.scenes[0].tier.as_mut().expect("a tier").octree = true;
        let octree = plan_frame(&moving(octree, 0, 1));
        assert_eq!(cost(&octree, FrameStage::APPLY).work, Work::Links(50_000));
        let first = run(&mut model, &mut one, 2.0);
        assert!(
            close(first.predicted, 2.0) && close(first.measured, 2.0),
            "{first}"
        );
        // Another scene in three channels is foretold by what three channels took.
        let mut other = plan_frame(&moving(state(), 1, 1));
        model.price(&mut other);
        assert!(close(cost(&other, FrameStage::APPLY).predicted, 16.0));
    }

    #[test]
    fn cost_of_occluders_volumes_and_soft_shadows_has_own_units() {
        let mut state = state();
        let scene = &mut state.scenes[0];
        (scene.occluders_changed, scene.passages) = (1, 5000);
        scene.probes = true;
        scene.volume = VolumeState {
            asked: true,
            seen: true,
            held: false,
            voxels: 4096,
        };
        scene.soft = SoftState {
            lights: 2,
            remembers: true,
            points: 300,
            ..SoftState::default()
        };
        let plan = plan_frame(&state);
        assert_eq!(cost(&plan, FrameStage::OCCLUDE).work, Work::Passages(5000));
        assert_eq!(cost(&plan, FrameStage::VOLUME).work, Work::Voxels(4096));
        assert_eq!(cost(&plan, FrameStage::SOFT_SHADOW).work, Work::Sights(600));
        assert_eq!(
            cost(&plan, FrameStage::SUBTRACT_SHADOW).work,
            Work::Pixels(10_000)
        );
        let counted = |(_, cost): &(TimingScope, Cost)| cost.work != Work::Uncounted;
        assert!(plan.costs.iter().all(counted), "{plan}");
    }
}
