//! [`MeshlessGiPlugin`]: indirect light in a Bevy app.
//!
//! # The flow of a frame
//!
//! | file | world, schedule | does |
//! |---|---|---|
//! | `points` | main, `Update` | gives point clouds what they are drawn as |
//! | `entity_bake` | main, `Last` | starts bakes of the meshes below roots that ask for one |
//! | `check` | main, `Last` | warns of what would be counted twice |
//! | `level_check` | main, `Last` | warns of bakes whose level has changed since |
//! | `check_display` | main, `Last` | warns of a bake that no camera displays |
//! | `reflective` | main, `PostUpdate` | aims the cameras that draw what moves from the lights that ask for it |
//! | `extract` | render, `ExtractSchedule` | reads scenes, cameras and lights |
//! | `inventory` | both | counts what there is and what changed of it |
//! | `compute` | render, `RenderGraph`, before the cameras | makes the [plan](crate::plan), uploads, projects, applies, flattens |
//! | `volume` | both | light in free space as one of Bevy's irradiance volumes, for cameras without a G-buffer |
//! | `volume_shader` | main, `PostUpdate` | has Bevy read such a volume with its walls in mind |
//! | `soft` | both | lamps with soft shadows, and what is taken from the picture for them |
//! | `capture` | render, before the other cameras | draws what moves, as those lights see it |
//! | `forward_views` | render, `Render`, around Bevy's queues | draws deferred materials in views without a G-buffer |
//! | `evaluate` | render, in the two below | splats |
//! | `composite` | render, `Core3d` of each camera, after opaque, before transmissive and transparent | adds that to the pictures of deferred cameras |
//! | `forward_display` | render, `Core3d` of each camera, before opaque | hands it to the surfaces of forward cameras |
//! | `fog` | render, `Core3d` of each camera, behind Bevy's volumetric fog | adds what fog sends to the eye of a level's light |
//! | `diagnostics` | main, `PreUpdate` | counters to Bevy's diagnostics |
//! | `costs` | both | what the device's clock says of the passes, to the next plans |
//! | `decisions` | main, `PreUpdate` | logs changes of the plan's decisions (DEBUG) |
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
mod debug;
mod deferred;
mod diagnostics;
mod entity_bake;
mod environment;
mod evaluate;
mod extract;
mod extract_lights;
mod fog;
mod fog_order;
mod forward_camera;
mod forward_display;
mod forward_views;
mod gizmos;
mod gpu_timings;
mod inventory;
mod level_check;
#[cfg(feature = "gltf")]
mod level_files;
mod light;
mod loader;
mod materials;
mod occluders;
mod plan_log;
mod point_cloud;
#[cfg(feature = "gltf")]
mod process_assets;
mod quality;
mod readback;
#[cfg(feature = "gltf")]
mod recipe_loader;
#[cfg(feature = "gltf")]
mod recipe_progress;
mod rsm;
mod rsm_render;
mod scene;
mod scene_log;
mod sets;
mod settings;
mod sky;
mod soft_shadow;
mod solver;
mod splatting;
mod stages;
mod transform;
mod validation;
mod volume;
mod volume_shader;
mod volumetric_fog;
mod vpl_specular;

pub use crate::plan::{GiBounceCount, GiColorMode, GiQuality};
pub use asset::GiBakedScene;
pub use bake_error::GiBakeError;
pub use bake_finished::GiBakeFinished;
#[cfg(feature = "gltf")]
pub use bake_processor::GiBakeProcessor;
pub use bake_progress::{GiBakeProgress, GiBakeStage};
pub use bake_summary::GiBakeSummary;
pub use bake_task::GiBakeTask;
pub use camera::{GiCamera, GiDebugView};
pub use debug::MeshlessGiDebugPlugin;
pub use diagnostics::{FrameStats, GiFrameStats, dispatch_path};
pub use entity_bake::{GiBakeCommands, GiBakeExclude, GiBakeRequest, GiBakeWarning};
pub use environment::GiEnvironment;
pub use forward_camera::GiForwardCamera;
pub use gizmos::GiGizmos;
pub use level_check::{GiSceneCheck, GiStaleBakes};
pub use light::GiLight;
pub use loader::{GiBakedSceneLoader, GiBakedSceneLoaderSettings, GiLoadError};
pub use materials::GiDynamicMaterials;
pub use occluders::GiOccluder;
pub use point_cloud::{
    GiPointCloud, GiPointCloudAsset, GiPointCloudLoadError, GiPointCloudLoader,
    GiPointCloudLoaderSettings, GiPointCloudPart,
};
#[cfg(feature = "gltf")]
pub use process_assets::{
    ProcessAssetsError, ProcessAssetsFailure, ProcessAssetsOptions, ProcessAssetsReport,
    process_assets,
};
pub use quality::{GiActiveTier, SolveCostFn, SolveCostSource};
pub use readback::SharedCoefficients;
#[cfg(feature = "gltf")]
pub use recipe_loader::{GiBakeSettings, GiRecipeLoader, RecipeLoadError};
#[cfg(feature = "gltf")]
pub use recipe_progress::GiRecipeProgress;
pub use rsm::{
    GiReflectiveShadowMap, GiReflector, GiRsmCamera, RSM_CAMERA_ORDER, RSM_RENDER_LAYER,
};
pub use rsm_render::RsmSchedule;
pub use scene::GiScene;
pub use sets::{GiRenderSystems, GiSystems};
pub use settings::GiSettings;
pub use sky::{GiSky, GiSkyError};
pub use soft_shadow::GiSoftShadow;
pub use solver::GiSolver;
pub use splatting::{GiDepthTest, GiNormalTest, GiSplatting, GiSubsplatSettings};
pub use transform::SimilarityTransform;
pub use validation::{GiWarning, GiWarnings};
pub use volume::GiIrradianceVolume;
pub use volumetric_fog::GiVolumetricFog;
pub use vpl_specular::GiSpecular;

use bevy::app::{App, Last, Plugin, PostUpdate, PreUpdate, Update};
use bevy::asset::{AssetApp, AssetEventSystems, Assets};
use bevy::camera::CameraUpdateSystems;
use bevy::camera::visibility::VisibilitySystems;
use bevy::core_pipeline::core_3d::{main_opaque_pass_3d, main_transparent_pass_3d};
use bevy::core_pipeline::schedule::{Core3d, Core3dSystems, camera_driver};
use bevy::ecs::prelude::*;
use bevy::image::Image;
use bevy::log::warn;
use bevy::mesh::Mesh;
use bevy::pbr::deferred::prepare_deferred_lighting_pipelines;
use bevy::pbr::{DefaultOpaqueRendererMethod, StandardMaterial, main_transmissive_pass_3d};
use bevy::render::renderer::{RenderDevice, RenderGraph, RenderGraphSystems};
use bevy::render::{ExtractSchedule, GpuResourceAppExt, Render, RenderApp, RenderSystems};
use bevy::transform::TransformSystems;

/// Adds indirect light to an app. Add it after `DefaultPlugins`; nothing else is needed.
#[derive(Clone, Debug)]
pub struct MeshlessGiPlugin {
    /// Makes deferred the default for opaque materials, as the composite needs it. Views without a
    /// deferred prepass draw such materials forward, as they do without the plugin, so forward
    /// cameras need nothing set here. Turn it off to choose material by material, or to keep a
    /// [`DefaultOpaqueRendererMethod`] that was inserted before the plugin; one that is inserted
    /// after it stays in any case.
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
        app.register_type::<GiScene>()
            .register_type::<GiBakeExclude>()
            .register_type::<GiBakeRequest>()
            .register_type::<GiStaleBakes>()
            .register_type::<GiBakeProgress>()
            .register_type::<GiReflector>()
            .register_type::<GiCamera>()
            .register_type::<GiRsmCamera>()
            .register_type::<SolveCostSource>()
            .register_type::<GiSplatting>()
            .register_type::<GiWarnings>()
            .register_type::<GiGizmos>()
            .register_type::<GiForwardCamera>()
            .register_type::<GiSpecular>()
            .register_type::<GiLight>()
            .register_type::<GiEnvironment>()
            .register_type::<GiSolver>()
            .register_type::<GiBakedSceneLoaderSettings>()
            .register_type::<GiDynamicMaterials>()
            .register_type::<GiOccluder>()
            .register_type::<GiColorMode>()
            .register_type::<GiPointCloud>()
            .register_type::<GiPointCloudPart>()
            .register_type::<GiPointCloudLoaderSettings>()
            .register_type::<GiQuality>()
            .register_type::<GiReflectiveShadowMap>()
            .register_type::<GiSettings>()
            .register_type::<GiSky>()
            .register_type::<GiSoftShadow>()
            .register_type::<GiActiveTier>()
            .register_type::<GiDebugView>()
            .register_type::<GiIrradianceVolume>()
            .register_type::<GiVolumetricFog>()
            .init_resource::<GiFrameStats>()
            .init_resource::<GiSettings>()
            .init_resource::<GiWarnings>()
            .init_resource::<SolveCostSource>()
            .init_resource::<deferred::ReadyDisplays>()
            .init_resource::<SharedCoefficients>()
            .init_resource::<rsm::AskingLights>()
            .init_resource::<inventory::NormalMaps>()
            .init_resource::<gpu_timings::DeviceCosts>()
            .init_asset::<GiPointCloudAsset>()
            .register_asset_loader(GiPointCloudLoader)
            .add_plugins(asset::BakedAssetPlugin)
            .add_systems(
                PreUpdate,
                (
                    bake_task::collect_bakes,
                    gpu_timings::learn,
                    plan_log::log_decisions,
                    scene_log::log_scenes,
                )
                    .in_set(GiSystems::CollectBakes),
            )
            .add_systems(
                PostUpdate,
                quality::select_tiers.in_set(GiSystems::SelectTiers),
            )
            // After assets have come, and before transforms and bounds of new meshes are made.
            .add_systems(
                Update,
                (
                    point_cloud::spawn_point_cloud_meshes,
                    point_cloud::sync_point_cloud_parts,
                )
                    .chain()
                    .in_set(GiSystems::UpdatePointClouds),
            )
            .add_systems(
                PostUpdate,
                (rsm::update_rsm_layers, rsm::update_rsm_cameras)
                    .chain()
                    .in_set(GiSystems::UpdateRsmCameras)
                    .after(TransformSystems::Propagate)
                    .after(VisibilitySystems::VisibilityPropagate)
                    .before(CameraUpdateSystems)
                    .before(VisibilitySystems::UpdateFrusta)
                    .before(VisibilitySystems::CheckVisibility),
            )
            .add_systems(
                PostUpdate,
                rsm::detect_dynamic_changes
                    .after(rsm::update_rsm_cameras)
                    .after(AssetEventSystems)
                    // An app that draws nothing has none of these.
                    .run_if(resource_exists::<Assets<Mesh>>)
                    .run_if(resource_exists::<Assets<Image>>)
                    .run_if(resource_exists::<Assets<StandardMaterial>>),
            )
            .add_systems(
                PostUpdate,
                (
                    volume::update_irradiance_volumes
                        .in_set(GiSystems::UpdateVolumes)
                        .before(TransformSystems::Propagate)
                        .before(AssetEventSystems)
                        .run_if(resource_exists::<Assets<Image>>),
                    volume_shader::replace
                        .in_set(GiSystems::UpdateVolumes)
                        .before(AssetEventSystems),
                    volume::hide_irradiance_volumes
                        .in_set(GiSystems::FilterVolumes)
                        .after(VisibilitySystems::CheckVisibility),
                ),
            )
            .add_systems(
                PostUpdate,
                inventory::follow_materials
                    .after(AssetEventSystems)
                    .run_if(resource_exists::<Assets<StandardMaterial>>),
            )
            .add_systems(
                Last,
                (
                    validation::check,
                    check_display::check_display,
                    soft_shadow::check_soft,
                    volume::check_volumes,
                    fog::check_fog,
                    materials::check_textures.run_if(resource_exists::<Assets<StandardMaterial>>),
                )
                    .chain()
                    .in_set(GiSystems::Validate),
            )
            .add_systems(
                Last,
                (
                    entity_bake::systems::start_bakes.run_if(any_with_component::<GiBakeRequest>),
                    entity_bake::stale::compare_bakes.run_if(entity_bake::stale::has_comparison),
                )
                    .chain()
                    .in_set(GiSystems::StartBakes)
                    .before(GiSystems::Validate),
            )
            .add_systems(
                Last,
                entity_bake::wrong_file::check_files.in_set(GiSystems::Validate),
            );
        #[cfg(feature = "gltf")]
        app.register_type::<GiBakeSettings>();
        if self.deferred_by_default {
            app.insert_resource(DefaultOpaqueRendererMethod::deferred());
        }
    }

    fn finish(&self, app: &mut App) {
        let status = app.world().resource::<GiFrameStats>().clone();
        let costs = app.world().resource::<gpu_timings::DeviceCosts>().clone();
        let coefficients = app.world().resource::<SharedCoefficients>().clone();
        let ready = app.world().resource::<deferred::ReadyDisplays>().clone();
        let Some(render_app) = app.get_sub_app_mut(RenderApp) else {
            warn!("MeshlessGiPlugin: there is no renderer, indirect light stays off.");
            return;
        };
        // Also where indirect light stays off: deferred is the default for opaque materials there
        // too.
        forward_views::add_systems(render_app);
        let world = render_app.world();
        let Some(device) = world.get_resource::<RenderDevice>() else {
            warn!("MeshlessGiPlugin: the renderer has no device, indirect light stays off.");
            return;
        };
        if let Err(why) = compute::device_able(device) {
            warn!("MeshlessGiPlugin: indirect light stays off, because {why}.");
            return;
        }
        forward_display::add_systems(render_app);
        render_app
            .insert_resource(status)
            .insert_resource(costs)
            .insert_resource(coefficients)
            .init_resource::<extract::ExtractedGi>()
            .init_resource::<soft_shadow::ExtractedSoft>()
            .init_resource::<volume::ExtractedVolumes>()
            .init_resource::<fog::ExtractedFogs>()
            .init_resource::<compute::GiRender>()
            .init_resource::<rsm_render::LightMaps>()
            .add_schedule(rsm_render::schedule())
            .add_systems(
                ExtractSchedule,
                (
                    extract::extract,
                    rsm_render::extract_maps,
                    soft_shadow::extract_soft,
                    (fog::extract_fogs, volume::extract_volumes)
                        .chain()
                        .after(extract::extract),
                    inventory::take_inventory.after(extract::extract),
                )
                    .in_set(GiRenderSystems::Extract),
            )
            .add_systems(
                RenderGraph,
                compute::compute
                    .in_set(GiRenderSystems::Solve)
                    .in_set(RenderGraphSystems::Render)
                    .before(camera_driver),
            )
            .init_gpu_resource::<deferred::WithoutVolumes>()
            .insert_resource(ready)
            .add_systems(
                Render,
                (
                    deferred::leave_volumes_out
                        .in_set(RenderSystems::Prepare)
                        .after(prepare_deferred_lighting_pipelines),
                    compute::publish.in_set(RenderSystems::Cleanup),
                ),
            )
            .add_systems(
                Core3d,
                composite::composite
                    .in_set(GiRenderSystems::Composite)
                    .in_set(Core3dSystems::MainPass)
                    .after(main_opaque_pass_3d)
                    .before(main_transmissive_pass_3d)
                    .before(main_transparent_pass_3d),
            )
            .edit_schedule(Core3d, |schedule| {
                schedule.add_build_pass(fog_order::FogFirst::default());
            })
            .add_systems(
                Core3d,
                fog::draw
                    .in_set(GiRenderSystems::CompositeFog)
                    .in_set(Core3dSystems::EarlyPostProcess),
            );
    }
}
