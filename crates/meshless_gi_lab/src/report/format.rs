//! Number formats of a report.

use super::measure::Row;
use super::variant::Factor;

/// Formats a fraction as percent: 0.0312 as "3.1 %".
pub fn percent(share: f64) -> String {
    let v = 100.0 * share;
    let decimals = match v.abs() {
        a if a >= 9.95 => 0,
        a if a >= 0.995 => 1,
        _ => 2,
    };
    format!("{v:.decimals$} %").replace('-', "−")
}

/// Formats a fraction as whole percent: 0.05 as "5 %".
pub fn whole_percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
}

/// Formats the error of a row.
pub fn error(row: &Row) -> String {
    if row.nrmse < row.nrmse_interval {
        format!("below {}", percent(row.nrmse_interval))
    } else {
        percent(row.nrmse)
    }
}

/// Returns the options that select a row.
pub fn recipe_label(row: &Row) -> String {
    match row.settings.factor {
        Factor::Tier => format!("`{}` at tier {}", row.settings.recipe, row.settings.tier),
        _ => format!("`{}`", row.settings.recipe),
    }
}

/// Formats a number with about three digits.
pub fn short(v: f64) -> String {
    let decimals = match v.abs() {
        a if a >= 99.5 => 0,
        a if a >= 9.95 => 1,
        _ => 2,
    };
    format!("{v:.decimals$}")
}

pub fn megabytes(bytes: u64) -> String {
    format!("{} MB", short(bytes as f64 / 1e6))
}

pub fn count(n: u64) -> String {
    match n {
        0..10_000 => n.to_string(),
        10_000..1_000_000 => format!("{} k", short(n as f64 / 1e3)),
        _ => format!("{} M", short(n as f64 / 1e6)),
    }
}

/// Escapes text for a cell of a table.
pub fn cell(text: &str) -> String {
    text.replace('|', "\\|").replace(['\n', '\r'], " ")
}
