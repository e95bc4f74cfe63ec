//! [`MeshlessGiPlugin`]: indirect light in a Bevy app.
//!
//! # The flow of a frame
//!
//! | file | world, schedule | does |
//! |---|---|---|
//! | `point_cloud` | main, `Update` | inserts the meshes of point clouds |
//! | `entity_bake` | main, `Last` | starts bakes of the meshes below roots with a request |
//! | `validation` | main, `Last` | warns of light that counts twice |
//! | `scene_check` | main, `Last` | warns of bakes whose scene has changed since |
//! | `check_display` | main, `Last` | warns of a bake that no camera displays |
//! | `effects` | both | one file or folder for each effect: components, extraction, passes |
//! | `extract` | render, `ExtractSchedule` | reads scenes, cameras and lights |
//! | `inventory` | both | counts entities and their changes |
//! | `compute` | render, `RenderGraph`, before the cameras | makes the [plan](crate::plan), uploads, projects, applies, flattens |
//! | `forward_views` | render, `Render`, around Bevy's queues | draws deferred materials in views without a G-buffer |
//! | `record` | render, in `compute`, `effects::rsm` and the three below | iterates over the plan's passes, which `effects` records |
//! | `composite` | render, `Core3d` of each camera, after opaque, before transmissive and transparent | adds irradiance to the pictures of deferred cameras |
//! | `forward_display` | render, `Core3d` of each camera, before opaque | provides irradiance to the surfaces of forward cameras |
//! | `post_process` | render, `Core3d` of each camera, after Bevy's volumetric fog | adds indirect light that fog scatters to the eye |
//! | `diagnostics` | main, `PreUpdate` | counters to Bevy's diagnostics |
//! | `gpu_timings` | both | provides measured pass times to the next plans |
//! | `plan_log` | main, `PreUpdate` | logs changes of the plan's decisions (DEBUG) |
//! | `scene_log` | main, `PreUpdate` | logs one line per scene when its light starts (INFO) |

mod asset;
#[cfg(feature = "gltf")]
mod asset_folders;
mod background;
mod bake_error;
mod bake_finished;
#[cfg(feature = "gltf")]
mod bake_processor;
mod bake_progress;
#[cfg(feature = "gltf")]
mod bake_store;
mod bake_summary;
mod bake_task;
#[cfg(feature = "gltf")]
mod build_copy;
mod camera;
mod check_display;
mod composite;
mod compute;
mod count;
mod debug;
mod deferred;
mod diagnostics;
mod effect_states;
pub(crate) mod effects;
mod entity_bake;
mod environment;
mod extract;
mod extract_lights;
mod forward_camera;
mod forward_display;
mod forward_views;
mod frame_record;
mod frame_stats;
mod gi_light;
mod gizmos;
mod gpu_timings;
mod inventory;
mod loader;
mod main_schedule;
mod observe;
mod plan_log;
#[cfg(feature = "point_clouds")]
mod point_cloud;
mod post_process;
#[cfg(feature = "gltf")]
mod process_assets;
mod quality;
#[cfg(feature = "gltf")]
mod recipe_loader;
#[cfg(feature = "gltf")]
mod recipe_progress;
mod record;
mod registration;
mod render_schedule;
mod render_state;
mod scene;
mod scene_check;
#[cfg(feature = "gltf")]
mod scene_files;
mod scene_log;
mod sets;
mod settings;
mod sky;
mod solver;
mod transform;
mod validation;
mod view_state;

pub use crate::plan::{GiBounceCount, GiColorMode, GiQuality};
pub use asset::GiBakedScene;
pub use bake_error::GiBakeError;
pub use bake_finished::GiBakeFinished;
#[cfg(feature = "gltf")]
pub use bake_processor::GiBakeProcessor;
pub use bake_progress::GiBakeProgress;
pub use bake_summary::GiBakeSummary;
pub use bake_task::GiBakeTask;
pub use camera::{GiCamera, GiDebugView};
pub use debug::MeshlessGiDebugPlugin;
pub use diagnostics::dispatch_path;
pub use effects::display::splatting::GiSplatting;
pub use effects::fog::volumetric_fog::GiVolumetricFog;
pub use effects::inspection::coefficients::SharedCoefficients;
pub use effects::materials::dynamic_materials::GiDynamicMaterials;
pub use effects::occluders::occluder::GiOccluder;
pub use effects::rsm::map_cameras::GiRsmCamera;
pub use effects::rsm::map_schedule::RsmSchedule;
pub use effects::rsm::reflective_shadow_map::GiReflectiveShadowMap;
pub use effects::rsm::reflector::GiReflector;
pub use effects::soft_shadows::soft_lights::GiSoftShadow;
pub use effects::volume::irradiance_volume::GiIrradianceVolume;
pub use effects::vpl_specular::specular::GiSpecular;
pub use entity_bake::{GiBakeCommands, GiBakeExclude, GiBakeRequest, GiBakeWarning};
pub use environment::GiEnvironment;
pub use forward_camera::GiForwardCamera;
pub use frame_record::FrameRecord;
pub use frame_stats::{FramePass, FrameStats, GiFrameStats};
pub use gi_light::GiLight;
pub use gizmos::GiGizmos;
pub use loader::{GiBakedSceneLoader, GiBakedSceneLoaderSettings, GiLoadError};
#[cfg(feature = "point_clouds")]
pub use point_cloud::{
    GiPointCloud, GiPointCloudAsset, GiPointCloudLoadError, GiPointCloudLoader,
    GiPointCloudLoaderSettings, PointCloudPart,
};
#[cfg(feature = "gltf")]
pub use process_assets::{
    GiProcessAssetsError, GiProcessAssetsFailure, GiProcessAssetsOptions, GiProcessAssetsReport,
    process_assets,
};
pub use quality::{GiActiveTier, SolveCostFn, SolveCostSource};
#[cfg(feature = "gltf")]
pub use recipe_loader::{GiBakeProcessorSettings, GiRecipeLoadError, GiRecipeLoader};
#[cfg(feature = "gltf")]
pub use recipe_progress::GiRecipeProgress;
pub use scene::GiScene;
pub use scene_check::{GiSceneCheck, GiStaleBakes};
pub use sets::{GiRenderSystems, GiSystems};
pub use settings::GiSettings;
pub use sky::{GiSky, GiSkyError};
pub use solver::GiSolver;
pub use transform::SimilarityTransform;
pub use validation::{GiWarning, GiWarnings};

use bevy::app::{App, Plugin};
use bevy::pbr::DefaultOpaqueRendererMethod;

/// Indirect light in an app. Add it after `DefaultPlugins`.
#[derive(Clone, Debug)]
pub struct MeshlessGiPlugin {
    /// Makes deferred the default render method of opaque materials, which the composite needs.
    /// Default: `true`.
    ///
    /// Views without a deferred prepass draw such materials forward, as without the plugin, so
    /// forward cameras need no setting. Set `false` to choose per material, or to keep a
    /// [`DefaultOpaqueRendererMethod`] that was inserted before the plugin. One that is inserted
    /// after the plugin is kept in any case.
    pub deferred_by_default: bool,
}

impl Default for MeshlessGiPlugin {
    fn default() -> Self {
        Self {
            deferred_by_default: true,
        }
    }
}

impl Plugin for MeshlessGiPlugin {
    fn build(&self, app: &mut App) {
        registration::register_types(app);
        registration::add_resources(app);
        main_schedule::add_systems(app);
        effects::add_to_app(app);
        if self.deferred_by_default {
            app.insert_resource(DefaultOpaqueRendererMethod::deferred());
        }
    }

    fn finish(&self, app: &mut App) {
        render_schedule::build(app);
    }
}
