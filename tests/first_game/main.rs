//! Test of the first hour of a Bevy developer. The programs of README.md are compiled against the
//! libraries of the tests and run in a window under Xvfb. Their light must match the light that
//! `CpuFrame` computes from the same bake.
//!
//! `MGI_TEST_PICTURES` names a folder that keeps the pictures.

#[path = "../support/mod.rs"]
mod support;

mod executable;
mod readme;
mod screen;

use bevy_meshless_gi::loader::{GiProcessAssetsOptions, process_assets};
use executable::Executable;
use meshless_gi::Recipe;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Largest mean FLIP between the plugin's indirect light and the CPU's.
const MAX_FLIP: f32 = 0.02;

/// Returns the executable with all programs, which is built once.
fn programs() -> &'static Executable {
    static BUILT: OnceLock<Executable> = OnceLock::new();
    BUILT.get_or_init(|| {
        let recipe = readme::program("GiScene(assets.load(");
        let assets = |processor: bool| {
            let plugin = format!(
                "DefaultPlugins.set(AssetPlugin {{ mode: AssetMode::Processed, \
                 use_asset_processor_override: Some({processor}), ..default() }})"
            );
            recipe.replacen("DefaultPlugins", &plugin, 1)
        };
        Executable::build(&[
            ("meshes", &readme::program(".bake_gi(")),
            ("recipe", &recipe),
            ("processed", &assets(true)),
            ("shipped", &assets(false)),
        ])
    })
}

/// Creates a folder with the scene and the recipe of README.
fn scene_folder() -> tempfile::TempDir {
    let root = tempfile::tempdir().expect("a folder");
    let assets = root.path().join("assets");
    std::fs::create_dir(&assets).expect("a folder");
    let rooms = Path::new(env!("CARGO_MANIFEST_DIR")).join(readme::SCENE);
    std::fs::copy(rooms, assets.join("level.glb")).expect("the scene is copied");
    std::fs::write(assets.join("level.gi.ron"), readme::recipe()).expect("the recipe is written");
    root
}

/// Returns a field of the line that a program printed.
fn field(line: &str, name: &str) -> f32 {
    line.split_whitespace()
        .find_map(|word| word.strip_prefix(&format!("{name}=")))
        .and_then(|value| value.parse().ok())
        .unwrap_or_else(|| panic!("no {name} in `{line}`"))
}

/// Runs a program on a virtual screen and checks the line that it prints.
#[track_caller]
fn assert_lit(name: &str, program: &Path, asset_root: Option<&Path>) -> String {
    let out = tempfile::tempdir().expect("a folder");
    let text = screen::run(program, name, asset_root, out.path());
    if let Some(keep) = std::env::var_os("MGI_TEST_PICTURES") {
        for picture in ["window.png", "pictures.png"] {
            let kept = Path::new(&keep).join(format!("first_game_{name}_{picture}"));
            std::fs::copy(out.path().join(picture), kept).expect("the picture is copied");
        }
    }
    let line = text
        .lines()
        .find(|line| line.starts_with("FIRST_GAME"))
        .unwrap_or_else(|| panic!("{name}: no measurement in\n{text}"));
    println!("{name}: {line}");
    assert!(field(line, "mean") > 0.003, "{name}: {line}");
    assert!(field(line, "covered") > 0.98, "{name}: {line}");
    assert!(field(line, "flip") <= MAX_FLIP, "{name}: {line}");
    assert!(field(line, "perturbed") > 2.0 * MAX_FLIP, "{name}: {line}");
    assert!(out.path().join("window.png").exists(), "{name}");
    text
}

#[test]
fn first_game_from_bevy_meshes_is_lit() {
    let program = programs().path();
    let root = tempfile::tempdir().expect("a folder");
    assert_lit("meshes", program, Some(root.path()));
}

#[test]
fn first_game_from_a_recipe_is_lit() {
    let root = scene_folder();
    let program = programs().path();
    assert_lit("recipe", program, Some(root.path()));
}

#[test]
fn first_game_from_processed_assets_is_lit_and_bakes_once() {
    let root = scene_folder();
    let program = programs().path();
    let baked = |text: &str| text.matches("baked `").count();
    let first = assert_lit("processed", program, Some(root.path()));
    assert_eq!(baked(&first), 1, "{first}");
    let second = assert_lit("processed", program, Some(root.path()));
    assert_eq!(baked(&second), 0, "{second}");
}

#[test]
fn first_game_from_shipped_assets_is_lit() {
    let root = scene_folder();
    let build = GiProcessAssetsOptions {
        source: root.path().join("assets"),
        processed: root.path().join("imported_assets/Default"),
        ..GiProcessAssetsOptions::default()
    };
    let recipes = process_assets(&build).expect("the recipe bakes");
    assert_eq!(recipes.baked, [PathBuf::from("level.gi.ron")]);
    // The shipped files: the program and the processed assets, without their sources.
    let shipped = tempfile::tempdir().expect("a folder");
    let program = shipped.path().join("game");
    std::fs::copy(programs().path(), &program).expect("the program is copied");
    let processed = shipped.path().join("imported_assets");
    std::fs::rename(root.path().join("imported_assets"), processed).expect("assets are moved");
    drop(root);
    let text = assert_lit("shipped", &program, None);
    assert!(!text.contains("baked `"), "{text}");
}

#[test]
fn readme_recipes_are_valid() {
    let recipes: Vec<Recipe> = readme::recipes()
        .map(|text| Recipe::from_ron(text).unwrap_or_else(|error| panic!("{text}: {error}")))
        .collect();
    assert!(recipes.len() >= 2);
    assert!(recipes.iter().all(|r| r.scene.is_some()));
    let all = recipes.last().expect("a recipe");
    assert!(all.probes.is_some() && all.occluders.len() == 1 && all.dynamic_materials);
}

#[test]
fn readme_first_program_matches_minimal_example() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/minimal.rs");
    let example = std::fs::read_to_string(file).expect("the example is there");
    let code: String = example
        .lines()
        .skip_while(|line| line.starts_with("//!") || line.is_empty())
        .flat_map(|line| [line, "\n"])
        .collect();
    assert_eq!(readme::program(".bake_gi(").trim(), code.trim());
    assert!(code.lines().count() <= 40, "the program has 40 lines");
}
