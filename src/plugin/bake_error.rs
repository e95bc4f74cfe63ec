//! Errors of a bake in a running app.

use super::entity_bake::GiBakeWarning;
use bevy::reflect::prelude::*;
use meshless_gi::BakeSceneError;
use std::sync::Arc;

/// Reason why a bake in a running app has no result.
#[derive(Reflect, Clone, Debug, thiserror::Error)]
#[reflect(opaque)]
#[reflect(Clone, Debug)]
#[non_exhaustive]
pub enum GiBakeError {
    /// No usable triangle below the root.
    #[error(
        "{root}: no usable mesh on it or below it{}; spawn the meshes before the bake is requested",
        list_warnings(.warnings)
    )]
    Empty {
        /// The root: entity and name.
        root: String,
        /// Meshes that could not be used.
        warnings: Vec<GiBakeWarning>,
    },
    /// More triangles than a bake supports.
    #[error("{root}: {count} triangles on it and below it, at most {limit} are supported")]
    TooManyTriangles {
        /// The root: entity and name.
        root: String,
        /// Number of triangles.
        count: u64,
        /// Largest supported number.
        limit: u64,
    },
    /// The bake failed or was canceled.
    #[error(transparent)]
    Bake(Arc<BakeSceneError>),
}

impl From<BakeSceneError> for GiBakeError {
    fn from(error: BakeSceneError) -> Self {
        Self::Bake(Arc::new(error))
    }
}

/// The first warnings, for an error message.
fn list_warnings(warnings: &[GiBakeWarning]) -> String {
    let first: Vec<String> = warnings.iter().take(3).map(ToString::to_string).collect();
    match (first.is_empty(), warnings.len().saturating_sub(3)) {
        (true, _) => String::new(),
        (false, 0) => format!(" ({})", first.join("; ")),
        (false, more) => format!(" ({}; {more} more)", first.join("; ")),
    }
}
