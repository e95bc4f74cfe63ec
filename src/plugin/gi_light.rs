//! [`GiLight`]: contribution of a light to indirect lighting.

use bevy::ecs::prelude::*;
use bevy::reflect::prelude::*;

/// Contribution of a light to indirect lighting. Optional, on any of Bevy's lights. A light without
/// it contributes fully.
#[derive(Component, Reflect, Clone, Debug, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
pub struct GiLight {
    /// The light contributes to indirect lighting. `false` leaves direct light only. Default:
    /// `true`.
    pub enabled: bool,
    /// Factor on the light's indirect contribution, 0 or more. Default: 1, the physical value.
    pub intensity: f32,
    /// Approximate number of samples of a [`RectLight`](bevy::light::RectLight). Each sample costs
    /// as much as a point light when the light moves. Default: 16.
    pub area_samples: u32,
}

impl Default for GiLight {
    fn default() -> Self {
        Self {
            enabled: true,
            intensity: 1.0,
            area_samples: 16,
        }
    }
}
