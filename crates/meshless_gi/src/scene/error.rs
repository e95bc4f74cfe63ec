//! What can be wrong with a scene, and where.

use super::{PlyError, PointsError, ReadError};
use std::path::{Path, PathBuf};

/// Why a scene could not be loaded. Every variant says in which file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A file could not be read: not a fault of its content.
    #[error("{}: cannot be read: {reason}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        reason: String,
    },
    /// A file was refused before its content was looked at.
    #[error("{}: {error}", path.display())]
    Refused {
        /// The file.
        path: PathBuf,
        /// Reason.
        error: ReadError,
    },
    /// The file is not the format that it should be.
    #[error("{file}: {reason}")]
    Format {
        /// The file.
        file: String,
        /// What is wrong, and where as far as it is known.
        reason: String,
    },
    /// A point cloud's file is not valid.
    #[error("{file}: {why}")]
    Ply {
        /// The file.
        file: String,
        /// What is wrong, and in which line or at which byte.
        why: PlyError,
    },
    /// The points of a file make no surface.
    #[error("{file}: {why}")]
    Points {
        /// The file.
        file: String,
        /// What is wrong with them.
        why: PointsError,
    },
    /// A mesh of the file is not valid.
    #[error("{file}: mesh {mesh}, primitive {primitive}: {reason}")]
    Mesh {
        /// The file.
        file: String,
        /// Index and, where it has one, name of the mesh.
        mesh: String,
        /// Which primitive of the mesh.
        primitive: usize,
        /// What is wrong, with the accessor's index where it is one.
        reason: String,
    },
    /// A texture could not be decoded.
    #[error("{file}: image {image}: {reason}")]
    Image {
        /// The file.
        file: String,
        /// Index of the image in the file.
        image: usize,
        /// What is wrong.
        reason: String,
    },
    /// More than this program takes on.
    #[error("{file}: {what}: {count}, at most {limit}")]
    TooLarge {
        /// The file.
        file: String,
        /// What there is too much of.
        what: &'static str,
        /// How many there are.
        count: u64,
        /// How many there may be.
        limit: u64,
    },
    /// There is not one usable triangle.
    #[error("{file}: no usable triangle ({dropped} dropped)")]
    Empty {
        /// The file.
        file: String,
        /// How many triangles were there but could not be used.
        dropped: u64,
    },
    /// A value of a scene description is out of its range.
    #[error("{file}: {place}: {reason}")]
    Value {
        /// The file.
        file: String,
        /// Which value, as a path into the description.
        place: String,
        /// What is wrong with it.
        reason: String,
    },
}

impl SceneError {
    /// Names the file of a [`ReadError`].
    #[must_use]
    pub fn reading(path: &Path, error: ReadError) -> Self {
        let path = path.into();
        match error {
            ReadError::Io(error) => Self::Io {
                path,
                reason: error.to_string(),
            },
            error => Self::Refused { path, error },
        }
    }

    /// True where the file could not be read at all, as opposed to read and found invalid.
    #[must_use]
    pub fn is_io(&self) -> bool {
        matches!(self, Self::Io { .. })
    }
}
