//! [`GiEnvironment`]: light of a baked scene that does not come from Bevy's lights.

use super::sky::GiSky;
use bevy::ecs::prelude::*;
use bevy::reflect::prelude::*;

/// Sky and emissive light of a baked scene. Goes on the root, next to
/// [`GiScene`](super::GiScene), which adds the default. All fields can change in any frame.
///
/// Quantities are Bevy's photometric ones. The core's watts correspond to lumens one to one.
#[derive(Component, Reflect, Clone, Debug, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
pub struct GiEnvironment {
    /// Radiance of the sky. It arrives from every direction that hits no surface, so walls block
    /// it. Use it in place of Bevy's ambient light. Default: none.
    pub sky: GiSky,
    /// Luminance of a baked emissive value of 1, cd/m². 0 disables emissive light.
    ///
    /// Bevy displays emissive materials independently of the exposure. The default 998 gives the
    /// same brightness at Bevy's default exposure (EV100 9.7): 1.2 · 2^9.7 ≈ 998.
    pub emissive_luminance: f32,
}

impl Default for GiEnvironment {
    fn default() -> Self {
        Self {
            sky: GiSky::None,
            emissive_luminance: 998.0,
        }
    }
}
