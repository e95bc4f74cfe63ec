//! `report`: what accuracy costs in time on a level: `report.json`, charts and `report.md` in a
//! folder.

use super::error::ToolError;
use super::{bake, output, progress};
use meshless_gi::BakeSceneError;
use meshless_gi::internals::asset::{check_writable, write_file};
use meshless_gi_lab::report::{Report, ReportError, Row, Sweep, choice, figures, sweep, text};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Duration;

#[derive(clap::Args)]
pub struct Args {
    /// The level (.glb, .gltf, .ply, .json), or a recipe (.gi.ron) that names one; of a recipe the
    /// level and the viewpoints count.
    scene: PathBuf,
    /// Folder for report.json, report.md and the charts.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// A handful of quick bakes.
    #[arg(long)]
    quick: bool,
    /// No bake begins that would probably end later than this many minutes after the start [25,
    /// with --quick 10]; the reference and one bake always run.
    #[arg(long, value_name = "M", allow_hyphen_values = true, value_parser = minutes)]
    minutes: Option<f64>,
    /// Threads; 0 for one a processor. Times depend on it, errors do not.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=bake::MAX_THREADS))]
    threads: u32,
}

/// What report.json holds.
#[derive(Serialize)]
struct Rows<'a> {
    rows: &'a [Row],
}

fn minutes(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(minutes @ 0.0..=10_080.0) => Ok(minutes),
        _ => Err("a number of minutes from 0 to 10080 (a week) is needed".into()),
    }
}

pub fn run(args: &Args) -> Result<(), ToolError> {
    let (recipe, level) = bake::level_and_recipe(&args.scene, None)?;
    let mesh = bake::load(&level, &recipe.viewpoints)?;
    let folder = &args.output;
    std::fs::create_dir_all(folder).map_err(|why| ToolError::write(folder, &why))?;
    // Before long work, not after it.
    let json = folder.join("report.json");
    check_writable(&json).map_err(|why| ToolError::write(&json, &why))?;

    let mut plan = match args.quick {
        true => Sweep::quick(),
        false => Sweep::full(),
    };
    plan.threads = args.threads as usize;
    plan.viewpoints = recipe.viewpoints;
    if let Some(minutes) = args.minutes {
        plan.limit = Duration::from_secs_f64(60.0 * minutes);
    }
    let report = progress::watch_steps(|progress, say| {
        sweep(&mesh, &plan, progress, &|step| {
            say(format!("{} of {}, {}: ", step.done + 1, step.of, step.what));
        })
    })
    .map_err(|why| failed(&level, &why))?;
    write(&report, folder, &json, &name(&level))?;
    output::print(&format!(
        "{}\n{} bakes and runs in {:.0} s: {}\n",
        choice(&report.rows),
        report.rows.len(),
        report.seconds,
        folder.join("report.md").display()
    ))
}

/// The level's name for titles.
fn name(level: &Path) -> String {
    let stem = level.file_stem().unwrap_or_default();
    stem.to_string_lossy().into_owned()
}

/// Writes the charts, the text and, last, the rows: where those are, all is there.
fn write(report: &Report, folder: &Path, json: &Path, name: &str) -> Result<(), ToolError> {
    let save = |path: &Path, bytes: &[u8]| {
        write_file(path, bytes).map_err(|why| ToolError::write(path, &why))
    };
    let figures = figures(name, report);
    for figure in &figures {
        save(&folder.join(&figure.file), figure.chart.svg().as_bytes())?;
    }
    save(
        &folder.join("report.md"),
        text(name, report, &figures).as_bytes(),
    )?;
    let rows = Rows { rows: &report.rows };
    let mut bytes = serde_json::to_vec_pretty(&rows).map_err(|why| ToolError::write(json, &why))?;
    bytes.push(b'\n');
    save(json, &bytes)
}

fn failed(level: &Path, why: &ReportError) -> ToolError {
    match why {
        ReportError::Threads(_)
        | ReportError::Bake {
            why: BakeSceneError::Threads(_),
            ..
        } => ToolError::Usage(why.to_string()),
        _ => ToolError::input(level, why),
    }
}
