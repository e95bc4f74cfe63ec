//! Settings of a visibility bake, with the part of them that a recipe has.

use super::HemisphereGrid;
#[cfg(feature = "bevy_reflect")]
use bevy_reflect::std_traits::ReflectDefault;
use serde::{Deserialize, Serialize};

/// Visibility of the senders and one finer level, for lights with soft shadows.
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
    /// Creates the default recipe. \[P14\] §6 has 2016 directions ([`HemisphereGrid::default`])
    /// and 50 coefficients, and §4.1 has 1000 points per cluster. The defaults are twice the
    /// directions in half the bits, and clusters of 400 points. Clusters have fewer points where
    /// visibility varies. docs/reports/pca_visibility.md has the measurements.
    fn default() -> Self {
        Self {
            directions: 4012,
            coefficients: 50,
            cluster_size: 400,
            max_cluster_error: 0.03,
        }
    }
}

/// Settings of a visibility bake. The values of `recipe` may be outside of the ranges of a recipe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VisibilitySettings {
    /// Directions, and number and size of clusters and components.
    pub recipe: VisibilityRecipe,
    /// Smallest effect of a stored coefficient: the root mean square change of e over all
    /// directions.
    pub tolerance: f32,
    /// Seed of the random numbers.
    pub seed: u64,
}

impl Default for VisibilitySettings {
    fn default() -> Self {
        Self {
            recipe: VisibilityRecipe::default(),
            tolerance: 5e-4,
            seed: 0,
        }
    }
}

impl VisibilitySettings {
    /// Returns the directions of each point.
    pub(super) fn grid(&self) -> HemisphereGrid {
        HemisphereGrid::with_directions(self.recipe.directions)
    }
}
