//! Reports on several scenes as one document. It starts with results that hold for all of them.

use super::charts::Figure;
use super::format::{cell, error, megabytes, recipe_label, short, whole_percent};
use super::markdown::{ERROR_LIMITS, cheapest, section};
use super::measure::Row;
use super::rules::{Ratio, compare, is_comparable};
use super::sentences::split_sentences;
use super::sweep::Report;
use super::variant::Factor;
use meshless_gi::TransportMethod;
use std::fmt::Write;

/// Section of a document on one scene.
#[derive(Clone, Debug)]
pub struct SceneSection {
    /// Name of the scene.
    pub name: String,
    /// Measurements.
    pub report: Report,
    /// Charts.
    pub figures: Vec<Figure>,
    /// Prefix of the chart files, relative to the document: a folder with a trailing slash, or a
    /// file name prefix.
    pub charts: String,
}

/// Returns the document. `command` is the command that printed it.
#[must_use]
pub fn document(parts: &[SceneSection], command: &str) -> String {
    let mut out = format!(
        "# Cost of accuracy\n\n\
         Made by one command:\n\n\
         ```sh\n\
         {command}\n\
         ```\n\n\
         Do not edit. `meshless_gi report SCENE -o FOLDER` writes the same for any scene.\n\
         Errors, links and bytes are the same on every machine, times are not.\n\n\
         ## Recommendations\n\n\
         {}\n\
         {}",
        advice(parts),
        rules(parts)
    );
    for part in parts {
        let _ = write!(
            out,
            "\n## {}\n\n{}",
            cell(&part.name),
            section(&part.report, &part.figures, &part.charts, 3)
        );
    }
    split_sentences(&out)
}

/// Returns the rows of a variant that all scenes have. It can be recommended for scenes outside of
/// the document.
fn everywhere<'a>(parts: &'a [SceneSection], like: &Row) -> Option<Vec<&'a Row>> {
    let same = |row: &&Row| recipe_label(row) == recipe_label(like) && is_comparable(row);
    parts
        .iter()
        .map(|p| p.report.rows.iter().find(same))
        .collect()
}

/// Returns the recommended choices for any scene, and for each scene of the document.
fn advice(parts: &[SceneSection]) -> String {
    let mut out = String::new();
    let Some(first) = parts.first() else {
        return "Nothing was measured.\n".into();
    };
    let names: Vec<&str> = parts.iter().map(|p| p.name.as_str()).collect();
    for max in [0.10, 0.05] {
        // Shortest frame time, relative to the baseline of each scene.
        let best = first
            .report
            .rows
            .iter()
            .filter(|r| is_comparable(r) && r.has_method(&TransportMethod::Bounded))
            .filter(|r| r.settings.factor != Factor::Density)
            .filter_map(|r| everywhere(parts, r))
            .filter(|rows| rows.iter().all(|r| r.error_or_bound() <= max))
            .map(|rows| {
                let bases = parts.iter().map(|p| p.report.rows[0].frame_ms);
                let cost: f64 = rows.iter().zip(bases).map(|(r, b)| r.frame_ms / b).sum();
                (cost, rows)
            })
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let _ = match best {
            Some((_, rows)) => writeln!(
                out,
                "**For at most {} error: {}.**\n\
                 Of all recipes below this error in all scenes here ({}) it has the fastest frame:\n\n\
                 {}",
                whole_percent(max),
                recipe_label(rows[0]),
                names.join(", "),
                rows.iter()
                    .zip(&names)
                    .map(|(r, name)| format!(
                        "- {name}: error {}, bake {} s, file {}, frame {} ms on the CPU.",
                        error(r),
                        short(r.bake_seconds),
                        megabytes(r.bytes),
                        short(r.frame_ms)
                    ))
                    .collect::<Vec<_>>()
                    .join("\n")
            ),
            None => writeln!(
                out,
                "**No measured recipe has an error below {} in all scenes here** ({}).",
                whole_percent(max),
                names.join(", ")
            ),
        };
        out.push('\n');
    }
    let _ = writeln!(
        out,
        "Fastest frame of each scene by error:\n\n\
         | error at most | {} |\n\
         |---|{}",
        names
            .iter()
            .map(|n| cell(n))
            .collect::<Vec<_>>()
            .join(" | "),
        "---|".repeat(parts.len())
    );
    for max in ERROR_LIMITS {
        let _ = write!(out, "| {} |", whole_percent(max));
        for part in parts {
            let _ = match cheapest(&part.report.rows, max, |r| r.frame_ms) {
                Some(r) => write!(
                    out,
                    " {}: {} s, {}, {} ms |",
                    r.settings.name,
                    short(r.bake_seconds),
                    megabytes(r.bytes),
                    short(r.frame_ms)
                ),
                None => write!(out, " not reached |"),
            };
        }
        out.push('\n');
    }
    out
}

/// Returns the comparison of both methods on all scenes, as a table.
fn rules(parts: &[SceneSection]) -> String {
    let mut out = "Method `bounded` relative to `l08`, over the Pareto front of `l08` (below 1 `bounded` is better):\n\n\
     | scene | links at equal error | error at equal links |\n\
     |---|---|---|\n"
        .to_string();
    for part in parts {
        let compared = compare(&part.report.rows);
        let range = |of: &dyn Fn(usize) -> Ratio| {
            let found: Vec<f64> = (0..compared.len()).filter_map(|i| of(i).value()).collect();
            let missing = compared.len() - found.len();
            let min = found.iter().copied().fold(f64::INFINITY, f64::min);
            let max = found.iter().copied().fold(0.0, f64::max);
            match (found.is_empty(), missing) {
                (true, _) => "not reached".to_string(),
                (false, 0) => format!("× {min:.2} to × {max:.2}"),
                (false, n) => format!(
                    "× {min:.2} to × {max:.2}, not reached in {n} of {} rows",
                    compared.len()
                ),
            }
        };
        let _ = writeln!(
            out,
            "| {} | {} | {} |",
            cell(&part.name),
            range(&|i| compared[i].links_ratio),
            range(&|i| compared[i].error_ratio)
        );
    }
    out
}
