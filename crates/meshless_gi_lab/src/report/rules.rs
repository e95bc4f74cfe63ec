//! Comparison of the default method `bounded` with the others, such as `l08` and `pca`. Links at
//! equal error and error at equal links are interpolated on the Pareto fronts of both methods.

use super::measure::Row;
use super::variant::Factor;
use crate::accuracy::{interpolate_log, pareto_front};
use meshless_gi::TransportMethod;

/// Value of `bounded` relative to that of the other method.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ratio {
    /// Ratio at a position within the front of `bounded`.
    Is(f64),
    /// Upper bound of the ratio. The position lies beyond the end of the front of `bounded`. The
    /// last value of the falling front bounds it.
    AtMost(f64),
    /// Position that no bake by `bounded` reaches.
    NotReached,
}

impl Ratio {
    /// Returns the ratio. Returns `None` if it was not reached.
    #[must_use]
    pub fn value(self) -> Option<f64> {
        match self {
            Self::Is(v) | Self::AtMost(v) => Some(v),
            Self::NotReached => None,
        }
    }
}

/// Comparison of two methods at one position of the other method's front.
#[derive(Clone, Debug, PartialEq)]
pub struct MethodComparison {
    /// Row of the bake by the other method.
    pub row: usize,
    /// Name of the row.
    pub name: String,
    /// Number of links of the row.
    pub links: f64,
    /// NRMSE of the row.
    pub error: f64,
    /// Links that `bounded` needs for the same error.
    pub links_ratio: Ratio,
    /// Error of `bounded` with the same number of links.
    pub error_ratio: Ratio,
}

/// Returns the Pareto front of a method over comparable rows: row index, links and error, ordered
/// by links.
#[must_use]
pub fn front(rows: &[Row], method: TransportMethod) -> Vec<(usize, f64, f64)> {
    let of_method: Vec<usize> = (0..rows.len())
        .filter(|&i| rows[i].has_method(&method) && is_comparable(&rows[i]))
        .filter(|&i| rows[i].links > 0 && rows[i].nrmse > 0.0)
        .collect();
    let positions: Vec<(f64, f64)> = of_method
        .iter()
        .map(|&i| (rows[i].links as f64, rows[i].nrmse))
        .collect();
    pareto_front(&positions)
        .into_iter()
        .map(|k| (of_method[k], positions[k].0, positions[k].1))
        .collect()
}

/// Returns `true` if the row's number of reflections is that of the reference, computed by sweeps.
/// Its error is then one of representation alone.
#[must_use]
pub fn is_comparable(row: &Row) -> bool {
    row.settings.factor != Factor::Bounces
}

/// Compares the default method with `l08` at each position of the front of `l08`, fewest links
/// first.
#[must_use]
pub fn compare(rows: &[Row]) -> Vec<MethodComparison> {
    compare_with(rows, TransportMethod::L08)
}

/// Compares the default method with `method` at each position of its front, fewest links first.
#[must_use]
pub fn compare_with(rows: &[Row], method: TransportMethod) -> Vec<MethodComparison> {
    let ours: Vec<(f64, f64)> = front(rows, TransportMethod::Bounded)
        .into_iter()
        .map(|(_, links, error)| (links, error))
        .collect();
    let by_error: Vec<(f64, f64)> = ours.iter().rev().map(|&(l, e)| (e, l)).collect();
    front(rows, method)
        .into_iter()
        .map(|(i, links, error)| MethodComparison {
            row: i,
            name: rows[i].settings.name.clone(),
            links,
            error,
            links_ratio: ratio(&by_error, error, links),
            error_ratio: ratio(&ours, links, error),
        })
        .collect()
}

/// Returns the value of a falling front at `x`, divided by `y`. Beyond the end of the front its
/// last value is an upper bound.
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
        // Midpoint on a logarithmic scale.
        assert!(matches!(ratio(&ours, 1e5, 0.4), Ratio::Is(r) if (r - 0.158).abs() < 1e-3));
        assert!(matches!(ratio(&ours, 1e7, 0.1), Ratio::AtMost(r) if (r - 0.2).abs() < 1e-9));
        assert_eq!(ratio(&ours, 1e3, 0.1), Ratio::NotReached);
        assert_eq!(ratio(&[], 1e3, 0.1), Ratio::NotReached);
        assert_eq!(Ratio::AtMost(0.2).value(), Some(0.2));
        assert_eq!(Ratio::NotReached.value(), None);
    }
}
