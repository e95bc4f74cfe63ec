//! Systems of the render world and their order. Effects add their own.

use super::*;
use bevy::app::{App, SubApp};
use bevy::core_pipeline::core_3d::{main_opaque_pass_3d, main_transparent_pass_3d};
use bevy::core_pipeline::schedule::{Core3d, Core3dSystems, camera_driver};
use bevy::ecs::prelude::*;
use bevy::log::warn;
use bevy::pbr::deferred::prepare_deferred_lighting_pipelines;
use bevy::pbr::main_transmissive_pass_3d;
use bevy::render::renderer::{RenderDevice, RenderGraph, RenderGraphSystems};
use bevy::render::{ExtractSchedule, GpuResourceAppExt, Render, RenderApp, RenderSystems};

/// Adds resources and systems of the render world. Warns if the device cannot run the kernels.
pub(super) fn build(app: &mut App) {
    let status = app.world().resource::<GiFrameStats>().clone();
    let costs = app.world().resource::<gpu_timings::DeviceCosts>().clone();
    let coefficients = app.world().resource::<SharedCoefficients>().clone();
    let ready = app.world().resource::<deferred::ReadyDisplays>().clone();
    let Some(render_app) = app.get_sub_app_mut(RenderApp) else {
        warn!("MeshlessGiPlugin: the app has no renderer; indirect light is disabled");
        return;
    };
    // Deferred is the default for opaque materials also if indirect light is disabled.
    forward_views::add_systems(render_app);
    let world = render_app.world();
    let Some(device) = world.get_resource::<RenderDevice>() else {
        warn!("MeshlessGiPlugin: the renderer has no device; indirect light is disabled");
        return;
    };
    if let Err(error) = compute::check_device(device) {
        warn!("MeshlessGiPlugin: {error}; indirect light is disabled");
        return;
    }
    forward_display::add_systems(render_app);
    render_app
        .insert_resource(status)
        .insert_resource(costs)
        .insert_resource(coefficients)
        .insert_resource(ready);
    add_extraction(render_app);
    effects::add_to_render_app(render_app);
    add_solve(render_app);
    add_camera_passes(render_app);
}

fn add_extraction(render_app: &mut SubApp) {
    render_app
        .init_resource::<extract::ExtractedGi>()
        .init_resource::<render_state::GiRender>()
        .add_systems(
            ExtractSchedule,
            (
                extract::extract,
                inventory::take_inventory.after(extract::extract),
            )
                .in_set(GiRenderSystems::Extract),
        );
}

fn add_solve(render_app: &mut SubApp) {
    render_app
        .add_systems(
            RenderGraph,
            compute::compute
                .in_set(GiRenderSystems::Solve)
                .in_set(RenderGraphSystems::Render)
                .before(camera_driver),
        )
        .init_gpu_resource::<deferred::PipelinesWithoutVolumes>()
        .add_systems(
            Render,
            (
                deferred::exclude_volumes
                    .in_set(RenderSystems::Prepare)
                    .after(prepare_deferred_lighting_pipelines),
                count::publish.in_set(RenderSystems::Cleanup),
            ),
        );
}

fn add_camera_passes(render_app: &mut SubApp) {
    render_app
        .add_systems(
            Core3d,
            composite::composite
                .in_set(GiRenderSystems::Composite)
                .in_set(Core3dSystems::MainPass)
                .after(main_opaque_pass_3d)
                .before(main_transmissive_pass_3d)
                .before(main_transparent_pass_3d),
        )
        .add_systems(
            Core3d,
            post_process::post_process
                .in_set(GiRenderSystems::CompositeFog)
                .in_set(Core3dSystems::EarlyPostProcess),
        );
}
