//! Files that the build step does not bake: copied so that every app loads them.
//!
//! The step has none of the app's loaders, so it writes no `.meta` of its own for such a file: Bevy
//! then picks the loader by type and extension, as for unprocessed assets. A `.meta` next to the
//! source is copied if it names a loader. The output of an app's own asset
//! processor stays as it is while it is not older than its source.

use super::process_assets::GiProcessAssetsError;
use bevy::asset::meta::{AssetActionMinimal, AssetMetaMinimal, ProcessedInfoMinimal};
use bevy::log::warn;
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Name of the list of files that the step made, in the folder of the kept bakes.
const LIST: &str = "files.txt";

/// Action that a `.meta` file names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Action {
    /// Load with the loader of this type path.
    Load(String),
    /// Process with the processor of this type path, short or long.
    Process(String),
    /// No asset.
    Ignore,
}

/// A `.meta` file.
pub(crate) struct Meta {
    pub bytes: Vec<u8>,
    pub action: Action,
    /// Hash of source and settings, if an asset processor or the build step wrote the file.
    pub hash: Option<[u8; 32]>,
    modified: Option<SystemTime>,
}

impl Meta {
    /// Reads the `.meta` next to `file`. Returns `None` if there is none.
    pub fn read(file: &Path) -> Result<Option<Self>, GiProcessAssetsError> {
        let path = meta_path(file);
        let bytes = match fs::read(&path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(GiProcessAssetsError::file(&path, "read", error)),
        };
        let invalid = |error: ron::error::SpannedError| {
            let error = io::Error::new(ErrorKind::InvalidData, error.to_string());
            GiProcessAssetsError::file(&path, "read", error)
        };
        let meta: AssetMetaMinimal = ron::de::from_bytes(&bytes).map_err(invalid)?;
        let info: ProcessedInfoMinimal = ron::de::from_bytes(&bytes).map_err(invalid)?;
        Ok(Some(Self {
            action: match meta.asset {
                AssetActionMinimal::Load { loader } => Action::Load(loader),
                AssetActionMinimal::Process { processor } => Action::Process(processor),
                AssetActionMinimal::Ignore => Action::Ignore,
            },
            hash: info.processed_info.map(|info| info.hash),
            modified: modified(&path),
            bytes,
        }))
    }
}

/// Path of the `.meta` of a file.
pub(crate) fn meta_path(file: &Path) -> PathBuf {
    let mut path = file.as_os_str().to_owned();
    path.push(".meta");
    path.into()
}

/// Copies `source` to `output` if they differ, with the `.meta` next to it if that names a loader.
/// Returns `false` if `meta`, the `.meta` of the source, declares no asset. Then there is no
/// output.
pub(crate) fn copy_asset(
    source: &Path,
    output: &Path,
    meta: Option<&Meta>,
) -> Result<bool, GiProcessAssetsError> {
    let load = match meta.map(|meta| &meta.action) {
        Some(Action::Ignore) => {
            remove_asset(output)?;
            return Ok(false);
        }
        Some(Action::Load(_)) => meta,
        Some(Action::Process(_)) | None => None,
    };
    if is_processed(source, output, meta) {
        return Ok(true);
    }
    if let Some(Action::Process(processor)) = meta.map(|meta| &meta.action) {
        warn!(
            "{}: only the app has the processor `{processor}`, so the file is copied as it is. Run the app with its asset processor to process it.",
            source.display()
        );
    }
    if !same_file(source, output) {
        let from = File::open(source)
            .map_err(|error| GiProcessAssetsError::file(source, "read", error))?;
        copy_file(from, output)
            .map_err(|error| GiProcessAssetsError::file(output, "write", error))?;
    }
    let path = meta_path(output);
    match load {
        Some(load) if fs::read(&path).ok().as_ref() == Some(&load.bytes) => {}
        Some(load) => fs::write(&path, &load.bytes)
            .map_err(|error| GiProcessAssetsError::file(&path, "write", error))?,
        None => remove_file(&path)?,
    }
    Ok(true)
}

/// Returns true if an app's asset processor made `output`, and neither `source` nor its `.meta` is
/// newer.
fn is_processed(source: &Path, output: &Path, meta: Option<&Meta>) -> bool {
    let made = Meta::read(output).ok().flatten();
    let loadable = made.is_some_and(|m| matches!(m.action, Action::Load(_)) && m.hash.is_some());
    let (Some(made), Some(source)) = (modified(output), modified(source)) else {
        return false;
    };
    let settled = meta
        .and_then(|meta| meta.modified)
        .is_none_or(|m| made >= m);
    loadable && made >= source && settled
}

/// Removes an asset's output and its `.meta`, where they are there.
pub(crate) fn remove_asset(output: &Path) -> Result<(), GiProcessAssetsError> {
    remove_file(output)?;
    remove_file(&meta_path(output))
}

fn remove_file(path: &Path) -> Result<(), GiProcessAssetsError> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            Err(GiProcessAssetsError::file(path, "remove", error))
        }
        _ => Ok(()),
    }
}

fn modified(path: &Path) -> Option<SystemTime> {
    fs::metadata(path).and_then(|m| m.modified()).ok()
}

/// Returns true if `output` has the size and the time of `source`, as [`copy_file`] leaves it.
fn same_file(source: &Path, output: &Path) -> bool {
    let facts = |path: &Path| {
        let metadata = fs::metadata(path).ok()?;
        Some((metadata.len(), metadata.modified().ok()?))
    };
    facts(source).is_some_and(|facts_of_source| facts(output) == Some(facts_of_source))
}

/// Copies a file, with its time, by way of a temporary file: it is there as a whole or not at all.
fn copy_file(mut from: File, output: &Path) -> io::Result<()> {
    if let Some(folder) = output.parent() {
        fs::create_dir_all(folder)?;
    }
    let mut name = OsString::from(".");
    name.push(output.file_name().unwrap_or_default());
    name.push(format!(".{}.tmp", std::process::id()));
    let temporary = output.with_file_name(name);
    let mut copy = || {
        let mut to = File::create(&temporary)?;
        io::copy(&mut from, &mut to)?;
        // A file system without times has the file copied again by the next run.
        let _ = (from.metadata()?.modified()).and_then(|time| to.set_modified(time));
        drop(to);
        fs::rename(&temporary, output)
    };
    copy().inspect_err(|_| {
        let _ = fs::remove_file(&temporary);
    })
}

/// Removes the outputs of the run before whose sources are gone, and lists those of this run.
/// Outputs that the step did not make stay.
pub(crate) fn remove_orphans(
    list: &Path,
    processed: &Path,
    made: &BTreeSet<String>,
) -> Result<(), GiProcessAssetsError> {
    let list = list.join(LIST);
    let before = fs::read_to_string(&list).unwrap_or_default();
    let inside = |name: &&str| {
        let mut parts = Path::new(name).components();
        !name.is_empty() && parts.all(|c| matches!(c, std::path::Component::Normal(_)))
    };
    for name in before.lines().filter(inside) {
        if !made.contains(name) {
            remove_asset(&processed.join(name))?;
        }
    }
    let lines: String = made.iter().map(|name| format!("{name}\n")).collect();
    if lines == before {
        return Ok(());
    }
    let written = (list.parent().map_or(Ok(()), fs::create_dir_all))
        .and_then(|()| meshless_gi::internals::asset::write_file(&list, lines.as_bytes()));
    if let Err(error) = written {
        warn!(
            "{}: outputs of deleted assets will stay: {error}",
            list.display()
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    const LOAD: &str =
        r#"(meta_format_version: "1.0", asset: Load(loader: "game::Loader", settings: ()))"#;
    const IGNORE: &str = r#"(meta_format_version: "1.0", asset: Ignore)"#;

    /// Writes a source, its `.meta` if there is any, and copies both.
    fn copy(folder: &Path, content: &[u8], meta: Option<&str>) -> bool {
        let source = folder.join("source.png");
        fs::write(&source, content).unwrap();
        match meta {
            Some(meta) => fs::write(meta_path(&source), meta).unwrap(),
            None => remove_file(&meta_path(&source)).unwrap(),
        }
        let meta = Meta::read(&source).unwrap();
        copy_asset(&source, &folder.join("out/output.png"), meta.as_ref()).unwrap()
    }

    #[test]
    fn copy_asset_copies_changed_files_and_removes_ignored() {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("out/output.png");
        let meta = meta_path(&output);
        assert!(copy(folder.path(), b"one", None));
        assert_eq!(fs::read(&output).unwrap(), b"one");
        assert!(!meta.exists());
        fs::write(&meta, IGNORE).unwrap();
        assert!(copy(folder.path(), b"two", None));
        assert_eq!(fs::read(&output).unwrap(), b"two");
        assert!(!meta.exists(), "an app without a loader wrote it");
        assert!(copy(folder.path(), b"two", Some(LOAD)));
        assert_eq!(fs::read_to_string(&meta).unwrap(), LOAD);
        assert!(!copy(folder.path(), b"two", Some(IGNORE)));
        assert!(!output.exists() && !meta.exists());
        let leftovers = fs::read_dir(folder.path().join("out")).unwrap().count();
        assert_eq!(leftovers, 0, "no temporary file stays");
    }

    #[test]
    fn copy_asset_output_of_a_processor_stays_while_it_is_newer() {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("out/output.png");
        let process =
            r#"(meta_format_version: "1.0", asset: Process(processor: "Game", settings: ()))"#;
        assert!(copy(folder.path(), b"png", Some(process)));
        assert!(!meta_path(&output).exists(), "the step cannot process it");
        let hash = format!("{:?}", [7u8; 32])
            .replace('[', "(")
            .replace(']', ")");
        let made = format!(
            r#"(meta_format_version: "1.0", processed_info: Some((hash: {hash}, full_hash: {hash}, process_dependencies: [])), asset: Load(loader: "game::Loader", settings: ()))"#
        );
        fs::write(&output, b"ktx").unwrap();
        fs::write(meta_path(&output), &made).unwrap();
        let later = SystemTime::now() + Duration::from_secs(60);
        File::options()
            .write(true)
            .open(&output)
            .and_then(|file| file.set_modified(later))
            .unwrap();
        assert!(copy(folder.path(), b"png", Some(process)));
        assert_eq!(fs::read(&output).unwrap(), b"ktx");
        assert_eq!(fs::read_to_string(meta_path(&output)).unwrap(), made);

        let source = folder.path().join("source.png");
        File::options()
            .write(true)
            .open(&source)
            .and_then(|file| file.set_modified(later + Duration::from_secs(60)))
            .unwrap();
        let meta = Meta::read(&source).unwrap();
        assert!(copy_asset(&source, &output, meta.as_ref()).unwrap());
        assert_eq!(fs::read(&output).unwrap(), b"png", "the source is newer");
        assert!(!meta_path(&output).exists());
    }

    #[test]
    fn remove_orphans_removes_only_outputs_of_the_step() {
        let folder = tempfile::tempdir().unwrap();
        let (list, processed) = (folder.path().join("list"), folder.path().join("processed"));
        fs::create_dir(&processed).unwrap();
        for name in ["a", "a.meta", "b", "game"] {
            fs::write(processed.join(name), name).unwrap();
        }
        fs::write(folder.path().join("outside"), "").unwrap();
        let made = |names: &[&str]| names.iter().map(|n| n.to_string()).collect::<BTreeSet<_>>();
        remove_orphans(&list, &processed, &made(&["a", "b", "../outside"])).unwrap();
        assert!(processed.join("a").exists(), "all are there");
        remove_orphans(&list, &processed, &made(&["b"])).unwrap();
        for (name, stays) in [("a", false), ("a.meta", false), ("b", true), ("game", true)] {
            assert_eq!(processed.join(name).exists(), stays, "{name}");
        }
        assert!(folder.path().join("outside").exists());
    }

    #[test]
    fn read_damaged_meta_is_an_error_that_names_it() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.png");
        fs::write(meta_path(&file), "(asset: Lo").unwrap();
        let error = Meta::read(&file).err().expect("an error").to_string();
        assert!(error.contains("a.png.meta"), "{error}");
    }
}
