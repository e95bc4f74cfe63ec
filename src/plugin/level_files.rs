//! A level's file and the files that it names, read in an asset loader, in the build step or from
//! the folder of the sources.

use super::level::RecipeLoadError;
use crate::asset::fingerprint;
use crate::scene::{SceneError, TriangleMesh, load_gltf_bytes, load_ply_bytes};
use bevy::asset::AssetPath;
use bevy::log::warn;
use bevy::math::Vec3;
use bevy::tasks::ConditionalSendFuture;
use std::collections::BTreeMap;

/// Source of the files that a recipe and a level name.
pub(crate) trait ReadFile: Send {
    /// Returns the bytes of a file.
    fn read(
        &mut self,
        path: &AssetPath<'static>,
    ) -> impl ConditionalSendFuture<Output = Result<Vec<u8>, RecipeLoadError>>;
}

/// Bytes of a level: its file, and every file that it names.
#[derive(Debug)]
pub(crate) struct LevelFiles {
    /// Name in the recipe.
    name: String,
    bytes: Vec<u8>,
    /// Files beside a glTF by name. An error is kept as text: not every file is needed by a bake.
    files: BTreeMap<String, Result<Vec<u8>, String>>,
}

impl LevelFiles {
    /// Reads the level that `base` names by `name`, and every file that the level names.
    pub async fn read(
        base: &AssetPath<'static>,
        name: &str,
        reader: &mut impl ReadFile,
    ) -> Result<Self, RecipeLoadError> {
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

    /// Digest of all bytes, as [`BakeInfo::level_digest`](crate::asset::BakeInfo) holds it.
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

    /// Reads the level as triangles. Points without normals face `viewpoints`, in meters.
    pub fn mesh(&self, viewpoints: &[[f32; 3]]) -> Result<TriangleMesh, RecipeLoadError> {
        let note = |notes: &[String]| notes.iter().for_each(|n| warn!("`{}`: {n}", self.name));
        if is_ply(&self.name) {
            let viewpoints: Vec<Vec3> = viewpoints.iter().map(|&v| v.into()).collect();
            let loaded = load_ply_bytes(&self.bytes, &self.name, &viewpoints)?;
            note(&loaded.notes);
            return Ok(loaded.cloud.mesh().0);
        }
        let mut resolve = |name: &str| match self.files.get(name) {
            Some(Ok(content)) => Ok(content.clone()),
            other => Err(SceneError::Io {
                path: name.into(),
                reason: other.map_or_else(
                    || "the level does not name it".into(),
                    |error| format!("{error:?}"),
                ),
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

/// Asset that a recipe or a level names by `name`, relative to itself.
fn resolve(base: &AssetPath<'_>, name: &str) -> Result<AssetPath<'static>, RecipeLoadError> {
    base.resolve_embed_str(name)
        .map_err(|why| RecipeLoadError::Path {
            path: name.into(),
            why,
        })
}

/// Files that a glTF names beside itself: buffers and images that are neither embedded nor data
/// URIs. Empty for bytes that are no glTF; reading those fails later, with a better message.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn external_files_of_a_level_are_named() {
        let text = br#"{"asset":{"version":"2.0"},"buffers":[{"byteLength":1,"uri":"a%20b.bin"},{"byteLength":0,"uri":"data:,"}],
            "images":[{"uri":"tex/wall.png"},{"bufferView":0,"mimeType":"image/png"}]}"#;
        assert_eq!(external_files(text), ["a b.bin", "tex/wall.png"]);
        assert_eq!(external_files(b"no glTF"), [] as [&str; 0]);
    }

    #[test]
    fn percent_decoded_partial_escape_stays() {
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
