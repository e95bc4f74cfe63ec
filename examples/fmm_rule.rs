//! Rule `fmm` beside `bounded` and `pca`: error, time of a frame, bytes and time of the bake on the same axes, for the Cornell box as triangles and as points, and for a statue of
//! points in a room of triangles. Writes `FMM_RULE.md` and its charts.
//!
//! ```text
//! cargo run --release --no-default-features --features cli --example fmm_rule -- -o docs
//! ```

use bevy_meshless_gi::bake::{Preset, Progress, Recipe, Rule, Settings};
use bevy_meshless_gi::report::{
    Factor, Figure, Report, Run, Sweep, Variant, beside_octree, figures, sweep,
};
use bevy_meshless_gi::samples::scatter;
use bevy_meshless_gi::scene::{PointCloud, TriangleMesh, cornell_box, mesh_of_quads, statue_room};
use glam::Vec3;
use std::error::Error;
use std::fmt::Write;
use std::path::PathBuf;
use std::time::Duration;

/// No bake begins that would end later than this.
const LIMIT: Duration = Duration::from_mins(8);
/// Points are at least this far apart, metres, in a room of two.
const SPACING: f32 = 0.035;

/// Rules at what presets make of them, and what is rule `fmm`'s own.
fn choose(_: &Settings) -> Vec<Variant> {
    let of = |name: &str, factor, cost, recipe| Variant {
        factor,
        name: name.into(),
        recipe,
        run: Run::default(),
        cost,
    };
    let draft = Recipe {
        preset: Preset::Draft,
        ..Recipe::default()
    };
    let rule = |rule| Recipe {
        rule,
        ..draft.clone()
    };
    let epsilon = |e| Recipe {
        epsilon: Some(e),
        tolerance: Some(2.0 * e),
        ..draft.clone()
    };
    let fmm = rule(Rule::Fmm);
    let sources = |k| Recipe {
        sources: Some(k),
        ..fmm.clone()
    };
    let order = |k| Recipe {
        order: Some(k),
        ..fmm.clone()
    };
    let levels = |k| Recipe {
        sender_levels: Some(k),
        ..fmm.clone()
    };
    vec![
        of("bounded, ε 0.1", Factor::Epsilon, 0.8, epsilon(0.1)),
        of("bounded, ε 0.05", Factor::Epsilon, 0.9, epsilon(0.05)),
        of("pca", Factor::RulePca, 1.3, rule(Rule::Pca)),
        of("fmm", Factor::RuleFmm, 0.8, fmm.clone()),
        of("fmm, 1 source", Factor::RuleFmm, 0.6, sources(1)),
        of("fmm, 16 sources", Factor::RuleFmm, 1.2, sources(16)),
        of("fmm, order 2", Factor::RuleFmm, 0.6, order(2)),
        of("fmm, order 6", Factor::RuleFmm, 1.0, order(6)),
        of("fmm, 3 sender levels", Factor::RuleFmm, 0.7, levels(3)),
        of("fmm, 5 sender levels", Factor::RuleFmm, 1.2, levels(5)),
    ]
}

/// The points of some of a level.
fn cloud(
    level: &TriangleMesh,
    spacing: f32,
    keep: impl Fn(Vec3) -> bool,
) -> Result<TriangleMesh, Box<dyn Error>> {
    let mut all = scatter(level, spacing, 1).ok_or("no points")?;
    let kept: Vec<bool> = all.positions.iter().map(|&p| keep(p)).collect();
    let part = |values: &mut Vec<Vec3>| {
        let mut kept = kept.iter();
        values.retain(|_| kept.next().copied().unwrap_or(false));
    };
    part(&mut all.positions);
    all.normals.iter_mut().for_each(part);
    all.albedo.iter_mut().for_each(part);
    Ok(PointCloud::new(all, None)?.mesh().0)
}

/// The levels and what they are called.
fn levels() -> Result<Vec<(&'static str, TriangleMesh)>, Box<dyn Error>> {
    let solid = mesh_of_quads(&cornell_box());
    let points = cloud(&solid, SPACING, |_| true)?;
    // The room's walls as triangles, all else as points.
    let walls = mesh_of_quads(&cornell_box()[..5]);
    let statue = cloud(&statue_room(), 0.6 * SPACING, |p| {
        p.x.abs() < 0.95 && p.z.abs() < 0.95 && p.y > 0.01 && p.y < 1.95
    })?;
    Ok(vec![
        ("the Cornell box of triangles", solid),
        ("the Cornell box of points", points),
        (
            "a statue of points in a room of triangles",
            TriangleMesh::joined(vec![walls, statue]),
        ),
    ])
}

/// A level's part of the document.
fn section(name: &str, report: &Report, charts: &[Figure]) -> String {
    let mut out = format!(
        "\n## {name}\n\n{} triangles; error is NRMSE of indirect irradiance after {} reflections at {} places under {} lamps, against the reference integrator; frame is the CPU's, \
         one lamp moved, all reflections, on {} threads. Links of `fmm` are entries of its lists.\n\n\
         | rule | what | error, % | bias, % | links | file, MB | bake, s | frame, ms |\n|---|---|---|---|---|---|---|---|\n",
        report.triangles, report.bounces, report.places, report.lamps, report.threads
    );
    for rule in [Rule::Bounded, Rule::Pca, Rule::Fmm] {
        for r in (report.rows.iter()).filter(|r| r.settings.baked.rule == rule) {
            let _ = writeln!(
                out,
                "| `{}` | {} | {:.1} ± {:.1} | {:.1} | {:.2} M | {:.1} | {:.1} | {:.1} |",
                format!("{rule:?}").to_lowercase(),
                r.settings.name,
                100.0 * r.nrmse,
                100.0 * r.nrmse_interval,
                100.0 * r.bias,
                r.links as f64 / 1e6,
                r.bytes as f64 / 1e6,
                r.bake_seconds,
                r.frame_ms,
            );
        }
    }
    if !report.left_out.is_empty() {
        let left = report.left_out.join("; ");
        let _ = writeln!(out, "\nLeft out for lack of time: {left}.");
    }
    for figure in charts {
        let _ = writeln!(out, "\n![{}](fmm/{})", figure.chart.title, figure.file);
    }
    let _ = writeln!(out, "\n{}", beside_octree(&report.rows));
    out
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let folder = match arguments.as_slice() {
        [flag, folder] if flag == "-o" => PathBuf::from(folder),
        _ => return Err("usage: fmm_rule -o FOLDER".into()),
    };
    let threads = rayon::current_num_threads();
    let mut out = format!(
        "# Rule `fmm` beside links\n\n\
         Made by `cargo run --release --no-default-features --features cli --example fmm_rule -- -o docs` on {threads} threads. Do not edit. What the method itself does to error \
         and time: [FMM.md](FMM.md).\n"
    );
    let charts = folder.join("fmm");
    std::fs::create_dir_all(&charts)?;
    for (k, (name, level)) in levels()?.into_iter().enumerate() {
        let plan = Sweep {
            choose,
            limit: LIMIT,
            ..Sweep::quick()
        };
        let report = sweep(&level, &plan, &Progress::default(), &|step| {
            eprintln!("{name}: {} of {}: {}", step.done + 1, step.of, step.what);
        })?;
        let mut all = figures(name, &report);
        all.retain(|f| ["error_frame_time.svg", "error_bake_time.svg"].contains(&&*f.file));
        for figure in &mut all {
            figure.file = format!("rule_{k}_{}", figure.file);
            std::fs::write(charts.join(&figure.file), figure.chart.svg())?;
        }
        out += &section(name, &report, &all);
        std::fs::write(folder.join("FMM_RULE.md"), &out)?;
    }
    Ok(())
}
