//! Input that all stages of a bake share, and the cost that each returns.

use super::{BakeError, BakeOrigin, BakeSource, BakeStage, Progress, Recipe};
use std::time::Instant;

/// Input of a bake.
pub(super) struct BakeContext<'a> {
    pub source: &'a BakeSource<'a>,
    pub recipe: &'a Recipe,
    pub origin: &'a BakeOrigin,
    pub progress: &'a Progress,
}

impl BakeContext<'_> {
    /// Stores the completed part of a stage.
    ///
    /// # Errors
    /// [`BakeError::Canceled`] if the bake should stop.
    pub fn report(&self, stage: BakeStage, done: f32) -> Result<(), BakeError> {
        match self.progress.set(stage, done) {
            true => Ok(()),
            false => Err(BakeError::Canceled),
        }
    }
}

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
