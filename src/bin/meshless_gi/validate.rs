//! `validate`: whether a bake is whole, and the list of what is wrong; and whether it still belongs to its level.

use super::error::ToolError;
use super::{input, output};
use bevy_meshless_gi::asset::{AssetError, BakeInfo, BakedScene};
use bevy_meshless_gi::bake::is_stale;
use bevy_meshless_gi::scene::{SceneError, load_geometry_within};
use glam::Vec3;
use std::path::{Path, PathBuf};

/// Whether the level is another one now. Points without normals face the bake's viewpoints if those were named, which the bake does not say.
fn stale(info: &BakeInfo, level: &Path) -> Result<bool, SceneError> {
    for viewpoints in [&info.viewpoints[..], &[]] {
        let viewpoints: Vec<Vec3> = viewpoints.iter().map(|&v| v.into()).collect();
        let read = load_geometry_within(level, &viewpoints, &mut input::budget())?;
        let hash = read.mesh.content_hash();
        if !is_stale(info, &hash) {
            return Ok(false);
        }
    }
    Ok(true)
}

#[derive(clap::Args)]
pub struct Args {
    /// The bake.
    bake: PathBuf,
    /// The level (.glb, .gltf, .ply, .json) that it should belong to: finds a bake that is stale.
    #[arg(long, value_name = "LEVEL")]
    level: Option<PathBuf>,
}

pub fn run(args: &Args) -> Result<(), ToolError> {
    let path = args.bake.display();
    let why = match BakedScene::read(&args.bake, &input::limits()) {
        Ok(scene) => {
            if let Some(level) = &args.level
                && stale(&scene.info, level)?
            {
                let why = format!(
                    "stale: {} has changed since it was baked, or another version of this tool baked it ({}; this one is {})",
                    level.display(),
                    scene.info.version,
                    env!("CARGO_PKG_VERSION"),
                );
                output::print(&format!("{path}: {why}\n"))?;
                return Err(ToolError::input(&args.bake, &why));
            }
            return output::print(&format!("{path}: valid\n"));
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
