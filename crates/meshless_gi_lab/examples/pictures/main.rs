//! Indirect light in views of scenes, compared with the path tracer: pictures, differences and
//! errors. Writes the document and its pictures:
//!
//! ```text
//! cargo run -p meshless_gi_lab --example pictures -- -o docs/reports [--cache FOLDER]
//!     [--presets draft,medium,high] [--scenes NAME,NAME] [SCENE_FOLDER...]
//! ```
//!
//! makes `docs/reports/pictures.md` and `docs/reports/pictures/`. References and bakes are kept in
//! the cache (`target/pictures`), and an interrupted run continues there. Bakes of another build of
//! this program are not used again. The folder of a scene holds `L0.json`. Its name must be one
//! with predefined views.

mod cache;
mod document;
mod measure;

use cache::Cache;
use measure::{Measured, measure};
use meshless_gi::Preset;
use meshless_gi_lab::fixtures::{TestScene, scenes::SCENES};
use meshless_gi_lab::pictures::ViewReferenceSize;
use meshless_gi_lab::report::split_sentences;
use std::error::Error;
use std::path::PathBuf;

/// Size of the references.
const SIZE: ViewReferenceSize = ViewReferenceSize {
    view: [96, 54],
    surface_points: 1000,
    paths: [256, 8192],
};

/// Arguments of the program.
struct Arguments {
    output: PathBuf,
    cache: PathBuf,
    presets: Vec<Preset>,
    scenes: Vec<TestScene>,
}

fn main() -> Result<(), Box<dyn Error>> {
    let args = arguments(std::env::args().skip(1))?;
    let cache = Cache::new(args.cache)?;
    let pictures = args.output.join("pictures");
    std::fs::create_dir_all(&pictures)?;
    let mut all: Vec<Measured> = Vec::new();
    for scene in &args.scenes {
        all.push(measure(scene, &args.presets, &SIZE, &cache, &pictures)?);
        // Written after every scene, so that a reader need not wait for the last.
        let text = document::text(&all, &args.presets);
        std::fs::write(args.output.join("pictures.md"), split_sentences(&text))?;
    }
    Ok(())
}

fn arguments(mut args: impl Iterator<Item = String>) -> Result<Arguments, Box<dyn Error>> {
    let usage = "usage: pictures -o FOLDER [--cache FOLDER] [--presets NAMES] [--scenes NAMES] [SCENE_FOLDER...]";
    let mut output = None;
    let mut cache = PathBuf::from("target/pictures");
    let mut presets = vec![Preset::Draft, Preset::Medium, Preset::High];
    let mut scenes: Vec<TestScene> = SCENES.iter().map(|scene| scene()).collect();
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "-o" => output = Some(PathBuf::from(args.next().ok_or(usage)?)),
            "--cache" => cache = PathBuf::from(args.next().ok_or(usage)?),
            "--presets" => {
                let names = args.next().ok_or(usage)?;
                presets = names.split(',').map(preset).collect::<Result<_, _>>()?;
            }
            "--scenes" => {
                let names = args.next().ok_or(usage)?;
                scenes.retain(|scene| names.split(',').any(|name| name == scene.name));
            }
            _ => {
                let scene = TestScene::read(arg.as_ref())?;
                scenes.push(scene.ok_or_else(|| format!("no views of {arg} are known"))?);
            }
        }
    }
    Ok(Arguments {
        output: output.ok_or(usage)?,
        cache,
        presets,
        scenes,
    })
}

fn preset(name: &str) -> Result<Preset, String> {
    match name {
        "draft" => Ok(Preset::Draft),
        "medium" => Ok(Preset::Medium),
        "high" => Ok(Preset::High),
        _ => Err(format!("no preset {name}: draft, medium or high")),
    }
}
