//! Scenes and assets below a root that are not there yet.

use super::label;
use super::material::images_of;
use super::walk::Walk;
use bevy::asset::{Asset, AssetId, AssetServer, Assets, LoadState};
use bevy::ecs::prelude::*;
use bevy::image::Image;
use bevy::mesh::Mesh;
use bevy::pbr::{MeshMaterial3d, StandardMaterial};
use bevy::world_serialization::{
    DynamicWorldRoot, WorldAssetRoot, WorldInstance, WorldInstanceSpawner,
};

/// State of a scene or an asset.
pub(super) enum State {
    Ready,
    /// The data may still arrive.
    Pending,
    /// The data never arrives, with the reason.
    Missing(String),
}

/// Returns the first scene or asset that a bake has to wait for. `None` if there is none.
pub(super) fn pending(world: &World, walk: &Walk) -> Option<String> {
    let waits = |state: State| matches!(state, State::Pending);
    for &entity in &walk.scenes {
        if waits(scene_state(world, entity)) {
            return Some(format!("the scene of {}", label(world, entity)));
        }
    }
    for found in &walk.meshes {
        let of = || label(world, found.entity);
        if waits(asset_state::<Mesh>(world, found.mesh.id())) {
            return Some(format!("the mesh of {}", of()));
        }
        let material = world.get::<MeshMaterial3d<StandardMaterial>>(found.entity);
        let Some(material) = material else {
            continue;
        };
        if waits(asset_state::<StandardMaterial>(world, material.id())) {
            return Some(format!("the material of {}", of()));
        }
        let materials = world.get_resource::<Assets<StandardMaterial>>();
        let Some(material) = materials.and_then(|all| all.get(material.id())) else {
            continue;
        };
        for image in images_of(material).into_iter().flatten() {
            if waits(asset_state::<Image>(world, image.id())) {
                return Some(format!("an image of the material of {}", of()));
            }
        }
    }
    None
}

/// State of an asset.
pub(super) fn asset_state<A: Asset>(world: &World, id: AssetId<A>) -> State {
    let all = world.get_resource::<Assets<A>>();
    if all.is_some_and(|all| all.contains(id)) {
        return State::Ready;
    }
    let (Some(_), AssetId::Index { .. }) = (all, id) else {
        return State::Missing("there is no such asset".into());
    };
    let server = world.get_resource::<AssetServer>();
    match server.and_then(|server| server.get_load_state(id)) {
        Some(LoadState::Failed(error)) => State::Missing(error.to_string()),
        // A handle may have been reserved for an asset that is added later.
        _ => State::Pending,
    }
}

/// State of an entity's scene.
pub(super) fn scene_state(world: &World, entity: Entity) -> State {
    let Some(spawner) = world.get_resource::<WorldInstanceSpawner>() else {
        return State::Missing("the app has no `WorldSerializationPlugin`".into());
    };
    let spawned = world.get::<WorldInstance>(entity);
    if spawned.is_some_and(|instance| spawner.instance_is_ready(**instance)) {
        return State::Ready;
    }
    let root = world.get::<WorldAssetRoot>(entity);
    let dynamic = world.get::<DynamicWorldRoot>(entity);
    let state = match (root, dynamic) {
        (Some(root), _) => asset_state(world, root.id()),
        (None, Some(root)) => asset_state(world, root.id()),
        (None, None) => State::Ready,
    };
    match state {
        // Loaded, and spawned in one of the next frames.
        State::Ready => State::Pending,
        other => other,
    }
}
