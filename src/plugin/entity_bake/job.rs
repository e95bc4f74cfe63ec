//! The work of the bake's thread: assembles the mesh, loads or bakes, and saves.

use super::super::bake_task::{BakeOutput, Outcome, bake_threads};
use super::assemble::assemble;
use super::collect::Collected;
use super::request::MeshlessGiBakeRequest;
use super::warning::MeshlessGiBakeWarning as Warning;
use bevy::log::{debug, info};
use meshless_gi::asset::{AssetError, BakedScene, Limits, fingerprint, write_file};
use meshless_gi::bake::{BAKE_VERSION, Progress, Recipe, bake_level};
use meshless_gi::scene::TriangleMesh;
use std::path::Path;
use std::time::Instant;

/// Bakes what was collected as `request` says.
pub(super) fn run(
    collected: &Collected,
    request: &MeshlessGiBakeRequest,
    progress: &Progress,
) -> Outcome {
    let began = Instant::now();
    let mut warnings = Vec::new();
    let mesh = assemble(collected, &mut warnings)?;
    let key = key(&mesh, &request.recipe);
    if let Some(path) = &request.save_to
        && let Some(scene) = load(path, &key, &mut warnings)
    {
        return Ok(BakeOutput {
            scene,
            seconds: began.elapsed().as_secs_f64(),
            loaded: true,
            warnings,
        });
    }
    let baked = bake_level(&mesh, &request.recipe, bake_threads(), progress)?;
    let mut output = BakeOutput::from(baked);
    output.scene.info.request = key;
    if let Some(path) = &request.save_to {
        warnings.extend(save(path, &output.scene));
    }
    warnings.append(&mut output.warnings);
    output.warnings = warnings;
    output.seconds = began.elapsed().as_secs_f64();
    Ok(output)
}

/// Digest of everything that the bake depends on.
fn key(mesh: &TriangleMesh, recipe: &Recipe) -> String {
    let recipe = Recipe {
        scene: None,
        ..recipe.clone()
    };
    let occluders: Vec<&str> = recipe.occluders.iter().map(|o| o.name.as_str()).collect();
    let mut held = blake3::Hasher::new();
    for occluder in mesh.hold_out(&occluders).1 {
        held.update(&(occluder.triangles.len() as u64).to_le_bytes());
        held.update(bytemuck::cast_slice(&occluder.triangles));
    }
    fingerprint(&[
        &mesh.content_hash(),
        ron::to_string(&recipe).unwrap_or_default().as_bytes(),
        held.finalize().as_bytes(),
        &BAKE_VERSION.to_le_bytes(),
    ])
}

/// The bake in the file, if it was made from the same request.
fn load(path: &Path, key: &str, warnings: &mut Vec<Warning>) -> Option<BakedScene> {
    match BakedScene::read(path, &Limits::default()) {
        Ok(scene) if scene.info.request == key => {
            debug!(
                "{}: matches the meshes and the recipe; loaded",
                path.display()
            );
            Some(scene)
        }
        Ok(_) => {
            info!(
                "{}: the meshes, the recipe or the version have changed; baking again",
                path.display()
            );
            None
        }
        Err(AssetError::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => None,
        Err(error) => {
            warnings.push(Warning::NotLoaded {
                path: path.into(),
                reason: error.to_string(),
            });
            None
        }
    }
}

/// Writes the bake, with the folders of its path.
fn save(path: &Path, scene: &BakedScene) -> Option<Warning> {
    let folder = path
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty());
    let written = scene
        .to_bytes()
        .map_err(|e| e.to_string())
        .and_then(|bytes| {
            folder
                .map_or(Ok(()), std::fs::create_dir_all)
                .and_then(|()| write_file(path, &bytes))
                .map_err(|e| e.to_string())
        });
    match written {
        Ok(()) => {
            debug!("{}: saved", path.display());
            None
        }
        Err(reason) => Some(Warning::NotSaved {
            path: path.into(),
            reason,
        }),
    }
}
