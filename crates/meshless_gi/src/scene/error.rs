//! Errors of reading a scene, with file and position.

use super::ReadError;
#[cfg(feature = "point_clouds")]
use super::{PlyError, PointsError};
use std::path::{Path, PathBuf};

/// Error of loading a scene. Every variant names the file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A file could not be read. The cause is not its content.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// A file was refused before its content was read.
    #[error("{}: {source}", path.display())]
    Refused {
        /// Path of the file.
        path: PathBuf,
        /// Reason.
        source: ReadError,
    },
    /// The file is not of the expected format.
    #[error("{file}: {reason}")]
    Format {
        /// Name of the file.
        file: String,
        /// Problem, and its position if known.
        reason: String,
    },
    /// A point cloud's file is not valid.
    #[cfg(feature = "point_clouds")]
    #[error("{file}: {source}")]
    Ply {
        /// Name of the file.
        file: String,
        /// Problem, with its line or byte.
        source: PlyError,
    },
    /// The points of a file do not form a surface.
    #[cfg(feature = "point_clouds")]
    #[error("{file}: {source}")]
    Points {
        /// Name of the file.
        file: String,
        /// Problem of the points.
        source: PointsError,
    },
    /// A mesh of the file is not valid.
    #[error("{file}: mesh {mesh}, primitive {primitive}: {reason}")]
    Mesh {
        /// Name of the file.
        file: String,
        /// Index of the mesh, and its name if it has one.
        mesh: String,
        /// Index of the primitive in the mesh.
        primitive: usize,
        /// Problem, with the index of the accessor if one is involved.
        reason: String,
    },
    /// A texture could not be decoded.
    #[error("{file}: image {image}: {reason}")]
    Image {
        /// Name of the file.
        file: String,
        /// Index of the image in the file.
        image: usize,
        /// Problem.
        reason: String,
    },
    /// A quantity of the file exceeds a limit.
    #[error("{file}: {what}: {count}, at most {limit}")]
    TooLarge {
        /// Name of the file.
        file: String,
        /// Name of the quantity.
        what: &'static str,
        /// Number found.
        count: u64,
        /// Largest number allowed.
        limit: u64,
    },
    /// The file has no usable triangle.
    #[error("{file}: no usable triangle ({dropped} dropped)")]
    Empty {
        /// Name of the file.
        file: String,
        /// Number of triangles that were dropped.
        dropped: u64,
    },
    /// A value of a scene description is out of range.
    #[error("{file}: {location}: {reason}")]
    Value {
        /// Name of the file.
        file: String,
        /// Path of the value in the description.
        location: String,
        /// Problem of the value.
        reason: String,
    },
}

impl SceneError {
    /// Adds the file name to a [`ReadError`].
    #[must_use]
    pub fn reading(path: &Path, error: ReadError) -> Self {
        let path = path.into();
        match error {
            ReadError::Io(source) => Self::Io { path, source },
            source => Self::Refused { path, source },
        }
    }

    /// Returns `true` if the file could not be read. `false` if it was read and is invalid.
    #[must_use]
    pub fn is_io(&self) -> bool {
        matches!(self, Self::Io { .. })
    }
}
