//! Bakes from entities in tests: apps, recipes, and results of bakes.

use super::assets::until;
use super::scenes::{Room, rough_recipe};
use bevy::asset::{AssetPlugin, RenderAssetUsages};
use bevy::ecs::schedule::{ScheduleLabel, SingleThreadedExecutor};
use bevy::image::Image;
use bevy::mesh::{Indices, PrimitiveTopology};
use bevy::prelude::*;
use bevy::world_serialization::WorldSerializationPlugin;
use bevy_meshless_gi::prelude::*;
use meshless_gi::BakedScene;
use std::path::Path;
use std::sync::Arc;

/// Results of bakes in the order of their events.
#[derive(Resource, Default)]
pub struct BakeResults(pub Vec<GiBakeFinished>);

/// Result of a bake in its event.
pub type BakeResult = Result<GiBakeSummary, GiBakeError>;

/// Creates an app without renderer and window that has meshes, materials, images and scenes.
pub fn bare_app(assets: &Path) -> App {
    let mut app = App::new();
    app.add_plugins((
        MinimalPlugins,
        AssetPlugin {
            file_path: assets.to_string_lossy().into_owned(),
            ..default()
        },
        TransformPlugin,
        WorldSerializationPlugin,
        MeshlessGiPlugin::default(),
    ))
    .init_asset::<Mesh>()
    .init_asset::<Image>()
    .init_asset::<StandardMaterial>();
    // Tests read the log of their own thread.
    for schedule in [PreUpdate.intern(), Last.intern()] {
        app.edit_schedule(schedule, |schedule| {
            schedule.set_executor(SingleThreadedExecutor::new());
        });
    }
    store_results(&mut app);
    super::app::finish_plugins(&mut app);
    app
}

/// Stores the results of bakes in [`BakeResults`].
pub fn store_results(app: &mut App) {
    app.init_resource::<BakeResults>();
    app.add_observer(|event: On<GiBakeFinished>, mut ends: ResMut<BakeResults>| {
        ends.0.push(event.event().clone());
    });
}

/// Returns a fast recipe for rooms as small as [`Room::cornell`].
pub fn quick_recipe() -> Recipe {
    Recipe {
        preset: Preset::Draft,
        rays_per_point: Some(64),
        ..rough_recipe()
    }
}

/// Returns a recipe with a bake time of minutes.
pub fn slow_recipe() -> Recipe {
    Recipe {
        rays_per_point: Some(60_000),
        preset: Preset::High,
        ..quick_recipe()
    }
}

/// Spawns a root with the surfaces of a room below it.
pub fn room_root(app: &mut App, room: &Room) -> Entity {
    let root = app
        .world_mut()
        .spawn((Transform::default(), Visibility::default()))
        .id();
    room.spawn(app, root);
    root
}

/// Waits for the next result of a bake of `root`, and removes it from [`BakeResults`].
#[track_caller]
pub fn wait_for_result(app: &mut App, root: Entity) -> BakeResult {
    until(app, "the bake", |app| {
        let mut ends = app.world_mut().resource_mut::<BakeResults>();
        let at = ends.0.iter().position(|end| end.entity == root)?;
        Some(ends.0.remove(at).result)
    })
}

/// Requests a bake of `root` and waits for its result.
#[track_caller]
pub fn bake(
    app: &mut App,
    root: Entity,
    request: impl Into<GiBakeRequest>,
) -> (GiBakeSummary, Arc<BakedScene>) {
    app.world_mut().entity_mut(root).bake_gi(request);
    let summary = wait_for_result(app, root).unwrap_or_else(|error| panic!("{error}"));
    (summary, scene_of(app, root))
}

/// Returns the bake of `root`.
pub fn scene_of(app: &App, root: Entity) -> Arc<BakedScene> {
    let gi = app.world().get::<GiScene>(root).expect("it has a bake");
    let bakes = app.world().resource::<Assets<GiBakedScene>>();
    bakes.get(&gi.0).expect("the bake is there").scene.clone()
}

/// Returns the sorted corners of a bake's triangles, rounded to a tenth of a millimeter.
pub fn triangles(scene: &BakedScene) -> Vec<[[i32; 3]; 3]> {
    let round = |p: [f32; 3]| p.map(|v| (1e4 * v).round() as i32);
    let mut all: Vec<_> = (scene.data().bvh.triangles.iter())
        .map(|t| {
            let mut corners = [t.a, t.b, t.c].map(round);
            // The rotation keeps the winding.
            let first = (0..3).min_by_key(|&i| corners[i]).unwrap_or(0);
            corners.rotate_left(first);
            corners
        })
        .collect();
    all.sort_unstable();
    all
}

/// Creates a mesh of one triangle.
pub fn triangle(corners: [Vec3; 3]) -> Mesh {
    Mesh::new(
        PrimitiveTopology::TriangleList,
        RenderAssetUsages::default(),
    )
    .with_inserted_attribute(
        Mesh::ATTRIBUTE_POSITION,
        corners.map(|p| p.to_array()).to_vec(),
    )
    .with_inserted_indices(Indices::U16(vec![0, 1, 2]))
}

/// Spawns a mesh below `parent`.
pub fn spawn_mesh(
    app: &mut App,
    parent: Entity,
    mesh: Mesh,
    material: StandardMaterial,
    transform: Transform,
) -> Entity {
    let world = app.world_mut();
    let mesh = world.resource_mut::<Assets<Mesh>>().add(mesh);
    let mut materials = world.resource_mut::<Assets<StandardMaterial>>();
    let material = materials.add(material);
    let parts = (Mesh3d(mesh), MeshMaterial3d(material), ChildOf(parent));
    world.spawn((parts, transform)).id()
}
