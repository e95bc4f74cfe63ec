//! Systems of the main world and their order. Effects add their own.

use super::*;
use bevy::app::{App, Last, PostUpdate, PreUpdate};
use bevy::asset::{AssetEventSystems, Assets};
use bevy::ecs::prelude::*;
use bevy::pbr::StandardMaterial;

/// Adds the systems of the main world.
pub(super) fn add_systems(app: &mut App) {
    add_update_systems(app);
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
        (
            quality::select_tiers.in_set(GiSystems::SelectTiers),
            inventory::update_normal_maps
                .after(AssetEventSystems)
                .run_if(resource_exists::<Assets<StandardMaterial>>),
        ),
    );
}

fn add_last_systems(app: &mut App) {
    app.add_systems(
        Last,
        (validation::check, check_display::check_display)
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
