//! Precomputed light according to \[P14\]: clusters of points, with a basis per cluster from
//! principal component analysis.

mod cluster;
mod compression;
mod decompose;
mod hemisphere;
mod light_basis;
mod visibility;
mod visibility_bake;
mod visibility_compress;
mod visibility_settings;
mod visibility_truncation;

pub use cluster::{Clusters, cluster};
pub use compression::{Column, Compression};
pub use decompose::{Components, decompose};
pub use hemisphere::HemisphereGrid;
pub use light_basis::{CompressScratch, LightBasis, TrainingSet};
pub use visibility::{MAX_RATIO, Visibility, VisibilityCluster, VisiblePoint, encode, frame};
pub use visibility_bake::{NEAR_PER_MEDIAN, VisibilityError, bake_visibility, depths};
pub use visibility_settings::{VisibilityRecipe, VisibilitySettings};
