//! Baked assets in Bevy: loading, hot reload, baking in the background, the asset processor as a build step; and a plugin that
//! stays inert where there is nothing to draw with.

mod plugin_support;

use bevy::prelude::*;
use bevy::render::RenderPlugin;
use bevy::render::settings::{RenderCreation, WgpuLimits, WgpuSettings};
use bevy_meshless_gi::asset::{BakedScene, Limits};
use bevy_meshless_gi::plugin::{AssetBuild, AssetBuildError, process_assets};
use bevy_meshless_gi::prelude::*;
use bevy_meshless_gi::scene::{Material, TriangleMesh};
use plugin_support::app::{camera, headless_plugins, picture, ready, run, target};
use plugin_support::assets::until;
use plugin_support::glb::{glb, gltf};
use plugin_support::log::warnings;
use plugin_support::scenes::{Room, cornell};
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

/// An app without renderer and window.
fn bare_app(assets: &Path) -> App {
    let mut app = App::new();
    app.add_plugins((
        MinimalPlugins,
        AssetPlugin {
            file_path: assets.to_string_lossy().into_owned(),
            ..default()
        },
        TransformPlugin,
        MeshlessGiPlugin::default(),
    ));
    ready(&mut app);
    app
}

#[test]
fn without_a_renderer_the_plugin_is_inert_and_still_loads_and_reloads() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("room.mgi");
    let (room, bake) = cornell();
    std::fs::write(&file, bake.to_bytes().unwrap()).unwrap();
    let (mut app, told) = warnings(|| bare_app(folder.path()));
    assert_eq!(told.len(), 1, "one warning: {told:?}");
    assert!(
        told[0].contains("no renderer") && told[0].contains("stays off"),
        "{told:?}"
    );
    let handle: Handle<MeshlessGiAsset> = app.world().resource::<AssetServer>().load("room.mgi");
    app.world_mut().spawn(MeshlessGi(handle.clone()));
    let loaded = |app: &mut App| {
        app.world()
            .resource::<Assets<MeshlessGiAsset>>()
            .get(&handle)
            .map(|a| a.scene.clone())
    };
    let first = until(&mut app, "loading", loaded);
    assert_eq!(*first, *bake, "what is loaded is what was baked");
    assert_eq!(
        app.world().resource::<MeshlessGiStatus>().get().frame,
        0,
        "nothing was drawn"
    );

    // Baked again, and reloaded, as a file watcher would have it.
    let again = room.recoloured(|c| 0.5 * c).bake(3);
    std::fs::write(&file, again.to_bytes().unwrap()).unwrap();
    app.world().resource::<AssetServer>().reload("room.mgi");
    let second = until(&mut app, "reloading", |app| {
        loaded(app).filter(|s| s.info.fingerprint != first.info.fingerprint || **s != *first)
    });
    assert_eq!(*second, *again);

    // Damage is an error, and leaves the bake that was there.
    let mut damaged = again.to_bytes().unwrap();
    let middle = damaged.len() / 2;
    damaged[middle] ^= 0x40;
    for bytes in [damaged, Vec::new()] {
        std::fs::write(folder.path().join("damaged.mgi"), bytes).unwrap();
        let broken: Handle<MeshlessGiAsset> =
            app.world().resource::<AssetServer>().load("damaged.mgi");
        let failed = |app: &mut App| match app
            .world()
            .resource::<AssetServer>()
            .get_load_state(&broken)
        {
            Some(bevy::asset::LoadState::Failed(why)) => Some(why.to_string()),
            _ => None,
        };
        let why = until(&mut app, "failing", failed);
        assert!(why.contains("damaged.mgi"), "{why}");
    }
}

#[test]
fn a_device_that_lacks_what_we_need_gets_a_picture_and_no_indirect_light() {
    let mut app = App::new();
    let plugins = headless_plugins().set(RenderPlugin {
        synchronous_pipeline_compilation: true,
        render_creation: RenderCreation::Automatic(Box::new(WgpuSettings {
            constrained_limits: Some(WgpuLimits {
                max_storage_textures_per_shader_stage: 0,
                ..WgpuLimits::default()
            }),
            ..default()
        })),
        ..default()
    });
    app.add_plugins((plugins, MeshlessGiPlugin::default()));
    app.insert_resource(GlobalAmbientLight::NONE);
    let ((), told) = warnings(|| ready(&mut app));
    assert_eq!(told.len(), 1, "one warning: {told:?}");
    assert!(
        told[0].contains("stays off, because")
            && told[0].contains("maxStorageTexturesPerShaderStage"),
        "{told:?}"
    );
    let (room, bake) = cornell();
    let asset = app
        .world_mut()
        .resource_mut::<Assets<MeshlessGiAsset>>()
        .add(MeshlessGiAsset { scene: bake });
    let root = app.world_mut().spawn(MeshlessGi(asset)).id();
    room.spawn(&mut app, root);
    let image = target(&mut app);
    let view = Transform::from_xyz(0.0, 1.0, 4.0).looking_at(Vec3::new(0.0, 1.0, 0.0), Vec3::Y);
    app.world_mut()
        .spawn((camera(&image, view), MeshlessGiCamera::default()));
    app.world_mut().spawn((
        PointLight {
            intensity: 20_000.0,
            ..default()
        },
        Transform::from_xyz(0.0, 1.5, 0.3),
    ));
    let (mean, told) = warnings(|| {
        run(&mut app, 3);
        picture(&mut app, &image).mean()
    });
    assert!(mean > 0.01, "the rest of the app draws");
    assert!(told.is_empty(), "it is not told again: {told:?}");
    assert_eq!(
        app.world().resource::<MeshlessGiStatus>().get().frame,
        0,
        "indirect light stays off"
    );
}

fn level(room: &Room) -> TriangleMesh {
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
    let materials = room.0.iter().map(|q| Material::diffuse(q.colour)).collect();
    let of = (0..triangles.len() as u32).map(|i| i / 2).collect();
    TriangleMesh::new(triangles, of, materials)
}

fn quick() -> Recipe {
    Recipe {
        preset: Preset::Draft,
        coarse_radius: Some(0.4),
        levels: Some(3),
        rays: Some(64),
        ..default()
    }
}

/// Ends of bakes.
#[derive(Resource, Default)]
struct Ends(Vec<MeshlessGiBakeFinished>);

fn asset_points(app: &App, handle: &Handle<MeshlessGiAsset>) -> u64 {
    let assets = app.world().resource::<Assets<MeshlessGiAsset>>();
    assets.get(handle).unwrap().scene.points.len() as u64
}

#[test]
fn a_bake_in_the_background_becomes_the_scenes_light_fails_or_is_cancelled() {
    let folder = tempfile::tempdir().unwrap();
    let mut app = bare_app(folder.path());
    app.init_resource::<Ends>();
    app.add_observer(
        |event: On<MeshlessGiBakeFinished>, mut ends: ResMut<Ends>| {
            ends.0.push(event.event().clone());
        },
    );
    let end_of = |app: &App, entity: Entity| {
        let ends = &app.world().resource::<Ends>().0;
        let of: Vec<_> = ends.iter().filter(|end| end.entity == entity).collect();
        assert!(of.len() <= 1, "one end for each bake: {of:?}");
        of.first().map(|end| end.result.clone())
    };
    let room = Room::cornell();
    let good = app
        .world_mut()
        .spawn(MeshlessGiBake::spawn(level(&room), quick()))
        .id();
    let empty = app
        .world_mut()
        .spawn(MeshlessGiBake::spawn(
            TriangleMesh::new(vec![], vec![], vec![]),
            quick(),
        ))
        .id();
    let wrong = Recipe {
        rays: Some(1),
        ..quick()
    };
    let wrong = app
        .world_mut()
        .spawn(MeshlessGiBake::spawn(level(&room), wrong))
        .id();
    let mut stages = Vec::new();
    let handle = until(&mut app, "baking", |app| {
        if let Some(progress) = app.world().get::<MeshlessGiBakeProgress>(good) {
            assert!((0.0..=1.0).contains(&progress.fraction));
            if !stages.contains(&progress.stage) {
                stages.push(progress.stage);
            }
        }
        app.world().get::<MeshlessGi>(good).map(|gi| gi.0.clone())
    });
    assert!(!stages.is_empty(), "progress was seen");
    let asset = app
        .world()
        .resource::<Assets<MeshlessGiAsset>>()
        .get(&handle)
        .unwrap();
    assert!(asset.scene.points.len() > 100 && !asset.scene.operator.links.is_empty());
    let summary = end_of(&app, good)
        .expect("the event comes with the light")
        .unwrap();
    assert!(summary.seconds > 0.0 && !summary.loaded);
    assert_eq!(summary.points, asset_points(&app, &handle));
    assert!(!app.world().entity(good).contains::<MeshlessGiBake>());
    assert!(
        !app.world()
            .entity(good)
            .contains::<MeshlessGiBakeProgress>()
    );
    for (entity, word) in [(empty, "no surface"), (wrong, "rays")] {
        let result = until(&mut app, "failing", |app| end_of(app, entity));
        let error = result.unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
        assert!(app.world().get::<MeshlessGi>(entity).is_none());
        assert!(
            !app.world()
                .entity(entity)
                .contains::<MeshlessGiBakeProgress>()
        );
    }

    // Bevy's pools stay free, for its pipelines for instance, however small they are.
    let pool = bevy::tasks::AsyncComputeTaskPool::get();
    let slow = Recipe {
        rays: Some(60_000),
        preset: Preset::High,
        ..Recipe::default()
    };
    let many: Vec<Entity> = (0..pool.thread_num())
        .map(|_| {
            let bake = MeshlessGiBake::spawn(level(&room), slow.clone());
            app.world_mut().spawn(bake).id()
        })
        .collect();
    app.update();
    let begun = Instant::now();
    assert_eq!(bevy::tasks::block_on(pool.spawn(async { 7 })), 7);
    assert!(begun.elapsed() < Duration::from_secs(5));
    app.update();
    for baking in many {
        assert!(
            app.world().get::<MeshlessGiBake>(baking).is_some(),
            "still under way"
        );
        app.world_mut().despawn(baking);
    }

    // A bake that would take minutes stops when its entity goes.
    let long = Recipe {
        rays: Some(60_000),
        preset: Preset::High,
        ..Recipe::default()
    };
    let long = app
        .world_mut()
        .spawn(MeshlessGiBake::spawn(level(&room), long))
        .id();
    app.update();
    app.world_mut().despawn(long);
    let begun = Instant::now();
    drop(app);
    assert!(begun.elapsed() < Duration::from_secs(20));
}

/// The name of the environment variable that makes [`process_here`] work.
const PROCESS: &str = "MGI_TEST_PROCESS";

/// Not a test of its own: [`the_asset_processor_bakes_recipes`] runs it in a process with another asset root.
#[test]
fn process_here() {
    if std::env::var_os(PROCESS).is_none() {
        return;
    }
    bevy::log::tracing::subscriber::set_global_default(Log).expect("the process is fresh");
    let build = AssetBuild {
        time_limit: Duration::from_secs(120),
        ..AssetBuild::default()
    };
    match process_assets(&build) {
        Ok(baked) => println!("BAKED {baked:?}"),
        Err(AssetBuildError::Failed(failed)) => println!("FAILED {failed:?}"),
        Err(why) => panic!("{why}"),
    }
}

/// Prints errors and what the plugin tells: a log in a few lines.
struct Log;

impl bevy::log::tracing::Subscriber for Log {
    fn enabled(&self, metadata: &bevy::log::tracing::Metadata<'_>) -> bool {
        let ours = metadata.target().starts_with("bevy_meshless_gi");
        *metadata.level() == bevy::log::Level::ERROR
            || (ours && *metadata.level() <= bevy::log::Level::INFO)
    }
    fn new_span(
        &self,
        _: &bevy::log::tracing::span::Attributes<'_>,
    ) -> bevy::log::tracing::span::Id {
        bevy::log::tracing::span::Id::from_u64(1)
    }
    fn record(&self, _: &bevy::log::tracing::span::Id, _: &bevy::log::tracing::span::Record<'_>) {}
    fn record_follows_from(
        &self,
        _: &bevy::log::tracing::span::Id,
        _: &bevy::log::tracing::span::Id,
    ) {
    }
    fn event(&self, event: &bevy::log::tracing::Event<'_>) {
        struct Message;
        impl bevy::log::tracing::field::Visit for Message {
            fn record_debug(
                &mut self,
                field: &bevy::log::tracing::field::Field,
                value: &dyn std::fmt::Debug,
            ) {
                if field.name() == "message" {
                    println!("LOG {value:?}");
                }
            }
        }
        event.record(&mut Message);
    }
    fn enter(&self, _: &bevy::log::tracing::span::Id) {}
    fn exit(&self, _: &bevy::log::tracing::span::Id) {}
}

/// Processes the assets below `root` in a process of its own and returns what it printed.
fn process(root: &Path) -> String {
    let output = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "process_here", "--nocapture"])
        .env(PROCESS, "1")
        .env("BEVY_ASSET_ROOT", root)
        .env_remove("RUST_BACKTRACE")
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned()
        + &String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{text}");
    text
}

#[test]
fn the_asset_processor_bakes_recipes() {
    let root = tempfile::tempdir().unwrap();
    let levels = root.path().join("assets/levels");
    std::fs::create_dir_all(&levels).unwrap();
    let room = Room::cornell();
    std::fs::write(levels.join("room.glb"), glb(&room)).unwrap();
    let recipe = r#"(scene: "room.glb", preset: Draft, coarse_radius: 0.4, levels: 3, rays: 64)"#;
    std::fs::write(levels.join("room.gi.ron"), recipe).unwrap();

    let text = process(root.path());
    assert!(
        text.contains("BAKED") && text.contains("room.gi.ron"),
        "{text}"
    );
    assert_eq!(text.matches("LOG baked").count(), 1, "{text}");
    let output = root
        .path()
        .join("imported_assets/Default/levels/room.gi.ron");
    let load = |path: &Path| {
        BakedScene::from_bytes(&std::fs::read(path).unwrap(), &Limits::default()).unwrap()
    };
    let first = load(&output);
    assert_eq!(first.info.triangles, 20);

    // Nothing changed: nothing is baked. The level changes: it is.
    assert_eq!(process(root.path()).matches("LOG baked").count(), 0);
    std::fs::write(levels.join("room.glb"), glb(&room.recoloured(|c| 0.5 * c))).unwrap();
    assert_eq!(process(root.path()).matches("LOG baked").count(), 1);
    assert_ne!(load(&output).info.fingerprint, first.info.fingerprint);

    // So do the recipe, and a file that a level names.
    let finer = recipe.replace("rays: 64", "rays: 96");
    std::fs::write(levels.join("room.gi.ron"), &finer).unwrap();
    let text = process(root.path());
    assert_eq!(text.matches("LOG baked").count(), 1, "{text}");
    assert!(load(&output).info.recipe.contains("rays:96"));
    std::fs::write(levels.join("room.gi.ron"), recipe).unwrap();
    let (json, binary) = gltf(&room, "parts.bin");
    std::fs::write(levels.join("parts.gltf"), json).unwrap();
    std::fs::write(levels.join("parts.bin"), &binary).unwrap();
    let of_parts = recipe.replace("room.glb", "parts.gltf");
    std::fs::write(levels.join("parts.gi.ron"), of_parts).unwrap();
    assert_eq!(process(root.path()).matches("LOG baked").count(), 2);
    let parts = root
        .path()
        .join("imported_assets/Default/levels/parts.gi.ron");
    let before = load(&parts);
    assert_eq!(process(root.path()).matches("LOG baked").count(), 0);
    let mut smaller = room.clone();
    smaller.0.truncate(5);
    smaller.0.extend([smaller.0[4]; 5]);
    std::fs::write(levels.join("parts.bin"), gltf(&smaller, "parts.bin").1).unwrap();
    assert_eq!(process(root.path()).matches("LOG baked").count(), 1);
    assert_ne!(load(&parts).info.fingerprint, before.info.fingerprint);

    // The app that ships loads what was baked, by the recipe's name.
    let mut app = App::new();
    app.add_plugins((
        MinimalPlugins,
        AssetPlugin {
            mode: AssetMode::Processed,
            use_asset_processor_override: Some(false),
            file_path: root.path().join("assets").to_string_lossy().into_owned(),
            processed_file_path: root
                .path()
                .join("imported_assets/Default")
                .to_string_lossy()
                .into_owned(),
            ..default()
        },
        MeshlessGiPlugin::default(),
    ));
    ready(&mut app);
    let handle: Handle<MeshlessGiAsset> = app
        .world()
        .resource::<AssetServer>()
        .load("levels/room.gi.ron");
    let loaded = until(&mut app, "loading", |app| {
        app.world()
            .resource::<Assets<MeshlessGiAsset>>()
            .get(&handle)
            .map(|a| a.scene.clone())
    });
    assert_eq!(*loaded, load(&output));

    // Levels that cannot be baked: each says what and where, and leaves nothing that looks like a bake.
    std::fs::write(levels.join("broken.glb"), b"not a level").unwrap();
    std::fs::write(levels.join("broken.gi.ron"), r#"(scene: "broken.glb")"#).unwrap();
    std::fs::write(levels.join("missing.gi.ron"), r#"(scene: "nowhere.glb")"#).unwrap();
    std::fs::write(
        levels.join("typo.gi.ron"),
        r#"(scene: "room.glb", raze: 64)"#,
    )
    .unwrap();
    std::fs::write(
        levels.join("room.gi.ron"),
        r#"(scene: "room.glb", rays: 1)"#,
    )
    .unwrap();
    let text = process(root.path());
    let failed = text
        .lines()
        .find(|l| l.starts_with("FAILED"))
        .unwrap_or_else(|| panic!("{text}"));
    for (name, words) in [
        ("broken", "broken.glb"),
        ("missing", "nowhere.glb"),
        ("typo", "raze"),
        ("room", "rays"),
    ] {
        assert!(failed.contains(&format!("{name}.gi.ron")), "{text}");
        assert!(
            text.lines()
                .any(|l| l.starts_with("LOG") && l.contains(words)),
            "{name}: {text}"
        );
        assert!(
            !root
                .path()
                .join(format!("imported_assets/Default/levels/{name}.gi.ron"))
                .exists(),
            "{name}"
        );
    }

    // And back again.
    for name in ["broken", "missing", "typo"] {
        std::fs::remove_file(levels.join(format!("{name}.gi.ron"))).unwrap();
    }
    std::fs::write(levels.join("room.gi.ron"), recipe).unwrap();
    let text = process(root.path());
    assert!(text.contains("BAKED"), "{text}");
    assert_eq!(load(&output), *loaded);
}

#[test]
fn an_unprocessed_recipe_bakes_while_it_loads() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("room.glb"), glb(&Room::cornell())).unwrap();
    let recipe = r#"(scene: "room.glb", preset: Draft, coarse_radius: 0.4, levels: 3, rays: 64)"#;
    std::fs::write(folder.path().join("room.gi.ron"), recipe).unwrap();
    let mut app = bare_app(folder.path());
    let handle: Handle<MeshlessGiAsset> = app.world().resource::<AssetServer>().load("room.gi.ron");
    let scene = until(&mut app, "baking", |app| {
        app.world()
            .resource::<Assets<MeshlessGiAsset>>()
            .get(&handle)
            .map(|a| a.scene.clone())
    });
    assert_eq!(scene.info.triangles, 20);
}
