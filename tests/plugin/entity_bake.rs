//! Bakes from entities: the meshes below a root become its bake. Tests collected and skipped meshes
//! with their warnings, replaced and canceled bakes, and reuse of saved files.

#[path = "../../examples/minimal.rs"]
#[allow(dead_code, reason = "its `main` opens a window")]
mod minimal;

use crate::support::app::{app, camera, finish_plugins, headless_plugins, picture, run, target};
use crate::support::assets::{bake_threads, until, until_ended};
use crate::support::bakes::{
    BakeResults, bake, bare_app, quick_recipe, room_root, scene_of, slow_recipe, spawn_mesh,
    store_results, triangle, triangles, wait_for_result,
};
use crate::support::glb::glb;
use crate::support::log::warnings;
use crate::support::scenes::{Room, cpu_indirect};
use crate::support::stage::{
    assert_pictures_match, bevy_light, indirect, light_source, save_picture, settings, view,
};
use bevy::asset::{AssetPlugin, RenderAssetUsages};
use bevy::image::Image;
use bevy::mesh::skinning::SkinnedMesh;
use bevy::mesh::{Indices, PrimitiveTopology};
use bevy::prelude::*;
use bevy::render::render_resource::{AsBindGroup, Extent3d, Face, TextureDimension, TextureFormat};
use bevy_meshless_gi::prelude::*;
use meshless_gi::{BakedScene, OccluderDesc, Progress, bake_scene, load_gltf};
use std::time::Duration;

/// Returns a bake without its request.
fn without_request(scene: &BakedScene) -> BakedScene {
    let mut scene = scene.clone();
    scene.info_mut().request.clear();
    scene
}

#[test]
fn gltf_scene_baked_from_entities_equals_bake_of_file() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("room.glb");
    std::fs::write(&file, glb(&Room::cornell())).unwrap();
    let assets = AssetPlugin {
        file_path: folder.path().to_string_lossy().into_owned(),
        ..default()
    };
    let mut app = App::new();
    app.add_plugins((headless_plugins().set(assets), MeshlessGiPlugin::default()));
    store_results(&mut app);
    finish_plugins(&mut app);
    let scene = GltfAssetLabel::Scene(0).from_asset("room.glb");
    let scene = app.world().resource::<AssetServer>().load(scene);
    // The scene is not loaded yet. The root's own transform is not part of the bake.
    let position = Transform::from_xyz(3.0, -7.0, 0.5).with_rotation(Quat::from_rotation_y(0.3));
    let root = app
        .world_mut()
        .spawn((WorldAssetRoot(scene), position))
        .id();
    let recipe = Recipe {
        dynamic_materials: true,
        ..quick_recipe()
    };
    app.world_mut().entity_mut(root).bake_gi(recipe.clone());
    let progress = app.world().get::<GiBakeProgress>(root).unwrap();
    assert_eq!(progress.stage, BakeStage::Waiting);
    let summary = wait_for_result(&mut app, root).unwrap();
    assert_eq!(summary.warnings, []);
    let from_entities = scene_of(&app, root);

    let mesh = load_gltf(&file).unwrap().mesh;
    let from_file = bake_scene(&mesh, &recipe, 2, &Progress::default()).unwrap();
    let from_file = from_file.scene;
    assert_eq!(triangles(&from_entities), triangles(&from_file));
    assert_eq!(
        (from_entities.info().triangles, from_file.info().triangles),
        (20, 20)
    );
    let factors = |scene: &BakedScene| {
        let dynamic = scene.data().materials.as_ref().unwrap();
        let mut all: Vec<_> = (dynamic.factors.iter())
            .map(|f| (f.base_color.map(f32::to_bits), f.emissive.map(f32::to_bits)))
            .collect();
        all.sort_unstable();
        // The bake from entities merges equal materials. The glTF reader adds a material for meshes
        // without one.
        all.dedup();
        all.retain(|(color, _)| color.map(f32::from_bits) != [1.0; 3]);
        all
    };
    assert_eq!(factors(&from_entities), factors(&from_file));
    // The order of triangles differs, but the points are equal.
    assert_eq!(from_entities.data().points, from_file.data().points);
    let (a, b) = (
        from_entities.info().estimated_nrmse,
        from_file.info().estimated_nrmse,
    );
    println!("estimated NRMSE: entities {a}, file {b}");
    assert!(a > 0.0 && (a - b).abs() < 1e-3 * b, "{a} {b}");
    // The scene's materials are in `GiDynamicMaterials`, so that light follows their changes.
    let named = app.world().get::<GiDynamicMaterials>(root).unwrap();
    assert!(!named.0.is_empty());
    let dynamic = from_entities.data().materials.as_ref().unwrap();
    for (name, _) in &named.0 {
        assert!(dynamic.names.contains(name), "{name}");
    }
}

#[test]
fn entity_bake_picture_matches_cpu() {
    let mut app = app();
    store_results(&mut app);
    let room = Room::cornell();
    let root = room_root(&mut app, &room);
    let (_, scene) = bake(&mut app, root, quick_recipe());
    let image = target(&mut app);
    (app.world_mut()).spawn((camera(&image, view()), indirect()));
    let position = Vec3::new(0.1, 1.5, 0.4);
    let at = Transform::from_translation(position);
    app.world_mut().spawn((bevy_light(), at));
    run(&mut app, 3);
    let light = [light_source(position)];
    let still = Transform::IDENTITY;
    let cpu = cpu_indirect(&room, &scene, still, view(), &light, &settings());
    assert_pictures_match("entity_bake", &cpu, &picture(&mut app, &image));
}

#[test]
fn minimal_example_has_indirect_light() {
    let mut app = app();
    store_results(&mut app);
    app.world_mut().run_system_cached(minimal::set_up).unwrap();
    let image = target(&mut app);
    let mut cameras = app.world_mut().query_filtered::<Entity, With<Camera3d>>();
    let camera_entity = cameras.single(app.world()).unwrap();
    let at = *app.world().get::<Transform>(camera_entity).unwrap();
    (app.world_mut().entity_mut(camera_entity)).insert(camera(&image, at));
    let mut roots = (app.world_mut()).query_filtered::<Entity, With<GiBakeRequest>>();
    let root = roots.single(app.world()).unwrap();
    let summary = wait_for_result(&mut app, root).unwrap();
    assert_eq!((summary.triangles, summary.warnings.len()), (7 * 12, 0));
    run(&mut app, 3);
    let lit = picture(&mut app, &image);
    save_picture("minimal_lit", &lit);
    app.world_mut()
        .get_mut::<GiCamera>(camera_entity)
        .unwrap()
        .enabled = false;
    run(&mut app, 2);
    let direct = picture(&mut app, &image);
    save_picture("minimal_direct", &direct);
    assert!(
        lit.mean() > 1.2 * direct.mean(),
        "{} {}",
        lit.mean(),
        direct.mean()
    );
    assert_eq!(app.world().resource::<GiWarnings>().0, []);
}

#[test]
fn unusable_meshes_are_named_and_skipped() {
    let mut app = bare_app(&std::env::temp_dir());
    let room = Room::cornell();
    let root = room_root(&mut app, &room);
    let small = |at: Vec3| triangle([at, at + 0.1 * Vec3::X, at + 0.1 * Vec3::Y]);
    let plain = StandardMaterial::default;
    let still = Transform::default();
    let inside = Vec3::new(-0.5, 1.0, 0.3);

    let mut extracted = small(inside);
    extracted.take_gpu_data().unwrap();
    let dark = spawn_mesh(&mut app, root, extracted, plain(), still);
    app.world_mut().entity_mut(dark).insert(Name::new("vase"));
    let lines = Mesh::new(PrimitiveTopology::LineList, RenderAssetUsages::default())
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, vec![[0.0f32; 3]; 2]);
    let wire = spawn_mesh(&mut app, root, lines, plain(), still);
    let broken = [inside, Vec3::new(f32::NAN, 0.0, 0.0), inside + Vec3::Y];
    let broken = spawn_mesh(&mut app, root, triangle(broken), plain(), still);
    let far = Transform::from_xyz(1e30, 0.0, 0.0);
    let far = spawn_mesh(&mut app, root, small(inside), plain(), far);
    let bare = Mesh::new(
        PrimitiveTopology::TriangleList,
        RenderAssetUsages::default(),
    );
    let bare = spawn_mesh(&mut app, root, bare, plain(), still);
    // The next meshes are skipped without a warning.
    let skinned = spawn_mesh(&mut app, root, small(inside), plain(), still);
    app.world_mut()
        .entity_mut(skinned)
        .insert(SkinnedMesh::default());
    let excluded = app.world_mut().spawn((GiBakeExclude, ChildOf(root))).id();
    spawn_mesh(&mut app, excluded, small(inside), plain(), still);
    let ball = spawn_mesh(&mut app, root, small(inside), plain(), still);
    app.world_mut().entity_mut(ball).insert(GiReflector);
    let hidden = app
        .world_mut()
        .spawn((Visibility::Hidden, ChildOf(root)))
        .id();
    spawn_mesh(&mut app, hidden, small(inside), plain(), still);
    let undrawn = spawn_mesh(&mut app, root, small(inside), plain(), still);
    (app.world_mut().entity_mut(undrawn)).remove::<MeshMaterial3d<StandardMaterial>>();
    // Spawns a visible lid below a hidden parent, and hides the root during the bake.
    let lid = spawn_mesh(&mut app, hidden, small(inside), plain(), still);
    app.world_mut().entity_mut(lid).insert(Visibility::Visible);
    app.world_mut().entity_mut(root).insert(Visibility::Hidden);

    let (bake, logged) = warnings(|| bake(&mut app, root, quick_recipe()));
    let (summary, scene) = bake;
    assert_eq!(scene.info().triangles, 21, "the room and the lid");
    let texts: Vec<String> = summary.warnings.iter().map(ToString::to_string).collect();
    for text in &texts {
        assert!(logged.contains(text), "{text} is in the log");
    }
    let expected = [
        (dark, ["`vase`", "MAIN_WORLD"]),
        (wire, ["LineList", "no surface"]),
        (broken, ["left out of the bake: 1", "not finite"]),
        (far, ["left out of the bake: 1", "not finite"]),
        (bare, ["no positions", "not in the bake"]),
    ];
    assert_eq!(texts.len(), expected.len(), "{texts:#?}");
    for (entity, parts) in expected {
        let of = |text: &&String| {
            text.contains(&format!("entity {entity}")) && parts.iter().all(|p| text.contains(p))
        };
        assert!(texts.iter().any(|text| of(&text)), "{parts:?}: {texts:#?}");
    }
    assert!(matches!(
        summary.warnings[0],
        GiBakeWarning::MeshInRenderWorld { .. }
    ));
}

#[test]
fn entity_bake_without_usable_meshes_returns_named_error() {
    let mut app = bare_app(&std::env::temp_dir());
    let world = app.world_mut();
    let empty = world.spawn(GiBakeRequest::from(Preset::Draft)).id();
    let result = wait_for_result(&mut app, empty);
    assert!(matches!(
        &result,
        Err(GiBakeError::Empty { warnings, .. }) if warnings.is_empty()
    ));
    let root = app.world_mut().spawn(Name::new("cave")).id();
    let mut extracted = triangle([Vec3::ZERO, Vec3::X, Vec3::Y]);
    extracted.take_gpu_data().unwrap();
    let plain = StandardMaterial::default();
    spawn_mesh(&mut app, root, extracted, plain.clone(), default());
    let nan = triangle([Vec3::NAN; 3]);
    app.world_mut().entity_mut(root).bake_gi(quick_recipe());
    let error = wait_for_result(&mut app, root).unwrap_err().to_string();
    assert!(
        error.contains("`cave`") && error.contains("MAIN_WORLD"),
        "{error}"
    );
    assert!(!app.world().entity(root).contains::<GiScene>());
    assert!(!app.world().entity(root).contains::<GiBakeRequest>());
    assert!(!app.world().entity(root).contains::<GiBakeProgress>());
    // The bake's thread detects that all triangles are unusable.
    let root = app.world_mut().spawn_empty().id();
    spawn_mesh(&mut app, root, nan, plain, default());
    app.world_mut().entity_mut(root).bake_gi(quick_recipe());
    assert!(matches!(
        wait_for_result(&mut app, root),
        Err(GiBakeError::Empty { warnings, .. }) if warnings.len() == 1
    ));
}

#[test]
fn later_bake_request_replaces_earlier_and_removal_cancels() {
    let mut app = bare_app(&std::env::temp_dir());
    let room = Room::cornell();
    let [replaced, despawned, removed] = [0; 3].map(|_| {
        let root = room_root(&mut app, &room);
        app.world_mut().entity_mut(root).bake_gi(slow_recipe());
        root
    });
    let is_baking = |app: &App, root: Entity| app.world().get::<GiBakeTask>(root).is_some();
    until(&mut app, "all three start", |app| {
        [replaced, despawned, removed]
            .iter()
            .all(|&root| is_baking(app, root))
            .then_some(())
    });
    let slow_bakes = bake_threads();
    app.world_mut().entity_mut(replaced).bake_gi(quick_recipe());
    assert!(!is_baking(&app, replaced), "the earlier bake is canceled");
    app.world_mut().despawn(despawned);
    app.world_mut()
        .entity_mut(removed)
        .remove::<GiBakeRequest>();
    assert!(!is_baking(&app, removed));
    assert!(!app.world().entity(removed).contains::<GiBakeProgress>());
    let summary = wait_for_result(&mut app, replaced).unwrap();
    assert!(
        scene_of(&app, replaced)
            .info()
            .recipe
            .contains("rays_per_point:64")
    );
    assert!(summary.points > 0);
    for _ in 0..20 {
        app.update();
    }
    assert!(
        app.world().resource::<BakeResults>().0.is_empty(),
        "no further result"
    );
    // Of two requests in one command queue the last one counts. A request for a despawned entity
    // has no effect.
    let mut commands = app.world_mut().commands();
    commands
        .entity(replaced)
        .bake_gi(slow_recipe())
        .bake_gi(quick_recipe());
    commands.entity(despawned).bake_gi(quick_recipe());
    app.world_mut().flush();
    wait_for_result(&mut app, replaced).unwrap();
    // Canceled bakes end, so that they do not delay the end of the app.
    until_ended(&mut app, &slow_bakes);
    drop(app);
}

#[test]
fn mirrored_and_instanced_meshes_keep_front_faces() {
    let mut app = bare_app(&std::env::temp_dir());
    let room = Room::cornell();
    let root = room_root(&mut app, &room);
    let tile = [
        Vec3::new(0.2, 0.5, 0.1),
        Vec3::new(0.4, 0.5, 0.1),
        Vec3::new(0.2, 0.8, 0.1),
    ];
    let mesh = app
        .world_mut()
        .resource_mut::<Assets<Mesh>>()
        .add(triangle(tile));
    let mut materials = app.world_mut().resource_mut::<Assets<StandardMaterial>>();
    let plain = materials.add(StandardMaterial::default());
    // bevy_gltf gives mirrored meshes such a material.
    let mirrored = materials.add(StandardMaterial {
        cull_mode: Some(Face::Front),
        ..default()
    });
    let turned = Transform::from_xyz(0.1, 0.0, 0.2).with_rotation(Quat::from_rotation_y(0.7));
    let mirror = Transform::from_scale(Vec3::new(-1.0, 1.0, 1.0));
    let group = app
        .world_mut()
        .spawn((mirror, Visibility::default(), ChildOf(root)))
        .id();
    for (parent, material) in [(root, plain), (group, mirrored)] {
        let parts = (Mesh3d(mesh.clone()), MeshMaterial3d(material), turned);
        app.world_mut().spawn((parts, ChildOf(parent)));
    }
    // The root's transform, mirrored or not, is not part of the bake.
    (app.world_mut().entity_mut(root)).insert(mirror.with_translation(Vec3::splat(5.0)));
    let (summary, scene) = bake(&mut app, root, quick_recipe());
    assert_eq!((summary.triangles, summary.warnings.len()), (22, 0));
    let normal = |flip: f32| {
        let corner = |p: Vec3| turned.transform_point(p) * Vec3::new(flip, 1.0, 1.0);
        let [a, b, c] = tile.map(corner);
        let wound = if flip < 0.0 { [a, c, b] } else { [a, b, c] };
        let [a, b, c] = wound.map(|p| p.to_array());
        (a, b, c)
    };
    let near = |a: [f32; 3], b: [f32; 3]| Vec3::from(a).distance(b.into()) < 1e-5;
    for flip in [1.0, -1.0] {
        let (a, b, c) = normal(flip);
        let same = |t: &&meshless_gi::internals::scene::BvhTriangle| {
            [[t.a, t.b, t.c], [t.b, t.c, t.a], [t.c, t.a, t.b]]
                .iter()
                .any(|[p, q, r]| near(*p, a) && near(*q, b) && near(*r, c))
        };
        assert_eq!(
            scene.data().bvh.triangles.iter().filter(same).count(),
            1,
            "{flip}"
        );
    }
}

/// Creates a floor of two triangles from (-1, 0, -1) to (1, 0, 1), with texture coordinates along x
/// and z.
fn floor() -> Mesh {
    let corners = [
        [-1.0, 0.0, -1.0],
        [-1.0, 0.0, 1.0],
        [1.0, 0.0, 1.0],
        [1.0, 0.0, -1.0f32],
    ];
    let uvs: Vec<[f32; 2]> = corners
        .iter()
        .map(|[x, _, z]| [0.5 + 0.5 * x, 0.5 + 0.5 * z])
        .collect();
    Mesh::new(
        PrimitiveTopology::TriangleList,
        RenderAssetUsages::default(),
    )
    .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, corners.to_vec())
    .with_inserted_attribute(Mesh::ATTRIBUTE_UV_0, uvs)
    .with_inserted_indices(Indices::U32(vec![0, 1, 2, 0, 2, 3]))
}

/// Returns a recipe with points of the finest hierarchy level on both halves of the floor.
fn fine_recipe() -> Recipe {
    Recipe {
        max_refinement_points: None,
        ..quick_recipe()
    }
}

/// Returns the mean albedo and emission of the points on the floor, for x below zero and x above
/// zero.
fn halves(scene: &BakedScene) -> [(Vec3, Vec3); 2] {
    let mut sums = [(Vec3::ZERO, Vec3::ZERO, 0.0); 2];
    let finest = *scene.data().level_starts.iter().rev().nth(1).unwrap() as usize;
    for (point, surface) in scene
        .data()
        .points
        .iter()
        .zip(&scene.data().surfaces)
        .skip(finest)
    {
        let p = point.x();
        // Points on walls can have the same height.
        if p.y.abs() < 1e-3 && point.n().y > 0.5 && p.x.abs() > 0.1 {
            let sum = &mut sums[usize::from(p.x > 0.0)];
            sum.0 += Vec3::from(surface.albedo);
            sum.1 += Vec3::from(surface.emission);
            sum.2 += 1.0;
        }
    }
    let counts = sums.map(|s| s.2);
    assert!(
        counts.iter().all(|n| *n >= 3.0),
        "points on both halves: {counts:?}"
    );
    sums.map(|(albedo, emission, count)| (albedo / count, emission / count))
}

fn two_texels(left: [u8; 4], right: [u8; 4]) -> Image {
    let size = Extent3d {
        width: 2,
        height: 1,
        depth_or_array_layers: 1,
    };
    let data = [left, right].concat();
    let format = TextureFormat::Rgba8UnormSrgb;
    Image::new(
        size,
        TextureDimension::D2,
        data,
        format,
        RenderAssetUsages::default(),
    )
}

/// Spawns [`Room::cornell`] with another floor.
fn room_with_floor(app: &mut App, mesh: Mesh, material: StandardMaterial) -> Entity {
    let mut room = Room::cornell();
    room.0.remove(0);
    let root = room_root(app, &room);
    spawn_mesh(app, root, mesh, material, Transform::default());
    root
}

#[test]
fn entity_bake_uses_textures_vertex_colors_and_alpha_masks() {
    let mut app = bare_app(&std::env::temp_dir());
    let near = |a: Vec3, b: Vec3| assert!(a.distance(b) < 0.03, "{a} {b}");
    let image = two_texels([255, 255, 255, 255], [0, 0, 0, 255]);
    let image = app.world_mut().resource_mut::<Assets<Image>>().add(image);
    let mut material = StandardMaterial {
        base_color: Color::linear_rgb(0.8, 0.4, 0.2),
        base_color_texture: Some(image.clone()),
        ..default()
    };
    let root = room_with_floor(&mut app, floor(), material.clone());
    let (summary, scene) = bake(&mut app, root, fine_recipe());
    assert_eq!(summary.warnings, []);
    let [left, right] = halves(&scene);
    assert!(left.0.x > 0.5 && right.0.x < 0.3, "{left:?} {right:?}");
    near(left.0 / left.0.x, Vec3::new(1.0, 0.5, 0.25));
    // Flipped texture coordinates.
    material.flip(true, false);
    let root = room_with_floor(&mut app, floor(), material.clone());
    let [left, right] = halves(&bake(&mut app, root, fine_recipe()).1);
    assert!(right.0.x > 0.5 && left.0.x < 0.3, "{left:?} {right:?}");
    // An emission texture. Its black texel emits no light.
    let root = room_with_floor(
        &mut app,
        floor(),
        StandardMaterial {
            emissive: LinearRgba::rgb(2.0, 1.0, 0.0),
            emissive_texture: Some(image),
            ..default()
        },
    );
    let [left, right] = halves(&bake(&mut app, root, fine_recipe()).1);
    assert!(
        left.1.x > 3.0 * right.1.x && left.1.x > 3.0,
        "{left:?} {right:?}"
    );

    // Vertex colors: the left half is bright and the right half is dark.
    let half = |x: f32| {
        floor()
            .scaled_by(Vec3::new(0.5, 1.0, 1.0))
            .translated_by(x * Vec3::X)
    };
    let mut painted = half(-0.5);
    painted.merge(&half(0.5)).unwrap();
    let bright = [1.0, 0.5, 0.25, 1.0];
    let dark = [0.2, 0.1, 0.05, 1.0];
    painted.insert_attribute(Mesh::ATTRIBUTE_COLOR, [[bright; 4], [dark; 4]].concat());
    let white = StandardMaterial {
        base_color: Color::WHITE,
        ..default()
    };
    let root = room_with_floor(&mut app, painted, white);
    let [left, right] = halves(&bake(&mut app, root, fine_recipe()).1);
    near(left.0, Vec3::new(1.0, 0.5, 0.25));
    near(right.0, Vec3::new(0.2, 0.1, 0.05));

    // A floor with a mask that is transparent everywhere is not in the bake.
    let holes = two_texels([255, 255, 255, 0], [255, 255, 255, 0]);
    let holes = app.world_mut().resource_mut::<Assets<Image>>().add(holes);
    let root = room_with_floor(
        &mut app,
        floor(),
        StandardMaterial {
            base_color_texture: Some(holes),
            alpha_mode: AlphaMode::Mask(0.5),
            ..default()
        },
    );
    let scene = bake(&mut app, root, quick_recipe()).1;
    assert_eq!(
        scene.data().bvh.triangles.len(),
        18,
        "the two floor triangles are left out"
    );
}

#[test]
fn unreadable_images_are_named_and_use_factors() {
    let mut app = bare_app(&std::env::temp_dir());
    let mut compressed = two_texels([255; 4], [255; 4]);
    compressed.texture_descriptor.format = TextureFormat::Bc1RgbaUnormSrgb;
    let mut extracted = two_texels([0; 4], [0; 4]);
    extracted.data = None;
    let mut images = app.world_mut().resource_mut::<Assets<Image>>();
    let [compressed, extracted] = [compressed, extracted].map(|image| images.add(image));
    let material = StandardMaterial {
        base_color: Color::linear_rgb(0.6, 0.3, 0.3),
        base_color_texture: Some(compressed),
        emissive: LinearRgba::rgb(1.0, 0.0, 0.0),
        emissive_texture: Some(extracted),
        ..default()
    };
    let root = room_with_floor(&mut app, floor(), material);
    let (summary, scene) = bake(&mut app, root, quick_recipe());
    let texts: Vec<String> = summary.warnings.iter().map(ToString::to_string).collect();
    assert_eq!(texts.len(), 2, "{texts:#?}");
    assert!(
        texts[0].contains("compressed") && texts[0].contains("base color"),
        "{}",
        texts[0]
    );
    assert!(
        texts[1].contains("MAIN_WORLD") && texts[1].contains("emissive"),
        "{}",
        texts[1]
    );
    for (albedo, emission) in halves(&scene) {
        assert!(albedo.distance(Vec3::new(0.6, 0.3, 0.3)) < 1e-3, "{albedo}");
        assert!(
            (emission.x - std::f32::consts::PI).abs() < 1e-2,
            "{emission}"
        );
    }
}

#[test]
fn equal_scenes_any_spawn_order_have_equal_bakes() {
    let mut app = bare_app(&std::env::temp_dir());
    let room = Room::cornell();
    let mut reversed = room.clone();
    reversed.0.reverse();
    let [a, b, c] = [room.clone(), reversed, room.recolored(|c| 0.9 * c)].map(|room| {
        let root = room_root(&mut app, &room);
        bake(&mut app, root, quick_recipe()).1
    });
    assert_eq!(a, b);
    assert!(!a.info().request.is_empty());
    assert_ne!(a.info().request, c.info().request);
    assert_ne!(without_request(&a), without_request(&c));
}

#[test]
fn saved_bake_is_loaded_if_matching_and_else_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("bakes/room.mgi");
    let mut app = bare_app(folder.path());
    let room = Room::cornell();
    let root = room_root(&mut app, &room);
    let request = |recipe: Recipe| GiBakeRequest::new(recipe).save_to(&file);
    let (first, baked) = bake(&mut app, root, request(quick_recipe()));
    assert!(!first.loaded && first.warnings.is_empty());
    let read = || BakedScene::read(&file, &default()).unwrap();
    assert_eq!(read(), *baked);
    let (again, loaded) = bake(&mut app, root, request(quick_recipe()));
    assert!(again.loaded);
    assert_eq!(loaded, baked);
    // Another recipe, then other meshes.
    let finer = Recipe {
        rays_per_point: Some(96),
        ..quick_recipe()
    };
    assert!(!bake(&mut app, root, request(finer.clone())).0.loaded);
    assert!(read().info().recipe.contains("rays_per_point:96"));
    let tile = triangle([0.0, 0.1, 0.2].map(|v| Vec3::new(v, 1.0 + 20.0 * v * v, 0.2)));
    let tile = spawn_mesh(&mut app, root, tile, default(), default());
    let (other, changed) = bake(&mut app, root, request(finer.clone()));
    assert!(!other.loaded);
    assert_eq!(
        (changed.info().triangles, read().info().triangles),
        (21, 21)
    );
    app.world_mut()
        .entity_mut(tile)
        .insert(Transform::from_xyz(0.0, 0.2, 0.0));
    assert!(!bake(&mut app, root, request(finer.clone())).0.loaded);
    assert!(bake(&mut app, root, request(finer.clone())).0.loaded);

    // A damaged file gives a warning and is replaced.
    std::fs::write(&file, b"no bake").unwrap();
    let (mended, _) = bake(&mut app, root, request(finer.clone()));
    assert!(!mended.loaded);
    assert!(matches!(
        &mended.warnings[..],
        [GiBakeWarning::NotLoaded { path, .. }] if *path == file
    ));
    assert_eq!(read().info().triangles, 21);
    // A file that cannot be written gives a warning. The bake itself succeeds.
    let below_a_file = file.join("room.mgi");
    let unsaved = GiBakeRequest::new(finer).save_to(&below_a_file);
    let (summary, _) = bake(&mut app, root, unsaved);
    let not_saved = |w: &GiBakeWarning| matches!(w, GiBakeWarning::NotSaved { path, .. } if *path == below_a_file);
    assert!(
        summary.warnings.iter().any(not_saved),
        "{:?}",
        summary.warnings
    );
}

#[test]
fn loaded_bake_of_other_meshes_warns_once() {
    let folder = tempfile::tempdir().unwrap();
    let mut app = bare_app(folder.path());
    let room = Room::cornell();
    let root = room_root(&mut app, &room);
    let request = GiBakeRequest::new(quick_recipe()).save_to(folder.path().join("room.mgi"));
    bake(&mut app, root, request);
    let load = |app: &mut App, room: &Room| {
        let root = room_root(app, room);
        let bake = app.world().resource::<AssetServer>().load("room.mgi");
        let named = (GiScene(bake), Name::new("hall"));
        app.world_mut().entity_mut(root).insert(named);
        let logged = warnings(|| {
            until(app, "loading", |app| {
                let gi = app.world().get::<GiScene>(root)?;
                let bakes = app.world().resource::<Assets<GiBakedScene>>();
                bakes.get(&gi.0).map(|_| ())
            });
            for _ in 0..100 {
                app.update();
                std::thread::sleep(Duration::from_millis(3));
            }
        });
        (root, logged.1)
    };
    let (_, logged) = load(&mut app, &room);
    assert_eq!(logged, [] as [String; 0], "the same meshes");
    let mut moved = room.clone();
    moved.0[9].corner.y += 0.1;
    let (hall, logged) = load(&mut app, &moved);
    assert_eq!(logged.len(), 1, "{logged:?}");
    for part in [
        format!("entity {hall}"),
        "`hall`".into(),
        "`room.mgi`".into(),
        "bake_gi".into(),
    ] {
        assert!(logged[0].contains(&part), "{part}: {}", logged[0]);
    }
}

#[test]
fn scene_file_loaded_as_bake_returns_named_error() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("hall.glb"), glb(&Room::cornell())).unwrap();
    let mut app = bare_app(folder.path());
    let handle = app.world().resource::<AssetServer>().load("hall.glb");
    let (root, logged) = warnings(|| {
        let root = app.world_mut().spawn(GiScene(handle)).id();
        for _ in 0..5 {
            app.update();
        }
        root
    });
    assert_eq!(logged.len(), 1, "{logged:?}");
    let entity = format!("entity {root}");
    for part in [
        entity.as_str(),
        "`hall.glb`",
        "hall.mgi",
        "hall.gi.ron",
        "bake_gi",
    ] {
        assert!(logged[0].contains(part), "{part}: {}", logged[0]);
    }
}

#[test]
fn occluder_entities_are_found_by_name_or_component() {
    let mut app = bare_app(&std::env::temp_dir());
    let room = Room::cornell();
    let root = room_root(&mut app, &room);
    let door = triangle([
        Vec3::new(-0.9, 0.1, 0.5),
        Vec3::new(0.9, 0.1, 0.5),
        Vec3::new(0.0, 1.8, 0.5),
    ]);
    let by_name = spawn_mesh(&mut app, root, door.clone(), default(), default());
    app.world_mut()
        .entity_mut(by_name)
        .insert(Name::new("gate"));
    let lower = Transform::from_xyz(0.0, 0.0, -0.9);
    let by_component = spawn_mesh(&mut app, root, door, default(), lower);
    app.world_mut().entity_mut(by_component).insert(GiOccluder {
        name: "door".into(),
        transmittance: 0.0,
    });
    let recipe = Recipe {
        occluders: ["door", "gate"].map(OccluderDesc::node).into(),
        ..quick_recipe()
    };
    let (summary, scene) = bake(&mut app, root, recipe);
    let occluders = scene.data().occluders.as_ref().unwrap();
    assert_eq!(occluders.names, ["door", "gate"]);
    assert!(!occluders.links.is_empty(), "light passes them");
    let is_open = |w: &GiBakeWarning| matches!(w, GiBakeWarning::OpenOccluder { .. });
    assert!(!summary.warnings.iter().any(is_open), "both are shut");

    // The bake uses the current transforms of the meshes. An open door gives a warning with its
    // name.
    let mut door = app.world_mut().get_mut::<GiOccluder>(by_component).unwrap();
    door.transmittance = 0.6;
    let recipe = Recipe {
        occluders: vec!["door".into()],
        ..quick_recipe()
    };
    let (summary, _) = bake(&mut app, root, recipe);
    let found: Vec<String> = (summary.warnings.iter())
        .filter(|w| is_open(w))
        .map(ToString::to_string)
        .collect();
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(found[0].contains("`door` is 60 % open"), "{found:?}");
}

#[test]
fn dynamic_materials_keep_app_names() {
    let mut app = bare_app(&std::env::temp_dir());
    let root = room_with_floor(&mut app, floor(), default());
    let mut drawn = app.world_mut().query::<&MeshMaterial3d<StandardMaterial>>();
    let handles: Vec<_> = drawn.iter(app.world()).map(|m| m.0.clone()).collect();
    let given = GiDynamicMaterials(vec![("sign".into(), handles[3].clone())]);
    app.world_mut().entity_mut(root).insert(given);
    let recipe = Recipe {
        dynamic_materials: true,
        ..quick_recipe()
    };
    let (_, scene) = bake(&mut app, root, recipe);
    let named = &app.world().get::<GiDynamicMaterials>(root).unwrap().0;
    assert_eq!(named.len(), handles.len());
    assert_eq!(named[0], ("sign".into(), handles[3].clone()));
    let dynamic = scene.data().materials.as_ref().unwrap();
    for (name, handle) in named {
        let at = dynamic
            .names
            .iter()
            .position(|known| known == name)
            .expect(name);
        let materials = app.world().resource::<Assets<StandardMaterial>>();
        let color = materials.get(handle).unwrap().base_color.to_linear();
        let baked = dynamic.factors[at].base_color;
        assert_eq!(baked, [color.red, color.green, color.blue], "{name}");
    }
}

/// Custom material of an app.
#[derive(Asset, AsBindGroup, TypePath, Clone, Default)]
struct Paint {}

impl Material for Paint {}

#[test]
fn custom_material_is_gray_and_named() {
    let mut app = bare_app(&std::env::temp_dir());
    app.init_asset::<Paint>();
    // Same registration as by `MaterialPlugin`.
    app.register_type::<MeshMaterial3d<Paint>>();
    let root = room_with_floor(&mut app, floor(), default());
    let paint = app
        .world_mut()
        .resource_mut::<Assets<Paint>>()
        .add(Paint {});
    let parts = app.world().get::<Children>(root).unwrap();
    let floor = *parts.last().unwrap();
    (app.world_mut().entity_mut(floor))
        .remove::<MeshMaterial3d<StandardMaterial>>()
        .insert((MeshMaterial3d(paint), Name::new("pond")));
    let (summary, scene) = bake(&mut app, root, quick_recipe());
    assert_eq!(scene.info().triangles, 20);
    assert!(matches!(
        &summary.warnings[..],
        [GiBakeWarning::CustomMaterial { entity }] if entity.contains("`pond`")
    ));
    for (albedo, _) in halves(&scene) {
        assert!(albedo.distance(Vec3::splat(0.5)) < 1e-2, "{albedo}");
    }
}

#[test]
fn failed_scenes_and_missing_assets_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let mut app = bare_app(folder.path());
    let room = Room::cornell();
    let root = room_root(&mut app, &room);
    let server = app.world().resource::<AssetServer>().clone();
    let scene = WorldAssetRoot(server.load("nowhere.scn.ron"));
    app.world_mut().spawn((scene, ChildOf(root)));
    let no_image = server.load("nowhere.png");
    let material = StandardMaterial {
        base_color_texture: Some(no_image),
        ..default()
    };
    let tile = triangle([0.0, 0.1, 0.2].map(|v| Vec3::new(v, 1.0 + 20.0 * v * v, 0.2)));
    spawn_mesh(&mut app, root, tile.clone(), material, default());
    let lost = spawn_mesh(&mut app, root, tile, default(), default());
    let no_material = MeshMaterial3d::<StandardMaterial>(server.load("nowhere.material"));
    app.world_mut().entity_mut(lost).insert(no_material);
    let (summary, scene) = bake(&mut app, root, quick_recipe());
    assert_eq!(scene.info().triangles, 22);
    let texts: Vec<String> = summary.warnings.iter().map(ToString::to_string).collect();
    for part in [
        "its scene is not in the bake",
        "nowhere.png",
        "nowhere.material",
    ] {
        assert!(texts.iter().any(|t| t.contains(part)), "{part}: {texts:#?}");
    }
    assert_eq!(texts.len(), 3, "{texts:#?}");
}
