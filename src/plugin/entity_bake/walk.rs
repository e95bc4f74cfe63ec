//! Visits the hierarchy below a root: static meshes with their transforms in the root's space.

use super::exclude::GiBakeExclude;
use super::request::GiBakeRequest;
#[cfg(feature = "point_clouds")]
use crate::plugin::GiPointCloud;
use crate::plugin::point_cloud::PointCloudPart;
use crate::plugin::{GiOccluder, GiReflector, GiScene};
use bevy::asset::Handle;
use bevy::camera::visibility::Visibility;
use bevy::ecs::prelude::*;
use bevy::math::{DMat4, DQuat};
use bevy::mesh::skinning::SkinnedMesh;
use bevy::mesh::{Mesh, Mesh3d};
use bevy::transform::components::Transform;
use bevy::world_serialization::{DynamicWorldRoot, WorldAssetRoot};
use meshless_gi::internals::scene::MeshNode;

/// Everything below a root that matters to a bake.
pub(super) struct Walk {
    pub(super) root: Entity,
    pub(super) meshes: Vec<StaticMesh>,
    /// Entities with a scene that is, or will be, spawned below them.
    pub(super) scenes: Vec<Entity>,
    #[cfg(feature = "point_clouds")]
    pub(super) point_clouds: Vec<Entity>,
    /// Names and parents of the visited entities, parents first.
    pub(super) nodes: Vec<MeshNode>,
}

/// A mesh that stays where it is.
pub(super) struct StaticMesh {
    pub(super) entity: Entity,
    pub(super) mesh: Handle<Mesh>,
    /// Transform from the mesh's space to that of the root.
    pub(super) to_root: DMat4,
    /// Index into [`Walk::nodes`].
    pub(super) node: u32,
}

/// Visits `root` and everything below it, depth first.
pub(super) fn walk(world: &World, root: Entity) -> Walk {
    let mut walk = Walk {
        root,
        meshes: Vec::new(),
        scenes: Vec::new(),
        #[cfg(feature = "point_clouds")]
        point_clouds: Vec::new(),
        nodes: Vec::new(),
    };
    // The root's own transform and visibility are not part of the bake.
    let mut open = vec![(root, DMat4::IDENTITY, None, true)];
    while let Some((entity, to_root, parent, visible)) = open.pop() {
        let Ok(entity) = world.get_entity(entity) else {
            continue;
        };
        if entity.id() != root && is_excluded(entity) {
            continue;
        }
        let node = walk.nodes.len() as u32;
        walk.nodes.push(MeshNode {
            name: node_name(entity),
            parent,
        });
        walk.visit(entity, to_root, node, visible);
        let children = entity.get::<Children>().into_iter().flatten();
        for child in children.copied().collect::<Vec<_>>().into_iter().rev() {
            let transform = world.get::<Transform>(child).map_or(DMat4::IDENTITY, local);
            let visible = match world.get::<Visibility>(child) {
                Some(Visibility::Hidden) => false,
                Some(Visibility::Visible) => true,
                Some(Visibility::Inherited) | None => visible,
            };
            open.push((child, to_root * transform, Some(node), visible));
        }
    }
    walk
}

impl Walk {
    fn visit(&mut self, entity: EntityRef, to_root: DMat4, node: u32, visible: bool) {
        if entity.contains::<WorldAssetRoot>() || entity.contains::<DynamicWorldRoot>() {
            self.scenes.push(entity.id());
        }
        let is_cloud = is_point_cloud(entity);
        #[cfg(feature = "point_clouds")]
        if entity.contains::<GiPointCloud>() {
            self.point_clouds.push(entity.id());
        }
        if let Some(mesh) = entity.get::<Mesh3d>()
            && visible
            && !is_cloud
            && !entity.contains::<SkinnedMesh>()
        {
            self.meshes.push(StaticMesh {
                entity: entity.id(),
                mesh: mesh.0.clone(),
                to_root,
                node,
            });
        }
    }
}

/// Returns `true` for point clouds and their parts, which are drawn as meshes.
#[cfg(feature = "point_clouds")]
fn is_point_cloud(entity: EntityRef) -> bool {
    entity.contains::<GiPointCloud>() || entity.contains::<PointCloudPart>()
}

#[cfg(not(feature = "point_clouds"))]
fn is_point_cloud(_: EntityRef) -> bool {
    false
}

/// Returns `true` if the bake excludes an entity below the root and its descendants.
fn is_excluded(entity: EntityRef) -> bool {
    entity.contains::<GiBakeExclude>()
        || entity.contains::<GiReflector>()
        || entity.contains::<GiScene>()
        || entity.contains::<GiBakeRequest>()
}

/// The name that the recipe's occluders refer to.
fn node_name(entity: EntityRef) -> String {
    match (entity.get::<GiOccluder>(), entity.get::<Name>()) {
        (Some(occluder), _) => occluder.name.clone(),
        (None, Some(name)) => name.as_str().into(),
        (None, None) => String::new(),
    }
}

/// Local transform in double precision, so that scenes of many nodes do not depend on the position
/// of the root.
fn local(transform: &Transform) -> DMat4 {
    DMat4::from_scale_rotation_translation(
        transform.scale.as_dvec3(),
        DQuat::from_array(transform.rotation.to_array().map(f64::from)),
        transform.translation.as_dvec3(),
    )
}
