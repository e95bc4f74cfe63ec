//! The baked scene as a Bevy asset.
//!
//! Hot reload: when a `.mgi` file is baked again and Bevy watches files, the new bake replaces the old one in every scene
//! that uses the handle, in the frame in which it has loaded.

use crate::asset::BakedScene;
use bevy::asset::Asset;
use bevy::reflect::TypePath;
use std::sync::Arc;

/// A baked scene. Shared, never changed: replacing the asset (not editing it) is how a bake changes.
#[derive(Asset, TypePath, Clone, Debug)]
pub struct MeshlessGiAsset {
    /// Everything that a frame reads.
    pub scene: Arc<BakedScene>,
}

impl From<BakedScene> for MeshlessGiAsset {
    fn from(scene: BakedScene) -> Self {
        Self {
            scene: Arc::new(scene),
        }
    }
}
