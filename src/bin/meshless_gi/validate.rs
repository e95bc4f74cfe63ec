//! `validate`: whether a bake is whole, and the list of what is wrong.

use super::error::ToolError;
use super::output;
use bevy_meshless_gi::asset::{AssetError, BakedScene, Limits};
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// The bake.
    bake: PathBuf,
}

pub fn run(args: &Args) -> Result<(), ToolError> {
    let path = args.bake.display();
    let why = match BakedScene::read(&args.bake, &Limits::default()) {
        Ok(_) => return output::print(&format!("{path}: valid\n")),
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
