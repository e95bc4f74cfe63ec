//! Baked assets in Bevy: loading, hot reload, background bakes, and a plugin that is inert without
//! a renderer or on an unsupported device.

use crate::support::app::{
    app_with, camera, finish_plugins, limited_plugins, picture, run, target,
};
use crate::support::assets::{bake_threads, bare_app, until, until_ended};
use crate::support::log::warnings;
use crate::support::scenes::{Room, cornell, rough_recipe};
use crate::support::stage::{counters, indirect, spawn_baked, view};
use bevy::prelude::*;
use bevy::render::settings::WgpuLimits;
use bevy_meshless_gi::internals::plan::SkipReason;
use bevy_meshless_gi::prelude::*;
use meshless_gi::{Material, TriangleMesh};

#[test]
fn plugin_without_renderer_loads_assets_only() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("room.mgi");
    let (room, bake) = cornell();
    std::fs::write(&file, bake.to_bytes().unwrap()).unwrap();
    let (mut app, logged) = warnings(|| bare_app(folder.path()));
    assert_eq!(logged.len(), 1, "one warning: {logged:?}");
    assert!(
        logged[0].contains("no renderer") && logged[0].contains("is disabled"),
        "{logged:?}"
    );
    let handle: Handle<GiBakedScene> = app.world().resource::<AssetServer>().load("room.mgi");
    app.world_mut().spawn(GiScene(handle.clone()));
    let loaded = |app: &mut App| {
        app.world()
            .resource::<Assets<GiBakedScene>>()
            .get(&handle)
            .map(|a| a.scene.clone())
    };
    let first = until(&mut app, "loading", loaded);
    assert_eq!(*first, *bake, "the loaded scene equals the baked one");
    assert_eq!(
        app.world().resource::<GiFrameStats>().get().frame,
        0,
        "nothing was drawn"
    );

    // The room is baked again and reloaded, as by a file watcher.
    let again = room.recolored(|c| 0.5 * c).bake(3);
    std::fs::write(&file, again.to_bytes().unwrap()).unwrap();
    app.world().resource::<AssetServer>().reload("room.mgi");
    let second = until(&mut app, "reloading", |app| {
        loaded(app).filter(|s| s.info().fingerprint != first.info().fingerprint || **s != *first)
    });
    assert_eq!(*second, *again);

    // A damaged or empty file is an error that names the file.
    let mut damaged = again.to_bytes().unwrap();
    let middle = damaged.len() / 2;
    damaged[middle] ^= 0x40;
    for bytes in [damaged, Vec::new()] {
        std::fs::write(folder.path().join("damaged.mgi"), bytes).unwrap();
        let broken: Handle<GiBakedScene> =
            app.world().resource::<AssetServer>().load("damaged.mgi");
        let failed = |app: &mut App| match app
            .world()
            .resource::<AssetServer>()
            .get_load_state(&broken)
        {
            Some(bevy::asset::LoadState::Failed(error)) => Some(error.to_string()),
            _ => None,
        };
        let error = until(&mut app, "failing", failed);
        assert!(error.contains("damaged.mgi"), "{error}");
    }
}

#[test]
fn unsupported_device_renders_without_indirect_light() {
    let mut app = App::new();
    let plugins = limited_plugins(WgpuLimits {
        max_storage_textures_per_shader_stage: 0,
        ..WgpuLimits::default()
    });
    app.add_plugins((plugins, MeshlessGiPlugin::default()));
    app.insert_resource(GlobalAmbientLight::NONE);
    let ((), logged) = warnings(|| finish_plugins(&mut app));
    assert_eq!(logged.len(), 1, "one warning: {logged:?}");
    assert!(
        logged[0].contains("indirect light is disabled")
            && logged[0].contains("maxStorageTexturesPerShaderStage"),
        "{logged:?}"
    );
    let (room, bake) = cornell();
    let asset = app
        .world_mut()
        .resource_mut::<Assets<GiBakedScene>>()
        .add(GiBakedScene { scene: bake });
    let root = app.world_mut().spawn(GiScene(asset)).id();
    room.spawn(&mut app, root);
    let image = target(&mut app);
    let view = Transform::from_xyz(0.0, 1.0, 4.0).looking_at(Vec3::new(0.0, 1.0, 0.0), Vec3::Y);
    app.world_mut()
        .spawn((camera(&image, view), GiCamera::default()));
    app.world_mut().spawn((
        PointLight {
            intensity: 20_000.0,
            ..default()
        },
        Transform::from_xyz(0.0, 1.5, 0.3),
    ));
    let (mean, logged) = warnings(|| {
        run(&mut app, 3);
        picture(&mut app, &image).mean()
    });
    assert!(mean > 0.01, "the rest of the app draws");
    assert!(logged.is_empty(), "it is not logged again: {logged:?}");
    assert_eq!(
        app.world().resource::<GiFrameStats>().get().frame,
        0,
        "indirect light stays off"
    );
}

/// A scene whose buffers the device does not hold fails while its passes are recorded. The frame
/// is then planned again without it.
#[test]
fn scene_above_device_limits_is_skipped_in_its_first_frame() {
    const BINDING: u32 = 256 << 10;
    let mut app = app_with(limited_plugins(WgpuLimits {
        max_storage_buffer_binding_size: BINDING.into(),
        ..WgpuLimits::default()
    }));
    let room = Room::cornell();
    let recipe = Recipe {
        coarse_radius: Some(0.25),
        ..rough_recipe()
    };
    let bake = room.bake_as(&recipe);
    spawn_baked(&mut app, &room, &bake, Transform::default());
    let image = target(&mut app);
    app.world_mut().spawn((camera(&image, view()), indirect()));
    let mut reasons = Vec::new();
    for _ in 0..3 {
        run(&mut app, 1);
        let plan = counters(&app).plan;
        assert!(plan.is_empty(), "{plan}");
        reasons.push(plan.skipped.first().map(|(_, _, reason)| *reason));
    }
    for reason in &reasons {
        let skipped = matches!(reason, Some(SkipReason::TooLarge { needs, has })
            if needs > has && *has == u64::from(BINDING));
        assert!(skipped, "{reasons:?}");
    }
}

fn scene_mesh(room: &Room) -> TriangleMesh {
    let mut triangles = Vec::new();
    for q in &room.0 {
        let [a, b, c, d] = [
            q.corner,
            q.corner + q.u,
            q.corner + q.u + q.v,
            q.corner + q.v,
        ];
        triangles.extend([[a, b, c], [a, c, d]]);
    }
    let materials = room.0.iter().map(|q| Material::diffuse(q.color)).collect();
    let of = (0..triangles.len() as u32).map(|i| i / 2).collect();
    TriangleMesh::new(triangles, of, materials)
}

fn quick_recipe() -> Recipe {
    Recipe {
        preset: Preset::Draft,
        coarse_radius: Some(0.6),
        levels: Some(3),
        rays_per_point: Some(64),
        ..default()
    }
}

/// Results of bakes.
#[derive(Resource, Default)]
struct BakeResults(Vec<GiBakeFinished>);

fn asset_points(app: &App, handle: &Handle<GiBakedScene>) -> u64 {
    let assets = app.world().resource::<Assets<GiBakedScene>>();
    assets.get(handle).unwrap().scene.data().points.len() as u64
}

#[test]
fn background_bake_finishes_fails_or_is_canceled() {
    let folder = tempfile::tempdir().unwrap();
    let mut app = bare_app(folder.path());
    app.init_resource::<BakeResults>();
    app.add_observer(|event: On<GiBakeFinished>, mut ends: ResMut<BakeResults>| {
        ends.0.push(event.event().clone());
    });
    let result_of = |app: &App, entity: Entity| {
        let ends = &app.world().resource::<BakeResults>().0;
        let of: Vec<_> = ends.iter().filter(|end| end.entity == entity).collect();
        assert!(of.len() <= 1, "one result for each bake: {of:?}");
        of.first().map(|end| end.result.clone())
    };
    let room = Room::cornell();
    let good = app
        .world_mut()
        .spawn(GiBakeTask::spawn(scene_mesh(&room), quick_recipe()))
        .id();
    let empty = app
        .world_mut()
        .spawn(GiBakeTask::spawn(
            TriangleMesh::new(vec![], vec![], vec![]),
            quick_recipe(),
        ))
        .id();
    let wrong = Recipe {
        rays_per_point: Some(1),
        ..quick_recipe()
    };
    let wrong = app
        .world_mut()
        .spawn(GiBakeTask::spawn(scene_mesh(&room), wrong))
        .id();
    let mut stages = Vec::new();
    let handle = until(&mut app, "baking", |app| {
        if let Some(progress) = app.world().get::<GiBakeProgress>(good) {
            assert!((0.0..=1.0).contains(&progress.fraction));
            if !stages.contains(&progress.stage) {
                stages.push(progress.stage);
            }
        }
        app.world().get::<GiScene>(good).map(|gi| gi.0.clone())
    });
    assert!(!stages.is_empty(), "progress was reported");
    let asset = app
        .world()
        .resource::<Assets<GiBakedScene>>()
        .get(&handle)
        .unwrap();
    assert!(asset.scene.data().points.len() > 100 && !asset.scene.data().operator.links.is_empty());
    let summary = result_of(&app, good)
        .expect("the event comes with the light")
        .unwrap();
    assert!(summary.seconds > 0.0 && !summary.loaded);
    assert_eq!(summary.points, asset_points(&app, &handle));
    assert!(!app.world().entity(good).contains::<GiBakeTask>());
    assert!(!app.world().entity(good).contains::<GiBakeProgress>());
    for (entity, word) in [(empty, "no surface"), (wrong, "rays")] {
        let result = until(&mut app, "failing", |app| result_of(app, entity));
        let error = result.unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
        assert!(app.world().get::<GiScene>(entity).is_none());
        assert!(!app.world().entity(entity).contains::<GiBakeProgress>());
    }

    // Running bakes block no thread of Bevy's pools, which pipelines also use. This holds for pools
    // of any size.
    let pool = bevy::tasks::AsyncComputeTaskPool::get();
    let slow_recipe = Recipe {
        rays_per_point: Some(60_000),
        preset: Preset::High,
        ..Recipe::default()
    };
    let many: Vec<Entity> = (0..pool.thread_num())
        .map(|_| {
            let bake = GiBakeTask::spawn(scene_mesh(&room), slow_recipe.clone());
            app.world_mut().spawn(bake).id()
        })
        .collect();
    app.update();
    assert_eq!(bevy::tasks::block_on(pool.spawn(async { 7 })), 7);
    app.update();
    let running = bake_threads();
    for baking in many {
        assert!(
            app.world().get::<GiBakeTask>(baking).is_some(),
            "still under way"
        );
        app.world_mut().despawn(baking);
    }

    // Bakes that would take minutes stop after their entities are despawned.
    until_ended(&mut app, &running);
}
