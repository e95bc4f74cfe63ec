//! Components of types that this crate can't name, read through Bevy's type registry.

use bevy::ecs::prelude::*;
use bevy::ecs::reflect::{AppTypeRegistry, ReflectComponent};

/// Returns `true` if a material of another type than `StandardMaterial` may draw an entity.
pub(super) fn has_custom_material(world: &World, entity: Entity) -> bool {
    let Some(types) = world.get_resource::<AppTypeRegistry>() else {
        return false;
    };
    let types = types.read();
    let Ok(components) = world.inspect_entity(entity) else {
        return false;
    };
    let mut ids = components.filter_map(|component| component.type_id());
    // `MaterialPlugin` registers the component of its material.
    let path = |id| types.get_type_info(id).map(|info| info.type_path());
    ids.any(|id| {
        path(id).is_some_and(|p| p.starts_with("bevy_pbr::mesh_material::MeshMaterial3d<"))
    })
}

/// The name of the glTF material of an entity. Read by reflection: the type is that of bevy_gltf,
/// which an app may not have.
pub(super) fn gltf_material_name(world: &World, entity: Entity) -> Option<String> {
    let types = world.get_resource::<AppTypeRegistry>()?.read();
    let registration = types.get_with_type_path("bevy_gltf::assets::GltfMaterialName")?;
    let reflected = registration.data::<ReflectComponent>()?;
    let name = reflected.reflect(world.get_entity(entity).ok()?)?;
    let name = name.reflect_ref().as_tuple_struct().ok()?.field(0)?;
    name.try_downcast_ref::<String>().cloned()
}
