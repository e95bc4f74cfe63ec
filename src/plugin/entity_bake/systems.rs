//! Starts requested bakes once everything below their roots is there.

use super::super::bake_error::GiBakeError;
use super::super::bake_progress::GiBakeProgress;
use super::super::bake_task::{GiBakeTask, end};
use super::collect::collect;
use super::request::GiBakeRequest;
use super::walk::walk;
use super::warning::GiBakeWarning;
use super::{job, label, wait};
use crate::plugin::effects::occluders::occluder::GiOccluder;
use bevy::ecs::prelude::*;
use bevy::log::warn;
use bevy::platform::collections::HashMap;
use meshless_gi::{BakeStage, Recipe};
use std::time::{Duration, Instant};

/// Time after which the log names the asset that a bake waits for.
const LONG_WAIT: Duration = Duration::from_secs(10);

/// A bake that waits.
pub(crate) struct Wait {
    since: Instant,
    logged: bool,
}

type Waiting = (With<GiBakeRequest>, Without<GiBakeTask>);

/// Runs in [`GiSystems::StartBakes`](super::super::GiSystems::StartBakes).
pub(crate) fn start_bakes(
    world: &mut World,
    requested: &mut QueryState<Entity, Waiting>,
    mut waits: Local<HashMap<Entity, Wait>>,
) {
    let roots: Vec<Entity> = requested.iter(world).collect();
    waits.retain(|root, _| roots.contains(root));
    for root in roots {
        let found = walk(world, root);
        if let Some(asset) = wait::pending(world, &found) {
            let wait = waits.entry(root).or_insert_with(|| Wait {
                since: Instant::now(),
                logged: false,
            });
            if !wait.logged && wait.since.elapsed() > LONG_WAIT {
                wait.logged = true;
                warn!("{}: its bake still waits for {asset}", label(world, root));
            }
            continue;
        }
        let Some(request) = world.get::<GiBakeRequest>(root).cloned() else {
            continue;
        };
        let mut collected = collect(world, found, request.recipe.dynamic_materials);
        collected
            .warnings
            .extend(open_occluders(world, &request.recipe));
        for warning in &collected.warnings {
            warn!("{warning}");
        }
        let named = std::mem::take(&mut collected.named);
        let warnings = collected.warnings.clone();
        let Ok(mut entity) = world.get_entity_mut(root) else {
            continue;
        };
        if collected.instances.is_empty() {
            let root = collected.root;
            end(entity, Err(GiBakeError::Empty { root, warnings }));
            continue;
        }
        let work = move |progress: &_| job::run(&collected, &request, progress);
        entity.insert((
            GiBakeTask::start(work).with(named, warnings),
            GiBakeProgress {
                stage: BakeStage::Geometry,
                fraction: 0.0,
            },
        ));
    }
}

/// Warnings of doors that are open when their meshes are collected.
fn open_occluders(world: &mut World, recipe: &Recipe) -> Vec<GiBakeWarning> {
    let mut occluders = world.query::<(Entity, &GiOccluder)>();
    let open: Vec<(Entity, GiOccluder)> = (occluders.iter(world))
        .filter(|(_, occluder)| occluder.transmittance > 0.0)
        .filter(|(_, occluder)| {
            let mut shapes = recipe.occluders.iter();
            shapes.any(|shape| shape.name == occluder.name && shape.boxes.is_empty())
        })
        .map(|(entity, occluder)| (entity, occluder.clone()))
        .collect();
    open.into_iter()
        .map(|(entity, occluder)| GiBakeWarning::OpenOccluder {
            entity: label(world, entity),
            name: occluder.name,
            percent: (100.0 * occluder.transmittance.min(1.0)) as u32,
        })
        .collect()
}
