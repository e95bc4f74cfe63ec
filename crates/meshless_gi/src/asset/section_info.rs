//! [`SectionInfo`]: size and digest of a section of a file.

use serde::Serialize;

/// Size and digest of a section of a `.mgi` file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct SectionInfo {
    /// Name of the content.
    pub name: &'static str,
    /// Number of items.
    pub items: u64,
    /// Bytes in the file.
    pub bytes: u64,
    /// Bytes without LZ4.
    pub raw_bytes: u64,
    /// BLAKE3, as hex, of the bytes without LZ4.
    pub digest: String,
}
