//! Charts of a report.

use super::measure::Row;
use super::rules::{front, is_comparable};
use super::sweep::Report;
use super::variant::Factor;
use crate::accuracy::{Axis, Chart, Format, Mark, Series, Style, pareto_front};
use meshless_gi::TransportMethod;

/// Index of the style of a front without a series: black.
const BLACK: usize = 6;

/// Errors that have a guide line with a label.
const GUIDES: [f64; 4] = [0.2, 0.1, 0.05, 0.02];

/// Groups of factors that share a color.
const GROUPS: [(&str, &[Factor]); 7] = [
    ("presets", &[Factor::Preset]),
    ("method l08, as published", &[Factor::RuleL08]),
    ("method pca, bases of direct light", &[Factor::RulePca]),
    (
        "threshold ε (plain: no refinement levels)",
        &[Factor::Epsilon, Factor::Plain],
    ),
    (
        "points, levels, senders",
        &[
            Factor::Density,
            Factor::Levels,
            Factor::Added,
            Factor::Senders,
            Factor::SamplesPerSender,
        ],
    ),
    (
        "several at once, tiers, rays per point",
        &[Factor::Several, Factor::Tier, Factor::Rays],
    ),
    ("method fmm, an octree of points", &[Factor::RuleFmm]),
];

/// Chart with the name of its file.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// File name.
    pub file: String,
    /// Content of the chart.
    pub chart: Chart,
}

/// Returns all charts of a report on the scene `name`.
#[must_use]
pub fn figures(name: &str, report: &Report) -> Vec<Figure> {
    let rows = &report.rows;
    let threads = report.threads;
    let mut all = vec![
        against(
            "error_bake_time",
            format!("{name}: error against bake time"),
            Axis::log(
                format!("time of the bake, s ({threads} threads)"),
                Format::Number,
            ),
            rows,
            |r| r.bake_seconds,
        ),
        against(
            "error_frame_time",
            format!("{name}: error against frame time"),
            Axis::log(
                format!("CPU time of a frame in which one light moves, ms ({threads} threads)"),
                Format::Number,
            ),
            rows,
            |r| r.frame_ms,
        ),
        against(
            "error_bytes",
            format!("{name}: error against size"),
            Axis::log("size of the file, bytes", Format::Si),
            rows,
            |r| r.bytes as f64,
        ),
        Figure {
            file: "error_links.svg".into(),
            chart: links(name, rows),
        },
    ];
    let reflections = reflections(name, report);
    if !reflections.series.iter().all(|s| s.points.is_empty()) {
        all.push(Figure {
            file: "reflections.svg".into(),
            chart: reflections,
        });
    }
    all
}

fn guides() -> Vec<(f64, String)> {
    GUIDES.iter().map(|&g| (g, String::new())).collect()
}

fn hint(row: &Row) -> String {
    format!(
        "{}: error {:.2} %, {:.1} s, {:.1} ms, {:.1} MB, {} links",
        row.settings.name,
        100.0 * row.nrmse,
        row.bake_seconds,
        row.frame_ms,
        row.bytes as f64 / 1e6,
        row.links
    )
}

/// Returns a chart of the error against a cost. A bake has the color of its factor, and the front
/// is that of all bakes.
fn against(file: &str, title: String, x: Axis, rows: &[Row], cost: fn(&Row) -> f64) -> Figure {
    let rows: Vec<&Row> = rows.iter().filter(|r| is_comparable(r)).collect();
    let positions: Vec<(f64, f64)> = rows.iter().map(|r| (cost(r), r.nrmse)).collect();
    let front = pareto_front(&positions);
    let mut series: Vec<Series> = GROUPS
        .iter()
        .enumerate()
        .map(|(look, (name, factors))| Series {
            name: (*name).into(),
            style: Style::Points,
            points: rows
                .iter()
                .enumerate()
                .filter(|(_, r)| factors.contains(&r.settings.factor))
                .map(|(i, r)| Mark {
                    x: cost(r),
                    y: r.nrmse,
                    // Presets always have a label, because users select them.
                    label: match front.contains(&i) || r.settings.factor == Factor::Preset {
                        true => r.settings.name.clone(),
                        false => String::new(),
                    },
                    hint: hint(r),
                })
                .collect(),
            like: Some(look),
        })
        .collect();
    series.retain(|s| !s.points.is_empty());
    series.push(Series {
        like: Some(BLACK),
        ..Series::new(
            "Pareto front",
            Style::Front,
            front.iter().map(|&i| positions[i]),
        )
    });
    Figure {
        file: format!("{file}.svg"),
        chart: Chart {
            title,
            caption: "Each marker is one bake. Left is cheaper, down is better. Both axes are logarithmic.".into(),
            x,
            y: Axis::log("error of indirect light (NRMSE)", Format::Percent),
            series,
            guides: guides(),
        },
    }
}

/// Returns a chart of the error against links: the default method, `l08`, and `pca` if it was
/// measured.
fn links(name: &str, rows: &[Row]) -> Chart {
    let rules = [
        (TransportMethod::Bounded, "method bounded (the default)", 0),
        (TransportMethod::L08, "method l08, as published", 1),
        (
            TransportMethod::pca(),
            "method pca, bases of direct light",
            2,
        ),
        (TransportMethod::fmm(), "method fmm, list entries", 3),
    ];
    let mut series = Vec::new();
    for (rule, title, look) in rules {
        let front = front(rows, rule);
        if front.is_empty() && matches!(rule, TransportMethod::Pca(_) | TransportMethod::Fmm(_)) {
            continue;
        }
        let points = rows
            .iter()
            .enumerate()
            .filter(|(_, r)| r.has_method(&rule) && is_comparable(r))
            .map(|(i, r)| Mark {
                x: r.links as f64,
                y: r.nrmse,
                label: match front.iter().any(|f| f.0 == i) {
                    true => r.settings.name.clone(),
                    false => String::new(),
                },
                hint: hint(r),
            })
            .collect();
        series.push(Series {
            name: title.into(),
            points,
            like: Some(look),
            ..Series::default()
        });
        series.push(Series {
            like: Some(look),
            ..Series::new(
                "its Pareto front",
                Style::Front,
                front.iter().map(|f| (f.1, f.2)),
            )
        });
    }
    Chart {
        title: format!("{name}: error against links, by method"),
        caption: "Each marker is one bake. Left is fewer links, down is better. Both axes are logarithmic.".into(),
        x: Axis::log("links that a frame uses", Format::Si),
        y: Axis::log("error of indirect light (NRMSE)", Format::Percent),
        series,
        guides: guides(),
    }
}

/// Returns a chart of the error against the reference with all reflections, by the number of
/// reflections of the frame.
fn reflections(name: &str, report: &Report) -> Chart {
    let rows = &report.rows;
    let baked = |r: &Row| r.settings.name.ends_with("baked");
    let mut runtime: Vec<&Row> = rows
        .iter()
        .enumerate()
        .filter(|(i, r)| (*i == 0 || !is_comparable(r)) && !baked(r))
        .map(|(_, r)| r)
        .collect();
    runtime.sort_by_key(|r| r.settings.baked.bounces);
    if runtime.len() < 2 {
        runtime.clear();
    }
    let mark = |r: &&Row| Mark {
        x: r.frame_ms,
        y: r.nrmse_all,
        label: match baked(r) {
            true => r.settings.name.clone(),
            false => r.settings.baked.bounces.to_string(),
        },
        hint: String::new(),
    };
    let mut series = vec![Series {
        name: "number of bounces".into(),
        style: Style::LineAndPoints,
        points: runtime.iter().map(mark).collect(),
        like: None,
    }];
    let in_the_bake: Vec<Mark> = rows.iter().filter(|r| baked(r)).map(|r| mark(&r)).collect();
    if !in_the_bake.is_empty() {
        series.push(Series {
            name: "in the bake".into(),
            points: in_the_bake,
            ..Series::default()
        });
    }
    Chart {
        title: format!("{name}: error and frame time by number of bounces"),
        caption: "Bake of the baseline. Errors are relative to the converged solution.".into(),
        x: Axis::linear(
            format!(
                "CPU time of a frame in which one light moves, ms ({} threads)",
                report.threads
            ),
            Format::Number,
        ),
        y: Axis::log(
            "error against the converged solution (NRMSE)",
            Format::Percent,
        ),
        series,
        guides: guides(),
    }
}
