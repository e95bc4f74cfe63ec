//! The work of the bake's thread: assembles the mesh, loads or bakes, and saves.

use super::super::bake_task::{BakeOutput, Outcome, bake_threads};
use super::super::recipe_progress::log_progress;
use super::assemble::assemble;
use super::collect::Collected;
use super::request::GiBakeRequest;
use super::warning::GiBakeWarning as Warning;
use bevy::log::{info, warn};
use meshless_gi::internals::asset::{check_writable, fingerprint, write_file};
use meshless_gi::internals::bake::{
    BAKE_VERSION, BakeInputs, BakeOrigin, Staleness, bake_scene_with_origin,
};
use meshless_gi::{AssetError, BakedScene, Limits, Progress, Recipe, TriangleMesh};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Bakes the collected meshes with the settings of `request`.
pub(super) fn run(
    collected: &Collected,
    request: &GiBakeRequest,
    progress: &Arc<Progress>,
) -> Outcome {
    let began = Instant::now();
    let root = &collected.root;
    let mut warnings = Vec::new();
    let mesh = assemble(collected, &mut warnings)?;
    let key = key(&mesh, &request.recipe);
    let mut save_to = request.save_to.as_deref();
    if let Some(path) = save_to
        && let Some(scene) = load(path, &key, (&mesh, &request.recipe), &mut warnings)
    {
        info!("loaded the bake of {root} from {}", path.display());
        return Ok(BakeOutput {
            scene,
            seconds: began.elapsed().as_secs_f64(),
            loaded: true,
            logged: Vec::new(),
            warnings,
        });
    }
    // A bake may take minutes: a path that cannot be written is in the log before.
    let unwritable = save_to.and_then(check);
    if let Some(warning) = &unwritable {
        warn!("{warning}");
        save_to = None;
    }
    info!(
        "baking {root}: {} triangles, {:?}",
        mesh.len(),
        request.recipe.preset
    );
    let progress_log = log_progress(root.clone(), progress.clone());
    let origin = BakeOrigin {
        request: key,
        ..BakeOrigin::default()
    };
    let threads = bake_threads();
    let baked = bake_scene_with_origin(&mesh, &request.recipe, &origin, threads, progress)?;
    drop(progress_log);
    let mut output = BakeOutput::from(baked);
    let mut saved = String::new();
    if let Some(path) = save_to {
        match save(path, &output.scene) {
            Some(warning) => output.warnings.push(warning),
            None => saved = format!(", saved to {}", path.display()),
        }
    }
    info!(
        "baked {root} in {:.1} s{saved}",
        began.elapsed().as_secs_f64()
    );
    output.logged = unwritable.into_iter().collect();
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
    for occluder in mesh.split_occluders(&occluders).1 {
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

/// Returns the bake in the file if it was made from the same request. `now` has the geometry and
/// the recipe of the request.
fn load(
    path: &Path,
    key: &str,
    now: (&TriangleMesh, &Recipe),
    warnings: &mut Vec<Warning>,
) -> Option<BakedScene> {
    match BakedScene::read(path, &Limits::default()) {
        Ok(scene) if scene.info().request == key => Some(scene),
        Ok(scene) => {
            let now = BakeInputs {
                content_hash: Some(&now.0.content_hash()),
                recipe: Some(now.1),
            };
            let differs = Staleness::compare(scene.info(), &now);
            let what = match differs.is_stale() {
                true => differs.to_string(),
                false => "occluders".into(),
            };
            info!(
                "{} is stale ({what} changed) and is baked again",
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

fn save_warning(path: &Path, reason: String) -> Warning {
    Warning::NotSaved {
        path: path.into(),
        reason,
    }
}

/// Creates the folders of a path. Returns a warning if a file can't be written there.
fn check(path: &Path) -> Option<Warning> {
    let folder = path
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty());
    folder
        .map_or(Ok(()), std::fs::create_dir_all)
        .and_then(|()| check_writable(path))
        .err()
        .map(|error| save_warning(path, error.to_string()))
}

/// Writes the bake.
fn save(path: &Path, scene: &BakedScene) -> Option<Warning> {
    let bytes = scene.to_bytes().map_err(|error| error.to_string());
    bytes
        .and_then(|bytes| write_file(path, &bytes).map_err(|error| error.to_string()))
        .err()
        .map(|reason| save_warning(path, reason))
}
