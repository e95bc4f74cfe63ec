//! [`GiSettings`]: settings of the plugin.

use bevy::ecs::prelude::*;
use bevy::reflect::prelude::*;

/// Settings of the plugin.
#[derive(Resource, Reflect, Clone, Debug, PartialEq)]
#[reflect(Resource, Default, Clone, Debug, PartialEq)]
pub struct GiSettings {
    /// Number of frames without a camera that shows a scene, after which the scene's GPU memory is
    /// freed. Default: 120.
    pub unload_after_frames: u32,
    /// Warns about settings of the game that would count light twice, Bevy's ambient light for
    /// example. Default: `true`.
    pub warn_double_counting: bool,
}

impl Default for GiSettings {
    fn default() -> Self {
        Self {
            unload_after_frames: 120,
            warn_double_counting: true,
        }
    }
}
