//! Types, resources and assets of the main world. Effects add their own.

use super::*;
use bevy::app::App;

/// Registers the types of the plugin without those of effects for reflection.
pub(super) fn register_types(app: &mut App) {
    app.register_type::<GiScene>()
        .register_type::<GiBakeExclude>()
        .register_type::<GiBakeRequest>()
        .register_type::<GiStaleBakes>()
        .register_type::<GiBakeProgress>()
        .register_type::<GiBakeFinished>()
        .register_type::<GiBakeTask>()
        .register_type::<GiFrameStats>()
        .register_type::<GiCamera>()
        .register_type::<SolveCostSource>()
        .register_type::<GiSplatting>()
        .register_type::<GiWarnings>()
        .register_type::<GiGizmos>()
        .register_type::<GiForwardCamera>()
        .register_type::<GiLight>()
        .register_type::<GiEnvironment>()
        .register_type::<GiSolver>()
        .register_type::<GiBakedSceneLoaderSettings>()
        .register_type::<GiColorMode>()
        .register_type::<GiQuality>()
        .register_type::<GiSettings>()
        .register_type::<GiSky>()
        .register_type::<GiActiveTier>()
        .register_type::<GiDebugView>();
    #[cfg(feature = "gltf")]
    app.register_type::<GiBakeProcessorSettings>()
        .register_type::<GiProcessAssetsOptions>()
        .register_type::<GiRecipeProgress>();
}

/// Adds the plugin's resources, assets and loaders.
pub(super) fn add_resources(app: &mut App) {
    app.init_resource::<GiFrameStats>()
        .init_resource::<GiSettings>()
        .init_resource::<GiWarnings>()
        .init_resource::<SolveCostSource>()
        .init_resource::<deferred::ReadyDisplays>()
        .init_resource::<SharedCoefficients>()
        .init_resource::<inventory::NormalMaps>()
        .init_resource::<gpu_timings::DeviceCosts>()
        .add_plugins(asset::BakedAssetPlugin);
    #[cfg(feature = "point_clouds")]
    point_cloud::build(app);
}
