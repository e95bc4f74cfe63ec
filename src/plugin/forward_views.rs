//! Deferred materials in views without a G-buffer: the plugin's default for opaque materials takes
//! nothing away from other cameras.
//!
//! Bevy 0.19 draws an opaque material of the deferred method in the G-buffer alone.
//! `queue_material_meshes` leaves it out of the main pass of every view (bevy_pbr `material.rs`,
//! arm `RenderPhaseType::Opaque`). Therefore a camera without a deferred prepass shows the clear
//! color. `queue_prepass_material_meshes` adds it to a phase that such a view does not have. It
//! panics if the view has a depth, normal or motion vector prepass (`prepass/mod.rs`,
//! `opaque_deferred_phase.as_mut().unwrap()`). The pipelines of both passes exist, because Bevy
//! specializes them for each view before it checks the method.
//!
//! The systems here run around those two. They add the omitted meshes under the keys that Bevy uses
//! for forward materials, over the same lists of changed meshes. A view without a deferred prepass
//! is then drawn as with `DefaultOpaqueRendererMethod::forward()`.
//!
//! Masked materials have the opposite fault: a view with a G-buffer draws them in it and again in
//! the main pass. In a view with a display, the second draw would add the light of a volume to
//! pixels that the display lights. It is removed there.

use super::extract::ExtractedGi;
use crate::plan::ViewId;
use bevy::app::SubApp;
use bevy::core_pipeline::core_3d::{AlphaMask3d, Opaque3d, Opaque3dBatchSetKey, Opaque3dBinKey};
use bevy::core_pipeline::deferred::{AlphaMask3dDeferred, Opaque3dDeferred};
use bevy::core_pipeline::prepass::{
    AlphaMask3dPrepass, DeferredPrepass, Opaque3dPrepass, OpaqueNoLightmap3dBatchSetKey,
    OpaqueNoLightmap3dBinKey,
};
use bevy::ecs::prelude::*;
use bevy::material::labels::DrawFunctionId;
use bevy::material::{MaterialProperties, OpaqueRendererMethod, RenderPhaseType};
use bevy::mesh::Mesh3d;
use bevy::pbr::{
    MainPassOpaqueDrawFunction, PendingMeshMaterialQueues, PendingPrepassMeshMaterialQueues,
    PreparedMaterial, PrepassOpaqueDepthOnlyDrawFunction, RenderMaterialInstances,
    RenderMeshInstances, RenderMeshQueueData, SpecializedMaterialPipelineCache,
    SpecializedPrepassMaterialPipelineCache, check_views_need_specialization,
    queue_material_meshes, queue_prepass_material_meshes,
};
use bevy::platform::collections::HashSet;
use bevy::render::batching::gpu_preprocessing::{GpuPreprocessingMode, GpuPreprocessingSupport};
use bevy::render::camera::{DirtySpecializations, PendingQueues};
use bevy::render::erased_render_asset::ErasedRenderAssets;
use bevy::render::mesh::allocator::{MeshAllocator, MeshSlabs};
use bevy::render::render_phase::{BinnedRenderPhaseType, ViewBinnedRenderPhases};
use bevy::render::render_resource::CachedRenderPipelineId;
use bevy::render::sync_world::MainEntity;
use bevy::render::view::{ExtractedView, RenderVisibleEntities, RetainedViewEntity};
use bevy::render::{Render, RenderSystems};

/// Adds the systems to the render world.
pub(crate) fn add_systems(app: &mut SubApp) {
    app.init_resource::<BorrowedPhases>().add_systems(
        Render,
        (
            (
                open_phases.before(queue_prepass_material_meshes),
                queue_prepasses.after(queue_prepass_material_meshes),
                queue_main_pass.after(queue_material_meshes),
            )
                .in_set(RenderSystems::QueueMeshes)
                .run_if(resource_exists::<RenderMeshInstances>),
            requeue_masked
                .in_set(RenderSystems::PrepareAssets)
                .after(check_views_need_specialization)
                .run_if(resource_exists::<ExtractedGi>),
            dequeue_masked
                .in_set(RenderSystems::QueueMeshes)
                .after(queue_material_meshes)
                .run_if(resource_exists::<ExtractedGi>),
        ),
    );
}

/// Resources of [`ChangedMeshes`], as the parameter of a system.
type ChangedResources<'w> = (
    Res<'w, DirtySpecializations>,
    Res<'w, RenderMeshInstances>,
    Res<'w, RenderMaterialInstances>,
    Res<'w, ErasedRenderAssets<PreparedMaterial>>,
    Res<'w, MeshAllocator>,
    Res<'w, GpuPreprocessingSupport>,
);

/// Meshes that changed since the last frame. No `SystemParam`, as
/// [`ExtractedWorld`](super::observe::ExtractedWorld).
struct ChangedMeshes<'w> {
    dirty: Res<'w, DirtySpecializations>,
    meshes: Res<'w, RenderMeshInstances>,
    used: Res<'w, RenderMaterialInstances>,
    materials: Res<'w, ErasedRenderAssets<PreparedMaterial>>,
    allocator: Res<'w, MeshAllocator>,
    support: Res<'w, GpuPreprocessingSupport>,
}

impl<'w> From<ChangedResources<'w>> for ChangedMeshes<'w> {
    fn from((dirty, meshes, used, materials, allocator, support): ChangedResources<'w>) -> Self {
        Self {
            dirty,
            meshes,
            used,
            materials,
            allocator,
            support,
        }
    }
}

/// Mesh of a deferred material, and the data of its phase keys.
struct DeferredMesh<'a> {
    entity: (Entity, MainEntity),
    material: &'a PreparedMaterial,
    mesh: RenderMeshQueueData<'a>,
    slabs: MeshSlabs,
    phase_type: BinnedRenderPhaseType,
}

impl ChangedMeshes<'_> {
    /// Meshes of deferred materials among those that Bevy queues for this view in this frame.
    fn deferred<'a>(
        &'a self,
        view: RetainedViewEntity,
        visible: &'a RenderVisibleEntities,
        pending: &'a PendingQueues,
    ) -> impl Iterator<Item = DeferredMesh<'a>> {
        let both = visible.get::<Mesh3d>().zip(pending.get(&view));
        both.into_iter().flat_map(move |(visible, pending)| {
            (self.dirty)
                .iter_to_queue(view, visible, &pending.prev_frame)
                .filter_map(|(entity, main)| self.find(*entity, *main))
        })
    }

    /// Returns the mesh of an entity. `None` if its material is not deferred, or an asset is
    /// missing. In that case Bevy queues it in a later frame.
    fn find(&self, entity: Entity, main: MainEntity) -> Option<DeferredMesh<'_>> {
        let used = self.used.instances.get(&main)?;
        let material = self.materials.get(used.asset_id)?;
        if material.properties.render_method != OpaqueRendererMethod::Deferred {
            return None;
        }
        let mesh = self.meshes.render_mesh_queue_data(main)?;
        let slabs = self.allocator.mesh_slabs(&mesh.mesh_asset_id())?;
        Some(DeferredMesh {
            entity: (entity, main),
            material,
            slabs,
            phase_type: BinnedRenderPhaseType::mesh(mesh.should_batch(), &self.support),
            mesh,
        })
    }
}

impl DeferredMesh<'_> {
    fn properties(&self) -> &MaterialProperties {
        &self.material.properties
    }

    fn prepass_keys(
        &self,
        pipeline: CachedRenderPipelineId,
        draw_function: DrawFunctionId,
    ) -> (OpaqueNoLightmap3dBatchSetKey, OpaqueNoLightmap3dBinKey) {
        let depth_only = self
            .properties()
            .get_draw_function(PrepassOpaqueDepthOnlyDrawFunction);
        let set = OpaqueNoLightmap3dBatchSetKey {
            pipeline,
            draw_function,
            material_bind_group_index: (Some(draw_function) != depth_only)
                .then_some(self.material.binding.group.0),
            slabs: self.slabs,
        };
        let bin = OpaqueNoLightmap3dBinKey {
            asset_id: self.mesh.mesh_asset_id().into(),
        };
        (set, bin)
    }
}

/// Views that have phases of the G-buffer while Bevy queues their prepasses.
#[derive(Resource, Default)]
pub(crate) struct BorrowedPhases(Vec<RetainedViewEntity>);

/// Gives the phases of a G-buffer to views that draw a prepass and no G-buffer: Bevy adds deferred
/// meshes to them without a test that they exist.
pub(crate) fn open_phases(
    mut borrowed: ResMut<BorrowedPhases>,
    prepasses: Res<ViewBinnedRenderPhases<Opaque3dPrepass>>,
    mut opaque: ResMut<ViewBinnedRenderPhases<Opaque3dDeferred>>,
    mut masked: ResMut<ViewBinnedRenderPhases<AlphaMask3dDeferred>>,
) {
    borrowed.0.clear();
    for view in prepasses.keys().filter(|view| !opaque.contains_key(*view)) {
        borrowed.0.push(*view);
    }
    for view in &borrowed.0 {
        opaque.prepare_for_new_frame(*view, GpuPreprocessingMode::None);
        masked.prepare_for_new_frame(*view, GpuPreprocessingMode::None);
    }
}

/// Phases of opaque meshes and of meshes with an alpha mask.
type Phases<'w, O, M> = (
    ResMut<'w, ViewBinnedRenderPhases<O>>,
    ResMut<'w, ViewBinnedRenderPhases<M>>,
);

/// Removes those phases again, and adds the meshes to the prepasses that the views have.
pub(crate) fn queue_prepasses(
    borrowed: Res<BorrowedPhases>,
    (mut opaque_deferred, mut masked_deferred): Phases<Opaque3dDeferred, AlphaMask3dDeferred>,
    (mut opaque, mut masked): Phases<Opaque3dPrepass, AlphaMask3dPrepass>,
    pipelines: Res<SpecializedPrepassMaterialPipelineCache>,
    pending: Res<PendingPrepassMeshMaterialQueues>,
    views: Query<(&ExtractedView, &RenderVisibleEntities)>,
    changed: ChangedResources,
) {
    let changed = ChangedMeshes::from(changed);
    for view in &borrowed.0 {
        opaque_deferred.remove(view);
        masked_deferred.remove(view);
    }
    for (view, visible) in &views {
        let view = view.retained_view_entity;
        if !borrowed.0.contains(&view) {
            continue;
        }
        let (Some(opaque), Some(masked), Some(pipelines)) = (
            opaque.get_mut(&view),
            masked.get_mut(&view),
            pipelines.get(&view),
        ) else {
            continue;
        };
        for item in changed.deferred(view, visible, &pending) {
            let Some(&(_, pipeline, draw_function)) = pipelines.get(&item.entity.1) else {
                continue;
            };
            let (set, bin) = item.prepass_keys(pipeline, draw_function);
            let uniform = item.mesh.current_uniform_index;
            match item.properties().render_phase_type {
                RenderPhaseType::Opaque => {
                    opaque.add(set, bin, item.entity, uniform, item.phase_type);
                }
                RenderPhaseType::AlphaMask => {
                    masked.add(set, bin, item.entity, uniform, item.phase_type);
                }
                _ => {}
            }
        }
    }
}

/// Adds deferred opaque meshes to the main pass of views without a G-buffer.
pub(crate) fn queue_main_pass(
    mut phases: ResMut<ViewBinnedRenderPhases<Opaque3d>>,
    pipelines: Res<SpecializedMaterialPipelineCache>,
    pending: Res<PendingMeshMaterialQueues>,
    views: Query<(&ExtractedView, &RenderVisibleEntities), Without<DeferredPrepass>>,
    changed: ChangedResources,
) {
    let changed = ChangedMeshes::from(changed);
    for (view, visible) in &views {
        let view = view.retained_view_entity;
        let (Some(phase), Some(pipelines)) = (phases.get_mut(&view), pipelines.get(&view)) else {
            continue;
        };
        for item in changed.deferred(view, visible, &pending) {
            let properties = item.properties();
            if !matches!(properties.render_phase_type, RenderPhaseType::Opaque) {
                continue;
            }
            let (Some(&pipeline), Some(draw_function)) = (
                pipelines.get(&item.entity.1),
                properties.get_draw_function(MainPassOpaqueDrawFunction),
            ) else {
                continue;
            };
            let lightmap = item.mesh.lightmap_slab_index();
            phase.add(
                Opaque3dBatchSetKey {
                    pipeline,
                    draw_function,
                    material_bind_group_index: Some(item.material.binding.group.0),
                    slabs: item.slabs,
                    lightmap_slab: lightmap.map(|index| *index),
                },
                Opaque3dBinKey {
                    asset_id: item.mesh.mesh_asset_id().into(),
                },
                (Entity::PLACEHOLDER, item.entity.1),
                item.mesh.current_uniform_index,
                item.phase_type,
            );
        }
    }
}

/// Returns `true` if a view has a display on its G-buffer.
fn displays(world: &ExtractedGi, view: &ExtractedView) -> bool {
    let id = ViewId(view.retained_view_entity.main_entity.to_bits());
    let own = world.views.iter().find(|v| v.id == id);
    own.is_some_and(|v| v.has_gbuffer && !v.forward && v.settings.enabled)
}

/// Requests a new queue of all meshes of a view whose display was added or removed.
pub(crate) fn requeue_masked(
    world: Res<ExtractedGi>,
    views: Query<&ExtractedView>,
    mut dirty: ResMut<DirtySpecializations>,
    mut before: Local<HashSet<RetainedViewEntity>>,
) {
    let now: HashSet<_> = (views.iter())
        .filter(|view| displays(&world, view))
        .map(|view| view.retained_view_entity)
        .collect();
    dirty.views.extend(now.symmetric_difference(&before));
    *before = now;
}

/// Takes deferred masked meshes out of the main pass of views that display them in their G-buffer.
pub(crate) fn dequeue_masked(
    world: Res<ExtractedGi>,
    mut phases: ResMut<ViewBinnedRenderPhases<AlphaMask3d>>,
    pending: Res<PendingMeshMaterialQueues>,
    views: Query<(&ExtractedView, &RenderVisibleEntities), With<DeferredPrepass>>,
    changed: ChangedResources,
) {
    let changed = ChangedMeshes::from(changed);
    for (view, visible) in views.iter().filter(|(view, _)| displays(&world, view)) {
        let view = view.retained_view_entity;
        let Some(phase) = phases.get_mut(&view) else {
            continue;
        };
        for item in changed.deferred(view, visible, &pending) {
            let kind = item.properties().render_phase_type;
            if matches!(kind, RenderPhaseType::AlphaMask) {
                phase.remove(item.entity.1);
            }
        }
    }
}
