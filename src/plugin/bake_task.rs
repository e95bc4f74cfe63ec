//! Baking inside a running game: a component that bakes in the background and becomes the scene's light when it is done.
//!
//! ```no_run
//! # use bevy::prelude::*;
//! # use bevy_meshless_gi::{bake::Recipe, plugin::MeshlessGiBake, scene::{TriangleMesh, cornell_box, mesh_of_quads}};
//! # fn level() -> TriangleMesh { mesh_of_quads(&cornell_box()) }
//! fn start(mut commands: Commands) {
//!     // `level()` makes a `TriangleMesh` in the local space of the entity that it is spawned on.
//!     commands.spawn((Transform::default(), MeshlessGiBake::spawn(level(), Recipe::default())));
//! }
//! ```
//!
//! The bake runs on threads of its own, one less than the machine has, so that the game stays alive; none of Bevy's task pools
//! waits for it. Despawning the entity or removing the component cancels it.

use super::asset::MeshlessGiAsset;
use super::background::Background;
use super::components::MeshlessGi;
use crate::bake::{BakeLevelError, Baked, Progress, Recipe, Stage, bake_level};
use crate::scene::TriangleMesh;
use bevy::asset::Assets;
use bevy::ecs::prelude::*;
use bevy::log::{debug, error};
use bevy::reflect::prelude::*;
use std::sync::Arc;

/// A bake under way. When it is done the entity gets a [`MeshlessGi`] and an event [`MeshlessGiBaked`]; when it fails, a
/// [`MeshlessGiBakeFailed`]. Dropping it cancels the bake.
#[derive(Component)]
pub struct MeshlessGiBake {
    progress: Arc<Progress>,
    work: Result<Baking, String>,
}

/// A bake on another thread.
pub(crate) type Baking = Background<Result<Baked, BakeLevelError>>;

impl MeshlessGiBake {
    /// Starts a bake of `level`.
    #[must_use]
    pub fn spawn(level: TriangleMesh, recipe: Recipe) -> Self {
        let progress = Arc::new(Progress::default());
        let work =
            bake_in_background(level, recipe, progress.clone()).map_err(|why| why.to_string());
        Self { progress, work }
    }

    /// The result, once, when it is there.
    fn take(&mut self) -> Option<Result<Baked, BakeLevelError>> {
        match &mut self.work {
            Ok(work) => work.take(),
            Err(why) => Some(Err(BakeLevelError::Threads(std::mem::take(why)))),
        }
    }

    /// What the bake is doing, and how much of that is done, 0 to 1.
    #[must_use]
    pub fn progress(&self) -> (Stage, f32) {
        self.progress.get()
    }

    /// Asks the bake to stop. It ends soon after, as a [`MeshlessGiBakeFailed`].
    pub fn cancel(&self) {
        self.progress.cancel();
    }
}

impl Drop for MeshlessGiBake {
    fn drop(&mut self) {
        self.progress.cancel();
    }
}

/// On an entity whose bake failed: why.
#[derive(Component, Reflect, Clone, Debug, Default, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
pub struct MeshlessGiBakeFailed(pub String);

/// Sent to the entity when its bake is done and its [`MeshlessGi`] is there.
#[derive(EntityEvent, Clone, Debug)]
pub struct MeshlessGiBaked {
    /// The entity that was baked for.
    pub entity: Entity,
    /// Seconds that the bake took.
    pub seconds: f64,
    /// The bake's own estimate of its error (NRMSE of indirect irradiance).
    pub estimated_nrmse: f32,
}

/// Threads for a bake beside a running game: one less than the machine has.
fn bake_threads() -> usize {
    std::thread::available_parallelism().map_or(1, |n| n.get().saturating_sub(1).max(1))
}

/// Starts [`bake_level`] on a thread of its own.
pub(crate) fn bake_in_background(
    level: TriangleMesh,
    recipe: Recipe,
    progress: Arc<Progress>,
) -> std::io::Result<Baking> {
    Background::spawn(
        "meshless gi bake",
        move || bake_level(&level, &recipe, bake_threads(), &progress),
        || Err(BakeLevelError::Threads("the bake panicked".into())),
    )
}

/// Runs in [`MeshlessGiSystems::Collect`](super::MeshlessGiSystems::Collect).
pub(crate) fn collect_bakes(
    mut commands: Commands,
    mut bakes: Query<(Entity, &mut MeshlessGiBake)>,
    mut assets: ResMut<Assets<MeshlessGiAsset>>,
) {
    for (entity, mut under_way) in &mut bakes {
        let Some(result) = under_way.take() else {
            continue;
        };
        // Somebody may have despawned the entity in this very frame: then nobody wants the bake.
        let mut commands = commands.entity(entity);
        commands.try_remove::<MeshlessGiBake>();
        match result {
            Ok(Baked { scene, stats }) => {
                let seconds = stats.seconds.total;
                let estimated_nrmse = scene.info.estimated_nrmse;
                debug!("baked in {seconds:.1} s for {entity}");
                let bake = MeshlessGi(assets.add(MeshlessGiAsset::from(scene)));
                commands.queue_silenced(move |mut entity: EntityWorldMut| {
                    entity
                        .remove::<MeshlessGiBakeFailed>()
                        .insert(bake)
                        .trigger(|entity| MeshlessGiBaked {
                            entity,
                            seconds,
                            estimated_nrmse,
                        });
                });
            }
            Err(why) => {
                error!("a bake failed: {why}");
                commands.try_insert(MeshlessGiBakeFailed(why.to_string()));
            }
        }
    }
}
