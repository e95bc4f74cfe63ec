//! Deferred views whose transparent and forward surfaces are lit by a volume: their G-buffer has
//! our own display, and must not have the volume's light too.
//!
//! Bevy lights a view's G-buffer with the shader that it draws forward surfaces with, volumes in
//! it. Here the same pipeline is made without them; what is drawn forward in that view keeps the
//! volume. Bind groups stay those of the view.

use super::volume::ExtractedVolumes;
use bevy::ecs::prelude::*;
use bevy::pbr::deferred::{DeferredLightingLayout, DeferredLightingPipeline, SkipDeferredLighting};
use bevy::pbr::{MeshPipelineKey, ViewKeyCache};
use bevy::platform::collections::{HashMap, HashSet};
use bevy::render::camera::ExtractedCamera;
use bevy::render::render_resource::{
    CachedRenderPipelineId, PipelineCache, SpecializedRenderPipeline,
};
use bevy::render::view::ExtractedView;
use std::sync::{Arc, Mutex, PoisonError};

/// What says in Bevy's shaders that a view has volumes.
const VOLUMES: &str = "IRRADIANCE_VOLUME";

/// Bevy's deferred lighting without volumes, by what it is specialised for. Made anew with the
/// device.
#[derive(Resource, Default)]
pub(crate) struct WithoutVolumes(HashMap<MeshPipelineKey, CachedRenderPipelineId>);

/// Cameras of the main world whose G-buffer can be lit without volumes now: the pipeline is
/// compiled. Until then they see none, or the G-buffer would be dark meanwhile. Shared by both
/// worlds.
#[derive(Resource, Clone, Default)]
pub(crate) struct ReadyDisplays(Arc<Mutex<HashSet<Entity>>>);

impl ReadyDisplays {
    /// Whether this one is among them.
    pub fn contains(&self, camera: Entity) -> bool {
        let ready = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        ready.contains(&camera)
    }
}

/// Views whose G-buffer Bevy lights.
type Lit = (With<ExtractedCamera>, Without<SkipDeferredLighting>);

/// Takes the volumes out of the G-buffer's lighting in the views that have our display and see one
/// of ours, and has what that takes compiled before. Runs behind Bevy's choice of that pipeline.
pub(crate) fn leave_volumes_out(
    mut commands: Commands,
    mut made: ResMut<WithoutVolumes>,
    ready: Res<ReadyDisplays>,
    world: Res<ExtractedVolumes>,
    pipelines: Res<PipelineCache>,
    bevy: (
        Option<Res<DeferredLightingLayout>>,
        Option<Res<ViewKeyCache>>,
    ),
    views: Query<(Entity, &ExtractedView), Lit>,
) {
    let mut ready = ready.0.lock().unwrap_or_else(PoisonError::into_inner);
    ready.clear();
    let (Some(layout), Some(keys)) = bevy else {
        return;
    };
    for (entity, view) in &views {
        let id = &view.retained_view_entity;
        let camera = id.main_entity.id();
        let (Some(sees), Some(key)) = (world.display(camera), keys.get(id)) else {
            continue;
        };
        let lit = *key | MeshPipelineKey::IRRADIANCE_VOLUME;
        let pipeline_id = *made.0.entry(lit).or_insert_with(|| {
            let mut descriptor = layout.specialize(lit);
            if let Some(fragment) = &mut descriptor.fragment {
                (fragment.shader_defs).retain(|def| *def != VOLUMES.into());
            }
            pipelines.queue_render_pipeline(descriptor)
        });
        if pipelines.get_render_pipeline(pipeline_id).is_some() {
            ready.insert(camera);
        }
        if sees && *key == lit {
            let pipeline = DeferredLightingPipeline { pipeline_id };
            commands.entity(entity).insert(pipeline);
        }
    }
}
