//! [`GiCamera`]: the component that shows indirect light in a deferred camera.

use super::effects::display::splatting::GiSplatting;
use bevy::camera::Hdr;
use bevy::core_pipeline::prepass::{DeferredPrepass, DepthPrepass, NormalPrepass};
use bevy::ecs::lifecycle::HookContext;
use bevy::ecs::prelude::*;
use bevy::ecs::world::DeferredWorld;
use bevy::reflect::prelude::*;
use bevy::render::view::Msaa;

/// Indirect light in a camera.
///
/// The component adds the prepasses that the composite pass reads, and turns MSAA off. It works on
/// deferred, high-dynamic-range cameras with one sample per pixel.
#[derive(Component, Reflect, Clone, Debug, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
#[require(Hdr, DepthPrepass, NormalPrepass, DeferredPrepass, Msaa = Msaa::Off, GiSplatting)]
#[component(on_insert = disable_msaa)]
pub struct GiCamera {
    /// Shows indirect light. `false` runs no pass of the plugin for this camera and frees GPU
    /// memory that no other camera uses. The prepasses stay. Default: `true`.
    pub enabled: bool,
    /// Factor on the indirect light, 0 or more. Default: 1, the physical value.
    pub intensity: f32,
    /// Displayed light, for debugging. Default: [`GiDebugView::Final`].
    pub debug_view: GiDebugView,
}

/// Sets the MSAA of the camera to one sample per pixel, as deferred rendering requires. Bevy's
/// camera component adds the default of four samples before the requirement of [`GiCamera`]
/// applies.
fn disable_msaa(mut world: DeferredWorld, context: HookContext) {
    if let Some(mut msaa) = world.get_mut::<Msaa>(context.entity) {
        msaa.set_if_neq(Msaa::Off);
    }
}

impl Default for GiCamera {
    fn default() -> Self {
        Self {
            enabled: true,
            intensity: 1.0,
            debug_view: GiDebugView::Final,
        }
    }
}

/// Light that a camera displays.
#[derive(Reflect, Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[reflect(Default, Clone, Debug, PartialEq, Hash)]
#[non_exhaustive]
pub enum GiDebugView {
    /// Direct and indirect light: the final picture.
    #[default]
    Final,
    /// Indirect light only.
    IndirectOnly,
    /// Indirect irradiance, displayed as the radiance of a white surface.
    Irradiance,
}
