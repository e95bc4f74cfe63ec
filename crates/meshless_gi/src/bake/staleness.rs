//! Comparison of a bake with the current inputs of a new bake.

use super::Recipe;
use crate::asset::{BakeInfo, fingerprint};
#[cfg(feature = "bevy_reflect")]
use bevy_reflect::std_traits::ReflectDefault;
use std::fmt;

/// Version of the bake. It increases only if equal input bakes to different data. It is independent
/// of the crate's version.
pub const BAKE_VERSION: u32 = 7;

/// Current inputs of a new bake.
#[derive(Clone, Copy, Debug, Default)]
pub struct BakeInputs<'a> {
    /// Hash of the geometry and its materials, computed by
    /// [`TriangleMesh::content_hash`](crate::scene::TriangleMesh::content_hash). `None` if the
    /// content is not to be compared.
    pub content_hash: Option<&'a [u8; 32]>,
    /// Recipe. `None` if settings are not to be compared.
    pub recipe: Option<&'a Recipe>,
}

/// Inputs of a bake that have changed since it was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(
    feature = "bevy_reflect",
    derive(bevy_reflect::Reflect),
    reflect(Default, Clone, Debug, PartialEq, Hash)
)]
pub struct Staleness {
    /// `true` if the geometry or its materials differ.
    pub content: bool,
    /// `true` if the recipe differs in more than its `scene`.
    pub settings: bool,
    /// `true` if another [`BAKE_VERSION`] made the bake.
    pub version: bool,
}

impl Staleness {
    /// Compares a bake with current inputs. Inputs that are `None` count as equal, and so do values
    /// that an older file does not have. Such a file differs in its version.
    #[must_use]
    pub fn compare(info: &BakeInfo, now: &BakeInputs<'_>) -> Self {
        let differs = |held: &str, now: Option<String>| {
            !held.is_empty() && now.is_some_and(|now| now != held)
        };
        Self {
            content: differs(&info.content_hash, now.content_hash.map(hex)),
            settings: differs(&info.given_recipe, now.recipe.map(canonical_recipe)),
            version: info.bake_version != BAKE_VERSION,
        }
    }

    /// Returns `true` if anything differs.
    #[must_use]
    pub fn is_stale(self) -> bool {
        self.content || self.settings || self.version
    }
}

impl fmt::Display for Staleness {
    /// Writes the names of the differing inputs, separated by commas.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = [
            (self.content, "content"),
            (self.settings, "settings"),
            (self.version, "bake version"),
        ];
        let names: Vec<&str> = names.iter().filter(|n| n.0).map(|n| n.1).collect();
        f.write_str(&names.join(", "))
    }
}

/// Returns `true` if content or bake version differ. `content_hash` is that of the current scene:
/// [`TriangleMesh::content_hash`](crate::scene::TriangleMesh::content_hash).
#[must_use]
pub fn is_stale(info: &BakeInfo, content_hash: &[u8; 32]) -> bool {
    let now = BakeInputs {
        content_hash: Some(content_hash),
        recipe: None,
    };
    Staleness::compare(info, &now).is_stale()
}

/// Returns the recipe without its `scene`, as RON. Equal recipes give equal text for any spelling.
#[must_use]
pub fn canonical_recipe(recipe: &Recipe) -> String {
    let plain = Recipe {
        scene: None,
        ..recipe.clone()
    };
    ron::to_string(&plain).unwrap_or_default()
}

/// Returns the fingerprint of a bake of geometry with this hash, by these settings (as in
/// [`BakeInfo::recipe`]), from the viewpoints of the recipe.
pub(super) fn fingerprint_of(
    content_hash: &[u8; 32],
    settings: &str,
    viewpoints: &[[f32; 3]],
) -> String {
    fingerprint(&[
        content_hash,
        settings.as_bytes(),
        bytemuck::cast_slice(viewpoints),
        &BAKE_VERSION.to_le_bytes(),
    ])
}

/// Returns the hash as lower-case hexadecimal digits.
pub(super) fn hex(hash: &[u8; 32]) -> String {
    blake3::Hash::from_bytes(*hash).to_hex().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::Preset;

    #[test]
    fn compare_changed_input_names_it_alone() {
        let recipe = Recipe {
            scene: Some("a.glb".into()),
            ..Recipe::default()
        };
        let info = BakeInfo {
            content_hash: hex(&[7; 32]),
            given_recipe: canonical_recipe(&recipe),
            bake_version: BAKE_VERSION,
            ..BakeInfo::default()
        };
        let compare = |hash: &[u8; 32], recipe: &Recipe, info: &BakeInfo| {
            let now = BakeInputs {
                content_hash: Some(hash),
                recipe: Some(recipe),
            };
            Staleness::compare(info, &now)
        };
        assert_eq!(compare(&[7; 32], &recipe, &info), Staleness::default());
        let moved = Recipe {
            scene: Some("elsewhere/b.glb".into()),
            ..recipe.clone()
        };
        assert!(!compare(&[7; 32], &moved, &info).is_stale());
        assert_eq!(compare(&[8; 32], &recipe, &info).to_string(), "content");
        let finer = Recipe {
            preset: Preset::High,
            ..recipe.clone()
        };
        assert_eq!(compare(&[7; 32], &finer, &info).to_string(), "settings");
        let older = BakeInfo {
            bake_version: BAKE_VERSION - 1,
            ..info.clone()
        };
        assert_eq!(
            compare(&[7; 32], &recipe, &older).to_string(),
            "bake version"
        );
        assert_eq!(
            compare(&[8; 32], &finer, &older).to_string(),
            "content, settings, bake version"
        );
        assert!(is_stale(&info, &[8; 32]) && !is_stale(&info, &[7; 32]));
    }

    #[test]
    fn compare_older_file_differs_in_version_only() {
        let now = BakeInputs {
            content_hash: Some(&[7; 32]),
            recipe: Some(&Recipe::default()),
        };
        let found = Staleness::compare(&BakeInfo::default(), &now);
        assert_eq!(found.to_string(), "bake version");
        assert!(!Staleness::default().is_stale());
    }
}
