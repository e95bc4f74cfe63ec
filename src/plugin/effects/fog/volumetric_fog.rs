//! [`GiVolumetricFog`]: indirect light in Bevy's volumetric fog.

use crate::plugin::effects::volume::irradiance_volume::GiIrradianceVolume;
use bevy::ecs::prelude::*;
use bevy::reflect::prelude::*;

/// Indirect light in Bevy's volumetric fog ([`VolumetricFog`](bevy::light::VolumetricFog)). Goes on
/// the root of a scene, next to [`GiScene`](crate::plugin::GiScene). The fog reads the scene's
/// [`GiIrradianceVolume`], which this component adds.
///
/// Every camera with a fog volume of the scene in view shows it, at every pixel and without noise.
/// A ray takes one step per two voxels, at most `step_count`. Each fog volume attenuates only the
/// light that it scatters itself. If scenes overlap, the first lights the fog there, of at most
/// five.
///
/// Set the `ambient_intensity` of the cameras' fog to 0. It is added otherwise.
#[derive(Component, Reflect, Clone, Copy, Debug, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
#[require(GiIrradianceVolume)]
pub struct GiVolumetricFog {
    /// Factor on the scattered indirect light, 0 or more. 0 disables it. Default: 1, the physical
    /// value.
    pub intensity: f32,
}

impl Default for GiVolumetricFog {
    fn default() -> Self {
        Self { intensity: 1.0 }
    }
}
