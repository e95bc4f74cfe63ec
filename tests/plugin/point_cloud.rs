//! Point clouds in the running plugin: a room as points from a `.ply` file, compared with the same
//! room as meshes in direct and indirect light. Also tests invalid files.

use crate::support::app::{camera, finish_plugins, headless_plugins, picture, run, target};
use crate::support::flip::{Picture, flip};
use crate::support::scenes::Room;
use crate::support::stage::{save_picture, spawn_light_source, view};
use bevy::camera::visibility::RenderLayers;
use bevy::light::NotShadowCaster;
use bevy::prelude::*;
use bevy_meshless_gi::internals::plugin::PointCloudPart;
use bevy_meshless_gi::point_cloud::{GiPointCloud, GiPointCloudAsset};
use bevy_meshless_gi::prelude::*;
use meshless_gi::internals::samples::scatter;
use meshless_gi::internals::scene::{PlyEncoding, PlyPoints, write_ply};
use meshless_gi::{Material, PointCloud, Preset, Progress, Quad, Recipe, TriangleMesh, bake_scene};
use std::path::Path;

const LIGHT_SOURCE: Vec3 = Vec3::new(0.0, 1.7, 0.4);

fn room_mesh() -> TriangleMesh {
    let quads: Vec<Quad> = (Room::cornell().0.iter())
        .map(|q| Quad {
            corners: [
                q.corner,
                q.corner + q.u,
                q.corner + q.u + q.v,
                q.corner + q.v,
            ],
            material: Material::diffuse(q.color),
        })
        .collect();
    TriangleMesh::from_quads(&quads)
}

fn write(to: &Path, points: &PlyPoints) {
    let mut bytes = Vec::new();
    let none = Vec::new();
    write_ply(
        &mut bytes,
        PlyEncoding::LittleEndian,
        &points.positions,
        points.normals.as_ref().unwrap_or(&none),
        points.albedo.as_ref().unwrap_or(&none),
    )
    .unwrap();
    std::fs::write(to, bytes).unwrap();
}

fn app_in(folder: &Path) -> App {
    let mut app = App::new();
    let plugins = headless_plugins().set(AssetPlugin {
        file_path: folder.to_string_lossy().into_owned(),
        ..default()
    });
    app.add_plugins((plugins, MeshlessGiPlugin::default()))
        .insert_resource(GlobalAmbientLight::NONE);
    finish_plugins(&mut app);
    app
}

/// Returns the room's picture with a bake of `mesh`. `spawn` spawns the drawn room.
fn draw_room(mesh: &TriangleMesh, folder: &Path, spawn: impl Fn(&mut App, Entity)) -> Picture {
    let recipe = Recipe {
        preset: Preset::Draft,
        viewpoints: vec![[0.0, 1.0, 0.6]],
        ..Recipe::default()
    };
    let baked = bake_scene(mesh, &recipe, 0, &Progress::default()).expect("the room bakes");
    let mut app = app_in(folder);
    let asset = app
        .world_mut()
        .resource_mut::<Assets<GiBakedScene>>()
        .add(GiBakedScene::from(baked.scene));
    let root = app
        .world_mut()
        .spawn((GiScene(asset), Transform::IDENTITY, Visibility::Inherited))
        .id();
    spawn(&mut app, root);
    let image = target(&mut app);
    app.world_mut()
        .spawn((camera(&image, view()), GiCamera::default()));
    spawn_light_source(&mut app, LIGHT_SOURCE);
    run(&mut app, 8);
    picture(&mut app, &image)
}

#[test]
fn point_room_picture_matches_triangle_room() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = room_mesh();
    let points = scatter(&mesh, 0.03, 3).expect("the number of points is supported");
    assert!(points.positions.len() > 10_000);
    write(&folder.path().join("room.ply"), &points);
    let expected = draw_room(&mesh, folder.path(), |app, root| {
        Room::cornell().spawn(app, root);
    });
    let loaded =
        meshless_gi::internals::scene::load_ply(folder.path().join("room.ply"), &[]).unwrap();
    let (cells, _) = loaded.cloud.mesh();
    let count = loaded.cloud.len();
    let drawn = draw_room(&cells, folder.path(), |app, root| {
        let handle: Handle<GiPointCloudAsset> =
            app.world().resource::<AssetServer>().load("room.ply");
        let entity = app
            .world_mut()
            .spawn((GiPointCloud(handle.clone()), ChildOf(root)))
            .id();
        for _ in 0..10_000 {
            run(app, 1);
            if app.world().get::<Mesh3d>(entity).is_some() {
                break;
            }
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
        let assets = app.world().resource::<Assets<GiPointCloudAsset>>();
        let cloud = assets.get(&handle).expect("it has loaded");
        assert_eq!(cloud.cloud.len(), count);
        let material = app
            .world()
            .get::<MeshMaterial3d<StandardMaterial>>(entity)
            .expect("the points have a material");
        assert_eq!(material.0, cloud.material);
    });
    save_picture("points", &expected.beside(&drawn));
    let (d, nrmse) = (flip(&expected, &drawn), drawn.nrmse(&expected));
    println!("a room of {count} points: FLIP {d:.4}, NRMSE {nrmse:.4}");
    assert!(d < 0.04 && nrmse < 0.06, "FLIP {d}, NRMSE {nrmse}");
    let mut dimmer = drawn.clone();
    dimmer.pixels.iter_mut().flatten().for_each(|v| *v *= 0.85);
    assert!(dimmer.nrmse(&expected) > 0.06);
}

/// A cloud with more points than one mesh should hold is split into parts. The cloud's entity draws
/// the first part and children draw the others, with its material. A new cloud removes the
/// children.
#[test]
fn large_point_cloud_is_split_into_parts() {
    let folder = tempfile::tempdir().unwrap();
    let mut app = app_in(folder.path());
    let plane = |across: u32| {
        let position = |i: u32| Vec3::new((i % across) as f32, 0.0, (i / across) as f32);
        let count = across * across;
        let points = PlyPoints {
            positions: (0..count).map(position).collect(),
            normals: Some(vec![Vec3::Y; count as usize]),
            ..PlyPoints::default()
        };
        PointCloud::new(points, &[]).expect("a plane")
    };
    let add = |app: &mut App, cloud: PointCloud| {
        let world = app.world_mut();
        world.resource_scope(|world, mut meshes: Mut<Assets<Mesh>>| {
            let mut materials = world.resource_mut::<Assets<StandardMaterial>>();
            let points = GiPointCloudAsset::new(cloud, &mut meshes, &mut materials);
            world
                .resource_mut::<Assets<GiPointCloudAsset>>()
                .add(points)
        })
    };
    let large = add(&mut app, plane(500));
    let small = add(&mut app, plane(20));
    let entity = app.world_mut().spawn(GiPointCloud(large.clone())).id();
    run(&mut app, 2);
    let drawn = |app: &mut App| {
        let mut all = app
            .world_mut()
            .query::<(&Mesh3d, &MeshMaterial3d<StandardMaterial>)>();
        let (meshes, materials): (Vec<_>, Vec<_>) = all
            .iter(app.world())
            .map(|(mesh, material)| (mesh.0.clone(), material.0.id()))
            .unzip();
        let meshes_of = app.world().resource::<Assets<Mesh>>();
        let vertices = meshes
            .iter()
            .map(|m| meshes_of.get(m).expect("there").count_vertices());
        (vertices.collect::<Vec<_>>(), materials)
    };
    let (vertices, materials) = drawn(&mut app);
    assert_eq!(vertices.len(), 4, "250,000 points");
    assert!(
        vertices.iter().all(|n| *n < 1_000_000 && *n > 100_000),
        "{vertices:?}"
    );
    assert!(materials.iter().all(|m| *m == materials[0]));
    // Another material, then another cloud.
    let other = app
        .world_mut()
        .resource_mut::<Assets<StandardMaterial>>()
        .add(StandardMaterial::default());
    let id = other.id();
    app.world_mut()
        .entity_mut(entity)
        .insert(MeshMaterial3d(other));
    run(&mut app, 2);
    assert_eq!(drawn(&mut app).1, [id; 4]);
    // Other layers, and no shadow.
    let layers = RenderLayers::layer(3);
    (app.world_mut().entity_mut(entity)).insert((layers.clone(), NotShadowCaster));
    run(&mut app, 2);
    let mut parts = app
        .world_mut()
        .query_filtered::<(&RenderLayers, Has<NotShadowCaster>), With<PointCloudPart>>();
    let parts: Vec<_> = parts.iter(app.world()).collect();
    assert_eq!(parts, [(&layers, true); 3]);
    let draw = |app: &mut App, cloud: Handle<GiPointCloudAsset>| {
        let mut entity = app.world_mut().entity_mut(entity);
        entity.insert(GiPointCloud(cloud));
        run(app, 2);
        drawn(app)
    };
    let (vertices, materials) = draw(&mut app, small);
    assert_eq!((vertices.len(), materials), (1, vec![id]));
    assert!(vertices[0] < 10_000);
    // Without a cloud nothing is drawn.
    assert_eq!(draw(&mut app, large).0.len(), 4);
    (app.world_mut().entity_mut(entity)).remove::<GiPointCloud>();
    run(&mut app, 2);
    assert!(drawn(&mut app).0.is_empty());
}

#[test]
fn broken_point_cloud_fails_only_its_asset() {
    let folder = tempfile::tempdir().unwrap();
    let files: [(&str, &[u8]); 3] = [
        ("none.ply", b"ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\nend_header\n"),
        ("no.ply", b"not a PLY file"),
        ("short.ply", b"ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nproperty float y\nproperty float z\nend_header\n123"),
    ];
    for (name, bytes) in files {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    let mut app = app_in(folder.path());
    for (name, _) in files {
        let server = app.world().resource::<AssetServer>().clone();
        let handle: Handle<GiPointCloudAsset> = server.load(name);
        let entity = app.world_mut().spawn(GiPointCloud(handle.clone())).id();
        let mut failed = false;
        for _ in 0..10_000 {
            run(&mut app, 1);
            failed = server.load_state(&handle).is_failed();
            if failed {
                break;
            }
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
        assert!(failed, "{name}");
        assert!(app.world().get::<Mesh3d>(entity).is_none(), "{name}");
    }
}
