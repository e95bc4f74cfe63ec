//! Tables of all rows of a report.

use super::format::{cell, count, error, megabytes, percent, short};
use super::measure::Row;
use super::rules::is_comparable;
use super::variant::{BOUNCES, Factor};
use std::fmt::Write;

/// Returns the table of all comparable rows.
pub(super) fn table(rows: &[Row]) -> String {
    let mut out = "| bake | bake, s | frame, ms | display of 1000 points, ms | file | links | points | error | 99 % below | bias | own estimate |\n\
     |---|---|---|---|---|---|---|---|---|---|---|\n"
        .to_string();
    for factor in Factor::ALL {
        for row in rows
            .iter()
            .filter(|r| r.settings.factor == factor && is_comparable(r))
        {
            let _ = writeln!(
                out,
                "| {} | {} | {} | {} | {} | {} | {} | {} ± {} | {} | {} | {} ± {} |",
                cell(&row.settings.name),
                short(row.bake_seconds),
                short(row.frame_ms),
                short(row.splat_ms_per_1000),
                megabytes(row.bytes),
                count(row.links),
                count(row.points),
                error(row),
                percent(row.nrmse_interval),
                percent(row.p99),
                percent(row.bias),
                percent(row.estimated_nrmse),
                percent(row.estimated_nrmse_interval),
            );
        }
    }
    out
}

/// Returns the section that compares the presets with another program's ground truth. Empty if
/// there is none.
pub(super) fn known(rows: &[Row], mark: &str) -> String {
    let mut out = String::new();
    for row in rows {
        for k in &row.known {
            let _ = writeln!(
                out,
                "| {} | {} | {} | {} | {} | {} |",
                cell(&row.settings.name),
                cell(&k.name),
                percent(k.nrmse),
                percent(k.bias),
                percent(k.p99),
                error(row),
            );
        }
    }
    if out.is_empty() {
        return out;
    }
    format!(
        "\n{mark} Comparison with another program\n\n\
         NRMSE against irradiance after {BOUNCES} bounces that another program computed for this scene, at its own points and under its own lights.\n\n\
         | preset | lights | error | bias | 99 % below | error in this report |\n\
         |---|---|---|---|---|---|\n\
         {out}"
    )
}
