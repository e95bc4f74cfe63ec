//! What can go wrong, and with which exit code the tool says so.

use meshless_gi::internals::scene::ReadError;
use meshless_gi::{AssetError, SceneError};
use std::path::Path;

/// Exit code for input that is not valid.
const INPUT: u8 = 1;
/// Exit code for wrong usage, clap's own.
pub const USAGE: u8 = 2;
/// Exit code for what could not be read or written.
const IO: u8 = 3;

/// Why the tool stops. Every text says what and where.
#[derive(Debug, thiserror::Error)]
pub enum ToolError {
    /// The input is not valid.
    #[error("{0}")]
    Input(String),
    /// The options make no sense.
    #[error("{0}\n\nFor more information, try '--help'.")]
    Usage(String),
    /// Something could not be read or written.
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

    pub fn read(path: &Path, why: &dyn std::fmt::Display) -> Self {
        Self::Io(format!("{}: cannot be read: {why}", path.display()))
    }

    /// A file that was not read.
    pub fn reading(path: &Path, error: &ReadError) -> Self {
        let text = format!("{}: {error}", path.display());
        match error {
            ReadError::Io(_) => Self::Io(text),
            _ => Self::Input(text),
        }
    }

    pub fn write(path: &Path, why: &dyn std::fmt::Display) -> Self {
        Self::Io(format!("{}: cannot be written: {why}", path.display()))
    }

    /// `path` is at fault.
    pub fn input(path: &Path, why: &dyn std::fmt::Display) -> Self {
        Self::Input(format!("{}: {why}", path.display()))
    }

    /// An asset of this path. Its own text names the path only where reading or writing failed.
    pub fn asset(path: &Path, why: &AssetError) -> Self {
        if why.is_content() {
            Self::input(path, why)
        } else {
            Self::Io(why.to_string())
        }
    }
}

impl From<SceneError> for ToolError {
    fn from(why: SceneError) -> Self {
        if why.is_io() {
            Self::Io(why.to_string())
        } else {
            Self::Input(why.to_string())
        }
    }
}
