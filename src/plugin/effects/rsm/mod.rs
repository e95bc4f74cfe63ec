//! Effect `rsm`: reflective shadow maps of dynamic objects, and the virtual point
//! lights chosen from them.
//!
//! Reads: the lights with reflective shadow maps, the views that they may light, and whether the
//! device holds their virtual lights. Each map is drawn and read in its own camera
//! ([`map_schedule`]). Kernels: `rsm`, then `vpl` in each view.

pub(crate) mod map_cameras;
pub(crate) mod map_schedule;
pub(crate) mod object_changes;
mod reflections;
pub(crate) mod reflective_shadow_map;
pub(crate) mod reflector;

pub(crate) use reflections::{Reflections, observe};

use super::{Effect, PassKind, Record, Recording};
use crate::gpu;
use crate::plan::{
    BounceState, FrameStage, FrameState, Pass, Plan, RunReason, SceneId, SkipReason, Timing,
    ViewState, Work,
};
use crate::plugin::gpu_timings::map_spans;
use crate::plugin::record::{
    LayerInput, LayerRecording, LightMapRecording, MapDrawContext, SubsplatLayers,
};
use crate::plugin::{GiReflectiveShadowMap, GiReflector, GiRenderSystems, GiRsmCamera, GiSystems};
use bevy::app::{App, PostUpdate, SubApp};
use bevy::asset::{AssetEventSystems, Assets};
use bevy::camera::CameraUpdateSystems;
use bevy::camera::visibility::VisibilitySystems;
use bevy::ecs::prelude::*;
use bevy::image::Image;
use bevy::log::error;
use bevy::mesh::Mesh;
use bevy::pbr::StandardMaterial;
use bevy::render::ExtractSchedule;
use bevy::render::diagnostic::RecordDiagnostics;
use bevy::render::render_resource::{RenderPassDescriptor, StoreOp};
use bevy::transform::TransformSystems;

pub(super) const EFFECT: Effect = Effect {
    name: "rsm",
    summary: "draws dynamic objects from lights with reflective shadow maps, and creates virtual point lights",
    schedule,
    passes: &[
        PassKind {
            stage: FrameStage::RSM,
            per_view: false,
            timing: Timing::With(FrameStage::RSM),
            work: |state, pass| {
                let light = (state.bounces.iter()).find(|light| Some(light.id) == pass.light);
                let texels = light.map(|l| u64::from(l.maps.unwrap_or(0)) * l.texels_per_map);
                texels.map_or(Work::Uncounted, Work::Texels)
            },
            record: Recording {
                kernels: &[
                    gpu::EntryPoint::RsmTexels,
                    gpu::EntryPoint::RsmShadow,
                    gpu::EntryPoint::RsmSelect,
                ],
                draws: None,
                how: Record::LightMap(LightMapRecording {
                    prepare: Reflections::prepare,
                    draw: draw_map,
                    read: |ctx, _| Reflections::read_map(ctx),
                }),
            },
        },
        PassKind {
            stage: FrameStage::VPL,
            per_view: true,
            timing: Timing::With(FrameStage::SPLAT),
            work: |state, pass| Work::Pixels(state.pixels(pass.view)),
            record: Recording {
                kernels: &[
                    gpu::EntryPoint::Vpl,
                    gpu::EntryPoint::VplOver,
                    gpu::EntryPoint::VplNodes,
                ],
                draws: None,
                how: Record::Layer(LayerRecording {
                    prepare: |ctx, _| ctx.world_states.get::<Reflections>().map(|_| ()),
                    splat: |ctx, _, targets| Reflections::splat(ctx, targets),
                    add_to_subsplats,
                }),
            },
        },
    ],
};

/// Adds the components, the cameras of maps and the change detection to the main world.
pub(super) fn add_to_app(app: &mut App) {
    app.register_type::<GiReflector>()
        .register_type::<GiReflectiveShadowMap>()
        .register_type::<GiRsmCamera>()
        .init_resource::<map_cameras::RsmRequests>()
        .add_systems(
            PostUpdate,
            (
                map_cameras::update_rsm_layers,
                map_cameras::update_rsm_cameras,
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
            object_changes::detect_dynamic_changes
                .after(map_cameras::update_rsm_cameras)
                .after(AssetEventSystems)
                // An app that draws nothing has none of these.
                .run_if(resource_exists::<Assets<Mesh>>)
                .run_if(resource_exists::<Assets<Image>>)
                .run_if(resource_exists::<Assets<StandardMaterial>>),
        );
}

/// Adds the extraction and the schedule of map cameras to the render world.
pub(super) fn add_to_render_app(render_app: &mut SubApp) {
    render_app
        .init_resource::<map_schedule::LightMaps>()
        .add_schedule(map_schedule::schedule())
        .add_systems(
            ExtractSchedule,
            map_schedule::extract_maps.in_set(GiRenderSystems::Extract),
        );
}

fn schedule(state: &FrameState, plan: &mut Plan) {
    for light in &state.bounces {
        let maps = match state.maps_of(light) {
            Ok(_) if state.virtual_lights_valid => Err(SkipReason::AtRest),
            maps => maps,
        };
        match maps {
            Ok(maps) => {
                let (stage, reason) = (FrameStage::RSM, RunReason::ObjectsInRange(maps));
                plan.push(EFFECT.name, stage, SceneId::WORLD, reason).light = Some(light.id);
            }
            Err(reason) => plan.without_maps.push((light.id, reason)),
        }
    }
    for view in state.views.iter().filter(|view| lights_view(state, view)) {
        plan.push_layer(EFFECT.name, FrameStage::VPL, SceneId::WORLD, view);
    }
}

/// Returns `true` if virtual lights light a view.
pub(super) fn lights_view(state: &FrameState, view: &ViewState) -> bool {
    let lights =
        |light: &BounceState| light.views.contains(&view.id) && state.maps_of(light).is_ok();
    view.displays() && state.bounces.iter().any(lights)
}

/// Draws the deferred meshes in the camera of a map. Bevy's deferred prepass is not public. This
/// one has the same bindings (format of Bevy 0.19).
fn draw_map(ctx: &mut MapDrawContext<'_, '_, '_>, planned: &Pass) {
    let recorder = ctx.ctx.diagnostic_recorder();
    let recorder = recorder.as_deref();
    let textures = ctx.textures;
    let mut pass = ctx.ctx.begin_tracked_render_pass(RenderPassDescriptor {
        label: Some("meshless_gi reflective shadow map"),
        color_attachments: &[
            (textures.normal.as_ref()).map(|t| t.get_attachment()),
            (textures.motion_vectors.as_ref()).map(|t| t.get_attachment()),
            (textures.deferred.as_ref()).map(|t| t.get_attachment()),
            (textures.deferred_lighting_pass_id.as_ref()).map(|t| t.get_attachment()),
        ],
        depth_stencil_attachment: Some(ctx.depth.get_attachment(StoreOp::Store)),
        timestamp_writes: None,
        occlusion_query_set: None,
        multiview_mask: None,
    });
    // Spans of render passes do not nest.
    let [name, _] = map_spans(planned, ctx.map.index);
    let span = recorder.pass_span(&mut pass, name);
    if let Err(error) = ctx.opaque.render(&mut pass, ctx.world, ctx.camera) {
        error!("a reflective shadow map lacks its opaque meshes: {error:?}");
    }
    if let Err(error) = ctx.masked.render(&mut pass, ctx.world, ctx.camera) {
        error!("a reflective shadow map lacks its masked meshes: {error:?}");
    }
    span.end(&mut pass);
}

/// Adds the virtual lights to the subsplats of a view.
fn add_to_subsplats<'a>(
    input: &LayerInput<'a>,
    _: &Pass,
    layers: &mut SubsplatLayers<'a>,
) -> Option<()> {
    let reflections = input.world_states.get::<Reflections>()?;
    layers.lights = Some(reflections.view_lights(input.view, input.scenes, input.shown));
    Some(())
}
