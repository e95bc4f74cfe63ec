//! [`GiSolver`]: solver settings of a baked scene.

use crate::plan::{GiBounceCount, GiColorMode};
use bevy::ecs::prelude::*;
use bevy::reflect::prelude::*;

/// Solver settings of a baked scene. Goes on the root, next to [`GiScene`](super::GiScene), which
/// adds the default. All fields can change in any frame.
#[derive(Component, Reflect, Clone, Debug, Default, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
pub struct GiSolver {
    /// Number of diffuse bounces. Default: [`GiBounceCount::Auto`]. Ignored if the bake stores its
    /// bounces.
    pub bounces: GiBounceCount,
    /// Color channels of the solve. Default: [`GiColorMode::Auto`].
    pub color_mode: GiColorMode,
}
