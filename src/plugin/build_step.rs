//! Bevy's asset processing as a build step: no window, no renderer, no game.
//!
//! ```no_run
//! use bevy_meshless_gi::plugin::{AssetBuild, process_assets};
//!
//! fn main() -> Result<(), Box<dyn std::error::Error>> {
//!     let baked = process_assets(&AssetBuild::default())?;
//!     println!("{} recipes are up to date", baked.len());
//!     Ok(())
//! }
//! ```
//!
//! All assets of the folder pass through: recipes become bakes, what has no processor is copied. Only what changed since the last
//! run is processed. Bevy keeps a log of it in `imported_assets/log` of the project's root (`BEVY_ASSET_ROOT`, or the package's
//! folder); it belongs to the processed folder: keep or cache them together.

use super::{MeshlessGiPlugin, MeshlessGiRecipeLoader};
use bevy::MinimalPlugins;
use bevy::app::{App, PluginGroup, ScheduleRunnerPlugin};
use bevy::asset::processor::{AssetProcessor, ProcessStatus};
use bevy::asset::{AssetLoader, AssetMode, AssetPath, AssetPlugin};
use bevy::tasks::futures::check_ready;
use bevy::tasks::{IoTaskPool, Task};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// What to process.
#[derive(Clone, Debug)]
pub struct AssetBuild {
    /// Folder of the assets as people make them; relative to the project's root, or absolute.
    pub source: PathBuf,
    /// Folder for the processed ones.
    pub processed: PathBuf,
    /// Gives up after this long.
    pub time_limit: Duration,
}

impl Default for AssetBuild {
    /// Bevy's folders, and an hour.
    fn default() -> Self {
        Self {
            source: "assets".into(),
            processed: "imported_assets/Default".into(),
            time_limit: Duration::from_secs(3600),
        }
    }
}

/// Why a build step failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AssetBuildError {
    /// Recipes that did not become bakes. What was wrong with each is in the log, as errors of `bevy_asset`.
    #[error("{} recipe(s) could not be baked: {}", .0.len(), list(.0))]
    Failed(Vec<PathBuf>),
    /// The folder of the assets cannot be listed.
    #[error("{}: {why}", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What the system said.
        why: std::io::Error,
    },
    /// It took too long.
    #[error("asset processing did not finish within {0:?}")]
    TimeLimit(Duration),
    /// Bevy started no asset processor.
    #[error("Bevy started no asset processor")]
    NoProcessor,
}

fn list(paths: &[PathBuf]) -> String {
    paths
        .iter()
        .map(|p| p.display().to_string())
        .collect::<Vec<_>>()
        .join(", ")
}

/// Processes the assets and returns the recipes that are now baked, relative to the source folder. Add a log of your own to see
/// what is wrong with one that fails ([`AssetBuildError::Failed`] names it); what a failed bake leaves behind is removed.
///
/// # Errors
/// See [`AssetBuildError`].
pub fn process_assets(build: &AssetBuild) -> Result<Vec<PathBuf>, AssetBuildError> {
    let mut app = App::new();
    app.add_plugins((
        MinimalPlugins.build().disable::<ScheduleRunnerPlugin>(),
        AssetPlugin {
            mode: AssetMode::Processed,
            file_path: build.source.to_string_lossy().into_owned(),
            processed_file_path: build.processed.to_string_lossy().into_owned(),
            use_asset_processor_override: Some(true),
            watch_for_changes_override: Some(false),
            ..AssetPlugin::default()
        },
        MeshlessGiPlugin::default(),
    ));
    app.finish();
    app.cleanup();
    let root = bevy::asset::io::file::FileAssetReader::get_base_path();
    let mut recipes = Vec::new();
    find_recipes(&root.join(&build.source), Path::new(""), &mut recipes)?;

    let until = Instant::now() + build.time_limit;
    let wait = |app: &mut App, mut task: Task<Option<Vec<PathBuf>>>| loop {
        app.update();
        if let Some(done) = check_ready(&mut task) {
            return Ok(done);
        }
        if Instant::now() > until {
            return Err(AssetBuildError::TimeLimit(build.time_limit));
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    app.update();
    let processor = app
        .world()
        .get_resource::<AssetProcessor>()
        .ok_or(AssetBuildError::NoProcessor)?
        .clone();
    let asked = recipes.clone();
    let task = IoTaskPool::get().spawn(async move {
        processor.data().wait_until_finished().await;
        let mut failed = Vec::new();
        for recipe in asked {
            let path = AssetPath::from_path_buf(recipe.clone());
            if processor.data().wait_until_processed(path).await != ProcessStatus::Processed {
                failed.push(recipe);
            }
        }
        Some(failed)
    });
    let failed = wait(&mut app, task)?.unwrap_or_default();
    // A failed bake leaves an empty file and the description of the one before; a later run might take them for a success.
    for recipe in &failed {
        let output = root.join(&build.processed).join(recipe);
        let mut meta = output.clone().into_os_string();
        meta.push(".meta");
        for file in [output, meta.into()] {
            let _ = std::fs::remove_file(file);
        }
    }
    if failed.is_empty() {
        Ok(recipes)
    } else {
        Err(AssetBuildError::Failed(failed))
    }
}

/// Every recipe below `folder`, relative to `root`, in the order of their names.
fn find_recipes(
    root: &Path,
    folder: &Path,
    found: &mut Vec<PathBuf>,
) -> Result<(), AssetBuildError> {
    let at = root.join(folder);
    let failed = |why| AssetBuildError::Folder {
        path: at.clone(),
        why,
    };
    let mut names = Vec::new();
    for entry in std::fs::read_dir(&at).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        names.push((
            entry.file_name(),
            entry.file_type().map_err(failed)?.is_dir(),
        ));
    }
    names.sort();
    for (name, is_folder) in names {
        let path = folder.join(&name);
        if is_folder {
            find_recipes(root, &path, found)?;
        } else if MeshlessGiRecipeLoader
            .extensions()
            .iter()
            .any(|e| name.to_string_lossy().ends_with(&format!(".{e}")))
        {
            found.push(path);
        }
    }
    Ok(())
}
