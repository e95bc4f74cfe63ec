//! Deferred views whose transparent and forward surfaces are lit by a volume: their G-buffer has our own display, and must not have the volume's light too.
//!
//! Bevy lights a view's G-buffer with the shader that it draws forward surfaces with, volumes in it. Here the same pipeline is made without them; what is drawn
//! forward in that view keeps the volume. Bind groups stay those of the view.

use super::volume::ExtractedVolumes;
use bevy::ecs::prelude::*;
use bevy::pbr::deferred::{DeferredLightingLayout, DeferredLightingPipeline, SkipDeferredLighting};
use bevy::pbr::{MeshPipelineKey, ViewKeyCache};
use bevy::platform::collections::HashMap;
use bevy::render::camera::ExtractedCamera;
use bevy::render::render_resource::{
    CachedRenderPipelineId, PipelineCache, SpecializedRenderPipeline,
};
use bevy::render::view::ExtractedView;

/// What says in Bevy's shaders that a view has volumes.
const VOLUMES: &str = "IRRADIANCE_VOLUME";

/// Bevy's deferred lighting without volumes, by what it is specialised for.
#[derive(Resource, Default)]
pub(crate) struct WithoutVolumes(HashMap<MeshPipelineKey, CachedRenderPipelineId>);

/// Takes the volumes out of the G-buffer's lighting in the views that have our display and see one of ours. Runs behind Bevy's choice of that pipeline.
pub(crate) fn leave_volumes_out(
    mut commands: Commands,
    mut made: ResMut<WithoutVolumes>,
    world: Res<ExtractedVolumes>,
    pipelines: Res<PipelineCache>,
    layout: Option<Res<DeferredLightingLayout>>,
    keys: Option<Res<ViewKeyCache>>,
    views: Query<(Entity, &ExtractedView), (With<ExtractedCamera>, Without<SkipDeferredLighting>)>,
) {
    let (Some(layout), Some(keys)) = (layout, keys) else {
        return;
    };
    for (entity, view) in &views {
        let id = &view.retained_view_entity;
        if !world.displays(id.main_entity.id()) {
            continue;
        }
        let Some(key) = keys.get(id) else {
            continue;
        };
        if !key.contains(MeshPipelineKey::IRRADIANCE_VOLUME) {
            continue;
        }
        let pipeline_id = *made.0.entry(*key).or_insert_with(|| {
            let mut descriptor = layout.specialize(*key);
            if let Some(fragment) = &mut descriptor.fragment {
                (fragment.shader_defs).retain(|def| *def != VOLUMES.into());
            }
            pipelines.queue_render_pipeline(descriptor)
        });
        let pipeline = DeferredLightingPipeline { pipeline_id };
        commands.entity(entity).insert(pipeline);
    }
}
