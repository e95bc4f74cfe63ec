//! Input that all stages of a bake share.

use super::{BakeError, BakeSource, BakeStage, Progress, Recipe};

/// Input of a bake.
pub(super) struct BakeContext<'a> {
    pub source: &'a BakeSource<'a>,
    pub recipe: &'a Recipe,
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
