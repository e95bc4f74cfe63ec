//! Example `load_gltf`: scenes and other files that are dropped on the window, the camera after a
//! bake, the progress bar, and saving.

#[path = "../../examples/load_gltf/main.rs"]
#[allow(dead_code, reason = "the example's own `main` and command line")]
mod level;

use crate::support::app::{finish_plugins, headless_plugins, run};
use crate::support::glb::glb;
use crate::support::scenes::Room;
use bevy::asset::AssetPlugin;
use bevy::camera::Exposure;
use bevy::prelude::*;
use bevy::window::FileDragAndDrop;
use bevy_meshless_gi::GiBakeTask;
use bevy_meshless_gi::prelude::*;
use level::drop::{CurrentScene, Loaded};
use level::progress::{Bar, Lines, Notice, overall};
use level::{LoadGltfPlugin, drop};
use meshless_gi::{BakeStage, BakedScene, Limits, Preset};
use std::path::{Path, PathBuf};
use std::time::Duration;

fn write_scene(folder: &Path, name: &str) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, glb(&Room::cornell())).unwrap();
    path
}

fn new_app(first: Loaded) -> App {
    let mut app = App::new();
    app.add_plugins((
        headless_plugins().set::<AssetPlugin>(level::assets()),
        MeshlessGiPlugin::default(),
        LoadGltfPlugin::new(first, Preset::Draft),
    ));
    finish_plugins(&mut app);
    app
}

fn drop_file(app: &mut App, path: &Path) {
    app.world_mut().write_message(FileDragAndDrop::DroppedFile {
        window: Entity::PLACEHOLDER,
        path_buf: path.into(),
    });
    run(app, 2);
}

/// Runs until no bake is in progress. Returns the widths of the bar in percent.
fn bake(app: &mut App) -> Vec<f32> {
    let mut widths = Vec::new();
    for _ in 0..60_000 {
        run(app, 1);
        let world = app.world_mut();
        if world.query::<&GiBakeTask>().iter(world).next().is_none() {
            run(app, 2);
            return widths;
        }
        let mut bar = world.query_filtered::<&Node, With<Bar>>();
        if let Val::Percent(width) = bar.single(world).unwrap().width {
            widths.push(width);
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    panic!("the bake does not end");
}

fn eye(app: &mut App) -> (Transform, f32) {
    let world = app.world_mut();
    let mut eyes = world.query_filtered::<(&Transform, &Exposure), With<Camera3d>>();
    let (transform, exposure) = eyes.iter(world).find(|(_, e)| e.ev100.is_finite()).unwrap();
    (*transform, exposure.ev100)
}

fn current_path(app: &App) -> PathBuf {
    app.world().resource::<CurrentScene>().path.clone()
}

fn press_save(app: &mut App) {
    for pressed in [true, false] {
        let mut keys = app.world_mut().resource_mut::<ButtonInput<KeyCode>>();
        for key in [KeyCode::ControlLeft, KeyCode::KeyS] {
            match pressed {
                true => keys.press(key),
                false => keys.release(key),
            }
        }
        // A frame would clear the keys first.
        app.world_mut().run_schedule(Update);
    }
    for _ in 0..1000 {
        run(app, 1);
        if !app.world().resource::<Notice>().0.is_empty() {
            return;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    panic!("the notice for the file is missing");
}

#[test]
fn dropped_scenes_load_and_other_files_are_ignored() {
    let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let first = write_scene(folders[0].path(), "first.glb");
    let second = write_scene(folders[1].path(), "second # level.glb");
    let mut app = new_app(drop::read(&first).unwrap());
    run(&mut app, 2);
    assert_eq!(current_path(&app), first);
    let root = app.world().resource::<CurrentScene>().root;

    // A file that is not a glTF file, and a missing file.
    let text = folders[0].path().join("notes.glb");
    std::fs::write(&text, "no glTF").unwrap();
    for wrong in [text, folders[0].path().join("missing.glb")] {
        drop_file(&mut app, &wrong);
        let notice = app.world().resource::<Notice>().0.clone();
        let name = wrong.file_name().unwrap().to_string_lossy().into_owned();
        assert!(
            notice.starts_with("not shown: ") && notice.contains(&name),
            "{notice}"
        );
        let world = app.world_mut();
        let mut lines = world.query_filtered::<&Text, With<Lines>>();
        assert!(lines.single(world).unwrap().0.contains(&notice));
        assert_eq!(
            (
                current_path(&app),
                app.world().resource::<CurrentScene>().root
            ),
            (first.clone(), root)
        );
        assert!(app.world().get_entity(root).is_ok());
    }

    // A second scene, then the first one again.
    for path in [&second, &first, &second] {
        let before = app.world().resource::<CurrentScene>().root;
        drop_file(&mut app, path);
        assert_eq!(current_path(&app), *path);
        assert_eq!(app.world().resource::<Notice>().0, "");
        assert!(app.world().get_entity(before).is_err());
        let world = app.world_mut();
        let bakes = world.query::<&GiBakeTask>().iter(world).count();
        assert_eq!(bakes, 1);
    }
    // The meshes come from the folder of the scene.
    bake(&mut app);
    let world = app.world_mut();
    assert_eq!(world.query::<&GiScene>().iter(world).count(), 1);
    assert!(world.query::<&Mesh3d>().iter(world).count() >= Room::cornell().0.len());
}

#[test]
fn dropped_scene_bake_moves_camera_shows_progress_and_is_saved() {
    let folder = tempfile::tempdir().unwrap();
    let file = write_scene(folder.path(), "level.glb");
    let mut app = new_app(drop::read(&file).unwrap());
    run(&mut app, 1);
    let (start, _) = eye(&mut app);
    press_save(&mut app);
    let notice = app.world().resource::<Notice>().0.clone();
    assert_eq!(notice, "not saved: there is no bake yet");

    let widths = bake(&mut app);
    assert!(widths.windows(2).all(|w| w[0] <= w[1]), "{widths:?}");
    assert!(widths.last().is_some_and(|w| *w > 20.0), "{widths:?}");

    // The camera is at a viewpoint of the bake, is horizontal, and has the exposure of a lit room.
    let (now, ev100) = eye(&mut app);
    let level = app.world().resource::<CurrentScene>();
    let gi = app.world().get::<GiScene>(level.root).unwrap();
    let bakes = app.world().resource::<Assets<GiBakedScene>>();
    let bake = bakes.get(&gi.0).unwrap().scene.clone();
    let at = now.translation.to_array();
    assert_ne!(now, start);
    assert!(bake.info().viewpoints.contains(&at), "{at:?}");
    assert!(now.forward().y.abs() < 1e-3);
    assert!(
        (-4.0..16.0).contains(&ev100) && ev100 != Exposure::default().ev100,
        "{ev100}"
    );

    press_save(&mut app);
    let notice = app.world().resource::<Notice>().0.clone();
    let saved = folder.path().join("level.mgi");
    assert!(notice.contains("level.mgi"), "{notice}");
    let read = BakedScene::read(&saved, &Limits::default()).unwrap();
    assert_eq!(read.info(), bake.info());

    // An existing folder of the same name gives an error on the screen.
    std::fs::remove_file(&saved).unwrap();
    std::fs::create_dir(&saved).unwrap();
    app.world_mut().resource_mut::<Notice>().0.clear();
    press_save(&mut app);
    let notice = app.world().resource::<Notice>().0.clone();
    assert!(notice.starts_with("not saved: "), "{notice}");
}

#[test]
fn overall_progress_rises_from_stage_to_stage() {
    let stages = [
        BakeStage::Waiting,
        BakeStage::Geometry,
        BakeStage::Points,
        BakeStage::Transport,
        BakeStage::Probes,
        BakeStage::Bounces,
        BakeStage::Visibility,
        BakeStage::ErrorEstimate,
    ];
    let steps = stages
        .iter()
        .flat_map(|s| [0.0, 0.5, 1.0].map(|d| overall(*s, d)));
    let steps: Vec<f32> = steps.collect();
    assert!(steps.windows(2).all(|w| w[0] <= w[1]), "{steps:?}");
    assert_eq!((steps[0], steps[steps.len() - 1]), (0.0, 1.0));
}
