//! Passes of a light's reflective shadow maps, in the camera of each map.

use crate::gpu::KernelPipelines;
use crate::plan::{LightId, Pass, Plan, SceneId, kind_of};
use crate::plugin::effects::rsm::{MapChanges, Reflections};
use crate::plugin::effects::{Effect, Record};
use crate::plugin::extract::ExtractedGi;
use crate::plugin::render_state::SceneRuntime;
use crate::plugin::rsm::AskingLight;
use bevy::core_pipeline::deferred::{AlphaMask3dDeferred, Opaque3dDeferred};
use bevy::core_pipeline::prepass::ViewPrepassTextures;
use bevy::ecs::prelude::*;
use bevy::render::render_phase::BinnedRenderPhase;
use bevy::render::renderer::RenderContext;
use bevy::render::view::{ExtractedView, ViewDepthTexture};
use std::collections::BTreeMap;

/// Camera of a map, and the meshes that it draws.
pub(crate) struct MapDrawContext<'a, 'w, 's> {
    /// Render world, as Bevy's draw functions read it.
    pub world: &'a World,
    /// Camera in the render world.
    pub camera: Entity,
    pub depth: &'a ViewDepthTexture,
    pub textures: &'a ViewPrepassTextures,
    pub opaque: &'a BinnedRenderPhase<Opaque3dDeferred>,
    pub masked: &'a BinnedRenderPhase<AlphaMask3dDeferred>,
    pub ctx: &'a mut RenderContext<'w, 's>,
}

/// A map of a light.
#[derive(Clone, Copy)]
pub(crate) struct MapOfLight<'a> {
    pub light: &'a AskingLight,
    /// Index of the map among the maps of the light.
    pub index: usize,
    /// Number of the light's maps.
    pub count: usize,
}

/// A map that was drawn, and the means to read it.
pub(crate) struct MapReadContext<'a> {
    pub kernels: &'a KernelPipelines,
    pub queue: &'a wgpu::Queue,
    pub encoder: &'a mut wgpu::CommandEncoder,
    pub map: MapOfLight<'a>,
    pub view: &'a ExtractedView,
    pub depth: &'a wgpu::TextureView,
    pub gbuffer: &'a wgpu::TextureView,
    /// `false` if a mesh may be missing, because its pipeline is not ready.
    pub complete: bool,
    pub world: &'a ExtractedGi,
    pub scenes: &'a BTreeMap<SceneId, SceneRuntime>,
    pub reflections: &'a mut Reflections,
    pub changes: &'a mut MapChanges,
}

/// Draws a map of a light, once for each of the light's passes.
pub(crate) fn draw_light_map(
    effects: &[Effect],
    plan: &Plan,
    light: LightId,
    ctx: &mut MapDrawContext<'_, '_, '_>,
) {
    for pass in plan.of_light(light) {
        if let Some(Record::LightMap { draw, .. }) = how(effects, pass) {
            draw(ctx, pass);
        }
    }
}

/// Reads a map of a light that was drawn, once for each of the light's passes.
pub(crate) fn read_light_map(
    effects: &[Effect],
    plan: &Plan,
    light: LightId,
    ctx: &mut MapReadContext<'_>,
) {
    for pass in plan.of_light(light) {
        if let Some(Record::LightMap { read, .. }) = how(effects, pass) {
            read(ctx, pass);
        }
    }
}

fn how<'a>(effects: &'a [Effect], pass: &Pass) -> Option<&'a Record> {
    Some(&kind_of(effects, pass)?.record.how)
}
