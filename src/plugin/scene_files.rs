//! File of a scene and the files that it names. An asset loader, the build step, or a reader of the
//! source folder loads them.

use super::recipe_loader::GiRecipeLoadError;
use bevy::asset::AssetPath;
use bevy::log::warn;
#[cfg(feature = "point_clouds")]
use bevy::math::Vec3;
use bevy::tasks::ConditionalSendFuture;
use meshless_gi::internals::asset::fingerprint;
use meshless_gi::internals::scene::{external_files, load_gltf_bytes};
use meshless_gi::{SceneError, TriangleMesh};
use std::collections::BTreeMap;
use std::io;

/// Source of the files that a recipe and a scene name.
pub(crate) trait ReadFile: Send {
    /// Returns the bytes of a file.
    fn read(
        &mut self,
        path: &AssetPath<'static>,
    ) -> impl ConditionalSendFuture<Output = Result<Vec<u8>, GiRecipeLoadError>>;
}

/// Bytes of a scene: its file, and every file that it names.
#[derive(Debug)]
pub(crate) struct SceneFiles {
    /// Name in the recipe.
    name: String,
    bytes: Vec<u8>,
    /// Files of a glTF by name. An error is stored as text, because a bake does not need every
    /// file.
    files: BTreeMap<String, Result<Vec<u8>, String>>,
}

impl SceneFiles {
    /// Reads the scene that `base` names by `name`, and every file that the scene names.
    pub async fn read(
        base: &AssetPath<'static>,
        name: &str,
        reader: &mut impl ReadFile,
    ) -> Result<Self, GiRecipeLoadError> {
        let path = resolve(base, name)?;
        let bytes = reader.read(&path).await?;
        let mut files = BTreeMap::new();
        let named = match is_ply(name) {
            true => Vec::new(),
            false => external_files(&bytes),
        };
        for name in named {
            let content = match resolve(&path, &name) {
                Ok(path) => reader.read(&path).await,
                Err(error) => Err(error),
            };
            files.insert(name, content.map_err(|error| error.to_string()));
        }
        Ok(Self {
            name: name.into(),
            bytes,
            files,
        })
    }

    /// Digest of all bytes, as [`BakeInfo::scene_digest`](meshless_gi::BakeInfo) holds it.
    pub fn digest(&self) -> String {
        let mut parts: Vec<&[u8]> = vec![&self.bytes];
        for (name, content) in &self.files {
            parts.push(name.as_bytes());
            match content {
                Ok(content) => parts.extend([&b"file"[..], content]),
                Err(_) => parts.push(b"none"),
            }
        }
        fingerprint(&parts)
    }

    /// Reads the scene as triangles. Points without normals face `viewpoints`, in meters.
    pub fn mesh(&self, viewpoints: &[[f32; 3]]) -> Result<TriangleMesh, GiRecipeLoadError> {
        let note = |notes: &[String]| notes.iter().for_each(|n| warn!("`{}`: {n}", self.name));
        #[cfg(not(feature = "point_clouds"))]
        if is_ply(&self.name) {
            let _ = viewpoints;
            return Err(GiRecipeLoadError::Level(SceneError::Format {
                file: self.name.clone(),
                reason: "a point cloud; build with the feature `point_clouds`".into(),
            }));
        }
        #[cfg(feature = "point_clouds")]
        if is_ply(&self.name) {
            let viewpoints: Vec<Vec3> = viewpoints.iter().map(|&v| v.into()).collect();
            let loaded = meshless_gi::internals::scene::load_ply_bytes(
                &self.bytes,
                &self.name,
                &viewpoints,
            )?;
            note(&loaded.notes);
            return Ok(loaded.cloud.mesh().0);
        }
        let mut resolve = |name: &str| match self.files.get(name) {
            Some(Ok(content)) => Ok(content.clone()),
            other => Err(SceneError::Io {
                path: name.into(),
                source: io::Error::other(other.map_or_else(
                    || "the scene does not name it".into(),
                    |error| format!("{error:?}"),
                )),
            }),
        };
        let loaded = load_gltf_bytes(&self.bytes, &self.name, &mut resolve)?;
        note(&loaded.notes);
        Ok(loaded.mesh)
    }
}

fn is_ply(name: &str) -> bool {
    name.to_ascii_lowercase().ends_with(".ply")
}

/// Asset that a recipe or a scene names by `name`, relative to itself.
fn resolve(base: &AssetPath<'_>, name: &str) -> Result<AssetPath<'static>, GiRecipeLoadError> {
    base.resolve_embed_str(name)
        .map_err(|source| GiRecipeLoadError::Path {
            path: name.into(),
            source,
        })
}
