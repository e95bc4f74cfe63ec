//! Component of cameras that enables specular reflections of virtual lights.

use bevy::ecs::prelude::*;
use bevy::reflect::prelude::*;
use meshless_gi::SpecularSettings;

/// Specular reflections of dynamic objects' light in a camera: smooth and metallic surfaces show
/// highlights of the virtual lights of
/// [`GiReflectiveShadowMap`](crate::plugin::GiReflectiveShadowMap)s. Goes next to
/// [`GiCamera`](crate::plugin::GiCamera).
///
/// Each virtual light is evaluated where it changes on the screen, and interpolated elsewhere
/// (\[N09\] §3.3.1). It costs nothing if no virtual light is in view.
#[derive(Component, Reflect, Clone, Copy, Debug, Default, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
pub struct GiSpecular(pub SpecularSettings);
