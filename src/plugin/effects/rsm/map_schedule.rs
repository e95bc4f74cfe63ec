//! Cameras of reflective shadow maps in the render world: their schedule, and their light sources
//! for the plan.
//!
//! Each map is a Bevy camera with its own schedule [`RsmSchedule`] instead of `Core3d`. The
//! schedule has the meshes' transforms, and the [walk](crate::plugin::record) of the plan's passes
//! that draw and read the map. It has no shadow maps, lighting, tonemapping or picture.
//!
//! Cameras whose targets have the same size share their textures (Bevy keys them by target).
//! Therefore a map is read before the next one is drawn, in the same schedule.

use crate::plan::{BounceState, LightId};
use crate::plugin::effects::rsm::map_cameras::{RsmRequest, RsmRequests};
use crate::plugin::extract::{ExtractedGi, LightKey};
use crate::plugin::record::{
    MapDrawContext, MapOfLight, MapReadContext, draw_light_map, read_light_map,
};
use crate::plugin::render_state::GiRender;
use bevy::core_pipeline::deferred::{AlphaMask3dDeferred, Opaque3dDeferred};
use bevy::core_pipeline::prepass::ViewPrepassTextures;
use bevy::ecs::prelude::*;
use bevy::ecs::schedule::{Schedule, ScheduleBuildSettings, ScheduleLabel};
use bevy::pbr::early_gpu_preprocess;
use bevy::render::Extract;
use bevy::render::render_phase::ViewBinnedRenderPhases;
use bevy::render::render_resource::PipelineCache;
use bevy::render::renderer::{RenderContext, RenderQueue, ViewQuery};
use bevy::render::view::{ExtractedView, ViewDepthTexture};

/// Schedule that a camera of a map runs instead of `Core3d`.
#[derive(ScheduleLabel, Clone, Debug, PartialEq, Eq, Hash, Default)]
pub struct RsmSchedule;

/// Creates the schedule: Bevy's transforms of the meshes, and the walk of the plan's passes.
pub(crate) fn schedule() -> Schedule {
    let mut schedule = Schedule::new(RsmSchedule);
    schedule.set_build_settings(ScheduleBuildSettings {
        auto_insert_apply_deferred: false,
        ..ScheduleBuildSettings::default()
    });
    schedule.add_systems((early_gpu_preprocess, draw, read).chain());
    schedule
}

/// Lights that bounce from dynamic objects in the frame that is drawn.
#[derive(Resource, Default)]
pub(crate) struct LightMaps(pub RsmRequests);

/// A light's name in the plan.
pub(crate) fn light_id(key: LightKey) -> LightId {
    LightId(key.0, key.1 as u8)
}

/// Extracts the maps of lights. Runs in the same schedule as `extract`.
pub(crate) fn extract_maps(mut maps: ResMut<LightMaps>, requests: Extract<Res<RsmRequests>>) {
    maps.0.clone_from(&requests);
}

impl LightMaps {
    /// Describes the lights for the plan.
    pub fn describe(&self, world: &ExtractedGi) -> Vec<BounceState> {
        let lights = &self.0.lights;
        let state = |light: &RsmRequest| BounceState {
            id: light_id(light.key),
            maps: light.maps.as_ref().map(|m| m.len() as u32).map_err(|w| *w),
            texels_per_map: u64::from(light.settings.texels()).pow(2),
            views: (world.views.iter())
                .filter(|v| v.layers.intersects(&light.layers))
                .map(|v| v.id)
                .collect(),
        };
        lights.iter().map(state).collect()
    }
}

type View = (
    &'static ExtractedView,
    &'static ViewDepthTexture,
    &'static ViewPrepassTextures,
);

/// Meshes that the cameras draw: opaque, and with alpha masks.
type DeferredPhases<'w> = (
    Res<'w, ViewBinnedRenderPhases<Opaque3dDeferred>>,
    Res<'w, ViewBinnedRenderPhases<AlphaMask3dDeferred>>,
);

/// Returns the map of this camera.
fn map_of(lights: &LightMaps, camera: Entity) -> Option<MapOfLight<'_>> {
    lights.0.lights.iter().find_map(|light| {
        let maps = light.maps.as_ref().ok()?;
        Some(MapOfLight {
            light,
            index: maps.iter().position(|map| *map == camera)?,
            count: maps.len(),
        })
    })
}

/// Draws the map of the camera. Bevy's draw functions read the whole render world, so that the
/// state of the plugin is not written here.
fn draw(
    world: &World,
    view: ViewQuery<View>,
    lights: Res<LightMaps>,
    render: Res<GiRender>,
    (opaque, masked): DeferredPhases,
    mut ctx: RenderContext,
) {
    let camera = view.entity();
    let (view, depth, textures) = view.into_inner();
    let id = &view.retained_view_entity;
    let (Some(map), Some(opaque), Some(masked)) = (
        map_of(&lights, id.main_entity.id()),
        opaque.get(id),
        masked.get(id),
    ) else {
        return;
    };
    let mut ctx = MapDrawContext {
        map,
        world,
        camera,
        depth,
        textures,
        opaque,
        masked,
        ctx: &mut ctx,
    };
    let light = light_id(map.light.key);
    draw_light_map(render.effects, &render.plan, light, &mut ctx);
}

/// Reads the map that was just drawn.
fn read(
    view: ViewQuery<View>,
    lights: Res<LightMaps>,
    world: Res<ExtractedGi>,
    mut render: ResMut<GiRender>,
    (queue, pipelines): (Res<RenderQueue>, Res<PipelineCache>),
    (opaque, masked): DeferredPhases,
    mut ctx: RenderContext,
) {
    let (view, depth, textures) = view.into_inner();
    let id = &view.retained_view_entity;
    // Without phases, nothing was drawn, and the texture holds another map.
    if !opaque.contains_key(id) || !masked.contains_key(id) {
        return;
    }
    let render = &mut *render;
    let (Some(map), Some(kernels), Some(gbuffer)) = (
        map_of(&lights, id.main_entity.id()),
        &render.kernels,
        textures.deferred_view(),
    ) else {
        return;
    };
    let recorder = ctx.diagnostic_recorder();
    let recorder = recorder.as_deref();
    let mut ctx = MapReadContext {
        kernels,
        queue: &queue,
        encoder: ctx.command_encoder(),
        map,
        view,
        depth: depth.view(),
        gbuffer,
        complete: pipelines.waiting_pipelines().next().is_none(),
        world: &world,
        scenes: &render.scenes,
        states: &mut render.states,
    };
    let light = light_id(map.light.key);
    read_light_map(render.effects, &render.plan, light, &mut ctx, recorder);
}
