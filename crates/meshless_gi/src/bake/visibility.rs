//! What a recipe says of soft shadows: whether points remember what they see ([P14] §4.2), and in
//! how many numbers.

use super::recipe::RecipeError;
use super::{BakeError, BakeSource, Baked, Progress, Settings, Stage};
use crate::transport::pca::{
    HemisphereGrid, Visibility, VisibilityError, VisibilitySettings, bake_visibility,
};
use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// Visibility of the senders and of one level behind them, for lights with soft shadows. The
/// defaults are those of [`VisibilitySettings`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VisibilityRecipe {
    /// Directions a point, about, 16 to 16384.
    pub directions: u32,
    /// Most coefficients a point, 1 to 128.
    pub coefficients: u32,
    /// Points of a cluster, about, 16 to 65536: fewer are more exact, and more to store.
    pub cluster_points: u32,
    /// A cluster whose depths are more wrong is cut in two, and these again: 0.001 to 1, the root
    /// mean square of d² / (d² + s²), with s twice the median of the cluster's depths before any
    /// cut. Less is more exact, and more to store; with 1 none is cut.
    pub error: f32,
}

impl Default for VisibilityRecipe {
    fn default() -> Self {
        let usual = VisibilitySettings::default();
        Self {
            directions: usual.grid.len() as u32,
            coefficients: usual.components,
            cluster_points: usual.cluster_points,
            error: usual.error,
        }
    }
}

impl VisibilityRecipe {
    /// Checks every value.
    pub(super) fn check(&self) -> Result<(), RecipeError> {
        let within = |field, v: u32, low: u32, high: u32, allowed| match (low..=high).contains(&v) {
            true => Ok(()),
            false => Err(RecipeError::OutOfRange {
                field,
                value: v.to_string(),
                allowed,
            }),
        };
        within(
            "soft_shadows.directions",
            self.directions,
            16,
            16_384,
            "16 to 16384",
        )?;
        within(
            "soft_shadows.coefficients",
            self.coefficients,
            1,
            Visibility::MAX_COMPONENTS,
            "1 to 128",
        )?;
        within(
            "soft_shadows.cluster_points",
            self.cluster_points,
            16,
            65_536,
            "16 to 65536",
        )?;
        match (0.001..=1.0).contains(&self.error) {
            true => Ok(()),
            false => Err(RecipeError::OutOfRange {
                field: "soft_shadows.error",
                value: self.error.to_string(),
                allowed: "0.001 to 1",
            }),
        }
    }

    /// What the bake of visibility needs.
    #[must_use]
    pub fn settings(&self, seed: u64) -> VisibilitySettings {
        VisibilitySettings {
            grid: HemisphereGrid::of(self.directions),
            components: self.coefficients,
            cluster_points: self.cluster_points,
            error: self.error,
            seed,
            ..VisibilitySettings::default()
        }
    }
}

/// What the points see, where the recipe asks for it: the senders and one level behind them, for
/// edges of shadows are finer than what senders are spread for.
pub(super) fn see(
    source: &BakeSource<'_>,
    settings: &Settings,
    mut baked: Baked,
    progress: &Progress,
) -> Result<Baked, BakeError> {
    let Some(soft) = &settings.soft_shadows else {
        return Ok(baked);
    };
    let began = Instant::now();
    let levels = (baked.scene.sender_levels as usize + 1).min(baked.scene.levels());
    let known = baked.scene.level_starts[levels] as usize;
    let points: Vec<(Vec3, Vec3)> = (baked.scene.points[..known].iter())
        .map(|p| (p.x(), p.n()))
        .collect();
    let told = |done| progress.set(Stage::Visibility, done);
    let (visibility, rays) = bake_visibility(
        source.geometry,
        &points,
        &soft.settings(settings.seed),
        &told,
    )
    .map_err(|e| match e {
        VisibilityError::Stopped => BakeError::Canceled,
        e @ VisibilityError::TooLarge { .. } => BakeError::Visibility(e),
    })?;
    baked.stats.rays += rays;
    baked.stats.visibility_bytes = visibility.bytes() as u64;
    baked.stats.visibility_kept = visibility.kept();
    baked.stats.seconds.visibility = began.elapsed().as_secs_f64();
    baked.scene.visibility = Some(visibility);
    if !source.occluders.is_empty() {
        let note = "what points see for soft shadows is seen with all occluders open: such lamps' direct light passes them when they shut";
        baked.stats.warnings.push(note.into());
    }
    Ok(baked)
}
