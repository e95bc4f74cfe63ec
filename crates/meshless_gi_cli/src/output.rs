//! Results on standard output, notes on standard error, and formats of numbers. A closed stream
//! causes no panic.

use super::error::ToolError;
use meshless_gi::EnergyInfo;
use meshless_gi::internals::asset::write_file;
use serde::Serialize;
use std::io::{self, Write};
use std::path::Path;

/// Prints a result. A pipe that was closed early is not an error.
pub fn print(text: &str) -> Result<(), ToolError> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            Err(ToolError::Io(format!("standard output: {error}")))
        }
        _ => Ok(()),
    }
}

/// Writes `value` to a JSON file.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<(), ToolError> {
    let mut text =
        serde_json::to_vec_pretty(value).map_err(|error| ToolError::write(path, &error))?;
    text.push(b'\n');
    write_file(path, &text).map_err(|error| ToolError::write(path, &error))
}

/// Prints a note to standard error.
pub fn note(text: &str) {
    let _ = writeln!(io::stderr(), "note: {text}");
}

/// Table of names and values in two aligned columns.
#[derive(Default)]
pub struct Table(Vec<(&'static str, String)>);

impl Table {
    pub fn row(&mut self, name: &'static str, value: impl Into<String>) -> &mut Self {
        self.0.push((name, value.into()));
        self
    }

    pub fn text(&self) -> String {
        let width = self.0.iter().map(|(n, _)| n.len()).max().unwrap_or(0);
        self.0
            .iter()
            .map(|(name, value)| format!("{name:width$}  {value}\n"))
            .collect()
    }
}

/// Formats 1234567 as "1 234 567".
pub fn count(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(' ');
        }
        out.push(digit);
    }
    out
}

/// Formats a number of bytes.
pub fn bytes(n: u64) -> String {
    if n < 10_000 {
        format!("{} B", count(n))
    } else if n < 10_000_000 {
        format!("{:.1} kB", n as f64 / 1e3)
    } else {
        format!("{:.1} MB", n as f64 / 1e6)
    }
}

/// Formats an error and its interval as "4.20 % ± 0.30 %".
pub fn error(nrmse: f64, interval: f64) -> String {
    format!("{:.2} % ± {:.2} %", 100.0 * nrmse, 100.0 * interval)
}

/// Formats a gain as "at most 0.6123 (0.5971 found)" and appends the albedo correction.
pub fn gain(energy: &EnergyInfo) -> String {
    let mut text = match energy.estimated {
        true => format!("{:.4} found, not bounded", energy.spectral_radius_estimate),
        false => format!(
            "at most {:.4} ({:.4} found)",
            energy.spectral_radius_bound, energy.spectral_radius_estimate
        ),
    };
    if energy.clamped_senders > 0 {
        text += &format!(
            ", the albedo of {} senders lowered by up to {:.2} %",
            count(energy.clamped_senders),
            100.0 * (1.0 - energy.albedo_scale)
        );
    }
    text
}

/// Formats a sum as "30 = 2 + 8 + 20".
pub fn sum(parts: &[u64]) -> String {
    let all: Vec<_> = parts.iter().map(|&n| count(n)).collect();
    format!("{} = {}", count(parts.iter().sum()), all.join(" + "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn output_numbers_are_grouped_and_columns_aligned() {
        assert_eq!(
            [0, 999, 1000, 1_234_567].map(count),
            ["0", "999", "1 000", "1 234 567"]
        );
        assert_eq!(bytes(9_999), "9 999 B");
        assert_eq!(bytes(12_345), "12.3 kB");
        let mut table = Table::default();
        table.row("a", "1").row("bcd", sum(&[1, 2]));
        assert_eq!(table.text(), "a    1\nbcd  3 = 1 + 2\n");
    }
}
