//! `.mgi` files on disk. A write replaces a file completely or not at all.

use super::{AssetError, BakedScene, Limits};
use crate::scene::{ReadError, read_file};
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

impl BakedScene {
    /// Reads a `.mgi` file.
    ///
    /// # Errors
    /// [`AssetError::Io`] if it cannot be read, any other if its content is not valid.
    pub fn read(path: &Path, limits: &Limits) -> Result<Self, AssetError> {
        let bytes = read_file(path, limits.max_bytes).map_err(|error| match error {
            ReadError::Io(source) => AssetError::Io {
                path: path.to_owned(),
                action: "read",
                source,
            },
            ReadError::TooLarge { size, limit } => AssetError::Limit {
                what: "the file",
                needed: size,
                allowed: limit,
            },
            refused => AssetError::Refused(refused),
        })?;
        Self::from_bytes(&bytes, limits)
    }

    /// Writes a `.mgi` file and returns its size in bytes. The previous file remains if the
    /// disk has no space left or the program crashes.
    ///
    /// # Errors
    /// [`AssetError::Io`] if it cannot be written, any other if the scene is not valid.
    pub fn write(&self, path: &Path) -> Result<u64, AssetError> {
        let bytes = self.to_bytes()?;
        write_file(path, &bytes).map_err(|source| AssetError::Io {
            path: path.to_owned(),
            action: "write",
            source,
        })?;
        Ok(bytes.len() as u64)
    }
}

/// Writes a file through a temporary file in the same folder. It replaces the target once it is
/// complete and on the disk. Targets that are not regular files (a pipe, a device) are written
/// directly.
///
/// # Errors
/// Errors of the operating system. The temporary file is then removed.
pub fn write_file(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let target = match resolve_target(path)? {
        Target::Device(device) => {
            return File::options().write(true).open(&device)?.write_all(bytes);
        }
        Target::File(target) => target,
    };
    let (temporary, mut file) = create_temporary(&target)?;
    let written = file
        .write_all(bytes)
        .and_then(|()| file.sync_all())
        .and_then(|()| std::fs::rename(&temporary, &target));
    if written.is_err() {
        // The first error is reported.
        let _ = std::fs::remove_file(&temporary);
    }
    written
}

/// Checks if [`write_file`] can write to `path`, and changes nothing. Use it before long work.
///
/// # Errors
/// Errors of the operating system.
pub fn check_writable(path: &Path) -> io::Result<()> {
    match resolve_target(path)? {
        Target::File(target) => {
            let (temporary, _) = create_temporary(&target)?;
            std::fs::remove_file(temporary)
        }
        // Opening a pipe waits for its reader.
        Target::Device(_) => Ok(()),
    }
}

/// Target of a path for writing.
enum Target {
    /// Regular file, which may not exist yet.
    File(PathBuf),
    /// Pipe or device.
    Device(PathBuf),
}

fn resolve_target(path: &Path) -> io::Result<Target> {
    // Links are followed.
    let target = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    if let Ok(there) = target.metadata() {
        if there.is_dir() {
            return Err(io::Error::new(io::ErrorKind::IsADirectory, "is a folder"));
        }
        if !there.is_file() {
            return Ok(Target::Device(target));
        }
        if there.permissions().readonly() {
            return Err(io::Error::new(
                io::ErrorKind::PermissionDenied,
                "is read-only",
            ));
        }
    }
    Ok(Target::File(target))
}

/// Creates a file with an unused name in the folder of `target`.
fn create_temporary(target: &Path) -> io::Result<(PathBuf, File)> {
    let name = target
        .file_name()
        .ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "is not a file name"))?;
    for attempt in 0..100u32 {
        let mut temporary = std::ffi::OsString::from(".");
        temporary.push(name);
        temporary.push(format!(".{}-{attempt}.tmp", std::process::id()));
        let temporary = target.with_file_name(temporary);
        match File::create_new(&temporary) {
            Ok(file) => return Ok((temporary, file)),
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
            Err(e) => return Err(e),
        }
    }
    Err(io::Error::new(
        io::ErrorKind::AlreadyExists,
        "100 temporary files of this name exist; delete them",
    ))
}
