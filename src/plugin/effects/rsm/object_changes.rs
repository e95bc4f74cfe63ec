//! Detection of changes that the reflective shadow maps show.

use crate::plugin::effects::rsm::map_cameras::{GiRsmCamera, RsmMesh, RsmRequests};
use bevy::asset::AssetEvent;
use bevy::camera::visibility::{InheritedVisibility, RenderLayers, VisibilityRange};
use bevy::ecs::prelude::*;
use bevy::ecs::system::SystemParam;
use bevy::image::Image;
use bevy::mesh::morph::MeshMorphWeights;
use bevy::mesh::skinning::SkinnedMesh;
use bevy::mesh::{Mesh, Mesh3d};
use bevy::pbr::{MeshMaterial3d, StandardMaterial};
use bevy::transform::components::GlobalTransform;

/// A mesh below a reflector.
type RsmMeshFilter = (With<RsmMesh>, With<Mesh3d>, Without<GiRsmCamera>);

/// Changes of a mesh.
type Changes = Or<(
    Added<RsmMesh>,
    Changed<GlobalTransform>,
    Changed<InheritedVisibility>,
    Changed<RenderLayers>,
    Changed<Mesh3d>,
    Changed<MeshMaterial3d<StandardMaterial>>,
    Changed<VisibilityRange>,
)>;

/// Meshes without change detection: animated meshes, and meshes with custom materials.
type WithoutChangeDetection = Or<(
    With<SkinnedMesh>,
    With<MeshMorphWeights>,
    Without<MeshMaterial3d<StandardMaterial>>,
)>;

/// Sources of changes in the maps, apart from their views.
#[derive(SystemParam)]
#[allow(clippy::type_complexity, reason = "filters of queries")]
pub(crate) struct DynamicChanges<'w, 's> {
    changed: Query<'w, 's, (), (RsmMeshFilter, Changes)>,
    without_change_detection: Query<'w, 's, (), (RsmMeshFilter, WithoutChangeDetection)>,
    gone: RemovedComponents<'w, 's, RsmMesh>,
    meshes: MessageReader<'w, 's, AssetEvent<Mesh>>,
    materials: MessageReader<'w, 's, AssetEvent<StandardMaterial>>,
    images: MessageReader<'w, 's, AssetEvent<Image>>,
}

impl DynamicChanges<'_, '_> {
    /// Returns `true` if anything changed since the last call.
    fn any(&mut self) -> bool {
        // Reads all of them, so that no event remains for a later frame.
        let gone = self.gone.read().count() > 0;
        let meshes = (self.meshes.read()).any(|e| !matches!(e, AssetEvent::Unused { .. }));
        let materials = (self.materials.read()).any(|e| !matches!(e, AssetEvent::Unused { .. }));
        let images = (self.images.read()).any(|e| !matches!(e, AssetEvent::Unused { .. }));
        self.meshes.clear();
        self.materials.clear();
        self.images.clear();
        gone || meshes
            || materials
            || images
            || !self.changed.is_empty()
            || !self.without_change_detection.is_empty()
    }
}

/// Stores whether objects may look different in the maps, for the plan's
/// [`MapChangeDetector`](crate::plan::MapChangeDetector). Runs after
/// [`update_rsm_cameras`](super::map_cameras::update_rsm_cameras) and after the frame's asset
/// events.
pub(crate) fn detect_dynamic_changes(
    mut requests: ResMut<RsmRequests>,
    mut motion: DynamicChanges,
) {
    requests.objects_changed = motion.any();
}
