//! Deferred views whose transparent and forward surfaces are lit by a volume. Their G-buffer has
//! the display and must not get the light of the volume in addition.
//!
//! Bevy lights the G-buffer of a view with the shader of forward surfaces, which includes volumes.
//! Here the same pipeline is specialized without volumes. Forward surfaces of that view keep the
//! volume. The bind groups of the view stay the same.

use super::effects::volume::irradiance_volume::ExtractedVolumes;
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

/// Shader definition of Bevy for views with irradiance volumes.
const VOLUMES: &str = "IRRADIANCE_VOLUME";

/// Bevy's deferred lighting without volumes, by pipeline key. Created again with the device.
#[derive(Resource, Default)]
pub(crate) struct PipelinesWithoutVolumes(HashMap<MeshPipelineKey, CachedRenderPipelineId>);

/// Cameras of the main world whose pipeline without volumes is compiled. Other cameras use no
/// volumes, because their G-buffer would be dark until then. Shared by both worlds.
#[derive(Resource, Clone, Default)]
pub(crate) struct ReadyDisplays(Arc<Mutex<HashSet<Entity>>>);

impl ReadyDisplays {
    /// Returns `true` if this camera is ready.
    pub fn contains(&self, camera: Entity) -> bool {
        let ready = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        ready.contains(&camera)
    }
}

/// Views with Bevy's deferred lighting.
type DeferredViews = (With<ExtractedCamera>, Without<SkipDeferredLighting>);

/// Removes the volumes from the deferred lighting of views that have a display and show a volume,
/// and compiles the pipelines for that. Runs after Bevy's choice of the pipeline.
pub(crate) fn exclude_volumes(
    mut commands: Commands,
    mut made: ResMut<PipelinesWithoutVolumes>,
    ready: Res<ReadyDisplays>,
    world: Res<ExtractedVolumes>,
    pipelines: Res<PipelineCache>,
    bevy: (
        Option<Res<DeferredLightingLayout>>,
        Option<Res<ViewKeyCache>>,
    ),
    views: Query<(Entity, &ExtractedView), DeferredViews>,
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
