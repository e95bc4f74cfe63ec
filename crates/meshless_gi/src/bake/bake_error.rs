//! Error of a bake.

use super::RecipeError;

/// Error of a bake.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BakeError {
    /// Invalid recipe.
    #[error(transparent)]
    Recipe(#[from] RecipeError),
    /// Missing surface that light can reach.
    #[error(
        "no surface was reached by light from {viewpoints} viewpoints: the scene is empty, or the viewpoints lie outside of it"
    )]
    NoReachableSurface {
        /// Number of viewpoints tried.
        viewpoints: usize,
    },
    /// Scene too far from the origin for single precision.
    #[error(
        "the scene of {size} m lies {far} m from its origin, where coordinates are {spacing} m apart: move it to its origin, and transform its root instead"
    )]
    PrecisionLoss {
        /// Largest coordinate, in meters.
        far: f32,
        /// Largest edge of the bounding box, in meters.
        size: f32,
        /// Distance between neighboring coordinates there, in meters.
        spacing: f32,
    },
    /// Occluder without geometry in the scene.
    #[error(
        "occluder `{name}`: the scene has no node of this name with triangles; use the name of another node, or add boxes"
    )]
    UnknownOccluder {
        /// Name of the occluder.
        name: String,
    },
    /// Too many sets of occluders along one path of light.
    #[error("light passes the occluders in more than {max} combinations; use fewer occluders")]
    TooManyOccluderSets {
        /// Largest number of sets.
        max: usize,
    },
    /// Visibility data for soft shadows exceeds its limit.
    #[error(
        "soft shadows: baked visibility exceeds the limit of {max} bytes: reduce the directions or the points, or raise the error"
    )]
    VisibilityTooLarge {
        /// Size limit in bytes.
        max: u64,
    },
    /// Points without an octree.
    #[error("the octree: {0}")]
    Octree(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// Cancelled through [`Progress::cancel`](super::Progress::cancel).
    #[error("the bake was canceled")]
    Canceled,
}
