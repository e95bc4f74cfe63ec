//! The marker that leaves entities out of a bake.

use bevy::ecs::prelude::*;
use bevy::reflect::prelude::*;

/// Leaves this entity and everything below it out of bakes from entities
/// ([`GiBakeRequest`](super::GiBakeRequest)): characters, moving things, sky domes.
#[derive(Component, Reflect, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
pub struct GiBakeExclude;
