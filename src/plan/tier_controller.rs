//! Which tier of the operator a scene's frames use (design D11): as asked for by number, by error,
//! or by time; and why that one.
//!
//! A budget is held by measuring: what the solves cost says what those of other tiers would, for
//! the cost grows with the links that are read. The picker goes down at once when a few solves in a
//! row are over the budget. It goes up when the tier above is predicted to stay well below it for
//! many solves; and when it has to come down again soon after, it waits twice as long before the
//! next try. So a load at the edge between two tiers flips a number of times that grows with the
//! logarithm of the time, and noise of single frames does nothing.
//!
//! Reflections and lit places are no part of the choice: what fewer of them cost in error no bake
//! measures.

use super::settings::milliseconds;
use super::{GiQuality, TierSelection};
use meshless_gi::BakedScene;

/// Solves in a row over the budget before the picker goes down.
const OVER: u32 = 3;
/// Share of the budget that the tier above must be predicted to stay below.
const HEADROOM: f32 = 0.8;
/// Solves in a row that must say so before the first try.
const CALM: u32 = 60;
/// Coming down within so many solves after going up is a failed try.
const TRIAL: u32 = 300;
/// Measurements after a change that may still be of the tier before.
const SETTLE: u32 = 4;
/// Weight of a new measurement in the running mean.
const SMOOTH: f32 = 0.2;

/// What is known of a tier.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TierCandidate {
    /// Links that a solve reads, those of the sweeps counted as often as they run; for the octree
    /// of rule `fmm` as many as take as long, about.
    pub work: u64,
    /// Estimated NRMSE at the upper end of its confidence interval.
    pub error: f32,
    /// The octree of rule `fmm` carries the light, and no link.
    pub octree: bool,
}

impl TierCandidate {
    /// The tiers of a bake, tier 1 first, for solves with so many sweeps. The octree of rule `fmm`
    /// stands above all links.
    #[must_use]
    pub fn of(scene: &BakedScene, sweeps: u32) -> Vec<Self> {
        let mut work = vec![0u64; scene.link_tiers() as usize];
        let senders = scene.senders();
        for (i, row) in scene.operator.rows.iter().enumerate() {
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
        let (octree, links) = (scene.fmm.as_ref(), work.len());
        work.extend(octree.map(|octree| octree.work() * (1 + u64::from(sweeps))));
        (work.into_iter().enumerate())
            .map(|(t, work)| {
                let info = scene.info.tiers.get(t);
                Self {
                    work,
                    // Unknown is no promise.
                    error: info.map_or(f32::INFINITY, |tier| {
                        tier.estimated_nrmse + tier.estimated_nrmse_interval
                    }),
                    octree: t >= links,
                }
            })
            .collect()
    }
}

/// Picks the tier of one scene, frame by frame.
#[derive(Clone, Debug)]
pub struct TierController {
    asked: GiQuality,
    tiers: Vec<TierCandidate>,
    tier: u32,
    /// Running mean of what a solve of this tier costs, milliseconds.
    cost: Option<f32>,
    /// The tier before, and what its solves cost: two tiers tell what a solve costs beside its
    /// links.
    before: Option<(u32, f32)>,
    /// Solves in a row over the budget, and their sum.
    over: (u32, f32),
    /// Solves in a row that leave room for the tier above.
    calm: u32,
    /// How many of them a try takes; doubles with each failed one.
    wait: u32,
    /// Measurements since the last change upwards, while that is on trial.
    trial: Option<u32>,
    /// Measurements still to be left out.
    settle: u32,
    changes: u64,
}

impl TierController {
    /// A picker for a bake's tiers, tier 1 first. A budget starts from all links.
    #[must_use]
    pub fn new(asked: GiQuality, tiers: Vec<TierCandidate>) -> Self {
        let top = tiers.len().max(1) as u32;
        let tier = match asked {
            GiQuality::Tier(n) => n.clamp(1, top),
            GiQuality::MaxError(most) => {
                let met = tiers.iter().position(|tier| tier.error <= most);
                met.map_or(top, |at| at as u32 + 1)
            }
            GiQuality::Full | GiQuality::GpuBudget(_) => top,
        };
        Self {
            asked,
            tiers,
            tier,
            cost: None,
            before: None,
            over: (0, 0.0),
            calm: 0,
            wait: CALM,
            trial: None,
            settle: 0,
            changes: 0,
        }
    }

    /// What was asked for.
    #[must_use]
    pub fn asked(&self) -> GiQuality {
        self.asked
    }

    /// The tiers that there are.
    #[must_use]
    pub fn tiers(&self) -> &[TierCandidate] {
        &self.tiers
    }

    /// The tier now.
    #[must_use]
    pub fn tier(&self) -> u32 {
        self.tier
    }

    /// How often the tier has changed.
    #[must_use]
    pub fn changes(&self) -> u64 {
        self.changes
    }

    /// A solve took so many milliseconds. Matters to a budget alone; what is no time is left out.
    pub fn measured(&mut self, ms: f32) {
        let GiQuality::GpuBudget(budget) = self.asked else {
            return;
        };
        let budget = milliseconds(budget);
        if !(ms.is_finite() && ms >= 0.0) {
            return;
        }
        if self.settle > 0 {
            self.settle -= 1;
            return;
        }
        let cost = self.cost.map_or(ms, |mean| mean + SMOOTH * (ms - mean));
        self.cost = Some(cost);
        self.trial = self.trial.map(|n| n + 1).filter(|&n| n <= TRIAL);
        self.over = if ms > budget {
            (self.over.0 + 1, self.over.1 + ms)
        } else {
            (0, 0.0)
        };
        if self.over.0 >= OVER && cost > budget {
            if self.tier > 1 {
                self.down(self.over.1 / self.over.0 as f32, budget);
            }
            return;
        }
        let above = self.tier + 1;
        let room =
            above as usize <= self.tiers.len() && self.predict(above, cost) <= HEADROOM * budget;
        self.calm = if room { self.calm + 1 } else { 0 };
        if self.calm >= self.wait {
            self.go(above, cost);
            self.trial = Some(0);
        }
    }

    /// The tier and why.
    #[must_use]
    pub fn picked(&self) -> TierSelection {
        let top = self.tiers.len().max(1) as u32;
        let percent = |error: f32| 100.0 * error;
        let here = self.tiers.get(self.tier as usize - 1);
        let error = here.map_or(f32::INFINITY, |t| t.error);
        let why = match (self.asked, self.cost) {
            (GiQuality::Full, _) => "nothing less was asked for".into(),
            (GiQuality::Tier(n), _) if n == self.tier => "it was asked for".into(),
            (GiQuality::Tier(n), _) => format!("the nearest to tier {n}, which there is not"),
            (GiQuality::MaxError(most), _) if error <= most => format!(
                "the lowest with an error of at most {:.1} %: {:.1} %",
                percent(most),
                percent(error)
            ),
            (GiQuality::MaxError(most), _) => format!(
                "none has an error of at most {:.1} %; this is the best, {:.1} %",
                percent(most),
                percent(error)
            ),
            (GiQuality::GpuBudget(budget), None) => {
                let budget = milliseconds(budget);
                format!("within {budget} ms as far as is known; it is not measured yet")
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
            forced: matches!(self.asked, GiQuality::Tier(_)),
            why,
        }
    }

    /// To the highest tier below that is predicted to stay well below the budget.
    fn down(&mut self, cost: f32, budget: f32) {
        if self.trial.is_some() {
            self.wait = self.wait.saturating_mul(2);
        }
        let fits = |t: &u32| self.predict(*t, cost) <= HEADROOM * budget;
        let tier = (1..self.tier).rev().find(fits).unwrap_or(1);
        self.go(tier, cost);
        self.trial = None;
    }

    /// To another tier; a solve of this one costs `cost`.
    fn go(&mut self, tier: u32, cost: f32) {
        self.before = Some((self.tier, cost));
        self.tier = tier;
        self.changes += 1;
        self.settle = SETTLE;
        self.cost = None;
        self.over = (0, 0.0);
        self.calm = 0;
    }

    /// What a solve of tier `t` would cost where one of this tier costs `cost`. Without another
    /// tier to compare with, the cost is the links'. With one, what does not grow with the links is
    /// set apart (shadow rays of lights that move); no more than nine tenths, for the load may have
    /// changed in between.
    fn predict(&self, t: u32, cost: f32) -> f32 {
        let work = |t: u32| self.tiers[t as usize - 1].work.max(1) as f64;
        let (cost, here) = (f64::from(cost), work(self.tier));
        let links = cost / here;
        let slope = match self.before {
            Some((other, before)) if work(other) != here => {
                let slope = (cost - f64::from(before)) / (here - work(other));
                slope.clamp(0.1 * links, links)
            }
            _ => links,
        };
        (cost + slope * (work(t) - here)) as f32
    }
}

#[cfg(test)]
mod tests;
