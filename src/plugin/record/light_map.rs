//! Passes of a light's reflective shadow maps, in the camera of each map.

use super::Recorder;
use crate::gpu::{GpuCounters, KernelPipelines};
use crate::plan::{LightId, Pass, Plan, SceneId, kind_of};
use crate::plugin::effect_states::EffectStates;
use crate::plugin::effects::rsm::map_cameras::RsmRequest;
use crate::plugin::effects::{Effect, Record};
use crate::plugin::extract::ExtractedGi;
use crate::plugin::gpu_timings::map_spans;
use crate::plugin::render_state::SceneRuntime;
use bevy::core_pipeline::deferred::{AlphaMask3dDeferred, Opaque3dDeferred};
use bevy::core_pipeline::prepass::ViewPrepassTextures;
use bevy::ecs::prelude::*;
use bevy::render::diagnostic::RecordDiagnostics;
use bevy::render::render_phase::BinnedRenderPhase;
use bevy::render::renderer::RenderContext;
use bevy::render::view::{ExtractedView, ViewDepthTexture};
use std::collections::BTreeMap;

/// Recording of the maps of lights. Two functions draw and read a map, because Bevy's draw
/// functions borrow the whole render world.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LightMapRecording {
    /// Reserves buffers for all maps of the frame.
    pub prepare: fn(&mut MapsContext<'_>, &[&Pass]),
    /// Draws a map.
    pub draw: fn(&mut MapDrawContext<'_, '_, '_>, &Pass),
    /// Reads a map that was drawn.
    pub read: fn(&mut MapReadContext<'_>, &Pass),
}

/// Lights with maps, and the means to reserve buffers for the maps.
pub(crate) struct MapsContext<'a> {
    pub device: &'a wgpu::Device,
    pub lights: &'a [RsmRequest],
    /// States of the effects that belong to no scene and no view.
    pub states: &'a mut EffectStates,
    /// Counters of released buffers.
    pub counters: &'a mut GpuCounters,
}

/// Camera of a map, and the meshes that it draws.
pub(crate) struct MapDrawContext<'a, 'w, 's> {
    pub map: MapOfLight<'a>,
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
    pub light: &'a RsmRequest,
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
    /// States of the effects that belong to no scene and no view.
    pub states: &'a mut EffectStates,
}

/// Reserves buffers for the maps of all lights, once for each stage.
pub(crate) fn prepare_light_maps(effects: &[Effect], plan: &Plan, ctx: &mut MapsContext<'_>) {
    let maps = plan
        .passes
        .iter()
        .filter_map(|pass| match how(effects, pass)? {
            Record::LightMap(recording) => Some((pass, recording)),
            _ => None,
        });
    let maps: Vec<_> = maps.collect();
    for group in maps.chunk_by(|(a, _), (b, _)| a.stage == b.stage) {
        let passes: Vec<&Pass> = group.iter().map(|(pass, _)| *pass).collect();
        (group[0].1.prepare)(ctx, &passes);
    }
}

/// Draws a map of a light, once for each of the light's passes.
pub(crate) fn draw_light_map(
    effects: &[Effect],
    plan: &Plan,
    light: LightId,
    ctx: &mut MapDrawContext<'_, '_, '_>,
) {
    for pass in plan.of_light(light) {
        if let Some(Record::LightMap(recording)) = how(effects, pass) {
            (recording.draw)(ctx, pass);
        }
    }
}

/// Reads a map of a light that was drawn, once for each of the light's passes.
pub(crate) fn read_light_map(
    effects: &[Effect],
    plan: &Plan,
    light: LightId,
    ctx: &mut MapReadContext<'_>,
    recorder: Recorder<'_>,
) {
    for pass in plan.of_light(light) {
        if let Some(Record::LightMap(recording)) = how(effects, pass) {
            let [_, name] = map_spans(pass, ctx.map.index);
            let span = recorder.time_span(ctx.encoder, name);
            (recording.read)(ctx, pass);
            span.end(ctx.encoder);
        }
    }
}

fn how<'a>(effects: &'a [Effect], pass: &Pass) -> Option<&'a Record> {
    Some(&kind_of(effects, pass)?.record.how)
}
