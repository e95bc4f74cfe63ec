//! [`SolveCost`]: the cost of a scene's solves as a function of the links that they read.

use super::RunningMean;

/// Cost of the solves of a scene. Solves with two numbers of links separate the cost of the links
/// from the rest.
#[derive(Clone, Debug, Default)]
pub struct SolveCost {
    /// Mean for the current number of links, milliseconds.
    mean: RunningMean,
    /// Number of links before the last change, and the cost of solves with them, milliseconds.
    before: Option<(u64, f32)>,
}

impl SolveCost {
    /// Adds a measurement, ms. Returns the running mean.
    pub fn measured(&mut self, ms: f32) -> f32 {
        self.mean.add(f64::from(ms)) as f32
    }

    /// Returns the running mean. `None` before the first measurement of the current links.
    #[must_use]
    pub fn mean(&self) -> Option<f32> {
        self.mean.0.map(|ms| ms as f32)
    }

    /// Starts solves with another number of links. `links` and `cost` are those of the solves so
    /// far.
    pub fn change_links(&mut self, links: u64, cost: f32) {
        self.before = Some((links.max(1), cost));
        self.mean = RunningMean::default();
    }

    /// Predicts the cost of a solve with `other` links from the `cost` of one with `links`, ms.
    /// Without a previous number of links, all of the cost is attributed to the links. With one,
    /// the part that does not grow with the links is separated (shadow rays of lights that move).
    /// That part is limited to nine tenths, because the load may have changed in between.
    #[must_use]
    pub fn predict(&self, other: u64, links: u64, cost: f32) -> f32 {
        let [other, links] = [other, links].map(|n| n.max(1) as f64);
        let cost = f64::from(cost);
        let per_link = cost / links;
        let slope = match self.before.map(|(links, cost)| (links as f64, cost)) {
            Some((before, old)) if before != links => {
                let slope = (cost - f64::from(old)) / (links - before);
                slope.clamp(0.1 * per_link, per_link)
            }
            _ => per_link,
        };
        (cost + slope * (other - links)) as f32
    }
}
