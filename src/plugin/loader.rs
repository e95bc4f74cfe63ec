//! Loader of `.mgi` files and of processed recipes.

use super::asset::GiBakedScene;
use super::scene_check::{GiSceneCheck, SceneChecker};
use bevy::asset::{AssetLoader, LoadContext, io::Reader};
use bevy::reflect::prelude::*;
use meshless_gi::{AssetError, BakedScene, Limits};
use serde::{Deserialize, Serialize};

/// Loads `.mgi` files, and the outputs of the asset processor for recipes.
#[derive(Clone, Debug, Default, TypePath)]
pub struct GiBakedSceneLoader {
    pub(crate) checker: SceneChecker,
}

/// Settings of [`GiBakedSceneLoader`], for `.meta` files.
#[derive(Reflect, Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[reflect(Default, Clone, Debug, PartialEq)]
#[serde(default)]
pub struct GiBakedSceneLoaderSettings {
    /// Largest size of a bake in memory, bytes, decoded. Larger files are refused before anything
    /// is allocated.
    pub max_bytes: u64,
    /// Condition for reading the scene file next to the bake, to detect a stale bake.
    #[serde(alias = "check_level")]
    pub check_scene: GiSceneCheck,
}

impl Default for GiBakedSceneLoaderSettings {
    fn default() -> Self {
        Self {
            max_bytes: Limits::default().max_bytes,
            check_scene: GiSceneCheck::default(),
        }
    }
}

/// Reason that a `.mgi` file cannot be loaded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GiLoadError {
    /// The bytes could not be read.
    #[error("the file could not be read: {0}")]
    Io(#[from] std::io::Error),
    /// The bytes are not a complete bake.
    #[error("this is not a usable bake: {0}")]
    Asset(#[from] AssetError),
    /// The file has no bytes: an asset processor leaves such a file after a failed bake.
    #[error("the file is empty: its bake failed; read the asset processor's log, or bake again")]
    Empty,
}

impl AssetLoader for GiBakedSceneLoader {
    type Asset = GiBakedScene;
    type Settings = GiBakedSceneLoaderSettings;
    type Error = GiLoadError;

    async fn load(
        &self,
        reader: &mut dyn Reader,
        settings: &Self::Settings,
        context: &mut LoadContext<'_>,
    ) -> Result<GiBakedScene, GiLoadError> {
        let mut bytes = Vec::new();
        reader.read_to_end(&mut bytes).await?;
        let scene = read_bake(&bytes, settings.max_bytes)?;
        let check = settings.check_scene;
        self.checker.check(scene.info(), check, context).await;
        Ok(scene.into())
    }

    fn extensions(&self) -> &[&str] {
        &["mgi"]
    }
}

/// Reads a bake that takes at most `max_bytes` of memory.
pub(crate) fn read_bake(bytes: &[u8], max_bytes: u64) -> Result<BakedScene, GiLoadError> {
    if bytes.is_empty() {
        return Err(GiLoadError::Empty);
    }
    Ok(BakedScene::from_bytes(bytes, &Limits { max_bytes })?)
}
