//! Bevy's asset processor for recipes: bakes ahead of time, in an app that processes its assets.

use super::asset_folders::AssetFolders;
use super::loader::{GiBakedSceneLoader, GiBakedSceneLoaderSettings};
use super::recipe_loader::{GiBakeProcessorSettings, RecipeInputLoader, RecipeInputs};
use super::recipe_progress::RecipeBakes;
use bevy::asset::io::Writer;
use bevy::asset::processor::{Process, ProcessContext, ProcessError};
use bevy::log::debug;
use bevy::reflect::TypePath;
use bevy::tasks::futures_lite::AsyncWriteExt;

/// Asset processor for recipes: its output is a `.mgi` container under the recipe's name. A bake
/// that the build step or an app made from equal input is taken over.
#[derive(Clone, Debug, Default, TypePath)]
pub struct GiBakeProcessor {
    pub(crate) bakes: RecipeBakes,
    pub(crate) folders: AssetFolders,
}

impl Process for GiBakeProcessor {
    type Settings = GiBakeProcessorSettings;
    type OutputLoader = GiBakedSceneLoader;

    async fn process(
        &self,
        context: &mut ProcessContext<'_>,
        _settings: &Self::Settings,
        writer: &mut Writer,
    ) -> Result<GiBakedSceneLoaderSettings, ProcessError> {
        let loaded = context.load_source_asset::<RecipeInputLoader>(&()).await?;
        let inputs: RecipeInputs = loaded.take().ok_or(ProcessError::WrongMetaType)?;
        let (path, key) = (context.path(), inputs.key());
        let store = self.folders.store.as_ref();
        let bytes = match store.and_then(|store| store.load(path, &key)) {
            Some(bytes) => {
                debug!("`{path}` was baked before");
                bytes
            }
            None => {
                let baked = inputs.bake_in_app(&self.bakes).await;
                let scene = baked.map_err(failed)?;
                let bytes = scene.to_bytes().map_err(failed)?;
                if let Some(store) = store {
                    store.save(path, &key, &bytes);
                }
                bytes
            }
        };
        writer.write_all(&bytes).await.map_err(failed)?;
        Ok(GiBakedSceneLoaderSettings::default())
    }
}

fn failed(error: impl std::error::Error + Send + Sync + 'static) -> ProcessError {
    ProcessError::AssetTransformError(Box::new(error))
}
