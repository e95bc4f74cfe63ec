//! Comparison of both kinds of operator on one scene: links to senders and bases of direct light.
//! The axes are error, frame time, bytes and bake time.

use super::document::SCENE;
use meshless_gi::internals::bake::BakeSettings;
use meshless_gi::{Progress, TransportMethod, TriangleMesh};
use meshless_gi_lab::report::{
    Factor, Figure, Report, Sweep, Variant, figures, full, pca_comparison, sweep,
};
use std::error::Error;
use std::fmt::Write;
use std::time::Duration;

/// Latest time at which a bake may be predicted to end.
const LIMIT: Duration = Duration::from_mins(8);

/// Chooses variants of a full report: those that change the method or its threshold at draft.
/// Includes bases of light without refinement levels, as for links to senders.
fn create_variants(base: &BakeSettings) -> Vec<Variant> {
    let mut all = full(base);
    all.retain(|v| {
        let wanted = [
            Factor::Epsilon,
            Factor::Plain,
            Factor::RulePca,
            Factor::Several,
        ];
        wanted.contains(&v.factor) && v.cost < 4.0
    });
    let bases = all.iter().filter(|v| v.factor == Factor::RulePca);
    let plain: Vec<Variant> = bases
        .map(|v| {
            let mut v = v.clone();
            v.name = format!("plain {}", v.name);
            v.recipe.refinement_levels = Some(0);
            v
        })
        .collect();
    all.extend(plain);
    all
}

/// Measures a scene.
pub fn measure(name: &str, mesh: &TriangleMesh) -> Result<Report, Box<dyn Error>> {
    let plan = Sweep {
        create_variants,
        limit: LIMIT,
        ..Sweep::quick()
    };
    Ok(sweep(mesh, &plan, &Progress::default(), &|step| {
        eprintln!("{name}: {} of {}: {}", step.done + 1, step.steps, step.what);
    })?)
}

/// Returns the charts of both methods: error against bake time, frame time, bytes and links.
pub fn charts(name: &str, report: &Report) -> Vec<Figure> {
    let mut all = figures(name, report);
    all.retain(|f| f.file.starts_with("error_"));
    for figure in &mut all {
        figure.file = format!("{name}_{}", figure.file);
    }
    all
}

/// Returns a section of the document.
pub fn section(name: &str, report: &Report, figures: &[Figure]) -> String {
    let mut out = format!(
        "{SCENE}{name}\n\n\
         {} triangles. Error: NRMSE of indirect irradiance after {} bounces at {} points under {} lights, against the reference integrator.\n\
         Frame: time on the CPU for one light that has moved, all bounces, on {} threads.\n\n\
         | method | recipe | error, % | links | file, MB | bake, s | frame, ms |\n\
         |---|---|---|---|---|---|---|\n",
        report.triangles, report.bounces, report.positions, report.light_sources, report.threads
    );
    for rule in [TransportMethod::Bounded, TransportMethod::pca()] {
        for r in report.rows.iter().filter(|r| r.has_method(&rule)) {
            let _ = writeln!(
                out,
                "| `{}` | `{}` | {:.1} ± {:.1} | {:.2} M | {:.1} | {:.1} | {:.1} |",
                rule.name().to_lowercase(),
                r.settings.recipe,
                100.0 * r.nrmse,
                100.0 * r.nrmse_interval,
                r.links as f64 / 1e6,
                r.bytes as f64 / 1e6,
                r.bake_seconds,
                r.frame_ms,
            );
        }
    }
    if !report.left_out.is_empty() {
        let _ = writeln!(
            out,
            "\nSkipped because of the time limit: {}.",
            report.left_out.join("; ")
        );
    }
    out.push('\n');
    for figure in figures {
        let _ = writeln!(out, "![{}](pca/{})\n", figure.chart.title, figure.file);
    }
    out += &pca_comparison(&report.rows);
    out
}
