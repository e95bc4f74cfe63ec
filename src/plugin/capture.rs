//! One bounce from what moves, the render world's part: draws the maps.
//!
//! Each map is a Bevy camera with a schedule of its own, [`MeshlessGiCaptureGraph`], in the place of `Core3d`: the meshes' transforms,
//! and one pass that draws the deferred G-buffer. No shadow maps, no lighting, no tonemapping, no picture. Bevy's own deferred prepass is not public; ours binds what it binds
//! (format of Bevy 0.19).
//!
//! Cameras whose targets have the same size share their textures (Bevy keys them by target): what a map holds must be read before the next is drawn, in the
//! same schedule.

use super::extract::{ExtractedGi, LightKey, LightKind};
use super::reflective::{AskingLight, AskingLights};
use crate::plan::{BounceState, LightId};
use bevy::core_pipeline::deferred::{AlphaMask3dDeferred, Opaque3dDeferred};
use bevy::core_pipeline::prepass::ViewPrepassTextures;
use bevy::ecs::prelude::*;
use bevy::ecs::schedule::{Schedule, ScheduleBuildSettings, ScheduleLabel};
use bevy::log::error;
use bevy::pbr::early_gpu_preprocess;
use bevy::render::Extract;
use bevy::render::diagnostic::RecordDiagnostics;
use bevy::render::render_phase::ViewBinnedRenderPhases;
use bevy::render::render_resource::{RenderPassDescriptor, StoreOp};
use bevy::render::renderer::{RenderContext, ViewQuery};
use bevy::render::view::{ExtractedView, ViewDepthTexture};

/// What a camera of a map runs instead of `Core3d`.
#[derive(ScheduleLabel, Clone, Debug, PartialEq, Eq, Hash, Default)]
pub struct MeshlessGiCaptureGraph;

/// The schedule: Bevy's transforms of the meshes, our pass, and what reads it.
pub(crate) fn schedule() -> Schedule {
    let mut schedule = Schedule::new(MeshlessGiCaptureGraph);
    schedule.set_build_settings(ScheduleBuildSettings {
        auto_insert_apply_deferred: false,
        ..ScheduleBuildSettings::default()
    });
    schedule.add_systems((early_gpu_preprocess, draw).chain());
    schedule
}

/// The lights that ask for the bounce of what moves, as of the frame that is drawn.
#[derive(Resource, Default)]
pub(crate) struct ReflectiveMaps(pub Vec<AskingLight>);

/// A light's name in the plan.
pub(crate) fn light_id(key: LightKey) -> LightId {
    let kind = match key.1 {
        LightKind::Point => 0,
        LightKind::Spot => 1,
        LightKind::Directional => 2,
        LightKind::Rect => 3,
    };
    LightId(key.0, kind)
}

/// Runs beside `extract`.
pub(crate) fn extract_maps(mut maps: ResMut<ReflectiveMaps>, asking: Extract<Res<AskingLights>>) {
    maps.0.clone_from(&asking.0);
}

impl ReflectiveMaps {
    /// As the plan sees them.
    pub fn describe(&self, world: &ExtractedGi) -> Vec<BounceState> {
        let state = |light: &AskingLight| BounceState {
            id: light_id(light.key),
            maps: light.maps.as_ref().map(|m| m.len() as u32).map_err(|w| *w),
            views: (world.views.iter())
                .filter(|v| v.layers.intersects(&light.layers))
                .map(|v| v.id)
                .collect(),
        };
        self.0.iter().map(state).collect()
    }
}

type View = (
    &'static ExtractedView,
    &'static ViewDepthTexture,
    &'static ViewPrepassTextures,
);

/// Draws the deferred meshes that the camera sees.
fn draw(
    world: &World,
    view: ViewQuery<View>,
    opaque: Res<ViewBinnedRenderPhases<Opaque3dDeferred>>,
    masked: Res<ViewBinnedRenderPhases<AlphaMask3dDeferred>>,
    mut ctx: RenderContext,
) {
    let entity = view.entity();
    let (extracted, depth, textures) = view.into_inner();
    let id = &extracted.retained_view_entity;
    let (Some(opaque), Some(masked)) = (opaque.get(id), masked.get(id)) else {
        return;
    };
    let recorder = ctx.diagnostic_recorder();
    let recorder = recorder.as_deref();
    let mut pass = ctx.begin_tracked_render_pass(RenderPassDescriptor {
        label: Some("meshless_gi reflective shadow map"),
        color_attachments: &[
            (textures.normal.as_ref()).map(|t| t.get_attachment()),
            (textures.motion_vectors.as_ref()).map(|t| t.get_attachment()),
            (textures.deferred.as_ref()).map(|t| t.get_attachment()),
            (textures.deferred_lighting_pass_id.as_ref()).map(|t| t.get_attachment()),
        ],
        depth_stencil_attachment: Some(depth.get_attachment(StoreOp::Store)),
        timestamp_writes: None,
        occlusion_query_set: None,
        multiview_mask: None,
    });
    let span = recorder.pass_span(&mut pass, "meshless_gi_rsm");
    if let Err(why) = opaque.render(&mut pass, world, entity) {
        error!("a reflective shadow map lacks its opaque meshes: {why:?}");
    }
    if let Err(why) = masked.render(&mut pass, world, entity) {
        error!("a reflective shadow map lacks its masked meshes: {why:?}");
    }
    span.end(&mut pass);
}
