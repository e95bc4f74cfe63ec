//! Standard output, for results, and standard error, for remarks. Neither panics where nobody
//! reads.

use super::error::ToolError;
use meshless_gi::EnergyInfo;
use std::io::{self, Write};

/// Prints a result as a whole. Who closes the pipe early has read enough: that is no error.
pub fn print(text: &str) -> Result<(), ToolError> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(why) if why.kind() != io::ErrorKind::BrokenPipe => {
            Err(ToolError::Io(format!("standard output: {why}")))
        }
        _ => Ok(()),
    }
}

/// A remark that is no result.
pub fn note(text: &str) {
    let _ = writeln!(io::stderr(), "note: {text}");
}

/// Names and values, the values one below the other.
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

/// 1234567 as "1 234 567".
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

/// A size for people.
pub fn bytes(n: u64) -> String {
    if n < 10_000 {
        format!("{} B", count(n))
    } else if n < 10_000_000 {
        format!("{:.1} kB", n as f64 / 1e3)
    } else {
        format!("{:.1} MB", n as f64 / 1e6)
    }
}

/// "4.20 % ± 0.30 %".
pub fn error(nrmse: f64, interval: f64) -> String {
    format!("{:.2} % ± {:.2} %", 100.0 * nrmse, 100.0 * interval)
}

/// "at most 0.6123 (0.5971 found)", and what had to be done for it.
pub fn gain(energy: &EnergyInfo) -> String {
    let mut text = match energy.estimated {
        true => format!("{:.4} found, not bounded", energy.gain_found),
        false => format!(
            "at most {:.4} ({:.4} found)",
            energy.gain, energy.gain_found
        ),
    };
    if energy.guarded > 0 {
        text += &format!(
            ", the albedo of {} senders lowered by up to {:.2} %",
            count(energy.guarded),
            100.0 * (1.0 - energy.guard_factor)
        );
    }
    text
}

/// "30 = 2 + 8 + 20".
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
