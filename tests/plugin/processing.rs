//! Asset processing: the build step, apps with and without their own asset processor, and apps that
//! load processed assets.

use crate::support::app::{camera, finish_plugins, headless_plugins, picture, run, target};
use crate::support::assets::{bare_app_with, shipped_asset_plugin, until};
use crate::support::glb::{glb, gltf, textured_glb};
use crate::support::log::Log;
use crate::support::scenes::Room;
use crate::support::stage::{indirect, save_picture, spawn_light_source, view};
use bevy::asset::io::Reader;
use bevy::asset::processor::AssetProcessor;
use bevy::asset::{AssetLoader, AssetMetaCheck, LoadContext, UntypedHandle};
use bevy::gltf::GltfPlugin;
use bevy::image::{CompressedImageFormats, ImageLoader, ImagePlugin};
use bevy::prelude::*;
use bevy::text::{Font, FontLoader};
use bevy::world_serialization::WorldSerializationPlugin;
use bevy_meshless_gi::loader::{
    GiProcessAssetsError, GiProcessAssetsOptions, GiRecipeProgress, process_assets,
};
use bevy_meshless_gi::prelude::*;
use meshless_gi::{BakedScene, Limits};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

/// Recipe that bakes in less than a second.
const RECIPE: &str =
    r#"(scene: "room.glb", preset: Draft, coarse_radius: 0.6, levels: 3, rays: 64)"#;

/// Assets of [`write_game`] by their paths in an app.
const ASSETS: [&str; 6] = [
    "levels/room.glb#Scene0",
    "levels/room.gi.ron",
    "levels/wall.png",
    "fonts/mono.ttf",
    "sounds/step.wav",
    "intro.talk",
];

/// Asset of file kinds with a loader only in the test's apps.
#[derive(Asset, TypePath)]
struct Bytes(Vec<u8>);

#[derive(Default, TypePath)]
struct BytesLoader;

impl AssetLoader for BytesLoader {
    type Asset = Bytes;
    type Settings = ();
    type Error = std::io::Error;

    async fn load(
        &self,
        reader: &mut dyn Reader,
        _: &(),
        _: &mut LoadContext<'_>,
    ) -> Result<Bytes, std::io::Error> {
        let mut bytes = Vec::new();
        reader.read_to_end(&mut bytes).await?;
        Ok(Bytes(bytes))
    }

    fn extensions(&self) -> &[&str] {
        &["wav", "talk"]
    }
}

/// Writes the sources of a game below `root`: a scene with an external texture, a font, a sound, a
/// file of a game-specific kind, and a recipe.
fn write_game(root: &Path) {
    let assets = root.join("assets");
    for folder in ["levels", "fonts", "sounds"] {
        std::fs::create_dir_all(assets.join(folder)).unwrap();
    }
    let write = |path: &str, bytes: &[u8]| std::fs::write(assets.join(path), bytes).unwrap();
    write(
        "levels/room.glb",
        &textured_glb(&Room::cornell(), "wall.png"),
    );
    image::save_buffer(
        assets.join("levels/wall.png"),
        &[230; 48],
        4,
        4,
        image::ColorType::Rgb8,
    )
    .unwrap();
    write("levels/room.gi.ron", RECIPE.as_bytes());
    write("fonts/mono.ttf", bevy::text::DEFAULT_FONT_DATA);
    write("sounds/step.wav", b"RIFF");
    write("intro.talk", b"Hello.");
}

/// Returns the absolute folders of the project below `root`.
fn build(root: &Path) -> GiProcessAssetsOptions {
    GiProcessAssetsOptions {
        source: root.join("assets"),
        processed: root.join("imported_assets/Default"),
        ..GiProcessAssetsOptions::default()
    }
}

/// Returns all files below `folder` with their bytes.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(at) = folders.pop() {
        for entry in std::fs::read_dir(&at).unwrap().flatten() {
            match entry.path().is_dir() {
                true => folders.push(entry.path()),
                false => {
                    let name = entry.path().strip_prefix(folder).unwrap().to_owned();
                    found.insert(name, std::fs::read(entry.path()).unwrap());
                }
            }
        }
    }
    found
}

fn load_all(app: &App) -> Vec<UntypedHandle> {
    let server = app.world().resource::<AssetServer>();
    vec![
        server.load::<WorldAsset>(ASSETS[0]).untyped(),
        server.load::<GiBakedScene>(ASSETS[1]).untyped(),
        server.load::<Image>(ASSETS[2]).untyped(),
        server.load::<Font>(ASSETS[3]).untyped(),
        server.load::<Bytes>(ASSETS[4]).untyped(),
        server.load::<Bytes>(ASSETS[5]).untyped(),
    ]
}

/// Updates until all of `handles` have loaded. Panics if one fails.
fn wait_for(app: &mut App, handles: &[UntypedHandle]) {
    until(app, "loading", |app| {
        let server = app.world().resource::<AssetServer>();
        for (handle, name) in handles.iter().zip(ASSETS) {
            if let Some(bevy::asset::LoadState::Failed(error)) = server.get_load_state(handle.id())
            {
                panic!("{name}: {error}");
            }
        }
        let loaded = |h: &UntypedHandle| server.is_loaded_with_dependencies(h.id());
        handles.iter().all(loaded).then_some(())
    });
}

fn load_bake(app: &mut App, path: &str) -> std::sync::Arc<BakedScene> {
    let handle: Handle<GiBakedScene> = app.world().resource::<AssetServer>().load(path.to_owned());
    until(app, "loading", |app| {
        let assets = app.world().resource::<Assets<GiBakedScene>>();
        assets.get(&handle).map(|a| a.scene.clone())
    })
}

/// Environment variable that enables [`process_assets_in_child_process`] and selects its action.
const PROCESS: &str = "MGI_TEST_PROCESS";

/// Program of a child process with another asset root and another log, which [`process`] starts.
/// Does nothing without the environment variable.
#[test]
#[ignore = "program of a child process, which other tests start"]
fn process_assets_in_child_process() {
    let Some(kind) = std::env::var_os(PROCESS) else {
        return;
    };
    bevy::log::tracing::subscriber::set_global_default(Log).expect("no other subscriber is set");
    match kind.to_str() {
        Some("step") => match process_assets(&GiProcessAssetsOptions::default()) {
            Ok(report) => println!("BAKED {:?} KEPT {:?}", report.baked, report.kept),
            Err(GiProcessAssetsError::Failed(failed)) => println!("FAILED {failed:?}"),
            Err(error) => panic!("{error}"),
        },
        Some("game") => run_game(),
        _ => load_unprocessed(),
    }
}

/// Runs a game that processes its assets, with loaders for all of them, and loads them.
fn run_game() {
    let mut app = App::new();
    app.add_plugins((
        MinimalPlugins,
        AssetPlugin {
            mode: AssetMode::Processed,
            use_asset_processor_override: Some(true),
            watch_for_changes_override: Some(false),
            ..default()
        },
        TransformPlugin,
        ImagePlugin::default(),
        WorldSerializationPlugin,
        GltfPlugin::default(),
    ))
    // Without a renderer no plugin registers this loader, and the processor would wait for it.
    .register_asset_loader(ImageLoader::new(CompressedImageFormats::NONE))
    .init_asset::<Mesh>()
    .init_asset::<StandardMaterial>()
    .init_asset::<Font>()
    .init_asset_loader::<FontLoader>()
    .init_asset::<Bytes>()
    .init_asset_loader::<BytesLoader>()
    .add_plugins(MeshlessGiPlugin::default());
    finish_plugins(&mut app);
    app.update();
    let processor = app.world().resource::<AssetProcessor>().clone();
    let mut finished = bevy::tasks::IoTaskPool::get()
        .spawn(async move { processor.data().wait_until_finished().await });
    until(&mut app, "processing", |_| {
        bevy::tasks::futures::check_ready(&mut finished)
    });
    let handles = load_all(&app);
    wait_for(&mut app, &handles);
    println!("LOADED");
}

/// Runs an app that loads the unprocessed recipe, and prints the progress of its bake.
fn load_unprocessed() {
    let mut app = bare_app_with(AssetPlugin::default());
    app.add_systems(Update, |mut news: MessageReader<GiRecipeProgress>| {
        for news in news.read() {
            println!("PROGRESS {} {:?} {}", news.path, news.stage, news.fraction);
        }
    });
    let scene = load_bake(&mut app, "levels/room.gi.ron");
    println!("GIVEN {}", scene.info().given_recipe);
}

/// Runs [`process_assets_in_child_process`] for the project at `root` and returns its output.
fn process(kind: &str, root: &Path) -> String {
    let output = Command::new(std::env::current_exe().unwrap())
        .args([
            "--exact",
            "processing::process_assets_in_child_process",
            "--nocapture",
            "--ignored",
        ])
        .env(PROCESS, kind)
        .env("BEVY_ASSET_ROOT", root)
        .env_remove("RUST_BACKTRACE")
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned()
        + &String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{text}");
    text
}

fn bakes(text: &str) -> usize {
    text.matches("LOG baked").count()
}

#[test]
fn process_assets_game_without_processor_loads_all_and_is_lit() {
    let root = tempfile::tempdir().unwrap();
    write_game(root.path());
    assert_eq!(
        process_assets(&build(root.path())).unwrap().baked,
        [Path::new("levels/room.gi.ron")]
    );
    let processed = root.path().join("imported_assets/Default");
    for (name, bytes) in files(&processed) {
        let text = String::from_utf8_lossy(&bytes);
        assert!(!text.contains("asset: Ignore"), "{}", name.display());
    }

    let mut app = App::new();
    app.add_plugins((
        headless_plugins().set(shipped_asset_plugin(&processed)),
        MeshlessGiPlugin::default(),
    ))
    .init_asset::<Bytes>()
    .init_asset_loader::<BytesLoader>()
    .insert_resource(GlobalAmbientLight::NONE);
    finish_plugins(&mut app);
    let handles = load_all(&app);
    wait_for(&mut app, &handles);
    let talk = handles[5].clone().typed::<Bytes>();
    let talk = app.world().resource::<Assets<Bytes>>().get(&talk);
    assert_eq!(talk.map(|t| &t.0[..]), Some(&b"Hello."[..]));

    let level = handles[0].clone().typed::<WorldAsset>();
    let bake = handles[1].clone().typed::<GiBakedScene>();
    app.world_mut()
        .spawn((WorldAssetRoot(level), GiScene(bake)));
    let image = target(&mut app);
    app.world_mut().spawn((camera(&image, view()), indirect()));
    let light_source = spawn_light_source(&mut app, Vec3::new(0.0, 1.6, 0.4));
    run(&mut app, 4);
    let lit = picture(&mut app, &image);
    save_picture("processed_scene", &lit);
    assert!(lit.mean() > 0.003, "{}", lit.mean());
    app.world_mut().despawn(light_source);
    run(&mut app, 4);
    let dark = picture(&mut app, &image).mean();
    assert!(dark < 0.01 * lit.mean(), "{dark}");
}

#[test]
fn process_assets_before_and_after_game_bakes_once() {
    for first in ["step", "game"] {
        let root = tempfile::tempdir().unwrap();
        write_game(root.path());
        let output = root
            .path()
            .join("imported_assets/Default/levels/room.gi.ron");
        let text = process(first, root.path());
        assert_eq!(bakes(&text), 1, "{text}");
        let container = std::fs::read(&output).unwrap();
        for kind in ["game", "step", "game", "step", "step", "game"] {
            let text = process(kind, root.path());
            assert_eq!(bakes(&text), 0, "{kind} after {first}: {text}");
            assert_eq!(text.contains("LOADED"), kind == "game", "{text}");
            assert_eq!(std::fs::read(&output).unwrap(), container);
        }

        // A changed scene is baked exactly once, in any order of game and build step.
        let level = root.path().join("assets/levels/room.glb");
        let darker = Room::cornell().recolored(|c| 0.5 * c);
        std::fs::write(&level, textured_glb(&darker, "wall.png")).unwrap();
        let second = ["game", "step"][usize::from(first == "game")];
        let text = process(second, root.path());
        assert_eq!(bakes(&text), 1, "{text}");
        assert_ne!(std::fs::read(&output).unwrap(), container);
        assert_eq!(bakes(&process(first, root.path())), 0);

        // The processed folder can be deleted: bakes are cached in a folder next to it.
        let container = std::fs::read(&output).unwrap();
        std::fs::remove_dir_all(root.path().join("imported_assets/Default")).unwrap();
        let text = process(second, root.path());
        assert_eq!(bakes(&text), 0, "{text}");
        assert_eq!(std::fs::read(&output).unwrap(), container);
    }
}

#[test]
fn process_assets_time_limit_leaves_no_output() {
    let root = tempfile::tempdir().unwrap();
    write_game(root.path());
    let recipe = root.path().join("assets/levels/room.gi.ron");
    let output = root
        .path()
        .join("imported_assets/Default/levels/room.gi.ron");
    process_assets(&build(root.path())).unwrap();
    assert!(output.exists());
    let long = r#"(scene: "room.glb", preset: High, rays: 60000)"#;
    std::fs::write(&recipe, long).unwrap();
    let limited = GiProcessAssetsOptions {
        time_limit: Duration::ZERO,
        ..build(root.path())
    };
    let error = process_assets(&limited).unwrap_err();
    assert!(
        matches!(error, GiProcessAssetsError::TimeLimit(_)),
        "{error}"
    );
    assert!(!output.exists() && !output.with_extension("ron.meta").exists());
    // The limit does not apply without a new bake.
    std::fs::write(&recipe, RECIPE).unwrap();
    process_assets(&limited).unwrap();
    assert!(output.exists());
}

#[test]
fn process_assets_deleted_source_removes_its_output() {
    let root = tempfile::tempdir().unwrap();
    write_game(root.path());
    let processed = root.path().join("imported_assets/Default");
    process_assets(&build(root.path())).unwrap();
    std::fs::write(processed.join("by_hand.txt"), "stays").unwrap();
    for name in ["intro.talk", "levels/room.gi.ron"] {
        std::fs::remove_file(root.path().join("assets").join(name)).unwrap();
    }
    process_assets(&build(root.path())).unwrap();
    let left: Vec<PathBuf> = files(&processed).into_keys().collect();
    let expected = [
        "by_hand.txt",
        "fonts/mono.ttf",
        "levels/room.glb",
        "levels/wall.png",
        "sounds/step.wav",
    ];
    assert_eq!(left, expected.map(PathBuf::from));
}

#[test]
fn recipe_that_contains_bake_loads_without_meta() {
    let root = tempfile::tempdir().unwrap();
    write_game(root.path());
    process_assets(&build(root.path())).unwrap();
    let processed = root.path().join("imported_assets/Default");
    std::fs::remove_file(processed.join("levels/room.gi.ron.meta")).unwrap();
    let container = std::fs::read(processed.join("levels/room.gi.ron")).unwrap();
    let bake = BakedScene::from_bytes(&container, &Limits::default()).unwrap();
    let apps = [
        shipped_asset_plugin(&processed),
        AssetPlugin {
            meta_check: AssetMetaCheck::Never,
            ..shipped_asset_plugin(&processed)
        },
        AssetPlugin {
            file_path: processed.to_string_lossy().into_owned(),
            ..default()
        },
    ];
    for assets in apps {
        let mut app = bare_app_with(assets);
        assert_eq!(*load_bake(&mut app, "levels/room.gi.ron"), bake);
    }
}

#[test]
fn unprocessed_recipe_without_preset_is_baked_at_draft() {
    let root = tempfile::tempdir().unwrap();
    write_game(root.path());
    let recipe = root.path().join("assets/levels/room.gi.ron");
    let bare = RECIPE.replace("preset: Draft, ", "");
    for (text, preset, names_draft) in [
        (bare.clone(), "preset:Draft", true),
        (
            bare.replace("levels", "preset: High, levels"),
            "preset:High",
            false,
        ),
    ] {
        std::fs::write(&recipe, text).unwrap();
        let text = process("load", root.path());
        let given = text.lines().find(|l| l.starts_with("GIVEN")).unwrap();
        assert!(given.contains(preset), "{given}");
        let warning = text.lines().find(|l| l.contains("unprocessed recipe"));
        let warning = warning.unwrap_or_else(|| panic!("{text}"));
        assert!(
            warning.contains("levels/room.gi.ron") && warning.contains("process_assets"),
            "{warning}"
        );
        assert_eq!(warning.contains("Draft"), names_draft, "{warning}");
        // The progress is a message in the main world.
        let progress: Vec<&str> = text.lines().filter(|l| l.starts_with("PROGRESS")).collect();
        assert!(!progress.is_empty(), "{text}");
        for line in progress {
            let words: Vec<&str> = line.split(' ').collect();
            assert_eq!(words[1], "levels/room.gi.ron");
            assert!(
                (0.0..=1.0).contains(&words[3].parse::<f32>().unwrap()),
                "{line}"
            );
        }
    }
    std::fs::write(&recipe, bare).unwrap();
    process_assets(&build(root.path())).unwrap();
    let mut app = bare_app_with(shipped_asset_plugin(
        &root.path().join("imported_assets/Default"),
    ));
    let scene = load_bake(&mut app, "levels/room.gi.ron");
    assert!(scene.info().given_recipe.contains("preset:Medium"));
}

#[test]
fn process_assets_changed_input_is_baked_again() {
    let root = tempfile::tempdir().unwrap();
    let levels = root.path().join("assets/levels");
    std::fs::create_dir_all(&levels).unwrap();
    let room = Room::cornell();
    std::fs::write(levels.join("room.glb"), glb(&room)).unwrap();
    std::fs::write(levels.join("room.gi.ron"), RECIPE).unwrap();

    let text = process("step", root.path());
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
    assert_eq!(first.info().triangles, 20);

    // Without a change nothing is baked. A changed scene is baked again.
    assert_eq!(process("step", root.path()).matches("LOG baked").count(), 0);
    std::fs::write(levels.join("room.glb"), glb(&room.recolored(|c| 0.5 * c))).unwrap();
    assert_eq!(process("step", root.path()).matches("LOG baked").count(), 1);
    assert_ne!(load(&output).info().fingerprint, first.info().fingerprint);

    // A changed recipe, or a changed file that a scene references, causes a new bake.
    let finer = RECIPE.replace("rays: 64", "rays: 96");
    std::fs::write(levels.join("room.gi.ron"), &finer).unwrap();
    let text = process("step", root.path());
    assert_eq!(text.matches("LOG baked").count(), 1, "{text}");
    assert!(load(&output).info().recipe.contains("rays_per_point:96"));
    std::fs::write(levels.join("room.gi.ron"), RECIPE).unwrap();
    let (json, binary) = gltf(&room, "parts.bin");
    std::fs::write(levels.join("parts.gltf"), json).unwrap();
    std::fs::write(levels.join("parts.bin"), &binary).unwrap();
    let of_parts = RECIPE.replace("room.glb", "parts.gltf");
    std::fs::write(levels.join("parts.gi.ron"), of_parts).unwrap();
    assert_eq!(process("step", root.path()).matches("LOG baked").count(), 2);
    let parts = root
        .path()
        .join("imported_assets/Default/levels/parts.gi.ron");
    let before = load(&parts);
    assert_eq!(process("step", root.path()).matches("LOG baked").count(), 0);
    let mut smaller = room.clone();
    smaller.0.truncate(5);
    smaller.0.extend([smaller.0[4]; 5]);
    std::fs::write(levels.join("parts.bin"), gltf(&smaller, "parts.bin").1).unwrap();
    assert_eq!(process("step", root.path()).matches("LOG baked").count(), 1);
    assert_ne!(load(&parts).info().fingerprint, before.info().fingerprint);

    let last = load(&output);

    // Scenes that cannot be baked: each error contains file and cause, and no output remains.
    std::fs::write(levels.join("broken.glb"), b"not a scene").unwrap();
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
    let text = process("step", root.path());
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

    // After the errors are fixed, the output is the same as before.
    for name in ["broken", "missing", "typo"] {
        std::fs::remove_file(levels.join(format!("{name}.gi.ron"))).unwrap();
    }
    std::fs::write(levels.join("room.gi.ron"), RECIPE).unwrap();
    let text = process("step", root.path());
    assert!(text.contains("BAKED"), "{text}");
    assert_eq!(load(&output), last);
}
