//! Bakes of a changed scene, recipe or bake version: content and time of the loader's reports.

use crate::support::app::finish_plugins;
use crate::support::assets::until;
use crate::support::glb::{glb, gltf};
use crate::support::log::warnings;
use crate::support::scenes::Room;
use bevy::asset::AssetPath;
use bevy::asset::io::{AssetSourceBuilder, AssetSourceEvent, AssetSourceId, AssetWatcher};
use bevy::ecs::schedule::SingleThreadedExecutor;
use bevy::prelude::*;
use bevy_meshless_gi::loader::{GiProcessAssetsOptions, process_assets};
use bevy_meshless_gi::prelude::*;
use bevy_meshless_gi::{GiStaleBakes, GiWarning, GiWarnings};
use meshless_gi::{BakedScene, Limits};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

const RECIPE: &str =
    r#"(scene: "room.glb", preset: Draft, coarse_radius: 0.6, levels: 3, rays: 64)"#;

/// Returns the room with a shifted block.
fn shifted_room() -> Room {
    let mut room = Room::cornell();
    room.0[5..].iter_mut().for_each(|quad| quad.corner.x -= 0.4);
    room
}

/// Writes a scene, its recipe and its bake to a folder of assets.
fn write_scene(root: &Path) -> PathBuf {
    let assets = root.join("assets");
    std::fs::create_dir_all(&assets).unwrap();
    std::fs::write(assets.join("room.glb"), glb(&Room::cornell())).unwrap();
    std::fs::write(assets.join("room.gi.ron"), RECIPE).unwrap();
    let processed = root.join("imported_assets/Default");
    process_assets(&GiProcessAssetsOptions {
        source: assets.clone(),
        processed: processed.clone(),
        ..GiProcessAssetsOptions::default()
    })
    .unwrap();
    std::fs::copy(processed.join("room.gi.ron"), assets.join("room.mgi")).unwrap();
    assets
}

/// Sender of file changes to an app.
#[derive(Clone, Default)]
struct Changes(Arc<Mutex<Option<Sink>>>);

type Sink = Box<dyn Fn(&str) + Send>;

impl Changes {
    fn notify(&self, path: &str) {
        self.0.lock().unwrap().as_ref().expect("an app watches")(path);
    }
}

struct NoWatcher;

impl AssetWatcher for NoWatcher {}

/// Creates an app without a renderer that watches its assets, with one entity that uses the bake
/// `path`.
fn app_with(assets: AssetPlugin, path: &str, changes: &Changes) -> App {
    let changes = changes.0.clone();
    let source =
        AssetSourceBuilder::platform_default(&assets.file_path, Some(&assets.processed_file_path))
            .with_watcher(move |sender| {
                *changes.lock().unwrap() = Some(Box::new(move |path| {
                    let event = AssetSourceEvent::ModifiedAsset(path.into());
                    sender.try_send(event).expect("the app runs");
                }));
                Some(Box::new(NoWatcher))
            });
    let mut app = App::new();
    app.register_asset_source(AssetSourceId::Default, source)
        .add_plugins((
            MinimalPlugins,
            AssetPlugin {
                watch_for_changes_override: Some(true),
                ..assets
            },
            TransformPlugin,
            MeshlessGiPlugin::default(),
        ));
    // The test reads the log of its own thread.
    app.edit_schedule(Last, |schedule| {
        schedule.set_executor(SingleThreadedExecutor::new());
    });
    finish_plugins(&mut app);
    let bake = app
        .world()
        .resource::<AssetServer>()
        .load::<GiBakedScene>(path.to_owned());
    app.world_mut().spawn((Name::new("hall"), GiScene(bake)));
    app
}

fn unprocessed_assets(assets: &Path) -> AssetPlugin {
    AssetPlugin {
        file_path: assets.to_string_lossy().into_owned(),
        ..default()
    }
}

/// Updates until the bake of the one entity has loaded, and once more.
fn load(app: &mut App) {
    let mut scenes = app.world_mut().query::<&GiScene>();
    let bake = scenes.single(app.world()).unwrap().0.clone();
    until(app, "loading", |app| {
        let assets = app.world().resource::<Assets<GiBakedScene>>();
        assets.contains(&bake).then_some(())
    });
    app.update();
}

/// Returns the changed inputs of the bake `path`. `None` if it is not stale.
fn stale(app: &App, path: &str) -> Option<String> {
    let mut stale = app.world().resource::<GiStaleBakes>().iter();
    let found = stale.find(|(bake, _)| **bake == AssetPath::from(path.to_owned()));
    found.map(|(_, inputs)| inputs)
}

fn findings(app: &App) -> &[GiWarning] {
    &app.world().resource::<GiWarnings>().0
}

#[test]
fn changed_scene_is_reported_once() {
    let root = tempfile::tempdir().unwrap();
    let assets = write_scene(root.path());
    let changes = Changes::default();
    let mut app = app_with(unprocessed_assets(&assets), "room.mgi", &changes);
    let ((), lines) = warnings(|| load(&mut app));
    assert_eq!(stale(&app, "room.mgi"), None);
    assert!(lines.is_empty() && findings(&app).is_empty(), "{lines:?}");

    // After the scene file changes, Bevy reloads the bake.
    std::fs::write(assets.join("room.glb"), glb(&shifted_room())).unwrap();
    changes.notify("room.glb");
    let (found, lines) = warnings(|| {
        let found = until(&mut app, "the comparison", |app| stale(app, "room.mgi"));
        (0..20).for_each(|_| app.update());
        found
    });
    assert_eq!(found, "content");
    assert_eq!(lines.len(), 1, "{lines:?}");
    for part in [
        "hall (",
        "`room.mgi` is stale",
        "`room.glb` has changed",
        "meshless_gi bake room.glb -o room.mgi",
    ] {
        assert!(lines[0].contains(part), "{part}: {}", lines[0]);
    }
    assert_eq!(findings(&app), [GiWarning::StaleBake]);

    // The same geometry in another file format is not a change.
    let (json, binary) = gltf(&Room::cornell(), "room.bin");
    std::fs::write(assets.join("room.bin"), binary).unwrap();
    std::fs::write(assets.join("room.glb"), json).unwrap();
    changes.notify("room.glb");
    until(&mut app, "the comparison", |app| {
        stale(app, "room.mgi").is_none().then_some(())
    });
}

#[test]
fn unchecked_scene_is_not_reported() {
    let root = tempfile::tempdir().unwrap();
    let assets = write_scene(root.path());
    std::fs::write(assets.join("room.glb"), glb(&shifted_room())).unwrap();
    // `check_level` is an earlier name of `check_scene`.
    let meta = |check: &str| {
        let text = format!(
            r#"(meta_format_version: "1.0", asset: Load(loader: "bevy_meshless_gi::plugin::loader::GiBakedSceneLoader", settings: ({check})))"#
        );
        std::fs::write(assets.join("room.mgi.meta"), text).unwrap();
    };
    meta("check_scene: Never");
    let mut app = app_with(unprocessed_assets(&assets), "room.mgi", &Changes::default());
    load(&mut app);
    assert_eq!(stale(&app, "room.mgi"), None);
    meta("check_level: Always");
    let mut app = app_with(unprocessed_assets(&assets), "room.mgi", &Changes::default());
    let found = until(&mut app, "the comparison", |app| stale(app, "room.mgi"));
    assert!(found.contains("content"), "{found}");

    // Without the scene file, the bake is not compared.
    std::fs::remove_file(assets.join("room.glb")).unwrap();
    let mut app = app_with(unprocessed_assets(&assets), "room.mgi", &Changes::default());
    load(&mut app);
    assert_eq!(stale(&app, "room.mgi"), None);
}

#[test]
fn bake_of_other_version_is_reported_without_scene() {
    let root = tempfile::tempdir().unwrap();
    let assets = write_scene(root.path());
    let file = assets.join("room.mgi");
    let mut scene = BakedScene::read(&file, &Limits::default()).unwrap();
    scene.info_mut().bake_version -= 1;
    scene.info_mut().scene = None;
    scene.write(&file).unwrap();
    let mut app = app_with(unprocessed_assets(&assets), "room.mgi", &Changes::default());
    let ((), lines) = warnings(|| load(&mut app));
    assert_eq!(stale(&app, "room.mgi").as_deref(), Some("bake version"));
    assert!(
        lines.len() == 1 && lines[0].contains("version"),
        "{lines:?}"
    );
}

#[test]
fn processed_recipe_with_changed_sources_is_reported() {
    let root = tempfile::tempdir().unwrap();
    let assets = write_scene(root.path());
    let processed = || AssetPlugin {
        mode: AssetMode::Processed,
        use_asset_processor_override: Some(false),
        processed_file_path: root
            .path()
            .join("imported_assets/Default")
            .to_string_lossy()
            .into_owned(),
        ..unprocessed_assets(&assets)
    };
    let app = || app_with(processed(), "room.gi.ron", &Changes::default());
    let mut fresh = app();
    load(&mut fresh);
    assert_eq!(stale(&fresh, "room.gi.ron"), None);

    std::fs::write(assets.join("room.glb"), glb(&shifted_room())).unwrap();
    let finer = RECIPE.replace("rays: 64", "rays: 96");
    std::fs::write(assets.join("room.gi.ron"), finer).unwrap();
    let mut changed = app();
    let (found, lines) = warnings(|| {
        until(&mut changed, "the comparison", |app| {
            stale(app, "room.gi.ron")
        })
    });
    assert_eq!(found, "content, settings");
    assert_eq!(lines.len(), 1, "{lines:?}");
    for part in ["`room.gi.ron`", "`room.glb`", "recipe", "process_assets"] {
        assert!(lines[0].contains(part), "{part}: {}", lines[0]);
    }
}
