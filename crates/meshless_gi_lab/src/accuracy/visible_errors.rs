//! Visible errors of indirect irradiance: visibly wrong pixels, the error without its worst
//! positions, and light leaks in dark areas.

use super::metrics::errors;
use super::render::srgb8;
use glam::Vec3;

/// Mean of the reference in an image, over pixels and channels, after its exposure.
const MEAN_BRIGHTNESS: f64 = 0.2;
/// Difference of an 8-bit sRGB channel above which a pixel is visibly wrong.
const MAX_INVISIBLE_DIFFERENCE: u8 = 24;
/// Fraction of the positions that are left out of [`VisibleErrors::nrmse_without_worst`].
const EXCLUDED_FRACTION: f64 = 0.005;
/// Irradiance of a dark position, relative to the RMS of the reference.
const DARK_THRESHOLD: f64 = 0.01;
/// Irradiance that a dark position may get, relative to the RMS of the reference.
const MAX_DARK_IRRADIANCE: f64 = 0.05;
/// Tolerance above the limit of a dark position, in standard errors of the reference.
const SIGMAS: f64 = 3.0;
/// Length of [`VisibleErrors::worst`].
const WORST_COUNT: usize = 10;

/// Errors at the pixels of a view or at other positions.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct VisibleErrors {
    /// Fraction of positions that are visibly wrong in an image of white surfaces. The image is
    /// 8-bit sRGB, with the mean of the reference at 0.2. A pixel is wrong if a channel is off by
    /// more than 24.
    pub wrong_fraction: f64,
    /// [`Errors::nrmse`](super::Errors::nrmse).
    pub nrmse: f64,
    /// NRMSE without the 0.5 % of positions of largest error.
    pub nrmse_without_worst: f64,
    /// [`Errors::p99`](super::Errors::p99).
    pub p99: f64,
    /// Number of positions whose reference is below 1 % of its RMS.
    pub dark_count: usize,
    /// Number of these that are more than three standard errors above 5 % of the RMS.
    pub dark_wrong: usize,
    /// Indices of the ten positions of largest error, the largest first.
    pub worst: Vec<usize>,
}

/// Compares irradiances with a reference and its standard errors, W/m², all of equal length.
/// Returns the default for an empty or black reference.
///
/// # Panics
/// Panics if the lengths differ.
#[must_use]
pub fn visible_errors(
    values: &[Vec3],
    reference: &[Vec3],
    standard_errors: &[Vec3],
) -> VisibleErrors {
    let all = errors(values, reference, standard_errors);
    let sum: f64 = reference.iter().map(|r| f64::from(r.element_sum())).sum();
    if sum <= 0.0 {
        return VisibleErrors::default();
    }
    let exposure = (MEAN_BRIGHTNESS * 3.0 * reference.len() as f64 / sum) as f32;
    let is_wrong = |i: &usize| {
        let [a, b] = [values[*i], reference[*i]].map(|v| srgb8(exposure * v));
        (0..3).any(|c| a[c].abs_diff(b[c]) > MAX_INVISIBLE_DIFFERENCE)
    };
    let wrong = (0..values.len()).filter(is_wrong).count();
    let mut order: Vec<usize> = (0..values.len()).collect();
    let square = |i: usize| match (values[i] - reference[i]).length_squared() {
        square if square.is_nan() => f32::INFINITY,
        square => square,
    };
    order.sort_by(|&a, &b| square(b).total_cmp(&square(a)).then(a.cmp(&b)));
    let kept = &order[(EXCLUDED_FRACTION * order.len() as f64) as usize..];
    let of = |list: &[Vec3]| -> Vec<Vec3> { kept.iter().map(|&i| list[i]).collect() };
    let without = errors(&of(values), &of(reference), &of(standard_errors));
    let power: f64 = reference
        .iter()
        .map(|r| r.as_dvec3().length_squared())
        .sum();
    let rms = (power / (3 * reference.len()) as f64).sqrt();
    let largest = |v: Vec3| f64::from(v.max_element());
    let is_dark = |i: &usize| largest(reference[*i]) < DARK_THRESHOLD * rms;
    let is_lit = |i: &usize| {
        let limit = MAX_DARK_IRRADIANCE * rms + SIGMAS * largest(standard_errors[*i]);
        values[*i].is_nan() || largest(values[*i]) > limit
    };
    let dark: Vec<usize> = (0..values.len()).filter(is_dark).collect();
    VisibleErrors {
        wrong_fraction: wrong as f64 / values.len() as f64,
        nrmse: all.nrmse,
        nrmse_without_worst: without.nrmse,
        p99: all.p99,
        dark_count: dark.len(),
        dark_wrong: dark.iter().filter(|i| is_lit(i)).count(),
        worst: order.into_iter().take(WORST_COUNT).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a reference of `count` positions between 1 and 2 W/m², without noise.
    fn reference(count: usize) -> [Vec<Vec3>; 2] {
        let at = |i: usize| Vec3::splat(1.0 + i as f32 / count as f32);
        [(0..count).map(at).collect(), vec![Vec3::ZERO; count]]
    }

    #[test]
    fn equal_values_have_no_error() {
        let [right, noise] = reference(1000);
        let found = visible_errors(&right, &right, &noise);
        assert_eq!(found.wrong_fraction, 0.0);
        assert_eq!((found.nrmse, found.nrmse_without_worst), (0.0, 0.0));
        assert_eq!((found.dark_count, found.dark_wrong), (0, 0));
        assert_eq!(found.worst.len(), WORST_COUNT);
    }

    #[test]
    fn few_wrong_pixels_are_counted_and_left_out() {
        let [right, noise] = reference(1000);
        let mut values = right.clone();
        for i in [3, 100, 500, 900, 999] {
            values[i].y = 0.0;
        }
        let found = visible_errors(&values, &right, &noise);
        assert!((found.wrong_fraction - 0.005).abs() < 1e-12);
        assert!(found.nrmse > 0.02 && found.nrmse_without_worst == 0.0);
        assert_eq!(
            found.worst[0], 999,
            "the brightest one has the largest error"
        );
        // The sixth error is not left out. It is the smallest: 1.003 of an RMS of 1.527 W/m².
        values[700].y = 0.0;
        let found = visible_errors(&values, &right, &noise);
        let one = 1.003 / (1.527 * (3.0f64 * 995.0).sqrt());
        assert!((found.nrmse_without_worst - one).abs() < 1e-3, "{found:?}");
    }

    #[test]
    fn small_differences_are_not_visible() {
        let [right, noise] = reference(1000);
        let scaled = |f: f32| -> Vec<Vec3> { right.iter().map(|r| f * *r).collect() };
        // Mean 0.2 is code 124. 24 codes are a third of the light there.
        assert_eq!(
            visible_errors(&scaled(1.2), &right, &noise).wrong_fraction,
            0.0
        );
        assert_eq!(
            visible_errors(&scaled(1.9), &right, &noise).wrong_fraction,
            1.0
        );
    }

    #[test]
    fn light_at_dark_positions_is_counted() {
        let [mut right, mut noise] = reference(1000);
        right[..100].fill(Vec3::ZERO);
        let mut values = right.clone();
        values[..30].fill(Vec3::splat(0.5));
        values[30..40].fill(Vec3::splat(0.01));
        let found = visible_errors(&values, &right, &noise);
        assert_eq!((found.dark_count, found.dark_wrong), (100, 30));
        // The standard error of the reference allows the difference.
        noise[..10].fill(Vec3::splat(0.3));
        assert_eq!(visible_errors(&values, &right, &noise).dark_wrong, 20);
        values[99] = Vec3::NAN;
        let found = visible_errors(&values, &right, &noise);
        assert_eq!((found.dark_wrong, found.worst[0]), (21, 99));
    }

    #[test]
    fn black_or_empty_reference_gives_default() {
        let black = [Vec3::ZERO; 4];
        let found = visible_errors(&[Vec3::ONE; 4], &black, &black);
        assert_eq!(found, VisibleErrors::default());
        assert_eq!(visible_errors(&[], &[], &[]), VisibleErrors::default());
    }
}
