//! Selection of the operator tier of a scene's frames, by number, by error or by time (design D11).
//! The reason is part of the selection.
//!
//! A time budget is held by measurement. The measured cost of solves predicts the cost of other
//! tiers, because the cost grows with the number of links. The controller lowers the tier after a
//! few consecutive solves over the budget. It raises the tier when the next one is predicted to
//! stay well below the budget for many solves. If it has to lower the tier again soon after, it
//! doubles the wait before the next attempt. A load between two tiers thus changes the tier a
//! number of times that grows with the logarithm of the time. Noise of single frames has no effect.
//!
//! The number of reflections and of lit points is not part of the choice, because no bake measures
//! the error of fewer of them.

use super::settings::milliseconds;
use super::{GiQuality, SolveCost, TierSelection};
use meshless_gi::BakedScene;

/// Number of consecutive solves over the budget before the tier is lowered.
const LOWER_AFTER_SOLVES: u32 = 3;
/// Share of the budget that the next tier must be predicted to stay below.
const HEADROOM: f32 = 0.8;
/// Number of consecutive solves with room for the next tier before the first attempt.
const RAISE_AFTER_SOLVES: u32 = 60;
/// Number of solves after a raise within which a lower tier counts as a failed attempt.
const TRIAL_SAMPLES: u32 = 300;
/// Number of measurements after a change that may still belong to the previous tier.
const SETTLE_SAMPLES: u32 = 4;

/// Properties of a tier.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TierCandidate {
    /// Number of links that a solve reads, with those of the sweeps counted once per sweep. For the
    /// octree of method `fmm`, the number of links that take about the same time.
    pub work: u64,
    /// Estimated NRMSE at the upper end of its confidence interval.
    pub error: f32,
    /// `true` if the octree of method `fmm` replaces the links.
    pub octree: bool,
}

impl TierCandidate {
    /// Returns the tiers of a bake, tier 1 first, for solves with this number of sweeps. The octree
    /// of method `fmm` is above all links.
    #[must_use]
    pub fn all_of(scene: &BakedScene, sweeps: u32) -> Vec<Self> {
        let mut work = vec![0u64; scene.data().link_tiers() as usize];
        let senders = scene.data().senders();
        for (i, row) in scene.data().operator.rows.iter().enumerate() {
            if (1..=work.len() as u32).contains(&row.tier) {
                let times = if i < senders {
                    1 + u64::from(sweeps)
                } else {
                    1
                };
                work[row.tier as usize - 1] += times * u64::from(row.count);
            }
        }
        for t in 1..work.len() {
            work[t] += work[t - 1];
        }
        let (octree, links) = (scene.data().fmm.as_ref(), work.len());
        work.extend(octree.map(|octree| octree.work() * (1 + u64::from(sweeps))));
        (work.into_iter().enumerate())
            .map(|(t, work)| {
                let info = scene.info().tiers.get(t);
                Self {
                    work,
                    // An unknown error counts as infinite.
                    error: info.map_or(f32::INFINITY, |tier| {
                        tier.estimated_nrmse + tier.estimated_nrmse_interval
                    }),
                    octree: t >= links,
                }
            })
            .collect()
    }
}

/// Selects the tier of one scene, frame by frame.
#[derive(Clone, Debug)]
pub struct TierController {
    request: GiQuality,
    tiers: Vec<TierCandidate>,
    tier: u32,
    /// Cost of the solves of this tier.
    cost: SolveCost,
    /// Number of consecutive solves over the budget, and the sum of their costs.
    over_budget: (u32, f32),
    /// Number of consecutive solves with room for the next tier.
    stable_solves: u32,
    /// Value of `stable_solves` that an attempt requires. Doubles with each failed attempt.
    required_stable_solves: u32,
    /// Number of measurements since the last raise, while it may still fail.
    trial_samples: Option<u32>,
    /// Number of measurements still to be ignored.
    settle_samples: u32,
    changes: u64,
}

impl TierController {
    /// Creates a controller for a bake's tiers, tier 1 first. A budget starts from all links.
    #[must_use]
    pub fn new(requested: GiQuality, tiers: Vec<TierCandidate>) -> Self {
        let top = tiers.len().max(1) as u32;
        let tier = match requested {
            GiQuality::Tier(n) => n.clamp(1, top),
            GiQuality::MaxError(max) => {
                let met = tiers.iter().position(|tier| tier.error <= max);
                met.map_or(top, |at| at as u32 + 1)
            }
            GiQuality::Full | GiQuality::GpuBudget(_) => top,
        };
        Self {
            request: requested,
            tiers,
            tier,
            cost: SolveCost::default(),
            over_budget: (0, 0.0),
            stable_solves: 0,
            required_stable_solves: RAISE_AFTER_SOLVES,
            trial_samples: None,
            settle_samples: 0,
            changes: 0,
        }
    }

    /// Returns the requested quality.
    #[must_use]
    pub fn request(&self) -> GiQuality {
        self.request
    }

    /// Returns all tiers.
    #[must_use]
    pub fn tiers(&self) -> &[TierCandidate] {
        &self.tiers
    }

    /// Returns the selected tier.
    #[must_use]
    pub fn tier(&self) -> u32 {
        self.tier
    }

    /// Returns the number of changes of the tier.
    #[must_use]
    pub fn changes(&self) -> u64 {
        self.changes
    }

    /// Adds the measured cost of a solve, ms. Only a budget uses it. Invalid times are
    /// ignored.
    pub fn record_sample(&mut self, ms: f32) {
        let GiQuality::GpuBudget(budget) = self.request else {
            return;
        };
        let budget = milliseconds(budget);
        if !(ms.is_finite() && ms >= 0.0) {
            return;
        }
        if self.settle_samples > 0 {
            self.settle_samples -= 1;
            return;
        }
        let cost = self.cost.measured(ms);
        self.trial_samples = self
            .trial_samples
            .map(|n| n + 1)
            .filter(|&n| n <= TRIAL_SAMPLES);
        self.over_budget = if ms > budget {
            (self.over_budget.0 + 1, self.over_budget.1 + ms)
        } else {
            (0, 0.0)
        };
        if self.over_budget.0 >= LOWER_AFTER_SOLVES && cost > budget {
            if self.tier > 1 {
                self.step_down(self.over_budget.1 / self.over_budget.0 as f32, budget);
            }
            return;
        }
        let above = self.tier + 1;
        let room =
            above as usize <= self.tiers.len() && self.predict(above, cost) <= HEADROOM * budget;
        self.stable_solves = if room { self.stable_solves + 1 } else { 0 };
        if self.stable_solves >= self.required_stable_solves {
            self.switch_to(above, cost);
            self.trial_samples = Some(0);
        }
    }

    /// Returns the selected tier and the reason.
    #[must_use]
    pub fn selection(&self) -> TierSelection {
        let top = self.tiers.len().max(1) as u32;
        let percent = |error: f32| 100.0 * error;
        let here = self.tiers.get(self.tier as usize - 1);
        let error = here.map_or(f32::INFINITY, |t| t.error);
        let reason = match (self.request, self.cost.mean()) {
            (GiQuality::Full, _) => "full quality is requested".into(),
            (GiQuality::Tier(n), _) if n == self.tier => "requested".into(),
            (GiQuality::Tier(n), _) => format!("the nearest to tier {n}, which does not exist"),
            (GiQuality::MaxError(max), _) if error <= max => format!(
                "the lowest with an error of at most {:.1} %: {:.1} %",
                percent(max),
                percent(error)
            ),
            (GiQuality::MaxError(max), _) => format!(
                "none has an error of at most {:.1} %; this is the best, {:.1} %",
                percent(max),
                percent(error)
            ),
            (GiQuality::GpuBudget(budget), None) => {
                let budget = milliseconds(budget);
                format!("expected within {budget} ms; not measured yet")
            }
            (GiQuality::GpuBudget(budget), Some(cost)) => {
                let budget = milliseconds(budget);
                let held = if cost <= budget { "within" } else { "over" };
                let change = match self.tiers.get(self.tier as usize) {
                    Some(above) => format!(
                        "tier {}{} would take {:.2} ms",
                        self.tier + 1,
                        if above.octree { ", the octree," } else { "" },
                        self.predict(self.tier + 1, cost)
                    ),
                    None => "there is no higher one".into(),
                };
                format!("{cost:.2} ms a solve, {held} {budget} ms; {change}")
            }
        };
        TierSelection {
            tier: self.tier,
            tiers: top,
            octree: here.is_some_and(|t| t.octree),
            work: here.map_or(0, |t| t.work),
            forced: matches!(self.request, GiQuality::Tier(_)),
            reason,
        }
    }

    /// Selects the highest lower tier that is predicted to stay well below the budget.
    fn step_down(&mut self, cost: f32, budget: f32) {
        if self.trial_samples.is_some() {
            self.required_stable_solves = self.required_stable_solves.saturating_mul(2);
        }
        let fits = |t: &u32| self.predict(*t, cost) <= HEADROOM * budget;
        let tier = (1..self.tier).rev().find(fits).unwrap_or(1);
        self.switch_to(tier, cost);
        self.trial_samples = None;
    }

    /// Changes the tier. `cost` is the cost of a solve of the current one.
    fn switch_to(&mut self, tier: u32, cost: f32) {
        self.cost.change_links(self.work(self.tier), cost);
        self.tier = tier;
        self.changes += 1;
        self.settle_samples = SETTLE_SAMPLES;
        self.over_budget = (0, 0.0);
        self.stable_solves = 0;
    }

    /// Predicts the cost of a solve of tier `t` from the `cost` of the current tier.
    fn predict(&self, t: u32, cost: f32) -> f32 {
        self.cost.predict(self.work(t), self.work(self.tier), cost)
    }

    /// Number of links that a solve of tier `t` reads.
    fn work(&self, t: u32) -> u64 {
        self.tiers[t as usize - 1].work
    }
}

#[cfg(test)]
mod tests;
