//! Bounded reading of files. All readers of this crate use it. Only regular files are read, and
//! only up to a limit.

use std::fs::{File, FileType, Metadata};
use std::io::{self, Read};
use std::path::Path;

/// Number of bytes per read call.
const CHUNK_BYTES: u64 = 1 << 20;

/// Error of reading a file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The operating system could not read the file.
    #[error("cannot be read: {0}")]
    Io(#[from] io::Error),
    /// The file is not a regular file and may have no end.
    #[error("is {kind}, not a regular file")]
    NotRegular {
        /// Kind of the file, with its article.
        kind: &'static str,
    },
    /// The file has more bytes than allowed.
    #[error("brings the input to {size} bytes or more, at most {limit} are allowed")]
    TooLarge {
        /// Number of bytes counted so far.
        size: u64,
        /// Limit, bytes.
        limit: u64,
    },
}

/// Number of bytes that may still be read for a scene. All files of the scene share the budget. A
/// small file that references a large one a thousand times cannot exceed the limit.
#[derive(Clone, Debug)]
pub struct InputBudget {
    limit: u64,
    left: u64,
}

impl Default for InputBudget {
    fn default() -> Self {
        Self::new(Self::DEFAULT)
    }
}

impl InputBudget {
    /// Default limit, bytes: 8 GiB.
    pub const DEFAULT: u64 = 8 << 30;

    /// Creates a budget of `limit` bytes.
    #[must_use]
    pub fn new(limit: u64) -> Self {
        Self { limit, left: limit }
    }

    /// Reads a whole file and subtracts its length from the budget.
    ///
    /// # Errors
    /// See [`ReadError`].
    pub fn read(&mut self, path: &Path) -> Result<Vec<u8>, ReadError> {
        let used = self.limit - self.left;
        let bytes = read_file(path, self.left).map_err(|error| match error {
            ReadError::TooLarge { size, .. } => ReadError::TooLarge {
                size: size.saturating_add(used),
                limit: self.limit,
            },
            other => other,
        })?;
        self.left -= bytes.len() as u64;
        Ok(bytes)
    }
}

/// Reads a regular file of at most `limit` bytes. Links are followed.
///
/// # Errors
/// See [`ReadError`]. The file is read in pieces. A file that grows during the read, or that has
/// another length than stated, is refused at the limit.
pub fn read_file(path: &Path, limit: u64) -> Result<Vec<u8>, ReadError> {
    // This check precedes the open call, because opening a pipe blocks until there is a writer.
    check(&path.metadata()?, limit)?;
    let mut file = File::open(path)?;
    let length = check(&file.metadata()?, limit)?;
    let mut bytes = Vec::new();
    let reserved = usize::try_from(length).map(|length| bytes.try_reserve_exact(length));
    if !matches!(reserved, Ok(Ok(()))) {
        return Err(io::Error::from(io::ErrorKind::OutOfMemory).into());
    }
    while bytes.len() as u64 <= limit {
        let piece = CHUNK_BYTES.min((limit - bytes.len() as u64).saturating_add(1));
        if file.by_ref().take(piece).read_to_end(&mut bytes)? == 0 {
            return Ok(bytes);
        }
    }
    Err(ReadError::TooLarge {
        size: bytes.len() as u64,
        limit,
    })
}

/// Returns the length in bytes that the file system reports.
fn check(found: &Metadata, limit: u64) -> Result<u64, ReadError> {
    if found.is_dir() {
        return Err(io::Error::from(io::ErrorKind::IsADirectory).into());
    }
    if !found.is_file() {
        let kind = kind(found.file_type());
        return Err(ReadError::NotRegular { kind });
    }
    match found.len() {
        size if size > limit => Err(ReadError::TooLarge { size, limit }),
        size => Ok(size),
    }
}

#[cfg(unix)]
fn kind(of: FileType) -> &'static str {
    use std::os::unix::fs::FileTypeExt;
    match () {
        () if of.is_fifo() => "a pipe",
        () if of.is_socket() => "a socket",
        () if of.is_char_device() || of.is_block_device() => "a device",
        () => "a special file",
    }
}

#[cfg(not(unix))]
fn kind(_: FileType) -> &'static str {
    "a special file"
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn file_at_limit_is_read_and_one_byte_more_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        // Two pieces and one byte.
        let content: Vec<u8> = (0..2 * CHUNK_BYTES + 1).map(|i| (i % 251) as u8).collect();
        fs::write(&path, &content).unwrap();
        let size = content.len() as u64;
        assert!(read_file(&path, size).unwrap() == content);
        assert!(read_file(&path, u64::MAX).unwrap() == content);
        let refused = read_file(&path, size - 1).unwrap_err();
        assert!(
            matches!(refused, ReadError::TooLarge { limit, .. } if limit == size - 1),
            "{refused}"
        );
        fs::write(&path, b"").unwrap();
        assert_eq!(read_file(&path, 0).unwrap(), b"");
    }

    #[test]
    fn budget_counts_all_files() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        fs::write(&path, [7; 400]).unwrap();
        let mut budget = InputBudget::new(1000);
        assert!(budget.read(&path).is_ok() && budget.read(&path).is_ok());
        let refused = budget.read(&path).unwrap_err();
        assert!(
            matches!(
                refused,
                ReadError::TooLarge {
                    size: 1200,
                    limit: 1000
                }
            ),
            "{refused}"
        );
    }

    /// Files of /proc report a length of 0.
    #[cfg(target_os = "linux")]
    #[test]
    fn file_without_stated_length_is_bounded() {
        let path = Path::new("/proc/self/status");
        let whole = read_file(path, 1 << 20).unwrap();
        assert!(whole.len() > 100);
        let refused = read_file(path, 100).unwrap_err();
        assert!(
            matches!(refused, ReadError::TooLarge { size: 101, .. }),
            "{refused}"
        );
    }

    #[test]
    fn irregular_file_is_rejected() {
        let folder = tempfile::tempdir().unwrap();
        let refused = read_file(folder.path(), 100).unwrap_err();
        assert!(matches!(refused, ReadError::Io(_)), "{refused}");
        let refused = read_file(&folder.path().join("gone"), 100).unwrap_err();
        assert!(matches!(refused, ReadError::Io(_)), "{refused}");
        #[cfg(unix)]
        {
            let refused = read_file(Path::new("/dev/zero"), 100).unwrap_err();
            assert_eq!(refused.to_string(), "is a device, not a regular file");
        }
    }
}
