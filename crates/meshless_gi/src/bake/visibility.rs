//! Visibility for soft shadows ([P14] §4.2): recipe and stage.

use super::context::{BakeContext, StageCost};
use super::packing::LinkedPoints;
use super::recipe::{RecipeError, in_range};
use super::{BakeError, BakeSettings, BakeStage};
use crate::transport::pca::{
    HemisphereGrid, Visibility, VisibilityError, VisibilitySettings, bake_visibility,
};
#[cfg(feature = "bevy_reflect")]
use bevy_reflect::std_traits::ReflectDefault;
use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// Visibility of the senders and one finer level, for lights with soft shadows. Defaults are those
/// of [`VisibilitySettings`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(
    feature = "bevy_reflect",
    derive(bevy_reflect::Reflect),
    reflect(Default, Clone, Debug, PartialEq)
)]
#[cfg_attr(feature = "documentation", derive(documented::DocumentedFields))]
#[serde(default, deny_unknown_fields)]
pub struct VisibilityRecipe {
    /// Approximate number of directions per point, 16 to 16384. Default 4012. \[P14\] uses 2016.
    pub directions: u32,
    /// Largest number of coefficients per point, 1 to 128. Default 50.
    pub coefficients: u32,
    /// Approximate number of points of a cluster, 16 to 65536. Default 400. Smaller clusters are
    /// more exact and take more memory.
    #[serde(alias = "cluster_points")]
    pub cluster_size: u32,
    /// Largest error of a cluster, 0.001 to 1. Default 0.03. A cluster with a larger error is
    /// split, and its parts again. The error is the root mean square of d² / (d² + s²), where s is
    /// twice the median of the cluster's depths before any split. 1 splits none. Smaller values are
    /// more exact and take more memory.
    #[serde(alias = "error")]
    pub max_cluster_error: f32,
}

impl Default for VisibilityRecipe {
    fn default() -> Self {
        let usual = VisibilitySettings::default();
        Self {
            directions: usual.grid.len() as u32,
            coefficients: usual.components,
            cluster_size: usual.cluster_points,
            max_cluster_error: usual.error,
        }
    }
}

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

    /// Returns the settings of the visibility bake.
    #[must_use]
    pub fn settings(&self, seed: u64) -> VisibilitySettings {
        VisibilitySettings {
            grid: HemisphereGrid::with_directions(self.directions),
            components: self.coefficients,
            cluster_points: self.cluster_size,
            error: self.max_cluster_error,
            seed,
            ..VisibilitySettings::default()
        }
    }
}

/// Bakes the visibility of the senders and of one finer level, if the recipe has soft shadows.
/// Shadow edges are finer than the spacing of senders.
pub(super) fn bake_soft_shadows(
    context: &BakeContext<'_>,
    settings: &BakeSettings,
    linked: &LinkedPoints,
) -> Result<(Option<Visibility>, StageCost), BakeError> {
    let Some(soft) = &settings.soft_shadows else {
        return Ok(Default::default());
    };
    let began = Instant::now();
    let levels = (linked.sender_levels as usize + 1).min(linked.level_starts.len() - 1);
    let count = linked.level_starts[levels] as usize;
    let points: Vec<(Vec3, Vec3)> = (linked.points[..count].iter())
        .map(|p| (p.x(), p.n()))
        .collect();
    let (visibility, rays) = bake_visibility(
        context.source.geometry,
        &points,
        &soft.settings(settings.seed),
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
