//! Errors of the tool and their exit codes.

use meshless_gi::internals::scene::ReadError;
use meshless_gi::{AssetError, SceneError};
use std::path::Path;

/// Exit code for input that is not valid.
const INPUT: u8 = 1;
/// Exit code for wrong usage, the same as clap's.
pub const USAGE: u8 = 2;
/// Exit code for a file or stream that could not be read or written.
const IO: u8 = 3;

/// Error that ends the tool. Each message names the object and the problem.
#[derive(Debug, thiserror::Error)]
pub enum ToolError {
    /// The input is not valid.
    #[error("{0}")]
    Input(String),
    /// The options are invalid or contradict each other.
    #[error("{0}\n\nFor more information, try '--help'.")]
    Usage(String),
    /// A file or stream could not be read or written.
    #[error("{0}")]
    Io(String),
}

impl ToolError {
    pub fn code(&self) -> u8 {
        match self {
            Self::Input(_) => INPUT,
            Self::Usage(_) => USAGE,
            Self::Io(_) => IO,
        }
    }

    /// Returns the error of a file that was not read.
    pub fn reading(path: &Path, error: &ReadError) -> Self {
        let text = format!("{}: {error}", path.display());
        match error {
            ReadError::Io(_) => Self::Io(text),
            _ => Self::Input(text),
        }
    }

    pub fn write(path: &Path, error: &dyn std::fmt::Display) -> Self {
        Self::Io(format!("{}: cannot be written: {error}", path.display()))
    }

    /// Returns the error of an invalid input file.
    pub fn input(path: &Path, error: &dyn std::fmt::Display) -> Self {
        Self::Input(format!("{}: {error}", path.display()))
    }

    /// Returns the error of a bake. `AssetError` names the path itself if reading or writing
    /// failed.
    pub fn asset(path: &Path, error: &AssetError) -> Self {
        if error.is_content() {
            Self::input(path, error)
        } else {
            Self::Io(error.to_string())
        }
    }
}

impl From<SceneError> for ToolError {
    fn from(error: SceneError) -> Self {
        if error.is_io() {
            Self::Io(error.to_string())
        } else {
            Self::Input(error.to_string())
        }
    }
}
