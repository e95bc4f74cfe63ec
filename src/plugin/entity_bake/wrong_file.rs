//! Warns about a scene file in place of a bake.

use super::super::scene::GiScene;
use bevy::asset::AssetPath;
use bevy::ecs::prelude::*;
use bevy::log::error;

/// Endings of files that hold scenes.
const SCENES: [&str; 6] = ["glb", "gltf", "ply", "obj", "fbx", "scn"];

/// Runs in [`GiSystems::Validate`](super::super::GiSystems::Validate).
pub(crate) fn check_files(changed: Query<(Entity, Option<&Name>, &GiScene), Changed<GiScene>>) {
    for (entity, name, gi) in &changed {
        if let Some(message) = gi.0.path().and_then(wrong_file) {
            let name = name.map(|name| format!(" (`{name}`)")).unwrap_or_default();
            error!("entity {entity}{name}: {message}");
        }
    }
}

/// Returns the message for a path that is no bake. `None` for other paths.
fn wrong_file(path: &AssetPath) -> Option<String> {
    let ending = path.path().extension()?.to_str()?;
    if !SCENES.contains(&ending.to_ascii_lowercase().as_str()) {
        return None;
    }
    let file = path.path().display().to_string();
    let stem = file.get(..file.len() - ending.len() - 1)?.to_owned();
    Some(format!(
        "`GiScene` names `{file}`, which is a scene and not a bake; there is no indirect light. \
         Use `GiScene(asset_server.load(\"{stem}.gi.ron\"))` with a recipe \
         `(scene: \"{file}\")`, or `\"{stem}.mgi\"` from `meshless_gi bake {file}`, or \
         `commands.entity(root).bake_gi(Recipe::default())` to bake the spawned scene"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scene_files_are_named_with_their_replacements() {
        let message = wrong_file(&AssetPath::parse("maps/hall.glb#Scene0")).unwrap();
        for part in [
            "maps/hall.glb",
            "maps/hall.gi.ron",
            "maps/hall.mgi",
            "bake_gi",
        ] {
            assert!(message.contains(part), "{message}");
        }
        for bake in ["hall.mgi", "hall.gi.ron", "hall", "http.bin"] {
            assert_eq!(wrong_file(&AssetPath::parse(bake)), None);
        }
    }
}
