//! Subsplats ([N09]) measured: their number, their difference to full resolution, their time, and
//! the effect of each setting. Writes the document and its charts:
//!
//! ```text
//! cargo run --release -p meshless_gi_lab --example subsplats -- -o docs/reports [--bakes FOLDER]
//! [SCENE_FOLDER...]
//! ```
//!
//! makes `docs/reports/subsplats.md` and `docs/reports/subsplats/`. The folder of a scene holds
//! `L0.json`. Its name must be one with predefined views. The cluttered room is built in and always
//! measured first. `FOLDER/NAME.mgi` replaces a bake at medium, and is written if it does not
//! exist.

mod bumps;
mod document;
mod experiments;
mod gloss;
use meshless_gi_lab::fixtures::gloss as gloss_support;
use meshless_gi_lab::fixtures::subsplats as subsplat_support;

use meshless_gi::{BakedScene, Limits, Progress, Recipe, bake_scene};
use meshless_gi_lab::fixtures::TestScene;
use meshless_gi_lab::report::split_sentences;
use std::error::Error;
use std::path::{Path, PathBuf};
use subsplat_support::{LitScene, clutter};

fn main() -> Result<(), Box<dyn Error>> {
    let usage = "usage: subsplats -o FOLDER [--bakes FOLDER] [SCENE_FOLDER...]";
    let (mut folder, mut bakes, mut scenes) = (None, None, vec![clutter()]);
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "-o" => folder = Some(PathBuf::from(args.next().ok_or(usage)?)),
            "--bakes" => bakes = Some(PathBuf::from(args.next().ok_or(usage)?)),
            _ => {
                let scene = TestScene::read(arg.as_ref())?;
                scenes.push(scene.ok_or_else(|| format!("no views of {arg} are known"))?);
            }
        }
    }
    let folder = folder.ok_or(usage)?;
    let mut stages = Vec::new();
    for scene in scenes {
        let baked = bake(&scene, bakes.as_deref())?;
        stages.push(LitScene::new(scene, baked));
    }
    let names: Vec<&str> = stages.iter().map(|s| s.scene.name.as_str()).collect();
    eprintln!("{} are lit", names.join(", "));
    let found = experiments::all(&stages)?;
    std::fs::create_dir_all(folder.join("subsplats"))?;
    for (file, chart) in document::charts(&found) {
        std::fs::write(folder.join("subsplats").join(file), chart.svg())?;
    }
    std::fs::write(
        folder.join("subsplats.md"),
        split_sentences(&document::text(&found)?),
    )?;
    Ok(())
}

fn bake(scene: &TestScene, bakes: Option<&Path>) -> Result<BakedScene, Box<dyn Error>> {
    let file = bakes.map(|folder| folder.join(format!("{}.mgi", scene.name)));
    if let Some(file) = file.as_deref().filter(|f| f.exists()) {
        return Ok(BakedScene::read(file, &Limits::default())?);
    }
    eprintln!("baking {}", scene.name);
    let baked = bake_scene(&scene.mesh, &Recipe::default(), 0, &Progress::default())?;
    if let Some(file) = file {
        baked.scene.write(&file)?;
    }
    Ok(baked.scene)
}
