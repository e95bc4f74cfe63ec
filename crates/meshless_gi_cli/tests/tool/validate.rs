//! `meshless_gi validate` on bakes whose scene, recipe or bake version has changed.

use crate::support::data;
use meshless_gi::internals::bake::BAKE_VERSION;
use meshless_gi::{BakedScene, Limits};
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

/// Runs the tool, checks its exit code and returns its standard output.
fn tool(code: i32, arguments: &[&str]) -> String {
    let ran = Command::new(env!("CARGO_BIN_EXE_meshless_gi"))
        .args(arguments)
        .stdin(Stdio::null())
        .output()
        .expect("the tool starts");
    let text = String::from_utf8_lossy(&ran.stderr);
    assert_eq!(ran.status.code(), Some(code), "{arguments:?}: {text}");
    String::from_utf8(ran.stdout).expect("text")
}

fn text(path: &Path) -> &str {
    path.to_str().expect("text")
}

#[test]
fn validate_with_scene_names_each_difference() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (scene_file, recipe, bake) = (at("level.glb"), at("level.gi.ron"), at("level.mgi"));
    let quick = r#"(scene: "level.glb", preset: Draft, rays: 64, levels: 4, sender_levels: 3)"#;
    fs::copy(data("cornell/cornell.glb"), &scene_file).unwrap();
    fs::write(&recipe, quick).unwrap();
    tool(0, &["bake", text(&recipe), "-o", text(&bake)]);
    let by_level = ["validate", text(&bake), "--level", text(&scene_file)];
    let by_recipe = ["validate", text(&bake), "--level", text(&recipe)];
    let by_both = [&by_level[..], &["--recipe", text(&recipe)]].concat();
    for check in [&by_level[..], &by_recipe, &by_both] {
        assert!(tool(0, check).contains(": valid"));
    }
    let kinds = |list: &str| {
        let starts = |kind: &&str| list.lines().any(|l| l.starts_with(&format!("  {kind}: ")));
        let kinds = ["content", "settings", "version"];
        kinds.into_iter().filter(starts).collect::<Vec<_>>()
    };

    // The text of the recipe may change, its values may not.
    fs::write(&recipe, quick.replace(", ", ",\n  ")).unwrap();
    tool(0, &by_recipe);
    fs::write(&recipe, quick.replace("rays: 64", "rays: 128")).unwrap();
    for check in [&by_recipe[..], &by_both] {
        let list = tool(1, check);
        assert_eq!(kinds(&list), ["settings"], "{list}");
        assert!(list.contains("level.gi.ron"), "{list}");
    }
    tool(0, &by_level);

    // The scene.
    fs::copy(data("rooms_open/rooms_open.glb"), &scene_file).unwrap();
    let list = tool(1, &by_level);
    assert_eq!(kinds(&list), ["content"], "{list}");
    assert!(list.contains("level.glb"), "{list}");
    assert_eq!(kinds(&tool(1, &by_recipe)), ["content", "settings"]);

    // The version of the bake counts, not that of the crate.
    let mut scene = BakedScene::read(&bake, &Limits::default()).unwrap();
    scene.info_mut().version = "0.0.0".into();
    scene.write(&bake).unwrap();
    assert_eq!(kinds(&tool(1, &by_level)), ["content"]);
    scene.info_mut().bake_version += 1;
    scene.write(&bake).unwrap();
    assert_eq!(kinds(&tool(1, &by_level)), ["content", "version"]);
    fs::copy(data("cornell/cornell.glb"), &scene_file).unwrap();
    let list = tool(1, &by_level);
    assert_eq!(kinds(&list), ["version"], "{list}");
    let version = format!("this program is bake version {BAKE_VERSION}");
    assert!(list.contains(&version), "{list}");

    // Wrong usage.
    tool(2, &["validate", text(&bake), "--recipe", text(&recipe)]);
    let twice = [&by_recipe[..], &["--recipe", text(&recipe)]].concat();
    tool(2, &twice);
}
