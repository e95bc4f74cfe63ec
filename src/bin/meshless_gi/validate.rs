//! `validate`: whether a bake is whole, and the list of what is wrong; and whether it still belongs to its level.

use super::error::ToolError;
use super::output;
use bevy_meshless_gi::asset::{AssetError, BakedScene, Limits};
use bevy_meshless_gi::bake::is_stale;
use bevy_meshless_gi::scene::load_geometry;
use std::path::PathBuf;

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
    let why = match BakedScene::read(&args.bake, &Limits::default()) {
        Ok(scene) => {
            if let Some(level) = &args.level
                && is_stale(&scene.info, &load_geometry(level)?.mesh.content_hash())
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
