//! Comparison of loaded bakes with their scenes, and the warning about stale bakes.
//!
//! A loader that has read a bake reads the scene file that the bake names, if it exists, and
//! compares digests. Only if they differ is the scene parsed, on its own thread, and its content
//! hash compared. An edited animation makes no bake stale. The scene is read through the load
//! context, so that Bevy's file watcher compares the bake again after a change.

use super::scene::GiScene;
use super::validation::{GiWarning, GiWarnings};
use bevy::asset::{AssetPath, LoadContext};
use bevy::ecs::prelude::*;
use bevy::log::warn;
use bevy::platform::collections::HashMap;
use bevy::reflect::prelude::*;
use meshless_gi::BakeInfo;
use meshless_gi::internals::bake::{BakeInputs, Staleness};
use serde::{Deserialize, Serialize};
use std::sync::{Arc, Mutex, PoisonError};

/// Condition for reading the scene file next to a bake, to detect a stale bake. The version of the
/// bake is always compared.
#[derive(Reflect, Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[reflect(Default, Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum GiSceneCheck {
    /// Builds with debug assertions.
    #[default]
    Auto,
    /// Every build.
    Always,
    /// No build.
    Never,
}

impl GiSceneCheck {
    #[cfg(feature = "gltf")]
    fn is_on(self) -> bool {
        match self {
            Self::Auto => cfg!(debug_assertions),
            Self::Always => true,
            Self::Never => false,
        }
    }
}

/// Loaded bakes that are stale, by path, with their differences. Each is reported once in the log,
/// as soon as an entity uses it, and again if it was baked or loaded anew and differs otherwise.
#[derive(Resource, Reflect, Clone, Debug, Default)]
#[reflect(opaque)]
#[reflect(Resource, Default, Clone, Debug)]
pub struct GiStaleBakes(HashMap<AssetPath<'static>, Staleness>);

impl GiStaleBakes {
    /// Returns the path of each stale bake, and the inputs that differ: `content`, `settings` and
    /// `bake version`, with commas between them. The order is arbitrary.
    pub fn iter(&self) -> impl Iterator<Item = (&AssetPath<'static>, String)> {
        let bakes = self.0.iter();
        bakes.map(|(path, differs)| (path, differs.to_string()))
    }
}

/// Comparisons on their way from loaders to the main world.
#[derive(Resource, Clone, Debug, Default)]
pub(crate) struct SceneReports(Arc<Mutex<Vec<SceneReport>>>);

/// Comparison of one bake.
#[derive(Clone, Debug)]
pub(crate) struct SceneReport {
    path: AssetPath<'static>,
    scene: Option<String>,
    differs: Staleness,
}

impl SceneReports {
    fn push(&self, report: SceneReport) {
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .push(report);
    }

    fn take(&self) -> Vec<SceneReport> {
        std::mem::take(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Part of a loader that compares bakes with their scenes.
#[derive(Clone, Debug, Default)]
pub(crate) struct SceneChecker {
    pub reports: SceneReports,
    #[cfg(feature = "gltf")]
    pub folders: super::asset_folders::AssetFolders,
}

impl SceneChecker {
    /// Compares a bake that `context` loads with its scene, and reports the result. A scene that
    /// cannot be read or parsed is not compared.
    pub async fn check(&self, info: &BakeInfo, check: GiSceneCheck, context: &mut LoadContext<'_>) {
        let report = SceneReport {
            path: context.path().clone(),
            scene: info.scene.clone(),
            differs: Staleness::compare(info, &BakeInputs::default()),
        };
        #[cfg(not(feature = "gltf"))]
        let _ = check;
        #[cfg(feature = "gltf")]
        if check.is_on() {
            return self.check_scene(info, report, context).await;
        }
        self.reports.push(report);
    }

    #[cfg(feature = "gltf")]
    async fn check_scene(
        &self,
        info: &BakeInfo,
        mut report: SceneReport,
        context: &mut LoadContext<'_>,
    ) {
        use super::recipe_loader::ContextReader;
        use super::scene_files::SceneFiles;
        use bevy::log::debug;
        use meshless_gi::Recipe;

        let is_recipe = is_recipe(&report.path);
        // The asset processor bakes such recipes again by itself.
        let Some(scene) = info
            .scene
            .clone()
            .filter(|_| !(is_recipe && self.folders.processing))
        else {
            return self.reports.push(report);
        };
        let source = |path| String::from_utf8(self.folders.read_source(path)?).ok();
        let recipe = is_recipe
            .then(|| source(&report.path))
            .flatten()
            .and_then(|text| Recipe::from_ron(&text).ok());
        let now = BakeInputs {
            content_hash: None,
            recipe: recipe.as_ref(),
        };
        report.differs = Staleness::compare(info, &now);
        let mut reader = ContextReader {
            context,
            folders: &self.folders,
        };
        let files = match SceneFiles::read(&report.path, &scene, &mut reader).await {
            Ok(files) => files,
            Err(error) => {
                debug!("`{}` is not compared with its scene: {error}", report.path);
                return self.reports.push(report);
            }
        };
        if files.digest() == info.scene_digest {
            return self.reports.push(report);
        }
        let viewpoints = Recipe::from_ron(&info.given_recipe)
            .map(|recipe| recipe.viewpoints)
            .unwrap_or_default();
        let (reports, info) = (self.reports.clone(), info.clone());
        let compare = move || {
            match files.mesh(&viewpoints) {
                Ok(mesh) => {
                    let hash = mesh.content_hash();
                    let now = BakeInputs {
                        content_hash: Some(&hash),
                        recipe: None,
                    };
                    report.differs.content = Staleness::compare(&info, &now).content;
                }
                Err(error) => debug!("`{}` is not compared with its scene: {error}", report.path),
            }
            reports.push(report);
        };
        // Without a thread, the comparison is left to the next start.
        let _ = std::thread::Builder::new()
            .name("meshless gi scene check".into())
            .spawn(compare);
    }
}

/// Returns true for bakes under the name of their recipe.
fn is_recipe(path: &AssetPath<'_>) -> bool {
    path.path().to_string_lossy().ends_with(".gi.ron")
}

/// Runs in [`GiSystems::Validate`](super::GiSystems::Validate).
pub(crate) fn warn_stale(
    reports: Res<SceneReports>,
    scenes: Query<(Entity, Option<&Name>, &GiScene)>,
    mut pending: Local<Vec<SceneReport>>,
    mut stale: ResMut<GiStaleBakes>,
    mut findings: ResMut<GiWarnings>,
) {
    for report in reports.take() {
        pending.retain(|older| older.path != report.path);
        if !report.differs.is_stale() {
            stale.0.remove(&report.path);
        } else if stale.0.insert(report.path.clone(), report.differs) != Some(report.differs) {
            pending.push(report);
        }
    }
    if pending.is_empty() {
        return;
    }
    pending.retain(|report| {
        let user = scenes
            .iter()
            .find(|(.., gi)| gi.0.path() == Some(&report.path));
        let Some((entity, name, _)) = user else {
            return true;
        };
        let entity = name.map_or_else(|| entity.to_string(), |name| format!("{name} ({entity})"));
        warn!("{}", advice(&entity, report));
        if !findings.0.contains(&GiWarning::StaleBake) {
            findings.0.push(GiWarning::StaleBake);
        }
        false
    });
}

/// Text of the warning.
fn advice(entity: &str, report: &SceneReport) -> String {
    let path = &report.path;
    let scene = report.scene.as_deref().unwrap_or("its scene");
    let mut reasons = Vec::new();
    if report.differs.content {
        reasons.push(format!("`{scene}` has changed since it was baked"));
    }
    if report.differs.settings {
        reasons.push("its recipe has changed since".into());
    }
    if report.differs.version {
        reasons.push("another bake version made it".into());
    }
    let again = match is_recipe(path) {
        true => "Run the build step (`process_assets`), or the app with Bevy's asset processor."
            .to_string(),
        false => format!(
            "Run `meshless_gi bake {scene} -o {}` with the options of that bake.",
            path.path().display()
        ),
    };
    format!(
        "{entity}: the bake `{path}` is stale: {}. {again}",
        reasons.join(", ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outdated_scene_message_names_entity_files_and_command() {
        let mut report = SceneReport {
            path: AssetPath::from("levels/room.mgi"),
            scene: Some("room.glb".into()),
            differs: Staleness {
                content: true,
                ..Staleness::default()
            },
        };
        let text = advice("hall (3v1)", &report);
        for part in [
            "hall (3v1)",
            "`levels/room.mgi`",
            "`room.glb` has changed",
            "meshless_gi bake room.glb -o levels/room.mgi",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
        assert!(!text.contains("recipe has changed") && !text.contains("version"));
        report.path = AssetPath::from("levels/room.gi.ron");
        report.differs = Staleness {
            content: false,
            settings: true,
            version: true,
        };
        let text = advice("hall", &report);
        for part in ["recipe has changed", "bake version", "process_assets"] {
            assert!(text.contains(part), "{part}: {text}");
        }
        assert!(!text.contains("room.glb"), "{text}");
    }
}
