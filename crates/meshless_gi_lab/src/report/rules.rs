//! The default rule beside others, that of \[L08\] as published and bases of direct light: links at
//! equal error, and error at equal links, read off the two rules' Pareto fronts.

use super::measure::Row;
use super::variant::Factor;
use crate::accuracy::{interpolate_log, pareto_front};
use meshless_gi::TransportMethod;

/// Values of `bounded` relative to those of `l08`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ratio {
    /// As its front has it.
    Is(f64),
    /// At most so much: what `bounded` has was measured only where it does better still.
    AtMost(f64),
    /// No bake by `bounded` comes there.
    NotReached,
}

impl Ratio {
    /// The number; none where it was not reached.
    #[must_use]
    pub fn value(self) -> Option<f64> {
        match self {
            Self::Is(v) | Self::AtMost(v) => Some(v),
            Self::NotReached => None,
        }
    }
}

/// Two rules compared at one position of the other rule's front.
#[derive(Clone, Debug, PartialEq)]
pub struct Compared {
    /// The row of the bake by the other rule.
    pub row: usize,
    /// Its name.
    pub name: String,
    /// Its links.
    pub links: f64,
    /// Its NRMSE.
    pub error: f64,
    /// Links that `bounded` needs for the same error.
    pub links_ratio: Ratio,
    /// Error that `bounded` has with as many links.
    pub error_ratio: Ratio,
}

/// Links and errors of the rows of a rule that run as many reflections as the reference, which rows
/// those are, by links: the Pareto front.
#[must_use]
pub fn front(rows: &[Row], rule: TransportMethod) -> Vec<(usize, f64, f64)> {
    let of_rule: Vec<usize> = (0..rows.len())
        .filter(|&i| rows[i].settings.baked.transport.is_same_method(&rule) && comparable(&rows[i]))
        .filter(|&i| rows[i].links > 0 && rows[i].nrmse > 0.0)
        .collect();
    let positions: Vec<(f64, f64)> = of_rule
        .iter()
        .map(|&i| (rows[i].links as f64, rows[i].nrmse))
        .collect();
    pareto_front(&positions)
        .into_iter()
        .map(|k| (of_rule[k], positions[k].0, positions[k].1))
        .collect()
}

/// Returns `true` if a row's error is one of representation alone: it runs as many reflections as
/// the reference has, by sweeps.
#[must_use]
pub fn comparable(row: &Row) -> bool {
    row.settings.factor != Factor::Bounces
}

/// Compares the default rule with that of \[L08\] at each position of its front, fewest links
/// first.
#[must_use]
pub fn compare(rows: &[Row]) -> Vec<Compared> {
    compare_with(rows, TransportMethod::L08)
}

/// Compares the default rule with `rule` at each position of its front, fewest links first.
#[must_use]
pub fn compare_with(rows: &[Row], rule: TransportMethod) -> Vec<Compared> {
    let ours: Vec<(f64, f64)> = front(rows, TransportMethod::Bounded)
        .into_iter()
        .map(|(_, links, error)| (links, error))
        .collect();
    let by_error: Vec<(f64, f64)> = ours.iter().rev().map(|&(l, e)| (e, l)).collect();
    front(rows, rule)
        .into_iter()
        .map(|(i, links, error)| Compared {
            row: i,
            name: rows[i].settings.name.clone(),
            links,
            error,
            links_ratio: ratio(&by_error, error, links),
            error_ratio: ratio(&ours, links, error),
        })
        .collect()
}

/// Value of a falling front at `x`, over `y`. Beyond its end the value there is an upper bound.
fn ratio(front: &[(f64, f64)], x: f64, y: f64) -> Ratio {
    match (interpolate_log(front, x), front.last()) {
        (Some(found), _) => Ratio::Is(found / y),
        (None, Some(last)) if x > last.0 => Ratio::AtMost(last.1 / y),
        _ => Ratio::NotReached,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn front_ratios_are_interpolated_and_bounded_outside() {
        let ours = [(1e4, 0.2), (1e6, 0.02)];
        // Half-way between, in logarithms.
        assert!(matches!(ratio(&ours, 1e5, 0.4), Ratio::Is(r) if (r - 0.158).abs() < 1e-3));
        assert!(matches!(ratio(&ours, 1e7, 0.1), Ratio::AtMost(r) if (r - 0.2).abs() < 1e-9));
        assert_eq!(ratio(&ours, 1e3, 0.1), Ratio::NotReached);
        assert_eq!(ratio(&[], 1e3, 0.1), Ratio::NotReached);
        assert_eq!(Ratio::AtMost(0.2).value(), Some(0.2));
        assert_eq!(Ratio::NotReached.value(), None);
    }
}
