//! Error of bakes and the times of their steps. Bakes scenes with a reference solution of another
//! program and prints one row per scene.
//!
//! ```text
//! cargo run --release -p meshless_gi_lab --example accuracy -- medium tests/data/cornell
//! tests/data/rooms_open
//! ```
//!
//! `--seed N` and `--link-step S` before the folders, in this order, set fields of the recipe. A
//! folder holds, for each light, `L0.json` (geometry and lights) and `L0.csv` (irradiance at sample
//! points, with standard errors).

use meshless_gi::internals::bake::{BakeSettings, cast_gather_rays};
use meshless_gi::internals::scene::SceneDescription;
use meshless_gi::{
    Baked, Bounces, Evaluator, Preset, Progress, Recipe, TriangleMesh, bake_scene, load_gltf,
};
use meshless_gi_lab::accuracy::{BOUNCES, GroundTruth};
use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1).peekable();
    let preset = match args.next().as_deref() {
        Some("draft") => Preset::Draft,
        Some("medium") => Preset::Medium,
        Some("high") => Preset::High,
        _ => {
            return Err(
                "usage: accuracy draft|medium|high [--seed N] [--link-step S] FOLDER...".into(),
            );
        }
    };
    let mut seed = 0;
    if args.next_if_eq("--seed").is_some() {
        seed = args.next().ok_or("--seed needs a number")?.parse()?;
    }
    let mut link_step = None;
    if args.next_if_eq("--link-step").is_some() {
        link_step = Some(args.next().ok_or("--link-step needs a number")?.parse()?);
    }
    let recipe = Recipe {
        preset,
        seed,
        link_step,
        ..Recipe::default()
    };
    println!(
        "| scene | light | bounces | NRMSE | bias | 99 % below | direct NRMSE | not covered |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    let (mut bakes, mut tiers) = (String::new(), String::new());
    for folder in args.map(PathBuf::from) {
        let name = folder.file_name().unwrap_or_default().to_string_lossy();
        let [bake, tier] = scene(&folder, &name, &recipe)?;
        bakes += &bake;
        tiers += &tier;
    }
    println!();
    println!(
        "| scene | seconds | points, gather, refine, estimate | rays alone | ratio | elsewhere | senders | rows | links | bytes of the file | estimated NRMSE |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|");
    print!("{bakes}");
    println!();
    println!(
        "| scene | tier | rows | links | share of links | estimated NRMSE | NRMSE | bias | bias to all tiers |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    print!("{tiers}");
    Ok(())
}

/// Bakes the scene of a folder and prints a row for each light and number of bounces. Returns the
/// row of the bake and those of its tiers.
fn scene(folder: &Path, name: &str, recipe: &Recipe) -> Result<[String; 2], Box<dyn Error>> {
    let lights = (0..)
        .map(|i| folder.join(format!("L{i}.json")))
        .take_while(|path| path.exists())
        .collect::<Vec<_>>();
    let mut made: Option<(Baked, TriangleMesh)> = None;
    let mut tiers = String::new();
    for (i, path) in lights.iter().enumerate() {
        let description = SceneDescription::read(path)?;
        if made.is_none() {
            let geometry = description.geometry.first();
            let mesh = load_gltf(geometry.ok_or("a scene without geometry")?)?.mesh;
            let baked = bake_scene(&mesh, recipe, 0, &Progress::default())?;
            made = Some((baked, mesh));
        }
        let Some((baked, mesh)) = &made else { continue };
        let truth = GroundTruth::read(path.with_extension("csv"))?;
        for (k, bounces) in BOUNCES.iter().enumerate() {
            let count = bounces.map_or(Bounces::All, Bounces::Count);
            let meshes = std::slice::from_ref(mesh);
            let evaluator = Evaluator::new(&baked.scene, meshes, &description.lights, count);
            let c = truth.compare(&evaluator, k);
            println!(
                "| {name} | L{i} | {} | {:.2} % | {:+.2} % | {:.1} % | {:.2} % | {} of {} |",
                bounces.map_or("all".into(), |b| b.to_string()),
                100.0 * c.indirect.nrmse,
                100.0 * c.indirect.bias,
                100.0 * c.indirect.p99,
                100.0 * c.direct.nrmse,
                c.uncovered,
                truth.positions.len(),
            );
        }
        tiers += &compare_tiers(baked, mesh, &description, &truth, &format!("{name} L{i}"));
    }
    let (baked, mesh) = made.ok_or_else(|| format!("{}: no L0.json", folder.display()))?;
    let (stats, seconds) = (&baked.stats, &baked.stats.seconds);
    let settings: BakeSettings = BakeSettings::from_ron(&baked.scene.info().recipe)?;
    let began = Instant::now();
    let cast = cast_gather_rays(&mesh, baked.scene.data(), &settings);
    let alone = began.elapsed().as_secs_f64() * stats.gather_rays as f64 / cast as f64;
    let bake = format!(
        "| {name} | {:.1} | {:.1}, {:.1}, {:.1}, {:.1} | {alone:.1} | {:.2} | {:.0} % | {} | {} | {} | {} | {:.1} ± {:.1} % |\n",
        seconds.total,
        seconds.points,
        seconds.gather,
        seconds.refine,
        seconds.estimate,
        seconds.total / alone,
        100.0 * (1.0 - alone / seconds.total),
        stats.senders,
        stats.active_rows,
        stats.links,
        baked.scene.to_bytes()?.len(),
        100.0 * stats.estimated_nrmse,
        100.0 * stats.estimated_nrmse_interval,
    );
    Ok([bake, tiers])
}

/// Prints a row for each tier: four bounces against the reference, and against the whole operator.
fn compare_tiers(
    baked: &Baked,
    mesh: &TriangleMesh,
    description: &SceneDescription,
    truth: &GroundTruth,
    name: &str,
) -> String {
    let scene = &baked.scene;
    let Some(k) = BOUNCES.iter().position(|&b| b == Some(4)) else {
        return String::new();
    };
    let at = |tier: u32| {
        let (meshes, lights) = (std::slice::from_ref(mesh), &description.lights);
        let evaluator = Evaluator::with_tier(scene, meshes, lights, Bounces::Count(4), tier);
        let sum: f64 = truth
            .positions
            .iter()
            .map(|&(x, n)| evaluator.at(x, n, 0).indirect.unwrap_or_default())
            .map(|e| f64::from(e.element_sum()))
            .sum();
        (truth.compare(&evaluator, k).indirect, sum)
    };
    let (_, all) = at(u32::MAX);
    let links = scene.data().operator.links.len() as f64;
    (scene.info().tiers.iter().zip(1..))
        .map(|(tier, t)| {
            let (against_truth, sum) = at(t);
            format!(
                "| {name} | {t} | {} | {} | {:.1} % | {:.2} ± {:.2} % | {:.2} % | {:+.2} % | {:+.3} % |\n",
                tier.rows,
                tier.links,
                100.0 * tier.links as f64 / links,
                100.0 * tier.estimated_nrmse,
                100.0 * tier.estimated_nrmse_interval,
                100.0 * against_truth.nrmse,
                100.0 * against_truth.bias,
                100.0 * (sum / all - 1.0),
            )
        })
        .collect()
}
