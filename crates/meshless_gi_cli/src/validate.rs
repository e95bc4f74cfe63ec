//! `validate`: checks that a bake is whole and still belongs to its level, and lists what is wrong.

use super::bake::level_and_recipe;
use super::error::ToolError;
use super::{input, output};
use glam::Vec3;
use meshless_gi::internals::bake::{BAKE_VERSION, BakeInputs, Staleness};
use meshless_gi::internals::scene::load_geometry_within;
use meshless_gi::{AssetError, BakeInfo, BakedScene, Recipe, SceneError};
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// The bake.
    bake: PathBuf,
    /// The level (.glb, .gltf, .ply, .json) that it should belong to, or the recipe (.gi.ron) that
    /// names it: finds a bake that is stale.
    #[arg(long, value_name = "LEVEL")]
    level: Option<PathBuf>,
    /// The recipe that it should be baked by, where LEVEL is none. Options of `bake` count as part
    /// of a recipe.
    #[arg(long, value_name = "FILE", requires = "level")]
    recipe: Option<PathBuf>,
}

pub fn run(args: &Args) -> Result<(), ToolError> {
    let path = args.bake.display();
    let why = match BakedScene::read(&args.bake, &input::limits()) {
        Ok(scene) => {
            let differences = match &args.level {
                Some(level) => differences(args, level, &scene.info)?,
                None => Vec::new(),
            };
            if differences.is_empty() {
                return output::print(&format!("{path}: valid\n"));
            }
            output::print(&format!("{path}: stale\n  {}\n", differences.join("\n  ")))?;
            return Err(ToolError::input(&args.bake, &"stale"));
        }
        Err(why) => why,
    };
    if why.is_content() {
        let wrong = match &why {
            AssetError::Invalid(violations) => violations.iter().map(ToString::to_string).collect(),
            other => vec![other.to_string()],
        };
        output::print(&format!("{path}: not valid\n  {}\n", wrong.join("\n  ")))?;
    }
    Err(ToolError::asset(&args.bake, &why))
}

/// One line for each input of the bake that has changed since.
fn differences(args: &Args, level: &Path, info: &BakeInfo) -> Result<Vec<String>, ToolError> {
    let (recipe, geometry) = level_and_recipe(&level.to_path_buf(), args.recipe.as_ref())?;
    let recipe_file = match &args.recipe {
        Some(file) => Some(file.as_path()),
        None if geometry != level => Some(level),
        None => None,
    };
    let hash = content_hash(info, &geometry)?;
    let now = BakeInputs {
        content_hash: Some(&hash),
        recipe: recipe_file.map(|_| &recipe),
    };
    let differs = Staleness::compare(info, &now);
    let mut lines = Vec::new();
    if differs.content {
        lines.push(format!(
            "content: {} has changed since it was baked",
            geometry.display()
        ));
    }
    if let (true, Some(file)) = (differs.settings, recipe_file) {
        lines.push(format!(
            "settings: {} is not the recipe that it was baked by",
            file.display()
        ));
    }
    if differs.version {
        lines.push(format!(
            "version: bake version {} made it, this program is bake version {BAKE_VERSION}",
            info.bake_version
        ));
    }
    Ok(lines)
}

/// Hash of the level now. Points without normals face the viewpoints that the bake's recipe names.
fn content_hash(info: &BakeInfo, level: &Path) -> Result<[u8; 32], SceneError> {
    let viewpoints = Recipe::from_ron(&info.given_recipe).map(|recipe| recipe.viewpoints);
    let viewpoints: Vec<Vec3> = (viewpoints.unwrap_or_default().iter())
        .map(|&v| v.into())
        .collect();
    Ok(
        load_geometry_within(level, &viewpoints, &mut input::budget())?
            .mesh
            .content_hash(),
    )
}
