//! Processing of assets as a build step: no window, no renderer, no game, no Bevy app.
//!
//! ```no_run
//! use bevy_meshless_gi::loader::{GiProcessAssetsOptions, process_assets};
//!
//! fn main() -> Result<(), Box<dyn std::error::Error>> {
//!     let report = process_assets(&GiProcessAssetsOptions::default())?;
//!     println!("{} recipes baked, {} up to date", report.baked.len(), report.kept.len());
//!     Ok(())
//! }
//! ```
//!
//! Recipes become bakes. All other files are copied, for apps with `AssetMode::Processed` and no
//! asset processor of their own. Such an app loads the copies with its own loaders. A recipe is
//! baked again only if its text, the scene, a file that the scene names, or the bake version has
//! changed. Bakes are kept in `meshless_gi` next to the folder of the processed assets, for later
//! runs and the app's asset processor. Keep that folder between runs. A run removes outputs of
//! earlier runs if their source is gone.

use super::asset_folders::{base_folder, source_file};
use super::bake_processor::GiBakeProcessor;
use super::bake_store::BakeStore;
use super::build_copy::{Action, Meta, copy_asset, meta_path, remove_asset, remove_orphans};
use super::loader::{GiBakedSceneLoader, GiBakedSceneLoaderSettings};
use super::recipe_loader::{
    GiBakeProcessorSettings, GiRecipeLoadError, RECIPE_EXTENSION, RecipeInputs,
};
use super::recipe_progress::RecipeBakes;
use super::scene_files::ReadFile;
use bevy::asset::AssetPath;
use bevy::asset::meta::{
    AssetAction, AssetMeta, AssetMetaDyn, ProcessDependencyInfo, ProcessedInfo,
};
use bevy::log::{debug, error};
use bevy::reflect::prelude::*;
use bevy::tasks::block_on;
use meshless_gi::internals::asset::write_file;
use std::collections::BTreeSet;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Folders to process, and a time limit. Relative folders are those of Bevy: below
/// `BEVY_ASSET_ROOT`, else below the package that `cargo run` runs, else next to the executable.
#[derive(Reflect, Clone, Debug)]
#[reflect(Default, Clone, Debug)]
pub struct GiProcessAssetsOptions {
    /// Folder of the source assets, absolute or relative to the project's root.
    pub source: PathBuf,
    /// Folder for the processed ones.
    pub processed: PathBuf,
    /// Time after which the step gives up.
    pub time_limit: Duration,
}

impl Default for GiProcessAssetsOptions {
    /// Bevy's folders, and an hour.
    fn default() -> Self {
        Self {
            source: "assets".into(),
            processed: "imported_assets/Default".into(),
            time_limit: Duration::from_secs(3600),
        }
    }
}

/// Recipes of a build step, relative to the source folder.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct GiProcessAssetsReport {
    /// Recipes that this run has baked.
    pub baked: Vec<PathBuf>,
    /// Recipes whose bake was kept from an earlier run.
    pub kept: Vec<PathBuf>,
}

/// A recipe that did not become a bake.
#[derive(Debug, thiserror::Error)]
#[error("{}: {source}", recipe.display())]
#[non_exhaustive]
pub struct GiProcessAssetsFailure {
    /// Path of the recipe, relative to the source folder.
    pub recipe: PathBuf,
    /// Reason.
    pub source: GiRecipeLoadError,
}

/// Error of a build step. `Debug` has the text of `Display`, for a `main` that returns the error.
#[derive(thiserror::Error)]
#[non_exhaustive]
pub enum GiProcessAssetsError {
    /// Recipes that did not become bakes. All other files are processed.
    #[error("{} recipe(s) could not be baked: {}", .0.len(), list(.0))]
    Failed(Vec<GiProcessAssetsFailure>),
    /// The folder of the assets cannot be listed.
    #[error(
        "{}: {source}. Relative folders lie below BEVY_ASSET_ROOT, else below the package that \
         `cargo run` runs, else next to the executable",
        path.display()
    )]
    Folder {
        /// The folder.
        path: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
    /// A file cannot be read, written or removed, or a `.meta` file makes no sense.
    #[error("{}: cannot {action}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// "read", "write" or "remove".
        action: &'static str,
        /// Error of the operating system, or of the text.
        source: io::Error,
    },
    /// Processing exceeded the time limit. The recipe of the running bake has no output.
    #[error("asset processing did not finish within {0:?}")]
    TimeLimit(Duration),
}

impl fmt::Debug for GiProcessAssetsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl GiProcessAssetsError {
    pub(crate) fn file(path: &Path, action: &'static str, source: io::Error) -> Self {
        Self::File {
            path: path.to_owned(),
            action,
            source,
        }
    }
}

fn list(failures: &[GiProcessAssetsFailure]) -> String {
    failures
        .iter()
        .map(ToString::to_string)
        .collect::<Vec<_>>()
        .join("; ")
}

/// Processes the assets and returns the recipes that have a bake now. A recipe that fails leaves no
/// output. Progress of bakes goes to standard error.
///
/// # Errors
/// See [`GiProcessAssetsError`].
pub fn process_assets(
    build: &GiProcessAssetsOptions,
) -> Result<GiProcessAssetsReport, GiProcessAssetsError> {
    let root = base_folder().unwrap_or_default();
    let processed = root.join(&build.processed);
    let step = Step {
        source: root.join(&build.source),
        store: BakeStore::next_to(&processed),
        processed,
        until: Instant::now().checked_add(build.time_limit),
        time_limit: build.time_limit,
    };
    let mut files = Vec::new();
    step.list(Path::new(""), &mut Vec::new(), &mut files)?;
    let (mut recipes, mut made) = (Vec::new(), BTreeSet::new());
    let mut keep = |file: &Path| made.extend(file.to_str().map(|name| name.replace('\\', "/")));
    for file in files {
        let source = step.source.join(&file);
        let meta = Meta::read(&source)?;
        if is_baked(&file, meta.as_ref()) {
            recipes.push((file, meta));
        } else if copy_asset(&source, &step.processed.join(&file), meta.as_ref())? {
            keep(&file);
        }
    }
    let (mut report, mut failures) = (GiProcessAssetsReport::default(), Vec::new());
    for (recipe, meta) in recipes {
        match step.bake(&recipe, meta.as_ref())? {
            Ok(source) => {
                keep(&recipe);
                match source {
                    BakeSource::Baked => report.baked.push(recipe),
                    BakeSource::Kept => report.kept.push(recipe),
                }
            }
            Err(source) => {
                error!("{}: {source}", recipe.display());
                remove_asset(&step.processed.join(&recipe))?;
                failures.push(GiProcessAssetsFailure { recipe, source });
            }
        }
    }
    if let Some(store) = &step.store {
        remove_orphans(store.folder(), &step.processed, &made)?;
    }
    match failures.is_empty() {
        true => Ok(report),
        false => Err(GiProcessAssetsError::Failed(failures)),
    }
}

/// Returns `true` for recipes, unless a `.meta` selects another action.
fn is_baked(file: &Path, meta: Option<&Meta>) -> bool {
    let names_recipe = (file.file_name())
        .and_then(|name| {
            name.to_str()?
                .strip_suffix(RECIPE_EXTENSION)?
                .strip_suffix('.')
        })
        .is_some_and(|stem| !stem.is_empty());
    let ours = [
        GiBakeProcessor::type_path(),
        GiBakeProcessor::short_type_path(),
    ];
    match meta.map(|meta| &meta.action) {
        Some(Action::Process(processor)) => ours.contains(&processor.as_str()),
        Some(Action::Load(_) | Action::Ignore) => false,
        None => names_recipe,
    }
}

/// Origin of a recipe's bake.
enum BakeSource {
    Baked,
    Kept,
}

/// One run of the build step.
struct Step {
    source: PathBuf,
    processed: PathBuf,
    store: Option<BakeStore>,
    until: Option<Instant>,
    time_limit: Duration,
}

impl Step {
    /// Every asset below `folder`, relative to the source folder, in the order of the names. Hidden
    /// files and `.meta` files are none, as in Bevy. `above` holds the real paths of the folders
    /// around it: a link to one of them is not followed.
    fn list(
        &self,
        folder: &Path,
        above: &mut Vec<PathBuf>,
        found: &mut Vec<PathBuf>,
    ) -> Result<(), GiProcessAssetsError> {
        let at = self.source.join(folder);
        let failed = |source| GiProcessAssetsError::Folder {
            path: at.clone(),
            source,
        };
        let real = at.canonicalize().map_err(failed)?;
        let outputs = [
            Some(self.processed.as_path()),
            self.store.as_ref().map(BakeStore::folder),
        ];
        let is_output = |path: &Path| path.canonicalize().is_ok_and(|path| path == real);
        if above.contains(&real) || outputs.into_iter().flatten().any(is_output) {
            return Ok(());
        }
        let mut names = Vec::new();
        for entry in std::fs::read_dir(&at).map_err(failed)? {
            names.push(entry.map_err(failed)?.file_name());
        }
        names.sort();
        above.push(real);
        for name in names {
            let path = folder.join(&name);
            let is_meta = path
                .extension()
                .is_some_and(|e| e.eq_ignore_ascii_case("meta"));
            if is_meta || name.to_string_lossy().starts_with('.') {
                continue;
            }
            match self.source.join(&path).is_dir() {
                true => self.list(&path, above, found)?,
                false => found.push(path),
            }
        }
        above.pop();
        Ok(())
    }

    /// Bakes a recipe, or takes over the bake that was kept. Writes the output where it differs.
    fn bake(
        &self,
        recipe: &Path,
        meta: Option<&Meta>,
    ) -> Result<Result<BakeSource, GiRecipeLoadError>, GiProcessAssetsError> {
        let source = self.source.join(recipe);
        let text = std::fs::read(&source)
            .map_err(|error| GiProcessAssetsError::file(&source, "read", error))?;
        let path = AssetPath::from_path_buf(recipe.to_owned());
        if recipe.to_str().is_none() {
            // Bevy's paths are text.
            return Ok(Err(GiRecipeLoadError::NotText));
        }
        let hash = processor_hash(meta, &text);
        let mut reader = FolderReader {
            folder: &self.source,
            read: Vec::new(),
        };
        let inputs = match block_on(RecipeInputs::read(&path, text, &mut reader)) {
            Ok(inputs) => inputs,
            Err(error) => return Ok(Err(error)),
        };
        let key = inputs.key();
        let kept = self.store.as_ref().and_then(|s| s.load(&path, &key));
        let (bytes, origin) = match kept {
            Some(bytes) => {
                debug!("`{path}` was baked before");
                (bytes, BakeSource::Kept)
            }
            None => {
                // An older bake must not be taken for this one if the step ends early.
                remove_asset(&self.processed.join(recipe))?;
                let bytes = match self.bake_anew(&inputs, &path)? {
                    Ok(bytes) => bytes,
                    Err(error) => return Ok(Err(error)),
                };
                if let Some(store) = &self.store {
                    store.save(&path, &key, &bytes);
                }
                (bytes, BakeSource::Baked)
            }
        };
        self.write(recipe, &bytes, hash, reader.read)?;
        Ok(Ok(origin))
    }

    /// Bakes on all processors, until the time is up.
    fn bake_anew(
        &self,
        inputs: &RecipeInputs,
        path: &AssetPath<'static>,
    ) -> Result<Result<Vec<u8>, GiRecipeLoadError>, GiProcessAssetsError> {
        let running = RecipeBakes::default().start_with(path.clone(), |line| eprintln!("{line}"));
        let mut work = match inputs.bake_in_background(0, running.progress.clone()) {
            Ok(work) => work,
            Err(error) => return Ok(Err(error)),
        };
        loop {
            if let Some(baked) = work.take() {
                return Ok(baked.and_then(|scene| {
                    let bytes = scene.to_bytes();
                    bytes.map_err(|error| GiRecipeLoadError::Baked(error.into()))
                }));
            }
            if self.until.is_some_and(|until| Instant::now() > until) {
                return Err(GiProcessAssetsError::TimeLimit(self.time_limit));
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Writes container and `.meta` of a recipe, unless the output holds the same.
    fn write(
        &self,
        recipe: &Path,
        container: &[u8],
        hash: [u8; 32],
        dependencies: Vec<AssetPath<'static>>,
    ) -> Result<(), GiProcessAssetsError> {
        let output = self.processed.join(recipe);
        let loads = Action::Load(GiBakedSceneLoader::type_path().into());
        let described = Meta::read(&output)
            .ok()
            .flatten()
            .is_some_and(|meta| meta.action == loads && meta.hash == Some(hash));
        if described && std::fs::read(&output).is_ok_and(|bytes| bytes == container) {
            return Ok(());
        }
        let meta = output_meta(hash, dependencies);
        let path = meta_path(&output);
        let write = |path: &Path, bytes: &[u8]| {
            write_file(path, bytes)
                .map_err(|error| GiProcessAssetsError::file(path, "write", error))
        };
        if let Some(folder) = output.parent() {
            std::fs::create_dir_all(folder)
                .map_err(|error| GiProcessAssetsError::file(folder, "write", error))?;
        }
        // A container of that name without a `.meta` is loaded too, so it goes first.
        write(&output, container)?;
        write(&path, &meta)
    }
}

/// Hash by which Bevy's asset processor finds that an asset has not changed: of its `.meta`, or of
/// the one that it would have, and of its bytes.
fn processor_hash(meta: Option<&Meta>, text: &[u8]) -> [u8; 32] {
    let usual = AssetMeta::<(), GiBakeProcessor>::new(AssetAction::Process {
        processor: GiBakeProcessor::type_path().into(),
        settings: GiBakeProcessorSettings::default(),
    });
    let meta = meta.map_or_else(|| usual.serialize(), |meta| meta.bytes.clone());
    let mut hasher = blake3::Hasher::new();
    hasher.update(&meta).update(text);
    *hasher.finalize().as_bytes()
}

/// The `.meta` of a processed recipe. Hashes of the files that the bake depends on follow from the
/// loaders of an app, which the step does not have. They are written as zeros, which no file has:
/// an app's asset processor then calls its processor once, which takes over the bake that is kept.
fn output_meta(hash: [u8; 32], dependencies: Vec<AssetPath<'static>>) -> Vec<u8> {
    let mut meta = AssetMeta::<GiBakedSceneLoader, ()>::new(AssetAction::Load {
        loader: GiBakedSceneLoader::type_path().into(),
        settings: GiBakedSceneLoaderSettings::default(),
    });
    meta.processed_info = Some(ProcessedInfo {
        hash,
        full_hash: hash,
        process_dependencies: dependencies
            .into_iter()
            .map(|path| ProcessDependencyInfo {
                full_hash: [0; 32],
                path,
            })
            .collect(),
    });
    meta.serialize()
}

/// Files of the source folder, and a list of those that were read.
struct FolderReader<'a> {
    folder: &'a Path,
    read: Vec<AssetPath<'static>>,
}

impl ReadFile for FolderReader<'_> {
    async fn read(&mut self, path: &AssetPath<'static>) -> Result<Vec<u8>, GiRecipeLoadError> {
        let failed = |error: io::Error| GiRecipeLoadError::File {
            path: path.to_string(),
            source: Box::new(error),
        };
        let file = source_file(self.folder, path).ok_or_else(|| {
            failed(io::Error::new(
                io::ErrorKind::Unsupported,
                "the build step reads the default asset source only",
            ))
        })?;
        let bytes = std::fs::read(file).map_err(failed)?;
        self.read.push(path.clone());
        Ok(bytes)
    }
}
