//! Visibility for soft shadows ([P14] §4.2): checks of the recipe, and stage.

use super::context::{BakeContext, StageCost};
use super::packing::LinkedPoints;
use super::recipe::{RecipeError, in_range};
use super::{BakeError, BakeSettings, BakeStage};
use crate::transport::pca::{
    Visibility, VisibilityError, VisibilityRecipe, VisibilitySettings, bake_visibility,
};
use glam::Vec3;
use std::time::Instant;

impl VisibilityRecipe {
    /// Checks every value.
    pub(super) fn check(&self) -> Result<(), RecipeError> {
        let directions = Some(self.directions);
        in_range("soft_shadows.directions", directions, 16..=16_384)?;
        let coefficients = Some(self.coefficients);
        let max = Visibility::MAX_COMPONENTS;
        in_range("soft_shadows.coefficients", coefficients, 1..=max)?;
        let size = Some(self.cluster_size);
        in_range("soft_shadows.cluster_size", size, 16..=65_536)?;
        let error = Some(self.max_cluster_error);
        in_range("soft_shadows.max_cluster_error", error, 0.001..=1.0)
    }
}

/// Bakes the visibility of the senders and of one finer level, if the recipe has soft shadows.
/// Shadow edges are finer than the spacing of senders.
pub(super) fn bake_soft_shadows(
    context: &BakeContext<'_>,
    settings: &BakeSettings,
    linked: &LinkedPoints,
) -> Result<(Option<Visibility>, StageCost), BakeError> {
    let Some(recipe) = settings.soft_shadows else {
        return Ok(Default::default());
    };
    let began = Instant::now();
    let levels = (linked.sender_levels as usize + 1).min(linked.level_starts.len() - 1);
    let count = linked.level_starts[levels] as usize;
    let points: Vec<(Vec3, Vec3)> = (linked.points[..count].iter())
        .map(|p| (p.x(), p.n()))
        .collect();
    let visibility_settings = VisibilitySettings {
        recipe,
        seed: settings.seed,
        ..VisibilitySettings::default()
    };
    let (visibility, rays) = bake_visibility(
        context.source.geometry,
        &points,
        &visibility_settings,
        &|done| context.progress.set(BakeStage::Visibility, done),
    )
    .map_err(|error| match error {
        VisibilityError::Stopped => BakeError::Canceled,
        VisibilityError::TooLarge { max } => BakeError::VisibilityTooLarge { max },
    })?;
    let mut cost = StageCost::new(began, rays);
    if !context.source.occluders.is_empty() {
        let note = "soft shadows: visibility is baked with all occluders open; direct light of soft lights passes closed occluders";
        cost.warnings.push(note.into());
    }
    Ok((Some(visibility), cost))
}
