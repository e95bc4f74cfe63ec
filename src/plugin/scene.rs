//! [`GiScene`]: the component that gives a scene its baked indirect light.

use super::asset::GiBakedScene;
use super::environment::GiEnvironment;
use super::quality::GiActiveTier;
use super::solver::GiSolver;
use crate::plan::GiQuality;
use bevy::asset::Handle;
use bevy::camera::visibility::Visibility;
use bevy::ecs::prelude::*;
use bevy::reflect::prelude::*;
use bevy::transform::components::Transform;

/// Baked indirect light of a scene. Add it to the root entity of the scene.
///
/// The root's [`GlobalTransform`](bevy::transform::components::GlobalTransform) moves, rotates and
/// scales the bake. A non-uniform scale is replaced by its mean, with one warning.
///
/// `RenderLayers` of the root select the cameras that show the bake and the lights that contribute
/// to it. Without them the scene is on layer 0.
#[derive(Component, Reflect, Clone, Debug, Default, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
#[require(
    Transform,
    Visibility,
    GiEnvironment,
    GiSolver,
    GiQuality,
    GiActiveTier
)]
pub struct GiScene(pub Handle<GiBakedScene>);
