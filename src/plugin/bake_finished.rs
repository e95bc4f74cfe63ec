//! The event at the end of a bake.

use super::bake_error::GiBakeError;
use super::bake_summary::GiBakeSummary;
use bevy::ecs::prelude::*;
use bevy::ecs::reflect::ReflectEvent;
use bevy::reflect::prelude::*;

/// Triggered on an entity when its bake has ended. After success its [`GiScene`](super::GiScene) is
/// present. After an error the entity keeps its previous one. A bake that was replaced triggers
/// none. The same holds if its entity or component was removed.
///
/// ```no_run
/// use bevy::prelude::*;
/// use bevy_meshless_gi::prelude::*;
///
/// fn report(event: On<GiBakeFinished>) {
///     match &event.result {
///         Ok(summary) => info!("{}: {} points", event.entity, summary.points),
///         Err(error) => error!("{}: {error}", event.entity),
///     }
/// }
/// # let mut app = App::new();
/// # app.add_observer(report);
/// ```
#[derive(EntityEvent, Reflect, Clone, Debug)]
#[reflect(Event, Clone, Debug)]
#[non_exhaustive]
pub struct GiBakeFinished {
    /// The entity that was baked for.
    pub entity: Entity,
    /// Figures of the bake, or the reason why there is none.
    pub result: Result<GiBakeSummary, GiBakeError>,
}
