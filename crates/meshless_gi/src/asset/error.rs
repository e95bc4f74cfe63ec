//! Errors of a `.mgi` file, and limits of the memory that reading one may take.

use super::violation::Violation;
use crate::scene::ReadError;
use std::path::PathBuf;

/// Bounds on what reading an asset may cost; checked before anything is allocated (design D10).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Most bytes of memory for the decoded scene and for decoding it.
    pub max_bytes: u64,
}

impl Default for Limits {
    /// 4 GiB: the largest level at the finest preset, and no more than a PC has.
    fn default() -> Self {
        Self { max_bytes: 1 << 32 }
    }
}

/// Error of writing or reading an asset.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AssetError {
    /// The operating system could not read or write: nothing is known about the content.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// Path of the file.
        path: PathBuf,
        /// "read" or "write".
        action: &'static str,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The file was refused before its content was looked at.
    #[error("it {0}")]
    Refused(#[source] ReadError),
    /// The bytes do not start as a `.mgi` file does.
    #[error("not a .mgi file: it does not start with the format's eight bytes")]
    NotMgi,
    /// Written in another layout.
    #[error(
        "format version {found}, but this program reads version {expected}: bake the scene again"
    )]
    Version {
        /// In the file.
        found: u32,
        /// Version that this program reads.
        expected: u32,
    },
    /// The bytes end too early.
    #[error("the file is cut off: {needed} bytes announced, {found} there")]
    Truncated {
        /// As the header says.
        needed: u64,
        /// Number found.
        found: u64,
    },
    /// The header or the section table makes no sense.
    #[error("header: {problem}")]
    Header {
        /// Problem.
        problem: String,
    },
    /// A checksum does not match.
    #[error("{section}: the checksum does not match, the file is damaged")]
    Checksum {
        /// "header" or the section's name.
        section: &'static str,
    },
    /// A section cannot be decoded.
    #[error("section `{section}`: {problem}")]
    Section {
        /// The section's name.
        section: &'static str,
        /// Problem.
        problem: String,
    },
    /// Decoding would take more memory than [`Limits`] allows.
    #[error("{what} would take {needed} bytes of memory, but at most {allowed} are allowed")]
    Limit {
        /// Name of the array.
        what: &'static str,
        /// Memory that it takes, bytes.
        needed: u64,
        /// [`Limits::max_bytes`].
        allowed: u64,
    },
    /// The arrays do not fit together; a frame could not run on them.
    #[error("the scene is not valid: {}", list(.0))]
    Invalid(Vec<Violation>),
}

impl AssetError {
    /// True when the content is at fault, false when reading or writing failed.
    #[must_use]
    pub fn is_content(&self) -> bool {
        !matches!(self, Self::Io { .. })
    }
}

fn list(violations: &[Violation]) -> String {
    let mut text = violations
        .iter()
        .take(4)
        .map(ToString::to_string)
        .collect::<Vec<_>>()
        .join("; ");
    if violations.len() > 4 {
        text += &format!("; and {} more", violations.len() - 4);
    }
    text
}
