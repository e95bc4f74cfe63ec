//! Error of a bake.

use super::RecipeError;

/// Why there is no bake.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BakeError {
    /// The recipe makes no sense.
    #[error(transparent)]
    Recipe(#[from] RecipeError),
    /// No surface was found that light can reach.
    #[error(
        "no surface was reached by light from {viewpoints} viewpoints: the level is empty, or the viewpoints lie outside of it"
    )]
    NoReachableSurface {
        /// How many were tried.
        viewpoints: usize,
    },
    /// The level lies so far from its origin that single precision cannot tell its places apart.
    #[error(
        "the level of {size} m lies {far} m from its origin, where coordinates are {spacing} m apart: move it to its origin, and place its root instead"
    )]
    PrecisionLoss {
        /// Largest coordinate, meters.
        far: f32,
        /// Largest edge of the box around it, meters.
        size: f32,
        /// Distance between neighboring coordinates there, meters.
        spacing: f32,
    },
    /// An occluder that the level has no part for.
    #[error(
        "the level has nothing called `{name}` for the occluder of that name: it must be the name of a node with triangles, or have boxes"
    )]
    UnknownOccluder {
        /// The occluder's name.
        name: String,
    },
    /// More sets of occluders that light passes one after the other than can be told apart.
    #[error("light passes the occluders in more than {most} combinations")]
    TooManyOccluderSets {
        /// How many can be told apart.
        most: usize,
    },
    /// What points see for soft shadows is too much.
    #[error("soft shadows: {0}")]
    Visibility(crate::transport::pca::VisibilityError),
    /// The points make no octree.
    #[error("the octree: {0}")]
    Octree(#[from] crate::transport::fmm::FmmError),
    /// Somebody asked it to stop.
    #[error("the bake was canceled")]
    Canceled,
}
