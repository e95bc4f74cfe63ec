//! Errors of reading a scene, with file and position.

use super::ReadError;
#[cfg(feature = "point_clouds")]
use super::{PlyError, PointsError};
use std::path::{Path, PathBuf};

/// Error of loading a scene. Every variant names the file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A file could not be read: not a fault of its content.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// A file was refused before its content was looked at.
    #[error("{}: {source}", path.display())]
    Refused {
        /// The file.
        path: PathBuf,
        /// Reason.
        source: ReadError,
    },
    /// The file is not the format that it should be.
    #[error("{file}: {reason}")]
    Format {
        /// The file.
        file: String,
        /// Problem, and its position if known.
        reason: String,
    },
    /// A point cloud's file is not valid.
    #[cfg(feature = "point_clouds")]
    #[error("{file}: {source}")]
    Ply {
        /// The file.
        file: String,
        /// Problem, with its line or byte.
        source: PlyError,
    },
    /// The points of a file make no surface.
    #[cfg(feature = "point_clouds")]
    #[error("{file}: {source}")]
    Points {
        /// The file.
        file: String,
        /// Problem of the points.
        source: PointsError,
    },
    /// A mesh of the file is not valid.
    #[error("{file}: mesh {mesh}, primitive {primitive}: {reason}")]
    Mesh {
        /// The file.
        file: String,
        /// Index and, where it has one, name of the mesh.
        mesh: String,
        /// Index of the primitive in the mesh.
        primitive: usize,
        /// Problem, with the index of the accessor if one is involved.
        reason: String,
    },
    /// A texture could not be decoded.
    #[error("{file}: image {image}: {reason}")]
    Image {
        /// The file.
        file: String,
        /// Index of the image in the file.
        image: usize,
        /// Problem.
        reason: String,
    },
    /// More than this program takes on.
    #[error("{file}: {what}: {count}, at most {limit}")]
    TooLarge {
        /// The file.
        file: String,
        /// Name of the quantity.
        what: &'static str,
        /// Number found.
        count: u64,
        /// Largest number allowed.
        limit: u64,
    },
    /// There is not one usable triangle.
    #[error("{file}: no usable triangle ({dropped} dropped)")]
    Empty {
        /// The file.
        file: String,
        /// Number of triangles that were dropped.
        dropped: u64,
    },
    /// A value of a scene description is out of its range.
    #[error("{file}: {location}: {reason}")]
    Value {
        /// The file.
        file: String,
        /// Path of the value in the description.
        location: String,
        /// Problem of the value.
        reason: String,
    },
}

impl SceneError {
    /// Names the file of a [`ReadError`].
    #[must_use]
    pub fn reading(path: &Path, error: ReadError) -> Self {
        let path = path.into();
        match error {
            ReadError::Io(source) => Self::Io { path, source },
            source => Self::Refused { path, source },
        }
    }

    /// True where the file could not be read at all, as opposed to read and found invalid.
    #[must_use]
    pub fn is_io(&self) -> bool {
        matches!(self, Self::Io { .. })
    }
}
