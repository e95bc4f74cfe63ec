//! [`GiReflector`]: dynamic objects that reflect light.

use bevy::ecs::prelude::*;
use bevy::reflect::prelude::*;

/// Dynamic object: this entity and its descendants reflect light that no bake contains. Lights with
/// [`GiReflectiveShadowMap`](crate::GiReflectiveShadowMap) add one diffuse bounce from its meshes
/// onto everything that cameras with [`GiCamera`](crate::plugin::GiCamera) show.
///
/// Meshes must be deferred, and opaque or masked. Others reflect nothing. Do not add it to baked
/// meshes, because their light would be counted twice.
#[derive(Component, Reflect, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
pub struct GiReflector;
