//! Folders of an app's assets on disk, where they are on disk.

use super::bake_store::BakeStore;
use bevy::app::App;
use bevy::asset::processor::AssetProcessor;
use bevy::asset::{AssetMode, AssetPath, AssetPlugin};
use std::path::{Path, PathBuf};

/// Folders that the app's [`AssetPlugin`] names.
#[derive(Clone, Debug, Default)]
pub(crate) struct AssetFolders {
    /// Folder of the assets before processing. `None` if the app reads it itself.
    source: Option<PathBuf>,
    /// Bakes that were made before. `None` if the app processes no assets.
    pub store: Option<BakeStore>,
    /// `true` if the app's asset processor bakes recipes again when their input changes.
    pub processing: bool,
}

impl AssetFolders {
    /// Reads the folders from the app's [`AssetPlugin`].
    pub fn from_app(app: &App) -> Self {
        let Some(base) = base_folder() else {
            return Self::default();
        };
        let processing = app.world().contains_resource::<AssetProcessor>();
        match app.get_added_plugins::<AssetPlugin>().first() {
            Some(assets) if matches!(assets.mode, AssetMode::Processed) => Self {
                source: Some(base.join(&assets.file_path)),
                store: processing
                    .then(|| BakeStore::next_to(&base.join(&assets.processed_file_path)))
                    .flatten(),
                processing,
            },
            _ => Self::default(),
        }
    }

    /// Reads a file of the default asset source before processing. Returns `None` if there is none.
    pub fn read_source(&self, path: &AssetPath<'_>) -> Option<Vec<u8>> {
        std::fs::read(source_file(self.source.as_deref()?, path)?).ok()
    }
}

/// File of `path` in `folder`. Returns `None` if the path belongs to another asset source.
pub(crate) fn source_file(folder: &Path, path: &AssetPath<'_>) -> Option<PathBuf> {
    (path.source().as_str().is_none()).then(|| folder.join(path.path()))
}

/// Folder that Bevy's asset folders are relative to. Returns `None` on platforms without files.
#[cfg(not(any(target_arch = "wasm32", target_os = "android")))]
pub(crate) fn base_folder() -> Option<PathBuf> {
    Some(bevy::asset::io::file::FileAssetReader::get_base_path())
}

#[cfg(any(target_arch = "wasm32", target_os = "android"))]
pub(crate) fn base_folder() -> Option<PathBuf> {
    None
}
