//! `.mgi` files on disk. Writing replaces a file as a whole or not at all.

use super::{AssetError, BakedScene, Limits};
use crate::scene::{ReadError, read_file};
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

impl BakedScene {
    /// Reads a `.mgi` file.
    ///
    /// # Errors
    /// [`AssetError::Io`] where it cannot be read, any other where its content is not valid.
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

    /// Writes a `.mgi` file and returns its size in bytes. A full disk or a crash leaves what was
    /// there before.
    ///
    /// # Errors
    /// [`AssetError::Io`] where it cannot be written, any other where the scene is not valid.
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

/// Writes a file by way of a temporary one in the same folder, which replaces it once it is
/// whole and on the disk. What is no regular file (a pipe, a device) is written directly.
///
/// # Errors
/// Those of the operating system; the temporary file is gone then.
pub fn write_file(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let target = match writable_target(path)? {
        Target::Device(device) => {
            return File::options().write(true).open(&device)?.write_all(bytes);
        }
        Target::File(target) => target,
    };
    let (temporary, mut file) = create_beside(&target)?;
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

/// Finds out whether [`write_file`] could write there, and leaves everything as it was: for a check
/// before long work.
///
/// # Errors
/// Those of the operating system.
pub fn check_writable(path: &Path) -> io::Result<()> {
    match writable_target(path)? {
        Target::File(target) => {
            let (temporary, _) = create_beside(&target)?;
            std::fs::remove_file(temporary)
        }
        // Opening a pipe waits for its reader.
        Target::Device(_) => Ok(()),
    }
}

/// File that a path leads to for writing.
enum Target {
    /// A regular file, there or not.
    File(PathBuf),
    /// A pipe or a device.
    Device(PathBuf),
}

fn writable_target(path: &Path) -> io::Result<Target> {
    // Through a link: to what it points to.
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

/// A new file beside `target`, of a name that nobody has.
fn create_beside(target: &Path) -> io::Result<(PathBuf, File)> {
    let name = target
        .file_name()
        .ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "is not the name of a file"))?;
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
        "a hundred temporary files are in the way",
    ))
}
