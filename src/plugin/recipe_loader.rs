//! Bake of a recipe as an asset: the input of the bake, the bake, and the loader that bakes.
//!
//! `level.gi.ron` next to `level.glb` holds a [`Recipe`] that names the scene: `(scene:
//! "level.glb", preset: Medium)`.
//!
//! | assets of the app | `asset_server.load::<GiBakedScene>("level.gi.ron")` |
//! |---|---|
//! | processed by the app (`AssetMode::Processed`) | loads the bake of the asset processor |
//! | processed before, by the build step or another app | loads that bake |
//! | unprocessed | bakes while loading, on background threads, at every start |
//!
//! The asset processor and the build step bake again when the recipe, the scene, or a file that the
//! scene names changes.
//!
//! A scene that cannot be baked fails its asset, with a message that names the problem and the
//! file. Nothing here panics, because a panic would hang Bevy's asset processor forever.

use super::asset::GiBakedScene;
use super::asset_folders::AssetFolders;
use super::background::Background;
use super::bake_task::bake_threads;
use super::loader::{GiLoadError, read_bake};
use super::recipe_progress::RecipeBakes;
use super::scene_check::{GiSceneCheck, SceneChecker};
use super::scene_files::{ReadFile, SceneFiles};
use bevy::asset::io::Reader;
use bevy::asset::{Asset, AssetLoader, AssetPath, LoadContext, ParseAssetPathError};
use bevy::log::{debug, info, warn};
use bevy::reflect::prelude::*;
use meshless_gi::internals::asset::{FORMAT_VERSION, fingerprint, is_container};
use meshless_gi::internals::bake::{
    BAKE_VERSION, BakeOrigin, bake_scene_with_origin, canonical_recipe,
};
use meshless_gi::{
    BakeSceneError, Baked, BakedScene, Limits, Preset, Progress, Recipe, RecipeError, SceneError,
};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Settings of [`GiBakeProcessor`](super::GiBakeProcessor) and
/// [`GiRecipeLoader`], for `.meta` files.
#[derive(Reflect, Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[reflect(Default, Clone, Debug, PartialEq)]
pub struct GiBakeProcessorSettings {
    /// [`BAKE_VERSION`], a part of Bevy's hash of the input of an asset.
    pub bake_version: u32,
}

impl Default for GiBakeProcessorSettings {
    fn default() -> Self {
        Self {
            bake_version: BAKE_VERSION,
        }
    }
}

/// Error of a recipe that gives no asset.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GiRecipeLoadError {
    /// The recipe could not be read.
    #[error("the recipe could not be read: {0}")]
    Io(#[from] std::io::Error),
    /// The recipe's text is not UTF-8.
    #[error("the recipe is not text")]
    NotText,
    /// The recipe makes no sense.
    #[error(transparent)]
    Recipe(#[from] RecipeError),
    /// The recipe names no scene.
    #[error("the recipe names no scene: add `scene: \"level.glb\"`")]
    NoScene,
    /// A path that is none.
    #[error("`{path}` is not an asset path: {source}")]
    Path {
        /// Path of the recipe or the scene.
        path: String,
        /// Error of Bevy.
        source: ParseAssetPathError,
    },
    /// A file that the recipe or the scene names could not be read.
    #[error("`{path}` could not be read: {source}")]
    File {
        /// Path of the file.
        path: String,
        /// Error of Bevy or of the operating system.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The scene cannot be parsed.
    #[error(transparent)]
    Level(#[from] SceneError),
    /// The scene cannot be baked.
    #[error("`{path}` cannot be baked: {source}")]
    Bake {
        /// Name of the scene in the recipe.
        path: String,
        /// Error of the bake.
        source: BakeSceneError,
    },
    /// The file of the recipe's name holds a bake that cannot be used.
    #[error(transparent)]
    Baked(#[from] GiLoadError),
}

/// Input of a recipe's bake.
#[derive(Asset, TypePath, Clone, Debug)]
pub(crate) struct RecipeInputs {
    pub recipe: Recipe,
    /// The recipe sets the quality, by `preset` or by `target_nrmse`.
    pub has_preset: bool,
    /// Path of the recipe.
    path: AssetPath<'static>,
    /// Scene file as the recipe names it.
    scene: String,
    files: Arc<SceneFiles>,
}

impl RecipeInputs {
    /// Reads the input of the recipe with this path and text.
    pub async fn read(
        path: &AssetPath<'static>,
        text: Vec<u8>,
        reader: &mut impl ReadFile,
    ) -> Result<Self, GiRecipeLoadError> {
        let text = String::from_utf8(text).map_err(|_| GiRecipeLoadError::NotText)?;
        let recipe = Recipe::from_ron(&text)?;
        let scene = recipe.scene.clone().ok_or(GiRecipeLoadError::NoScene)?;
        let files = SceneFiles::read(path, &scene, reader).await?;
        Ok(Self {
            has_preset: recipe.target_nrmse.is_some() || has_preset(&text),
            recipe,
            path: path.clone(),
            scene,
            files: Arc::new(files),
        })
    }

    /// Key of the bake: equal input gives an equal key in every app and in the build step.
    pub fn key(&self) -> [u8; 32] {
        let digest = fingerprint(&[
            self.scene.as_bytes(),
            canonical_recipe(&self.recipe).as_bytes(),
            self.files.digest().as_bytes(),
            &BAKE_VERSION.to_le_bytes(),
            &FORMAT_VERSION.to_le_bytes(),
        ]);
        *blake3::hash(digest.as_bytes()).as_bytes()
    }

    /// Bakes on `threads` threads (0: one for each processor), and logs the result.
    pub fn bake(
        &self,
        threads: usize,
        progress: &Progress,
    ) -> Result<BakedScene, GiRecipeLoadError> {
        let mesh = self.files.mesh(&self.recipe.viewpoints)?;
        let origin = BakeOrigin {
            scene_digest: self.files.digest(),
            ..BakeOrigin::default()
        };
        let baked = bake_scene_with_origin(&mesh, &self.recipe, &origin, threads, progress);
        let Baked { scene, stats, .. } = baked.map_err(|error| self.failed(error))?;
        info!("baked `{}` in {:.1} s", self.path, stats.seconds.total);
        Ok(scene)
    }

    /// Bakes on a thread of its own. The threads that load assets and compile shaders stay free: a
    /// bake takes seconds to minutes.
    pub fn bake_in_background(
        &self,
        threads: usize,
        progress: Arc<Progress>,
    ) -> Result<Background<Result<BakedScene, GiRecipeLoadError>>, GiRecipeLoadError> {
        debug!("baking `{}`, preset {:?}", self.path, self.recipe.preset);
        let (inputs, panicked) = (self.clone(), self.clone());
        Background::spawn(
            "meshless gi bake",
            move || inputs.bake(threads, &progress),
            move || Err(panicked.failed(BakeSceneError::Panicked("no message".into()))),
        )
        .map_err(|error| self.failed(BakeSceneError::Threads(error.to_string())))
    }

    /// Bakes in a running app.
    pub async fn bake_in_app(&self, bakes: &RecipeBakes) -> Result<BakedScene, GiRecipeLoadError> {
        let running = bakes.start(self.path.clone());
        let work = self.bake_in_background(bake_threads(), running.progress.clone())?;
        work.await
    }

    fn failed(&self, source: BakeSceneError) -> GiRecipeLoadError {
        GiRecipeLoadError::Bake {
            path: self.scene.clone(),
            source,
        }
    }
}

/// Returns true if the text of a recipe has a `preset`.
fn has_preset(text: &str) -> bool {
    #[derive(Default, Deserialize)]
    #[serde(default)]
    struct Named {
        preset: Option<Preset>,
    }
    ron::Options::default()
        .with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME)
        .from_str::<Named>(text)
        .is_ok_and(|named| named.preset.is_some())
}

/// Files of an asset source, read through a load context: it notes them as dependencies, and a
/// change of any of them loads or processes again.
pub(crate) struct ContextReader<'a, 'b> {
    pub context: &'a mut LoadContext<'b>,
    /// Folders of the app. Files before processing go before processed ones, which a processor of
    /// the game may have turned into a format of the device.
    pub folders: &'a AssetFolders,
}

impl ReadFile for ContextReader<'_, '_> {
    async fn read(&mut self, path: &AssetPath<'static>) -> Result<Vec<u8>, GiRecipeLoadError> {
        let read = self.context.read_asset_bytes(path.clone()).await;
        if let Some(bytes) = self.folders.read_source(path) {
            return Ok(bytes);
        }
        read.map_err(|error| GiRecipeLoadError::File {
            path: path.to_string(),
            source: Box::new(error),
        })
    }
}

/// Bakes a recipe (`.gi.ron`) while loading it. A recipe that names no preset is baked at
/// [`Preset::Draft`]. A file of that name that holds a bake is loaded like a `.mgi` file.
#[derive(Clone, Debug, Default, TypePath)]
pub struct GiRecipeLoader {
    pub(crate) bakes: RecipeBakes,
    pub(crate) folders: AssetFolders,
    pub(crate) checker: SceneChecker,
}

impl AssetLoader for GiRecipeLoader {
    type Asset = GiBakedScene;
    type Settings = GiBakeProcessorSettings;
    type Error = GiRecipeLoadError;

    async fn load(
        &self,
        reader: &mut dyn Reader,
        _settings: &Self::Settings,
        context: &mut LoadContext<'_>,
    ) -> Result<GiBakedScene, GiRecipeLoadError> {
        let mut bytes = Vec::new();
        reader.read_to_end(&mut bytes).await?;
        if is_container(&bytes) {
            let scene = read_bake(&bytes, Limits::default().max_bytes)?;
            let check = GiSceneCheck::default();
            self.checker.check(scene.info(), check, context).await;
            return Ok(scene.into());
        }
        let path = context.path().clone();
        let mut reader = ContextReader {
            context,
            folders: &self.folders,
        };
        let mut inputs = RecipeInputs::read(&path, bytes, &mut reader).await?;
        let preset = match inputs.has_preset {
            true => "",
            false => {
                inputs.recipe.preset = Preset::Draft;
                ", with preset Draft because the recipe names none (processing takes Medium)"
            }
        };
        warn!(
            "`{path}` is an unprocessed recipe: it is baked at every start of the app{preset}. Process the assets to bake once: \
             call `process_assets` as a build step, or run the app with `AssetMode::Processed`."
        );
        Ok(inputs.bake_in_app(&self.bakes).await?.into())
    }

    fn extensions(&self) -> &[&str] {
        &[RECIPE_EXTENSION]
    }
}

/// Extension of recipes.
pub(crate) const RECIPE_EXTENSION: &str = "gi.ron";

/// Reads the input of a recipe's bake without baking it, for the asset processor.
#[derive(Clone, Debug, Default, TypePath)]
pub(crate) struct RecipeInputLoader {
    pub folders: AssetFolders,
}

impl AssetLoader for RecipeInputLoader {
    type Asset = RecipeInputs;
    type Settings = ();
    type Error = GiRecipeLoadError;

    async fn load(
        &self,
        reader: &mut dyn Reader,
        _settings: &(),
        context: &mut LoadContext<'_>,
    ) -> Result<RecipeInputs, GiRecipeLoadError> {
        let mut bytes = Vec::new();
        reader.read_to_end(&mut bytes).await?;
        let path = context.path().clone();
        let mut reader = ContextReader {
            context,
            folders: &self.folders,
        };
        RecipeInputs::read(&path, bytes, &mut reader).await
    }
}

#[cfg(test)]
mod tests {
    use super::has_preset;

    #[test]
    fn has_preset_is_true_only_for_preset_in_text() {
        for (text, named) in [
            (r#"(scene: "a.glb")"#, false),
            (r#"(scene: "a.glb", preset: Medium)"#, true),
            (r#"(preset: Some(High), probes: ())"#, true),
            (
                r#"(scene: "preset", occluders: [(name: "preset")], sky: Harmonics)"#,
                false,
            ),
            (r#"(scene: "a.glb" /* preset: Draft */)"#, false),
            ("()", false),
        ] {
            assert_eq!(has_preset(text), named, "{text}");
        }
    }
}
