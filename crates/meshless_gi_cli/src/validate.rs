//! `validate`: checks a bake, compares it with its scene and recipe, and lists the differences.

use super::error::ToolError;
use super::source::recipe_and_scene;
use super::{input, output};
use glam::Vec3;
use meshless_gi::internals::bake::{BAKE_VERSION, BakeInputs, Staleness};
use meshless_gi::internals::scene::load_geometry_within;
use meshless_gi::{AssetError, BakeInfo, BakedScene, Recipe, SceneError};
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// Bake to check.
    bake: PathBuf,
    /// Scene (.glb, .gltf, .ply, .json) of the bake, or the recipe (.gi.ron) that names it. Reports
    /// a stale bake.
    #[arg(long, alias = "level", value_name = "SCENE")]
    scene: Option<PathBuf>,
    /// Recipe of the bake, if SCENE is not a recipe. Options that were given to `bake` count as
    /// differences.
    #[arg(long, value_name = "FILE", requires = "scene")]
    recipe: Option<PathBuf>,
}

pub fn run(args: &Args) -> Result<(), ToolError> {
    let path = args.bake.display();
    let error = match BakedScene::read(&args.bake, &input::limits()) {
        Ok(baked) => {
            let differences = match &args.scene {
                Some(scene) => differences(args, scene, baked.info())?,
                None => Vec::new(),
            };
            if differences.is_empty() {
                return output::print(&format!("{path}: valid\n"));
            }
            output::print(&format!("{path}: stale\n  {}\n", differences.join("\n  ")))?;
            return Err(ToolError::input(&args.bake, &"stale"));
        }
        Err(error) => error,
    };
    if error.is_content() {
        let problems = match &error {
            AssetError::Invalid(violations) => violations.iter().map(ToString::to_string).collect(),
            other => vec![other.to_string()],
        };
        output::print(&format!("{path}: not valid\n  {}\n", problems.join("\n  ")))?;
    }
    Err(ToolError::asset(&args.bake, &error))
}

/// Returns one line for each input of the bake that has changed.
fn differences(args: &Args, scene: &Path, info: &BakeInfo) -> Result<Vec<String>, ToolError> {
    let (recipe, geometry) = recipe_and_scene(scene, args.recipe.as_deref())?;
    let recipe_file = match &args.recipe {
        Some(file) => Some(file.as_path()),
        None if geometry != scene => Some(scene),
        None => None,
    };
    let hash = content_hash(info, &geometry)?;
    let current = BakeInputs {
        content_hash: Some(&hash),
        recipe: recipe_file.map(|_| &recipe),
    };
    let differs = Staleness::compare(info, &current);
    let mut lines = Vec::new();
    if differs.content {
        lines.push(format!(
            "content: {} has changed since the bake",
            geometry.display()
        ));
    }
    if let (true, Some(file)) = (differs.settings, recipe_file) {
        lines.push(format!(
            "settings: {} differs from the recipe of the bake",
            file.display()
        ));
    }
    if differs.version {
        lines.push(format!(
            "version: made by bake version {}, this program is bake version {BAKE_VERSION}",
            info.bake_version
        ));
    }
    Ok(lines)
}

/// Returns the hash of the current scene. Points without normals face the viewpoints of the bake's
/// recipe.
fn content_hash(info: &BakeInfo, scene: &Path) -> Result<[u8; 32], SceneError> {
    let viewpoints = Recipe::from_ron(&info.given_recipe).map(|recipe| recipe.viewpoints);
    let viewpoints: Vec<Vec3> = (viewpoints.unwrap_or_default().iter())
        .map(|&v| v.into())
        .collect();
    Ok(
        load_geometry_within(scene, &viewpoints, &mut input::budget())?
            .mesh
            .content_hash(),
    )
}
