//! [`GiReflectiveShadowMap`]: one bounce of a light from dynamic objects.

use bevy::ecs::prelude::*;
use bevy::reflect::prelude::*;
use meshless_gi::internals::frame::rsm_layout::side;

/// One bounce of this light from [`GiReflector`](crate::GiReflector)s, by a reflective shadow map.
/// Goes on a point, spot or directional light. It costs nothing if no dynamic object is in range.
///
/// A [`GiLight`](crate::GiLight) on the same entity that is disabled disables this bounce too.
#[derive(Component, Reflect, Clone, Debug, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
pub struct GiReflectiveShadowMap {
    /// Width of a map in texels: a power of two from 8 to 256. Other values are rounded down. A
    /// point light may need up to six maps, see [`map_views`](crate::plan::map_views). Default: 64.
    pub resolution: u32,
    /// Number of virtual point lights of all maps of the light, 1 to 1024. The cost per pixel is
    /// proportional to it. Default: 128.
    pub vpl_count: u32,
    /// Shadows from baked geometry, by rays through the first bake that a camera shows: for the
    /// light on dynamic objects and for the reflected light. The reflected light of all lights is
    /// shadowed together if one of them enables it. Default: `true`.
    pub trace_shadows: bool,
}

impl Default for GiReflectiveShadowMap {
    fn default() -> Self {
        Self {
            resolution: 64,
            vpl_count: 128,
            trace_shadows: true,
        }
    }
}

impl GiReflectiveShadowMap {
    /// Returns the width of a map in texels, rounded to a power of two.
    #[must_use]
    pub fn texels(&self) -> u32 {
        side(self.resolution.max(8))
    }
}
