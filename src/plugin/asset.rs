//! The baked scene as a Bevy asset, and the part of the plugin that loads and processes it.
//!
//! Hot reload: if Bevy watches files and a `.mgi` file is baked again, the new bake replaces the
//! old one in every scene with the handle. This happens in the frame in which it has loaded.

use super::scene_check::{GiStaleBakes, SceneChecker, SceneReports, warn_stale};
use super::{GiBakedSceneLoader, GiSystems};
use bevy::app::{App, Last, Plugin};
use bevy::asset::{Asset, AssetApp};
use bevy::ecs::prelude::*;
use bevy::reflect::prelude::*;
use meshless_gi::BakedScene;
use std::sync::Arc;

/// A baked scene. Shared, never changed: replacing the asset (not editing it) is how a bake
/// changes.
#[derive(Asset, Reflect, Clone, Debug)]
#[reflect(opaque)]
#[reflect(Clone, Debug)]
pub struct GiBakedScene {
    /// Everything that a frame reads.
    pub scene: Arc<BakedScene>,
}

impl From<BakedScene> for GiBakedScene {
    fn from(scene: BakedScene) -> Self {
        Self {
            scene: Arc::new(scene),
        }
    }
}

/// Registers loaders and the asset processor, and reports what they find.
pub(crate) struct BakedAssetPlugin;

impl Plugin for BakedAssetPlugin {
    fn build(&self, app: &mut App) {
        let reports = SceneReports::default();
        let checker = SceneChecker {
            reports: reports.clone(),
            #[cfg(feature = "gltf")]
            folders: super::asset_folders::AssetFolders::from_app(app),
        };
        app.init_asset::<GiBakedScene>()
            .register_asset_reflect::<GiBakedScene>()
            .insert_resource(reports)
            .init_resource::<GiStaleBakes>()
            .add_systems(Last, warn_stale.in_set(GiSystems::Validate));
        #[cfg(feature = "gltf")]
        build_recipes(app, &checker);
        app.register_asset_loader(GiBakedSceneLoader { checker });
    }
}

/// Registers all that bakes recipes.
#[cfg(feature = "gltf")]
fn build_recipes(app: &mut App, checker: &SceneChecker) {
    use super::recipe_loader::{RECIPE_EXTENSION, RecipeInputLoader, RecipeInputs};
    use super::recipe_progress::{RecipeBakes, send_progress};
    use super::{GiBakeProcessor, GiRecipeLoader, GiRecipeProgress};

    let bakes = RecipeBakes::default();
    let folders = checker.folders.clone();
    app.init_asset::<RecipeInputs>()
        .insert_resource(bakes.clone())
        .add_message::<GiRecipeProgress>()
        .add_systems(
            bevy::app::PreUpdate,
            send_progress.in_set(GiSystems::CollectBakes),
        )
        .register_asset_loader(RecipeInputLoader {
            folders: folders.clone(),
        })
        .register_asset_loader(GiRecipeLoader {
            bakes: bakes.clone(),
            folders: folders.clone(),
            checker: checker.clone(),
        })
        .register_asset_processor(GiBakeProcessor { bakes, folders })
        .set_default_asset_processor::<GiBakeProcessor>(RECIPE_EXTENSION);
}
