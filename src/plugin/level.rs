//! From a recipe beside a level to a baked asset: a loader that bakes, and the asset processor that bakes ahead of time.
//!
//! `level.gi.ron` beside `level.glb` holds a [`Recipe`] that names the level: `(scene: "level.glb", preset: Medium)`.
//!
//! | how the app runs | `asset_server.load::<MeshlessGiAsset>("level.gi.ron")` |
//! |---|---|
//! | assets processed (`AssetMode::Processed`) | loads what the processor baked: again when recipe, level, or a file that the level names changes |
//! | assets processed elsewhere, shipped | loads the shipped bake |
//! | assets unprocessed | bakes while loading, on a background thread |
//!
//! A level that cannot be baked fails its asset with a message that says what and where; nothing here panics, because a panic
//! would hang Bevy's asset processor for ever.

use super::asset::MeshlessGiAsset;
use super::bake_task::bake_in_background;
use super::loader::{MeshlessGiLoader, MeshlessGiLoaderSettings};
use crate::asset::AssetError;
use crate::bake::{BakeLevelError, Progress, Recipe, RecipeError};
use crate::scene::{SceneError, TriangleMesh, load_gltf_bytes, load_ply_bytes};
use bevy::asset::io::{Reader, Writer};
use bevy::asset::processor::{Process, ProcessContext, ProcessError};
use bevy::asset::{AssetLoader, AssetPath, LoadContext, ParseAssetPathError, ReadAssetBytesError};
use bevy::log::{debug, info, warn};
use bevy::math::Vec3;
use bevy::reflect::prelude::*;
use bevy::tasks::futures_lite::AsyncWriteExt;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Changes whenever equal input may bake to other bytes. Part of the processor's settings, so that Bevy bakes again.
pub const BAKE_VERSION: u32 = 1;

/// Bakes a recipe (`.gi.ron`) while loading it.
#[derive(Clone, Copy, Debug, Default, TypePath)]
pub struct MeshlessGiRecipeLoader;

/// The asset processor for recipes: the output is a `.mgi` container under the recipe's name.
#[derive(Clone, Copy, Debug, Default, TypePath)]
pub struct MeshlessGiBakeProcessor;

/// Settings of [`MeshlessGiBakeProcessor`] and [`MeshlessGiRecipeLoader`], for `.meta` files.
#[derive(Reflect, Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[reflect(Default, Clone, Debug, PartialEq)]
pub struct MeshlessGiBakeSettings {
    /// [`BAKE_VERSION`]; it takes part in Bevy's hash of what an asset was made from.
    pub bake_version: u32,
}

impl Default for MeshlessGiBakeSettings {
    fn default() -> Self {
        Self {
            bake_version: BAKE_VERSION,
        }
    }
}

/// Why a recipe gives no asset.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecipeLoadError {
    /// The recipe could not be read.
    #[error("the recipe could not be read: {0}")]
    Io(#[from] std::io::Error),
    /// The recipe's text is not UTF-8.
    #[error("the recipe is not text")]
    NotText,
    /// The recipe makes no sense.
    #[error(transparent)]
    Recipe(#[from] RecipeError),
    /// The recipe names no level.
    #[error("the recipe names no level: add `scene: \"level.glb\"`")]
    NoScene,
    /// A path that is none.
    #[error("`{path}` is no asset path: {why}")]
    Path {
        /// What the recipe or the level says.
        path: String,
        /// Bevy's reason.
        why: ParseAssetPathError,
    },
    /// A file that the recipe or the level names could not be read.
    #[error("`{path}` could not be read: {why}")]
    File {
        /// Which file.
        path: String,
        /// Bevy's reason.
        why: Box<ReadAssetBytesError>,
    },
    /// The level cannot be read or understood.
    #[error(transparent)]
    Level(#[from] SceneError),
    /// The level cannot be baked.
    #[error("`{path}` cannot be baked: {why}")]
    Bake {
        /// Which level.
        path: String,
        /// Why.
        why: BakeLevelError,
    },
}

impl AssetLoader for MeshlessGiRecipeLoader {
    type Asset = MeshlessGiAsset;
    type Settings = MeshlessGiBakeSettings;
    type Error = RecipeLoadError;

    async fn load(
        &self,
        reader: &mut dyn Reader,
        _settings: &Self::Settings,
        context: &mut LoadContext<'_>,
    ) -> Result<MeshlessGiAsset, RecipeLoadError> {
        let mut bytes = Vec::new();
        reader.read_to_end(&mut bytes).await?;
        let text = String::from_utf8(bytes).map_err(|_| RecipeLoadError::NotText)?;
        let recipe = Recipe::from_ron(&text)?;
        let scene = recipe.scene.clone().ok_or(RecipeLoadError::NoScene)?;
        let viewpoints: Vec<Vec3> = recipe.viewpoints.iter().map(|&v| v.into()).collect();
        let level = read_level(&scene, &viewpoints, context).await?;
        debug!("baking `{scene}` ({} triangles)", level.len());
        // The threads that load assets and compile shaders must stay free: a bake takes seconds to minutes.
        let failed = |why| RecipeLoadError::Bake {
            path: scene.clone(),
            why,
        };
        let cancel = CancelOnDrop(Arc::new(Progress::default()));
        let work = bake_in_background(level, recipe, cancel.0.clone())
            .map_err(|why| failed(BakeLevelError::Threads(why.to_string())))?;
        let baked = work.await.map_err(failed)?;
        debug!("baked `{scene}` in {:.1} s", baked.stats.seconds.total);
        Ok(baked.scene.into())
    }

    fn extensions(&self) -> &[&str] {
        &["gi.ron"]
    }
}

/// Stops the bake of a load that nobody waits for any more.
struct CancelOnDrop(Arc<Progress>);

impl Drop for CancelOnDrop {
    fn drop(&mut self) {
        self.0.cancel();
    }
}

/// Reads the level and every file that it names through the load context, which notes them as dependencies: a change in any
/// of them bakes again.
async fn read_level(
    scene: &str,
    viewpoints: &[Vec3],
    context: &mut LoadContext<'_>,
) -> Result<TriangleMesh, RecipeLoadError> {
    let path = resolve(context.path(), scene)?;
    let bytes = read(context, &path).await?;
    if scene.to_ascii_lowercase().ends_with(".ply") {
        let loaded = load_ply_bytes(&bytes, scene, viewpoints)?;
        for note in &loaded.notes {
            warn!("`{scene}`: {note}");
        }
        return Ok(loaded.cloud.mesh().0);
    }
    let mut files = BTreeMap::new();
    for name in external_files(&bytes) {
        // A file that cannot be read matters only if the bake needs it: not for a normal map.
        let content = match resolve(&path, &name) {
            Ok(path) => read(context, &path).await,
            Err(why) => Err(why),
        };
        files.insert(name, content.map_err(|why| why.to_string()));
    }
    let mut resolve = |name: &str| match files.get(name) {
        Some(Ok(content)) => Ok(content.clone()),
        other => Err(SceneError::Io {
            path: name.into(),
            reason: other.map_or_else(
                || "the level does not name it".into(),
                |why| format!("{why:?}"),
            ),
        }),
    };
    let loaded = load_gltf_bytes(&bytes, scene, &mut resolve)?;
    for note in &loaded.notes {
        warn!("`{scene}`: {note}");
    }
    Ok(loaded.mesh)
}

/// The asset that a recipe or a level names by `name`, relative to itself.
fn resolve(base: &AssetPath<'_>, name: &str) -> Result<AssetPath<'static>, RecipeLoadError> {
    base.resolve_embed_str(name)
        .map_err(|why| RecipeLoadError::Path {
            path: name.into(),
            why,
        })
}

async fn read(
    context: &mut LoadContext<'_>,
    path: &AssetPath<'static>,
) -> Result<Vec<u8>, RecipeLoadError> {
    context
        .read_asset_bytes(path.clone())
        .await
        .map_err(|why| RecipeLoadError::File {
            path: path.to_string(),
            why: Box::new(why),
        })
}

/// The files that a glTF names beside itself: buffers and images that are neither embedded nor data URIs. Empty for bytes that
/// are no glTF; reading those fails later, with a better message.
fn external_files(bytes: &[u8]) -> Vec<String> {
    let Ok(document) = gltf::Gltf::from_slice_without_validation(bytes) else {
        return Vec::new();
    };
    let json = document.document.into_json();
    let buffers = json.buffers.into_iter().filter_map(|b| b.uri);
    let images = json.images.into_iter().filter_map(|i| i.uri);
    buffers
        .chain(images)
        .filter(|uri| !uri.starts_with("data:"))
        .map(|uri| percent_decoded(&uri))
        .collect()
}

/// A URI's `%20` is a space in the file's name. What decodes to no text stays as it is.
fn percent_decoded(uri: &str) -> String {
    let digit = |b: Option<&u8>| b.and_then(|b| char::from(*b).to_digit(16));
    let bytes = uri.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while at < bytes.len() {
        match (
            bytes[at],
            digit(bytes.get(at + 1)),
            digit(bytes.get(at + 2)),
        ) {
            (b'%', Some(high), Some(low)) => {
                out.push((16 * high + low) as u8);
                at += 3;
            }
            (byte, ..) => {
                out.push(byte);
                at += 1;
            }
        }
    }
    String::from_utf8(out).unwrap_or_else(|_| uri.into())
}

impl Process for MeshlessGiBakeProcessor {
    type Settings = MeshlessGiBakeSettings;
    type OutputLoader = MeshlessGiLoader;

    async fn process(
        &self,
        context: &mut ProcessContext<'_>,
        settings: &Self::Settings,
        writer: &mut Writer,
    ) -> Result<MeshlessGiLoaderSettings, ProcessError> {
        let loaded = context
            .load_source_asset::<MeshlessGiRecipeLoader>(settings)
            .await?;
        let asset: MeshlessGiAsset = loaded.take().ok_or(ProcessError::WrongMetaType)?;
        let failed =
            |why: Box<dyn std::error::Error + Send + Sync>| ProcessError::AssetTransformError(why);
        let bytes = asset
            .scene
            .to_bytes()
            .map_err(|e: AssetError| failed(Box::new(e)))?;
        writer
            .write_all(&bytes)
            .await
            .map_err(|e| failed(Box::new(e)))?;
        // A build step has no scene whose light starts.
        info!(
            "baked `{}`: {:.1} MB",
            context.path(),
            bytes.len() as f64 / 1e6
        );
        Ok(MeshlessGiLoaderSettings::default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_level_names_its_files() {
        let text = br#"{"asset":{"version":"2.0"},"buffers":[{"byteLength":1,"uri":"a%20b.bin"},{"byteLength":0,"uri":"data:,"}],
            "images":[{"uri":"tex/wall.png"},{"bufferView":0,"mimeType":"image/png"}]}"#;
        assert_eq!(external_files(text), ["a b.bin", "tex/wall.png"]);
        assert_eq!(external_files(b"no glTF"), [] as [&str; 0]);
    }

    #[test]
    fn only_whole_escapes_are_decoded() {
        for (uri, name) in [
            ("100%.png", "100%.png"),
            ("%C3%BC", "\u{fc}"),
            ("%FF", "%FF"),
            ("a%2", "a%2"),
            ("", ""),
        ] {
            assert_eq!(percent_decoded(uri), name);
        }
    }
}
