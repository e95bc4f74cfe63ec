//! How much light comes through walls, and what it costs to stop it there? Bakes two rooms with our rule and with [L08]'s, with functions that stop at walls and
//! without, and prints a row of each.
//!
//! ```text
//! cargo run --release --no-default-features --features cli --example leaks -- draft
//! ```

#[path = "../tests/leak_support/mod.rs"]
mod leak_support;

use bevy_meshless_gi::bake::{Preset, Progress, Recipe, Rule, bake_level};
use leak_support::{Walled, open, sealed};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let preset = match std::env::args().nth(1).as_deref() {
        Some("draft") => Preset::Draft,
        Some("medium") => Preset::Medium,
        Some("high") => Preset::High,
        _ => return Err("usage: leaks draft|medium|high".into()),
    };
    println!(
        "| wall | rule | walls | leak ratio | NRMSE lit | NRMSE dark | not covered | seconds | bytes |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    let scenes = [sealed("2 cm", 0.02), sealed("a sheet", 0.0), open()];
    for scene in &scenes {
        for rule in [Rule::Bounded, Rule::L08] {
            let mut without = None;
            for walls in [false, true] {
                row(scene, preset, rule, walls, &mut without)?;
            }
        }
    }
    Ok(())
}

/// Bakes and prints one row; `without` holds seconds and bytes of the bake without walls, once it is known.
fn row(
    scene: &Walled,
    preset: Preset,
    rule: Rule,
    walls: bool,
    without: &mut Option<(f64, f64)>,
) -> Result<(), Box<dyn Error>> {
    let recipe = Recipe {
        preset,
        rule,
        walls: Some(walls),
        viewpoints: vec![[2.0, 1.3, 1.8], [6.0, 1.3, 1.8]],
        ..Recipe::default()
    };
    let baked = bake_level(&scene.mesh, &recipe, 0, &Progress::default())?;
    let leak = scene.measure(&baked.scene);
    let bytes = baked.scene.to_bytes()?.len() as f64;
    // The estimate is no part of what walls cost.
    let seconds = baked.stats.seconds.total - baked.stats.seconds.estimate;
    let (s, b) = *without.get_or_insert((seconds, bytes));
    println!(
        "| {} | {rule:?} | {} | {:.1e} | {:.2} % | {} | {} | {seconds:.1} ({:+.0} %) | {bytes} ({:+.0} %) |",
        scene.name,
        if walls { "on" } else { "off" },
        leak.ratio,
        100.0 * leak.lit.nrmse,
        if leak.dark.nrmse > 0.0 {
            format!("{:.2} %", 100.0 * leak.dark.nrmse)
        } else {
            "–".into()
        },
        leak.uncovered.iter().sum::<usize>(),
        100.0 * (seconds / s - 1.0),
        100.0 * (bytes / b - 1.0),
    );
    eprintln!(
        "worst {:?}; dark bias {:+.2} %, p99 {:.1} %; lit bias {:+.2} %, p99 {:.1} %",
        leak.worst,
        100.0 * leak.dark.bias,
        100.0 * leak.dark.p99,
        100.0 * leak.lit.bias,
        100.0 * leak.lit.p99
    );
    Ok(())
}
