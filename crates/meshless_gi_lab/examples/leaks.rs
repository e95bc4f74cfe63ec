//! Light leaks through walls, and the cost of preventing them. Bakes two rooms by method `bounded`
//! and by the method of [L08], with and without clip planes of basis functions at walls. Prints one
//! row per bake.
//!
//! ```text
//! cargo run --release -p meshless_gi_lab --example leaks -- draft
//! ```

use meshless_gi_lab::fixtures::leaks as leak_support;

use leak_support::{Door, WalledScene, load_open_rooms, rooms};
use meshless_gi::{Preset, Progress, Recipe, TransportMethod, bake_scene};
use std::error::Error;

/// Number of reference paths per sample in the lit room.
const PATHS: u32 = 2048;

fn main() -> Result<(), Box<dyn Error>> {
    let preset = match std::env::args().nth(1).as_deref() {
        Some("draft") => Preset::Draft,
        Some("medium") => Preset::Medium,
        Some("high") => Preset::High,
        _ => return Err("usage: leaks draft|medium|high".into()),
    };
    println!(
        "| wall | light behind it | method | clip planes | leak ratio | NRMSE lit | NRMSE dark | not covered | rays except the gather | seconds | bytes |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|");
    let scenes = [
        rooms("2 cm", 0.02, Door::Closed, PATHS),
        rooms("a sheet", 0.0, Door::Closed, PATHS),
        rooms("50 cm, door", 0.5, Door::Open, PATHS),
        rooms("2 cm, door", 0.02, Door::Open, PATHS),
        load_open_rooms(),
    ];
    for scene in &scenes {
        for method in [TransportMethod::Bounded, TransportMethod::L08] {
            let mut without = None;
            for walls in [false, true] {
                row(scene, preset, method, walls, &mut without)?;
            }
        }
    }
    Ok(())
}

/// Bakes and prints one row. `without` stores rays, seconds and bytes of the bake without walls.
fn row(
    scene: &WalledScene,
    preset: Preset,
    method: TransportMethod,
    walls: bool,
    without: &mut Option<[f64; 3]>,
) -> Result<(), Box<dyn Error>> {
    let recipe = Recipe {
        preset,
        transport: method,
        clip_planes: Some(walls),
        viewpoints: vec![[2.0, 1.3, 1.8], [6.0, 1.3, 1.8]],
        ..Recipe::default()
    };
    let baked = bake_scene(&scene.mesh, &recipe, 0, &Progress::default())?;
    let leak = scene.measure(&baked.scene);
    let bytes = baked.scene.to_bytes()?.len() as f64;
    // The error estimate is not part of the cost of walls.
    let seconds = baked.stats.seconds.total - baked.stats.seconds.estimate;
    let rays = (baked.stats.rays - baked.stats.gather_rays) as f64;
    let [r, s, b] = *without.get_or_insert([rays, seconds, bytes]);
    let per_cent = |v: f64| match v {
        0.0 => "–".to_string(),
        _ => format!("{:.1} %", 100.0 * v),
    };
    println!(
        "| {} | {} | `{}` | {} | {:.1e} | {} | {} | {} | {rays} ({:+.0} %) | {seconds:.1} ({:+.0} %) | {bytes} ({:+.1} %) |",
        scene.name,
        per_cent(leak.dim),
        method.name().to_lowercase(),
        if walls { "on" } else { "off" },
        leak.ratio,
        per_cent(leak.lit.nrmse),
        per_cent(leak.dark.nrmse),
        leak.uncovered.iter().sum::<usize>(),
        100.0 * (rays / r - 1.0),
        100.0 * (seconds / s - 1.0),
        100.0 * (bytes / b - 1.0),
    );
    Ok(())
}
