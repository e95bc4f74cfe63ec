//! Errors of a `.mgi` file, and limits of the memory that reading one may take.

use super::violation::Violation;
use crate::scene::ReadError;
use std::path::PathBuf;

/// Limits of the cost of reading an asset. They are checked before anything is allocated (design
/// D10).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Largest memory of the decoded scene and its decoding, bytes.
    pub max_bytes: u64,
}

impl Default for Limits {
    /// Returns 4 GiB. It fits the largest scene at the finest preset, and the memory of a PC.
    fn default() -> Self {
        Self { max_bytes: 1 << 32 }
    }
}

/// Error of writing or reading an asset.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AssetError {
    /// The operating system could not read or write. Its error does not concern the content.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// Path of the file.
        path: PathBuf,
        /// "read" or "write".
        action: &'static str,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The file was rejected before its content was read.
    #[error("it {0}")]
    Refused(#[source] ReadError),
    /// The bytes do not start as a `.mgi` file does.
    #[error("not a .mgi file: it does not start with the format's eight bytes")]
    NotMgi,
    /// The file has another format version.
    #[error(
        "format version {found}, but this program reads version {expected}: bake the scene again"
    )]
    Version {
        /// Version of the file.
        found: u32,
        /// Version that this program reads.
        expected: u32,
    },
    /// The bytes end too early.
    #[error("the file is cut off: {needed} bytes expected, {found} found")]
    Truncated {
        /// Length in the header, bytes.
        needed: u64,
        /// Length of the file, bytes.
        found: u64,
    },
    /// The header or the section table is not valid.
    #[error("header: {problem}")]
    Header {
        /// Problem.
        problem: String,
    },
    /// A checksum does not match.
    #[error("{section}: the checksum does not match, the file is damaged")]
    Checksum {
        /// "header" or the name of the section.
        section: &'static str,
    },
    /// A section cannot be decoded.
    #[error("section `{section}`: {problem}")]
    Section {
        /// Name of the section.
        section: &'static str,
        /// Problem.
        problem: String,
    },
    /// Decoding would take more memory than [`Limits`] allows.
    #[error("{what} would take {needed} bytes of memory, but at most {allowed} are allowed")]
    Limit {
        /// Name of the array.
        what: &'static str,
        /// Required memory, bytes.
        needed: u64,
        /// [`Limits::max_bytes`].
        allowed: u64,
    },
    /// The arrays are inconsistent, so that a frame could not use them.
    #[error("the scene is not valid: {}", list(.0))]
    Invalid(Vec<Violation>),
}

impl AssetError {
    /// Returns `true` if the content is not valid, `false` if reading or writing failed.
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
