//! Rays, seconds and warnings of the stages.

use super::StageSeconds;
use std::time::Instant;

/// Cost of a stage, and its warnings.
#[derive(Debug, Default)]
pub(super) struct StageCost {
    pub rays: u64,
    pub seconds: f64,
    pub warnings: Vec<String>,
}

impl StageCost {
    /// Creates the cost of a stage that has run since `began`, without warnings.
    pub fn new(began: Instant, rays: u64) -> Self {
        Self {
            rays,
            seconds: began.elapsed().as_secs_f64(),
            warnings: Vec::new(),
        }
    }
}

/// Costs of all stages, in their order.
#[derive(Debug)]
pub(super) struct Costs {
    pub survey: StageCost,
    pub points: StageCost,
    pub transport: StageCost,
    pub octree: StageCost,
    pub packing: StageCost,
    pub energy: StageCost,
    pub bounces: StageCost,
    pub visibility: StageCost,
    pub estimate: StageCost,
}

impl Costs {
    fn stages(&self) -> [&StageCost; 9] {
        [
            &self.survey,
            &self.points,
            &self.transport,
            &self.octree,
            &self.packing,
            &self.energy,
            &self.bounces,
            &self.visibility,
            &self.estimate,
        ]
    }

    /// Returns the number of rays of all stages.
    pub fn rays(&self) -> u64 {
        self.stages().iter().map(|stage| stage.rays).sum()
    }

    /// Returns the warnings of all stages.
    pub fn warnings(&self) -> Vec<String> {
        let stages = self.stages().into_iter();
        stages.flat_map(|stage| stage.warnings.clone()).collect()
    }

    /// Returns the times of the stages, with those of the whole bake and of the probes. The part
    /// `gather_share` of the transport's time is that of the gather.
    pub fn seconds(&self, began: Instant, gather_share: f64, probes: f64) -> StageSeconds {
        let gather = gather_share * self.transport.seconds;
        StageSeconds {
            points: self.survey.seconds + self.points.seconds,
            gather,
            refine: self.transport.seconds - gather,
            bounces: self.bounces.seconds,
            visibility: self.visibility.seconds,
            probes,
            octree: self.octree.seconds,
            estimate: self.estimate.seconds,
            total: began.elapsed().as_secs_f64(),
            ..StageSeconds::default()
        }
    }
}
