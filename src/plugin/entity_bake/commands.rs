//! The command that bakes the meshes below an entity.

use super::request::GiBakeRequest;
use bevy::ecs::prelude::*;

/// Adds [`bake_gi`](Self::bake_gi) to `EntityCommands` and `EntityWorldMut`.
pub trait GiBakeCommands {
    /// Bakes the static meshes on this entity and below it. `request` is a
    /// [`Recipe`](meshless_gi::Recipe), a [`Preset`](meshless_gi::Preset), or a
    /// [`GiBakeRequest`], which can name a file.
    ///
    /// ```no_run
    /// use bevy::prelude::*;
    /// use bevy_meshless_gi::prelude::*;
    ///
    /// fn bake(root: Entity, commands: &mut Commands) {
    ///     let request = GiBakeRequest::new(Recipe::default()).save_to("assets/room.mgi");
    ///     commands.entity(root).bake_gi(request);
    /// }
    /// ```
    fn bake_gi(&mut self, request: impl Into<GiBakeRequest>) -> &mut Self;
}

impl GiBakeCommands for EntityCommands<'_> {
    fn bake_gi(&mut self, request: impl Into<GiBakeRequest>) -> &mut Self {
        self.try_insert(request.into())
    }
}

impl GiBakeCommands for EntityWorldMut<'_> {
    fn bake_gi(&mut self, request: impl Into<GiBakeRequest>) -> &mut Self {
        self.insert(request.into())
    }
}
