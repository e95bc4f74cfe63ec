//! Instant, noise-free indirect light for Bevy.
//!
//! Add [`MeshlessGiPlugin`], [`GiScene`] to the root of a scene and [`GiCamera`] to a camera:
//!
//! ```no_run
//! # #[cfg(feature = "gltf")] {
//! use bevy::prelude::*;
//! use bevy_meshless_gi::prelude::*;
//!
//! fn main() {
//!     App::new()
//!         .add_plugins((DefaultPlugins, MeshlessGiPlugin::default()))
//!         .insert_resource(GlobalAmbientLight::NONE)
//!         .add_systems(Startup, setup)
//!         .run();
//! }
//!
//! fn setup(mut commands: Commands, assets: Res<AssetServer>) {
//!     // The scene and its baked light, on one root. The recipe lies next to the scene.
//!     commands.spawn((
//!         WorldAssetRoot(assets.load("level.glb#Scene0")),
//!         GiScene(assets.load("level.gi.ron")),
//!     ));
//!     let light = PointLight { shadow_maps_enabled: true, ..default() };
//!     commands.spawn((light, Transform::from_xyz(0.0, 2.0, 0.0)));
//!     commands.spawn((Camera3d::default(), GiCamera::default(), Transform::from_xyz(0.0, 1.5,
//! 4.0))); }
//! # }
//! ```
//!
//! # Requirements and limits
//!
//! - Compute shaders and storage buffers within WebGPU's default limits. Without them, or without a
//!   renderer, the plugin warns once and stays inactive.
//! - Deferred, high-dynamic-range cameras with one sample per pixel. [`GiCamera`] adds the required
//!   prepasses. Forward cameras and transparent surfaces use [`GiIrradianceVolume`].
//! - Indirect light is added after Bevy's distance fog and without screen-space ambient occlusion.
//! - If two baked scenes overlap, one of them lights a surface that both cover.
//!
//! # Modules
//!
//! [`meshless_gi`] bakes a scene and defines the computations of a frame. This crate records the
//! frame on a GPU. Its kernels run on any wgpu device (feature `gpu`), without Bevy. Data and
//! imports flow down this list:
//!
//! | module | content |
//! |---|---|
//! | `plan` | effects that a frame's scene needs |
//! | `gpu` | kernels on any wgpu device (feature `gpu`) |
//! | `plugin` | [`MeshlessGiPlugin`] (feature `bevy`) |
//! | [`prelude`] | names that most games use (feature `bevy`) |
#![warn(missing_docs)]
#![cfg_attr(not(test), warn(clippy::too_many_lines))]

#[cfg(feature = "gpu")]
pub mod gpu;
mod plan;
#[cfg(feature = "bevy")]
mod plugin;
#[cfg(feature = "bevy")]
pub mod prelude;

pub use meshless_gi;

// Scenes.
pub use plan::{GiBounceCount, GiColorMode, GiQuality};
#[cfg(feature = "bevy")]
pub use plugin::{
    GiActiveTier, GiBakedScene, GiDynamicMaterials, GiEnvironment, GiIrradianceVolume, GiOccluder,
    GiReflector, GiScene, GiSky, GiSkyError, GiSolver, GiVolumetricFog,
};

// Cameras and lights.
pub use meshless_gi::{DepthTest, NormalTest, SpecularSettings, SubsplatSettings};
#[cfg(feature = "bevy")]
pub use plugin::{
    GiCamera, GiDebugView, GiForwardCamera, GiLight, GiReflectiveShadowMap, GiRsmCamera,
    GiSoftShadow, GiSpecular, GiSplatting,
};

// Bakes.
pub use meshless_gi::{BakeStage, OccluderDesc, Preset, ProbeSettings, Recipe};
#[cfg(feature = "bevy")]
pub use plugin::{
    GiBakeCommands, GiBakeError, GiBakeExclude, GiBakeFinished, GiBakeProgress, GiBakeRequest,
    GiBakeSummary, GiBakeTask, GiBakeWarning, GiSceneCheck, GiStaleBakes,
};

// The plugin, its settings and its output.
#[cfg(feature = "bevy")]
pub use plugin::{
    FramePass, FrameStats, GiFrameStats, GiGizmos, GiRenderSystems, GiSettings, GiSystems,
    GiWarning, GiWarnings, MeshlessGiDebugPlugin, MeshlessGiPlugin,
};

/// Settings, errors and progress of loaders and of the asset processor.
#[cfg(feature = "bevy")]
pub mod loader {
    #[cfg(feature = "gltf")]
    pub use crate::plugin::{
        GiBakeProcessor, GiBakeProcessorSettings, GiProcessAssetsError, GiProcessAssetsFailure,
        GiProcessAssetsOptions, GiProcessAssetsReport, GiRecipeLoadError, GiRecipeProgress,
        process_assets,
    };
    pub use crate::plugin::{GiBakedSceneLoaderSettings, GiLoadError};
}

/// Point clouds as Bevy assets (feature `point_clouds`).
#[cfg(all(feature = "bevy", feature = "point_clouds"))]
pub mod point_cloud {
    pub use crate::plugin::{
        GiPointCloud, GiPointCloudAsset, GiPointCloudLoadError, GiPointCloudLoaderSettings,
    };
}

/// Items for the tests and programs of this repository. Exempt from semantic versioning.
#[doc(hidden)]
pub mod internals {
    #[cfg(feature = "gpu")]
    pub mod gpu {
        pub use crate::gpu::*;
    }
    pub mod plan {
        pub use crate::plan::*;
    }
    #[cfg(feature = "bevy")]
    pub mod plugin {
        pub use crate::plugin::*;
    }
}

// The documents' examples are compiled as documentation tests.
#[cfg(all(doctest, feature = "bevy"))]
#[doc = include_str!("../README.md")]
struct Readme;
// Chapters of the book with Rust examples.
#[cfg(all(doctest, feature = "bevy", feature = "gltf"))]
mod book {
    #[doc = include_str!("../docs/book/src/cameras/dynamic_objects.md")]
    struct DynamicObjects;
    #[doc = include_str!("../docs/book/src/cameras/exported_volume.md")]
    struct ExportedVolume;
    #[doc = include_str!("../docs/book/src/cameras/forward.md")]
    struct Forward;
    #[doc = include_str!("../docs/book/src/getting_started/bevy_meshes.md")]
    struct BevyMeshes;
    #[doc = include_str!("../docs/book/src/getting_started/first_scene.md")]
    struct FirstScene;
    #[doc = include_str!("../docs/book/src/getting_started/library.md")]
    struct Library;
    #[doc = include_str!("../docs/book/src/getting_started/recipes.md")]
    struct Recipes;
    #[doc = include_str!("../docs/book/src/lighting/fog.md")]
    struct Fog;
    #[doc = include_str!("../docs/book/src/lighting/materials.md")]
    struct Materials;
    #[doc = include_str!("../docs/book/src/lighting/occluders.md")]
    struct Occluders;
    #[cfg(feature = "point_clouds")]
    #[doc = include_str!("../docs/book/src/lighting/point_clouds.md")]
    struct PointClouds;
    #[doc = include_str!("../docs/book/src/lighting/sky.md")]
    struct Sky;
    #[doc = include_str!("../docs/book/src/lighting/soft_shadows.md")]
    struct SoftShadows;
}
