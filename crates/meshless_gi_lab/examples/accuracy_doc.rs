//! Writes docs/reports/accuracy.md and its charts: a report on each of several scenes, and the
//! results common to all of them.
//!
//! ```text
//! cargo run --release -p meshless_gi_lab --example accuracy_doc -- tests/data/cornell
//! tests/data/rooms_open path/to/level.glb
//! ```
//!
//! A folder holds, for each light, `L0.json` (geometry and lights) and `L0.csv` (irradiance of
//! another program at positions). The report also compares presets with that irradiance. `--quick`
//! before the scenes makes few bakes. `--minutes M` limits the time of each scene. `-o FOLDER` sets
//! the output folder.

use meshless_gi::internals::asset::write_file;
use meshless_gi::internals::scene::SceneDescription;
use meshless_gi::{Progress, TriangleMesh, load_gltf};
use meshless_gi_lab::accuracy::GroundTruth;
use meshless_gi_lab::report::{ExternalReference, SceneSection, Sweep, document, figures, sweep};
use std::error::Error;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

fn main() -> Result<(), Box<dyn Error>> {
    let mut plan = Sweep::full();
    let mut folder = PathBuf::from("docs");
    let mut scene_paths = Vec::new();
    let mut command =
        "cargo run --release -p meshless_gi_lab --example accuracy_doc --".to_string();
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--quick" => plan = Sweep::quick(),
            "--minutes" => {
                let minutes: f64 = args.next().ok_or("--minutes needs a number")?.parse()?;
                plan.limit = Duration::try_from_secs_f64(60.0 * minutes)?;
                let _ = write!(command, " --minutes {minutes}");
                continue;
            }
            "-o" => {
                folder = args.next().ok_or("-o needs a folder")?.into();
                continue;
            }
            _ => {
                let path = PathBuf::from(&arg);
                // Absolute paths of this machine are not published.
                let shown = match path.is_absolute() {
                    true => Path::new("path/to").join(path.file_name().unwrap_or_default()),
                    false => path.clone(),
                };
                let _ = write!(command, " {}", shown.display());
                scene_paths.push(path);
                continue;
            }
        }
        let _ = write!(command, " {arg}");
    }
    if scene_paths.is_empty() {
        return Err(
            "usage: accuracy_doc [--quick] [--minutes M] [-o FOLDER] LEVEL.glb|FOLDER...".into(),
        );
    }
    std::fs::create_dir_all(folder.join("accuracy"))?;
    let mut parts = Vec::new();
    for path in &scene_paths {
        let (mesh, known) = level(path)?;
        let plan = Sweep {
            known,
            ..plan.clone()
        };
        let name = path.file_stem().unwrap_or_default();
        let name = name.to_string_lossy().into_owned();
        eprintln!("{name}");
        let report = sweep(&mesh, &plan, &Progress::default(), &|step| {
            eprintln!("  {} of {}: {}", step.done + 1, step.steps, step.what);
        })?;
        let figures = figures(&name, &report);
        for figure in &figures {
            let file = folder.join(format!("accuracy/{name}_{}", figure.file));
            write_file(&file, figure.chart.svg().as_bytes())?;
        }
        println!(
            "{name}: {} rows in {:.0} s",
            report.rows.len(),
            report.seconds
        );
        parts.push(SceneSection {
            charts: format!("accuracy/{name}_"),
            name,
            report,
            figures,
        });
    }
    write_file(
        &folder.join("accuracy.md"),
        document(&parts, &command).as_bytes(),
    )?;
    Ok(())
}

/// Reads a scene and the results of another program: a folder with both, or a file without results.
fn level(path: &Path) -> Result<(TriangleMesh, Vec<ExternalReference>), Box<dyn Error>> {
    if !path.is_dir() {
        return Ok((load_gltf(path)?.mesh, Vec::new()));
    }
    let mut mesh = None;
    let mut known = Vec::new();
    for i in 0.. {
        let file = path.join(format!("L{i}.json"));
        if !file.exists() {
            break;
        }
        let description = SceneDescription::read(&file)?;
        if mesh.is_none() {
            let geometry = description.geometry.first();
            mesh = Some(load_gltf(geometry.ok_or("a scene without geometry")?)?.mesh);
        }
        known.push(ExternalReference {
            name: format!("L{i}"),
            lights: description.lights,
            truth: GroundTruth::read(file.with_extension("csv"))?,
        });
    }
    let mesh = mesh.ok_or_else(|| format!("{}: no L0.json", path.display()))?;
    Ok((mesh, known))
}
