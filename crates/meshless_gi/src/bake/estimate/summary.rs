//! Error estimate from the errors under single lights.

use super::ErrorEstimate;

/// Threshold of the returned light, relative to the median. Lights below it get a proportionally
/// smaller weight.
const MIN_RETURNED_FRACTION: f64 = 0.1;
/// Error of one tier under one light.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct LightError {
    /// Squared NRMSE. Its noise can make it negative.
    pub square: f64,
    /// Variance of the square by the reference paths alone.
    pub noise: f64,
    /// Mean square of the indirect light relative to that of the direct light.
    pub returns: f64,
}

/// Returns the median, or 0 without values.
fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Computes the error estimate from the errors under single lights.
///
/// The spread of the squared errors has two causes: lights differ, and each is sampled at few
/// points. Both also affect one more light. Only the noise of the reference paths is subtracted.
/// Let m be the mean and s² the variance, and assume that squares are normal. Then 95 % of lights
/// stay below m + t s √(1 + 1/n), with Student's t for n − 1 degrees of freedom. Squares are skewed
/// to larger errors, so the upper end gives the width on both sides.
pub(super) fn summarize(sources: &[LightError]) -> ErrorEstimate {
    let usual = MIN_RETURNED_FRACTION * median(sources.iter().map(|l| l.returns));
    let weights: Vec<f64> = sources
        .iter()
        .map(|l| (l.returns / usual).min(1.0))
        .collect();
    let total: f64 = weights.iter().sum();
    if total <= 0.0 {
        return ErrorEstimate::default();
    }
    let mean = |of: &dyn Fn(&LightError) -> f64| {
        let parts = sources
            .iter()
            .zip(&weights)
            .map(|(l, weight)| weight * of(l));
        parts.sum::<f64>() / total
    };
    let m = mean(&|l| l.square).max(0.0);
    // Effective number of lights of equal weight.
    let count = total * total / weights.iter().map(|w| w * w).sum::<f64>();
    let nrmse = m.sqrt();
    if count < 1.5 {
        return ErrorEstimate {
            nrmse: nrmse as f32,
            // One light does not predict the errors of others.
            interval: nrmse as f32,
        };
    }
    let observed = mean(&|l| (l.square - m).powi(2)) * count / (count - 1.0);
    // The median, since a single light with large noise often has a large error.
    let noise = median(sources.iter().map(|l| l.noise)).clamp(0.0, observed);
    let width = student(count - 1.0) * (observed - noise + observed / count).sqrt();
    ErrorEstimate {
        nrmse: nrmse as f32,
        interval: ((m + width).sqrt() - nrmse) as f32,
    }
}

/// Returns the 97.5 % quantile of Student's distribution with `freedom` degrees of freedom (at
/// least 2), by the first terms of its expansion in 1 / `freedom`.
pub(super) fn student(freedom: f64) -> f64 {
    const Z: f64 = 1.959_964;
    let (f, z3, z5) = (freedom.max(2.0), Z.powi(3), Z.powi(5));
    Z + (z3 + Z) / (4.0 * f) + (5.0 * z5 + 16.0 * z3 + 3.0 * Z) / (96.0 * f * f)
}
