//! `bake`: bakes a scene or a recipe into a `.mgi` file and prints statistics.

use super::bake_options::Options;
use super::error::ToolError;
use super::output::{self, Table};
use super::progress;
use super::ray_baseline::{self, RayBaseline};
use super::source::{self, recipe_and_scene};
use meshless_gi::internals::asset::check_writable;
use meshless_gi::{BakeError, BakeSceneError, BakeStats, Baked, Recipe, bake_scene};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Upper limit of `--threads`.
pub const MAX_THREADS: i64 = 1024;

#[derive(clap::Args)]
pub struct Args {
    /// Scene: triangles (.glb, .gltf), points (.ply), a scene description (.json) that names both,
    /// or a recipe (.gi.ron) that names a scene.
    scene: PathBuf,
    /// Path of the bake to write.
    #[arg(short, long, value_name = "OUT.mgi")]
    output: PathBuf,
    /// Recipe for the scene. The options below override its fields.
    #[arg(long, value_name = "FILE")]
    recipe: Option<PathBuf>,
    #[command(flatten)]
    options: Options,
    /// Number of threads. 0 selects one per processor. The result does not depend on it.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=MAX_THREADS))]
    threads: u32,
    /// Write statistics to this JSON file.
    #[arg(long, value_name = "FILE.json")]
    stats: Option<PathBuf>,
    /// After the bake, time the gather rays alone (a lower bound of the bake time).
    #[arg(long, alias = "yardstick")]
    ray_baseline: bool,
}

/// Content of the statistics file.
#[derive(Serialize)]
struct Statistics<'a> {
    #[serde(flatten)]
    bake: &'a BakeStats,
    #[serde(flatten)]
    ray_baseline: Option<RayBaseline>,
}

pub fn run(args: &Args) -> Result<(), ToolError> {
    let began = Instant::now();
    let (recipe, scene_file) = bake_input(args)?;
    check_outputs(args, &scene_file)?;
    let mesh = source::load(&scene_file, &recipe.viewpoints)?;
    let loaded = began.elapsed().as_secs_f64();
    let bvh = mesh.bvh_time().as_secs_f64();
    let threads = args.threads as usize;
    let Baked {
        scene, mut stats, ..
    } = progress::watch(|progress| bake_scene(&mesh, &recipe, threads, progress))
        .map_err(|error| bake_error(args, &scene_file, &error))?;
    stats.seconds.load = loaded - bvh;
    stats.seconds.bvh += bvh;
    let writing = Instant::now();
    stats.bytes = scene
        .write(&args.output)
        .map_err(|error| ToolError::asset(&args.output, &error))?;
    stats.seconds.write = writing.elapsed().as_secs_f64();
    stats.seconds.total = began.elapsed().as_secs_f64();

    let ray_baseline = match args.ray_baseline {
        true => Some(ray_baseline::measure(&mesh, &scene, &stats, threads)?),
        false => None,
    };
    for warning in &stats.warnings {
        output::note(warning);
    }
    if let Some(path) = &args.stats {
        output::write_json(
            path,
            &Statistics {
                bake: &stats,
                ray_baseline,
            },
        )?;
    }
    output::print(&summary(&args.output, &stats, ray_baseline))
}

/// Returns the recipe with the options applied, and the path of the scene file.
fn bake_input(args: &Args) -> Result<(Recipe, PathBuf), ToolError> {
    let (mut recipe, scene_file) = recipe_and_scene(&args.scene, args.recipe.as_deref())?;
    args.options.apply(&mut recipe);
    if scene_file == args.scene {
        // The bake stores the scene's name. A recipe given by --recipe may name another scene.
        recipe.scene = (scene_file.file_name()).map(|name| name.to_string_lossy().into_owned());
    }
    source::check(&recipe).map_err(|error| ToolError::Usage(error.to_string()))?;
    Ok((recipe, scene_file))
}

/// Checks before the bake that the outputs can be written and are not inputs.
fn check_outputs(args: &Args, scene_file: &Path) -> Result<(), ToolError> {
    let outputs = [Some(args.output.as_path()), args.stats.as_deref()];
    let inputs = [
        Some(scene_file),
        Some(args.scene.as_path()),
        args.recipe.as_deref(),
    ];
    for output in outputs.into_iter().flatten() {
        if (inputs.into_iter().flatten()).any(|input| is_same_file(input, output)) {
            return Err(ToolError::Usage(format!(
                "{}: is an input and an output; choose another output",
                output.display()
            )));
        }
        check_writable(output).map_err(|error| ToolError::write(output, &error))?;
    }
    if args.stats.as_ref().is_some_and(|s| *s == args.output) {
        return Err(ToolError::Usage(
            "-o and --stats name the same file; choose two files".into(),
        ));
    }
    Ok(())
}

fn is_same_file(a: &Path, b: &Path) -> bool {
    match (a.canonicalize(), b.canonicalize()) {
        (Ok(a), Ok(b)) => a == b,
        _ => false,
    }
}

/// Returns the error of a failed bake, which names the recipe or the scene file.
fn bake_error(args: &Args, scene_file: &Path, error: &BakeSceneError) -> ToolError {
    match error {
        BakeSceneError::Bake(BakeError::Recipe(error)) => match &args.recipe {
            Some(path) => ToolError::input(path, error),
            None => ToolError::input(&args.scene, error),
        },
        BakeSceneError::Threads(_) => ToolError::Usage(error.to_string()),
        _ => ToolError::input(scene_file, error),
    }
}

fn summary(path: &Path, stats: &BakeStats, ray_baseline: Option<RayBaseline>) -> String {
    let s = &stats.seconds;
    let mut table = Table::default();
    table
        .row("file", format!("{}, {}", path.display(), output::bytes(stats.bytes)))
        .row("triangles", output::count(stats.triangles))
        .row("points", output::sum(&stats.points_per_level))
        .row("senders", output::count(stats.senders))
        .row("links", output::count(stats.links))
        .row(
            "rays",
            format!(
                "{}, {} of them for the gather",
                output::count(stats.rays),
                output::count(stats.gather_rays)
            ),
        )
        .row(
            "estimated error",
            output::error(stats.estimated_nrmse, stats.estimated_nrmse_interval),
        )
        .row("gain", output::gain(&stats.energy))
        .row(
            "seconds",
            format!(
                "{:.2} on {} threads: load {:.2}, bvh {:.2}, points {:.2}, gather {:.2}, refine {:.2}, bounces {:.2}, estimate {:.2}, write {:.2}",
                s.total, stats.threads, s.load, s.bvh, s.points, s.gather, s.refine, s.bounces, s.estimate, s.write
            ),
        );
    if let Some(baseline) = ray_baseline {
        table.row(
            "ray baseline",
            format!(
                "{:.2} s for the gather rays alone; the bake took {:.1} times that",
                baseline.ray_baseline_seconds, baseline.total_over_ray_baseline
            ),
        );
    }
    table.text()
}
