//! `report`: measures error against time and bytes on a scene and writes `report.json`, charts and
//! `report.md`.

use super::error::ToolError;
use super::source::{self, recipe_and_scene};
use super::{bake, output, progress};
use meshless_gi::BakeSceneError;
use meshless_gi::internals::asset::{check_writable, write_file};
use meshless_gi_lab::report::{Report, ReportError, Row, Sweep, choice, figures, sweep, text};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Duration;

#[derive(clap::Args)]
pub struct Args {
    /// Scene (.glb, .gltf, .ply, .json), or a recipe (.gi.ron) that names one. Only the scene and
    /// the viewpoints of a recipe are used.
    scene: PathBuf,
    /// Folder of report.json, report.md and the charts.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Make a few quick bakes only.
    #[arg(long)]
    quick: bool,
    /// Time limit in minutes. Bakes that would probably exceed it are skipped. The reference and
    /// one bake always run. Default 25, with --quick 10.
    #[arg(long, alias = "minutes", value_name = "MINUTES", allow_hyphen_values = true, value_parser = minutes)]
    time_limit: Option<f64>,
    /// Number of threads. 0 selects one per processor. Times depend on it, errors do not.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=bake::MAX_THREADS))]
    threads: u32,
}

/// Content of report.json.
#[derive(Serialize)]
struct Rows<'a> {
    rows: &'a [Row],
}

fn minutes(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(minutes @ 0.0..=10_080.0) => Ok(minutes),
        _ => Err("expected a number of minutes from 0 to 10080 (a week)".into()),
    }
}

pub fn run(args: &Args) -> Result<(), ToolError> {
    let (recipe, scene) = recipe_and_scene(&args.scene, None)?;
    let mesh = source::load(&scene, &recipe.viewpoints)?;
    let folder = &args.output;
    std::fs::create_dir_all(folder).map_err(|error| ToolError::write(folder, &error))?;
    // Checked before the long work.
    let json = folder.join("report.json");
    check_writable(&json).map_err(|error| ToolError::write(&json, &error))?;

    let mut plan = match args.quick {
        true => Sweep::quick(),
        false => Sweep::full(),
    };
    plan.threads = args.threads as usize;
    plan.viewpoints = recipe.viewpoints;
    if let Some(minutes) = args.time_limit {
        plan.limit = Duration::from_secs_f64(60.0 * minutes);
    }
    let report = progress::watch_steps(|progress, set_step| {
        sweep(&mesh, &plan, progress, &|step| {
            set_step(format!(
                "{} of {}, {}: ",
                step.done + 1,
                step.steps,
                step.what
            ));
        })
    })
    .map_err(|error| report_error(&scene, &error))?;
    write(&report, folder, &json, &name(&scene))?;
    output::print(&format!(
        "{}\n{} bakes and runs in {:.0} s: {}\n",
        choice(&report.rows),
        report.rows.len(),
        report.seconds,
        folder.join("report.md").display()
    ))
}

/// Returns the scene's name for titles.
fn name(scene: &Path) -> String {
    let stem = scene.file_stem().unwrap_or_default();
    stem.to_string_lossy().into_owned()
}

/// Writes the charts, the text and, last, the rows. If the rows exist, all files exist.
fn write(report: &Report, folder: &Path, json: &Path, name: &str) -> Result<(), ToolError> {
    let save = |path: &Path, bytes: &[u8]| {
        write_file(path, bytes).map_err(|error| ToolError::write(path, &error))
    };
    let figures = figures(name, report);
    for figure in &figures {
        save(&folder.join(&figure.file), figure.chart.svg().as_bytes())?;
    }
    save(
        &folder.join("report.md"),
        text(name, report, &figures).as_bytes(),
    )?;
    output::write_json(json, &Rows { rows: &report.rows })
}

fn report_error(scene: &Path, error: &ReportError) -> ToolError {
    match error {
        ReportError::Threads(_)
        | ReportError::Bake {
            source: BakeSceneError::Threads(_),
            ..
        } => ToolError::Usage(error.to_string()),
        _ => ToolError::input(scene, error),
    }
}
