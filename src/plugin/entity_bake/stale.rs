//! Compares loaded bakes of entities with the meshes that are below their roots now.

use super::super::asset::GiBakedScene;
use super::super::background::Background;
use super::super::scene::GiScene;
use super::assemble::assemble;
use super::collect::{Collected, collect};
use super::request::GiBakeRequest;
use super::walk::walk;
use super::{label, wait};
use bevy::asset::{AssetId, AssetServer, Assets};
use bevy::ecs::prelude::*;
use bevy::log::warn;
use meshless_gi::internals::bake::is_stale;

/// Comparison of a root's bake with its meshes.
#[derive(Component)]
pub(crate) struct BakeComparison {
    /// The bake that was compared.
    asset: AssetId<GiBakedScene>,
    /// Hash of the meshes, while it is computed. The result is `None` if there are no meshes.
    work: Option<Background<Option<[u8; 32]>>>,
}

type Roots<'w> = (
    Entity,
    &'w GiScene,
    Option<&'w BakeComparison>,
    Has<GiBakeRequest>,
);

/// Run condition of [`compare_bakes`]: a bake has not been compared yet.
pub(crate) fn has_comparison(
    roots: Query<Roots<'static>>,
    bakes: Res<Assets<GiBakedScene>>,
    server: Option<Res<AssetServer>>,
) -> bool {
    let Some(server) = server else {
        return false;
    };
    (roots.iter()).any(|root| needs_comparison(root, &bakes, &server))
}

/// Returns `true` if a root has a loaded bake of entities that was not compared with its meshes.
fn needs_comparison(
    (_, gi, comparison, is_requested): (Entity, &GiScene, Option<&BakeComparison>, bool),
    bakes: &Assets<GiBakedScene>,
    server: &AssetServer,
) -> bool {
    let is_done = |c: &BakeComparison| c.asset == gi.0.id() && c.work.is_none();
    let is_of_entities = |bake: &GiBakedScene| !bake.scene.info().request.is_empty();
    // A bake of this session has no path, and was made from the current meshes.
    !is_requested
        && !comparison.is_some_and(is_done)
        && bakes.get(&gi.0).is_some_and(is_of_entities)
        && server.get_path(gi.0.id()).is_some()
}

/// Runs in [`GiSystems::StartBakes`](super::super::GiSystems::StartBakes).
pub(crate) fn compare_bakes(world: &mut World, roots: &mut QueryState<Roots<'static>>) {
    let Some(bakes) = world.get_resource::<Assets<GiBakedScene>>() else {
        return;
    };
    let Some(server) = world.get_resource::<AssetServer>() else {
        return;
    };
    let mut open = Vec::new();
    for root in roots.query(world) {
        if needs_comparison(root, bakes, server) {
            open.push((root.0, root.1.0.clone()));
        }
    }
    for (root, handle) in open {
        let bakes = world.resource::<Assets<GiBakedScene>>();
        let Some(scene) = bakes.get(&handle).map(|bake| bake.scene.clone()) else {
            continue;
        };
        let asset = handle.id();
        let under_way = world.get_mut::<BakeComparison>(root);
        if let Some(mut comparison) = under_way.filter(|c| c.asset == asset)
            && let Some(work) = &mut comparison.work
        {
            if let Some(hash) = work.take() {
                comparison.work = None;
                // Nothing below the root: the bake may be shown with other means.
                if hash.is_some_and(|hash| is_stale(scene.info(), &hash)) {
                    warn_stale(world, root, asset);
                }
            }
            continue;
        }
        let found = walk(world, root);
        if wait::pending(world, &found).is_some() {
            continue;
        }
        let collected = collect(world, found, scene.data().materials.is_some());
        let work = Background::spawn("meshless gi hash", move || hash(&collected), || None).ok();
        world
            .entity_mut(root)
            .insert(BakeComparison { asset, work });
    }
}

fn hash(collected: &Collected) -> Option<[u8; 32]> {
    let mesh = assemble(collected, &mut Vec::new()).ok()?;
    Some(mesh.content_hash())
}

fn warn_stale(world: &World, root: Entity, asset: AssetId<GiBakedScene>) {
    let path = (world.get_resource::<AssetServer>()).and_then(|server| server.get_path(asset));
    let path = path.map_or_else(String::new, |path| path.to_string());
    warn!(
        "{}: the meshes on it and below it are not those that `{path}` was baked from (or another \
         version baked it), so indirect light is wrong where they differ. Bake again: \
         `commands.entity(root).bake_gi(GiBakeRequest::new(recipe).save_to(file))`",
        label(world, root)
    );
}
