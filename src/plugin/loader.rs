//! The loader of `.mgi` files.

use super::asset::MeshlessGiAsset;
use crate::asset::{AssetError, BakedScene, Limits};
use bevy::asset::{AssetLoader, LoadContext, io::Reader};
use bevy::log::warn;
use bevy::reflect::prelude::*;
use serde::{Deserialize, Serialize};

/// Loads `.mgi` files, and what the asset processor makes of recipes.
#[derive(Clone, Copy, Debug, Default, TypePath)]
pub struct MeshlessGiLoader;

/// Settings of [`MeshlessGiLoader`], for `.meta` files.
#[derive(Reflect, Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[reflect(Default, Clone, Debug, PartialEq)]
pub struct MeshlessGiLoaderSettings {
    /// Most bytes of memory that a bake may take, decoded; larger files are refused before anything is allocated.
    pub max_bytes: u64,
}

impl Default for MeshlessGiLoaderSettings {
    fn default() -> Self {
        Self {
            max_bytes: Limits::default().max_bytes,
        }
    }
}

/// Why a `.mgi` file cannot be loaded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MeshlessGiLoadError {
    /// The bytes could not be read.
    #[error("the file could not be read: {0}")]
    Io(#[from] std::io::Error),
    /// The bytes are no whole bake.
    #[error("this is no usable bake: {0}")]
    Asset(#[from] AssetError),
    /// There are no bytes: what an asset processor leaves behind when a bake fails.
    #[error("the file is empty: its bake failed; read the asset processor's log, or bake again")]
    Empty,
}

impl AssetLoader for MeshlessGiLoader {
    type Asset = MeshlessGiAsset;
    type Settings = MeshlessGiLoaderSettings;
    type Error = MeshlessGiLoadError;

    async fn load(
        &self,
        reader: &mut dyn Reader,
        settings: &Self::Settings,
        context: &mut LoadContext<'_>,
    ) -> Result<MeshlessGiAsset, MeshlessGiLoadError> {
        let mut bytes = Vec::new();
        reader.read_to_end(&mut bytes).await?;
        if bytes.is_empty() {
            return Err(MeshlessGiLoadError::Empty);
        }
        let limits = Limits {
            max_bytes: settings.max_bytes,
        };
        let scene = BakedScene::from_bytes(&bytes, &limits)?;
        let (theirs, ours) = (&scene.info.version, env!("CARGO_PKG_VERSION"));
        if theirs != ours {
            warn!(
                "`{}` was baked by version {theirs} of the crate, this is {ours}: bake it again",
                context.path()
            );
        }
        Ok(scene.into())
    }

    fn extensions(&self) -> &[&str] {
        &["mgi"]
    }
}
