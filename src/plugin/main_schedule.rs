//! Systems of the main world and their order.

use super::effects::{fog, materials, rsm, soft_shadows, volume};
use super::*;
use bevy::app::{App, Last, PostUpdate, PreUpdate};
use bevy::asset::{AssetEventSystems, Assets};
use bevy::camera::CameraUpdateSystems;
use bevy::camera::visibility::VisibilitySystems;
use bevy::ecs::prelude::*;
use bevy::image::Image;
use bevy::mesh::Mesh;
use bevy::pbr::StandardMaterial;
use bevy::transform::TransformSystems;

/// Adds the systems of the main world.
pub(super) fn add_systems(app: &mut App) {
    add_update_systems(app);
    add_post_update_systems(app);
    add_last_systems(app);
}

fn add_update_systems(app: &mut App) {
    app.add_systems(
        PreUpdate,
        (
            bake_task::collect_bakes,
            gpu_timings::record_timings,
            plan_log::log_decisions,
            scene_log::log_scenes,
        )
            .in_set(GiSystems::CollectBakes),
    )
    .add_systems(
        PostUpdate,
        quality::select_tiers.in_set(GiSystems::SelectTiers),
    );
}

fn add_post_update_systems(app: &mut App) {
    app.add_systems(
        PostUpdate,
        (
            rsm::map_cameras::update_rsm_layers,
            rsm::map_cameras::update_rsm_cameras,
        )
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
        rsm::object_changes::detect_dynamic_changes
            .after(rsm::map_cameras::update_rsm_cameras)
            .after(AssetEventSystems)
            // An app that draws nothing has none of these.
            .run_if(resource_exists::<Assets<Mesh>>)
            .run_if(resource_exists::<Assets<Image>>)
            .run_if(resource_exists::<Assets<StandardMaterial>>),
    )
    .add_systems(
        PostUpdate,
        (
            volume::irradiance_volume::update_irradiance_volumes
                .in_set(GiSystems::UpdateVolumes)
                .before(TransformSystems::Propagate)
                .before(AssetEventSystems)
                .run_if(resource_exists::<Assets<Image>>),
            volume::shader::replace
                .in_set(GiSystems::UpdateVolumes)
                .before(AssetEventSystems),
            volume::irradiance_volume::hide_irradiance_volumes
                .in_set(GiSystems::FilterVolumes)
                .after(VisibilitySystems::CheckVisibility),
        ),
    )
    .add_systems(
        PostUpdate,
        inventory::update_normal_maps
            .after(AssetEventSystems)
            .run_if(resource_exists::<Assets<StandardMaterial>>),
    );
}

fn add_last_systems(app: &mut App) {
    app.add_systems(
        Last,
        (
            validation::check,
            check_display::check_display,
            soft_shadows::soft_lights::check_soft,
            volume::irradiance_volume::check_volumes,
            fog::fog_volumes::check_fog,
            materials::dynamic_materials::check_textures
                .run_if(resource_exists::<Assets<StandardMaterial>>),
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
}
