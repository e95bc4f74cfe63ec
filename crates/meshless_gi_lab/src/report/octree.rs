//! Comparison of the method `fmm` with links: the cost of each of its bakes, and the cost of the
//! default method at the same error.

use super::format::{cell, count, megabytes, percent, short};
use super::measure::Row;
use super::rules::is_comparable;
use meshless_gi::TransportMethod;
use std::fmt::Write;

/// Returns the lowest cost among the bakes by `method` with at most this error.
fn min(rows: &[Row], method: TransportMethod, error: f64, cost: fn(&Row) -> f64) -> Option<f64> {
    let met = rows.iter().filter(|r| {
        is_comparable(r) && r.has_method(&method) && r.nrmse <= error && r.nrmse.is_finite()
    });
    met.map(cost).min_by(f64::total_cmp)
}

/// Returns the comparison of `fmm` with `bounded`, and a recommendation. Empty if `fmm` was not
/// measured.
#[must_use]
pub fn fmm_comparison(rows: &[Row]) -> String {
    let mut ours: Vec<&Row> = rows
        .iter()
        .filter(|r| is_comparable(r) && r.has_method(&TransportMethod::fmm()))
        .collect();
    ours.sort_by(|a, b| b.nrmse.total_cmp(&a.nrmse));
    if ours.is_empty() {
        return String::new();
    }
    let mut out = "Method `fmm` ([G08]) has no links: each bounce of a frame is one upward and one downward pass over an octree of the points.\n\
     Each row below is a bake by `fmm`, with the lowest cost among the bakes by `bounded` whose error is not larger (–: none).\n\n\
     | `fmm` | error | entries | file | bake, s | frame, ms | file of `bounded` | bake of `bounded`, s | frame of `bounded`, ms |\n\
     |---|---|---|---|---|---|---|---|---|\n"
        .to_string();
    // Number of rows at which `bounded` is cheaper: file, bake, frame.
    let (mut cheaper, mut met) = ([0usize; 3], 0usize);
    for row in &ours {
        let costs: [fn(&Row) -> f64; 3] = [|r| r.bytes as f64, |r| r.bake_seconds, |r| r.frame_ms];
        let theirs = costs.map(|cost| min(rows, TransportMethod::Bounded, row.nrmse, cost));
        for ((cheaper, theirs), cost) in cheaper.iter_mut().zip(theirs).zip(costs) {
            *cheaper += usize::from(theirs.is_some_and(|theirs| theirs < cost(row)));
        }
        met += usize::from(theirs[0].is_some());
        let other = |v: Option<f64>, of: fn(f64) -> String| v.map_or("–".to_string(), of);
        let _ = writeln!(
            out,
            "| {} | {} | {} | {} | {} | {} | {} | {} | {} |",
            cell(&row.settings.name),
            percent(row.nrmse),
            count(row.links),
            megabytes(row.bytes),
            short(row.bake_seconds),
            short(row.frame_ms),
            other(theirs[0], |v| megabytes(v as u64)),
            other(theirs[1], short),
            other(theirs[2], short),
        );
    }
    let best = |method: TransportMethod| min(rows, method, f64::INFINITY, |r| r.nrmse);
    let reached = |v: Option<f64>| v.map_or("none".into(), percent);
    let [file, bake, frame] = cheaper;
    let (octree, linked) = (best(TransportMethod::fmm()), best(TransportMethod::Bounded));
    let _ = writeln!(
        out,
        "\nConclusion: `bounded` reaches {met} of the {} errors above, with a smaller file for {file}, a faster bake for {bake}, a faster frame for {frame}.\n\
         The minimum error is {} with `fmm` and {} with `bounded`. {}{}",
        ours.len(),
        reached(octree),
        reached(linked),
        match (met, frame, file) {
            (0, _, _) => "No bake by `bounded` reaches these errors.",
            (_, 0, _) => "Use `fmm` here.",
            (m, f, 0) if f == m =>
                "Use `bounded` here for fast frames, `fmm` for small files or for light that is solved once.",
            (m, f, _) if f == m => "Use `bounded` here.",
            _ => "The cheaper method depends on the error.",
        },
        match met < ours.len() && octree < linked {
            true => " Finer bakes by `bounded` were not measured.",
            false => "",
        }
    );
    out
}
