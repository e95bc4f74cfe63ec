//! Errors of irradiances against a noisy reference, and light leaks.

use glam::Vec3;

/// Errors of values against a reference, over all positions and color channels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Errors {
    /// ‖x − ref‖₂ / ‖ref‖₂, with the reference's own variance subtracted. 0 if the reference is 0.
    pub nrmse: f64,
    /// ‖x − ref‖₂ / ‖ref‖₂ without the subtraction.
    pub raw_nrmse: f64,
    /// (Σx − Σref) / Σref.
    pub bias: f64,
    /// 99th percentile of |x − ref| over the root mean square of the reference.
    pub p99: f64,
    /// Mean of (x − ref)² / (ref² + ε), with the reference's own variance subtracted. ε is 0.01
    /// times the mean square of the reference. Dim positions have the same weight as bright ones.
    /// In \[RKZ11\] ε is 0.01 for images with values of about one. Irradiance has a unit, so ε is
    /// relative here.
    pub rel_mse: f64,
}

/// Compares `values` with `reference` and its `standard_errors` (zero if it has none). All have
/// equal length.
#[must_use]
pub fn errors(values: &[Vec3], reference: &[Vec3], standard_errors: &[Vec3]) -> Errors {
    assert_eq!(values.len(), reference.len());
    assert_eq!(values.len(), standard_errors.len());
    let (mut square, mut power, mut noise, mut sum, mut total) = (0.0, 0.0, 0.0, 0.0, 0.0);
    let mut all = Vec::with_capacity(3 * values.len());
    for ((x, r), s) in values.iter().zip(reference).zip(standard_errors) {
        for c in 0..3 {
            let (x, r, s) = (f64::from(x[c]), f64::from(r[c]), f64::from(s[c]));
            square += (x - r).powi(2);
            power += r * r;
            noise += s * s;
            sum += x - r;
            total += r;
            all.push((x - r).abs());
        }
    }
    if power == 0.0 || total == 0.0 {
        return Errors::default();
    }
    let floor = 0.01 * power / all.len() as f64;
    let mut relative = 0.0;
    for ((x, r), s) in values.iter().zip(reference).zip(standard_errors) {
        for c in 0..3 {
            let (x, r, s) = (f64::from(x[c]), f64::from(r[c]), f64::from(s[c]));
            relative += ((x - r).powi(2) - s * s) / (r * r + floor);
        }
    }
    let rel_mse = relative / all.len() as f64;
    all.sort_by(f64::total_cmp);
    let at = ((all.len() as f64 * 0.99) as usize).min(all.len() - 1);
    Errors {
        // With `max` instead of a comparison, NaN would become a perfect score.
        nrmse: if square < noise {
            0.0
        } else {
            ((square - noise) / power).sqrt()
        },
        raw_nrmse: (square / power).sqrt(),
        bias: sum / total,
        p99: all[at] / (power / all.len() as f64).sqrt(),
        rel_mse: if rel_mse < 0.0 { 0.0 } else { rel_mse },
    }
}

/// Returns the ratio of leaked light through a wall: the root mean square error on its dark side,
/// over the root mean square of the light on its lit side. It is stricter than a ratio of means,
/// which hides single bright spots. It is infinite if the lit side is dark and the dark side has an
/// error.
///
/// # Panics
/// Panics if `dark` and `dark_reference` differ in length.
#[must_use]
pub fn leak_ratio(dark: &[Vec3], dark_reference: &[Vec3], lit_reference: &[Vec3]) -> f64 {
    assert_eq!(dark.len(), dark_reference.len());
    let mean_square = |all: &mut dyn Iterator<Item = Vec3>| {
        let (mut sum, mut count) = (0.0f64, 0usize);
        for v in all {
            sum += v.as_dvec3().length_squared();
            count += 1;
        }
        if count == 0 { 0.0 } else { sum / count as f64 }
    };
    let pairs = dark.iter().zip(dark_reference);
    let leak = mean_square(&mut pairs.map(|(x, r)| *x - *r));
    if leak == 0.0 {
        return 0.0;
    }
    (leak / mean_square(&mut lit_reference.iter().copied())).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nrmse_of_uniform_relative_error_equals_it() {
        let reference: Vec<Vec3> = (1..500)
            .map(|i| Vec3::new(i as f32, 2.0, 0.5 * i as f32))
            .collect();
        let values: Vec<Vec3> = reference.iter().map(|r| 1.04 * *r).collect();
        let none = vec![Vec3::ZERO; reference.len()];
        let e = errors(&values, &reference, &none);
        assert!(
            (e.nrmse - 0.04).abs() < 1e-5 && (e.bias - 0.04).abs() < 1e-5,
            "{e:?}"
        );
        assert_eq!(e.nrmse, e.raw_nrmse);
        // If all values are similar, relMSE is the square of the error times 1 / 1.01.
        let even = vec![Vec3::splat(3.0); 20];
        let off: Vec<Vec3> = even.iter().map(|r| 1.1 * *r).collect();
        let none_20 = vec![Vec3::ZERO; 20];
        let relative = errors(&off, &even, &none_20).rel_mse;
        assert!((relative - 0.01 / 1.01).abs() < 1e-6, "{relative}");
        assert_eq!(errors(&off, &even, &off).rel_mse, 0.0);
        // Noise of the reference does not count as an error of the values.
        let noise: Vec<Vec3> = reference.iter().map(|r| 0.04 * *r).collect();
        assert!(errors(&values, &reference, &noise).nrmse < 1e-3);
        assert_eq!(errors(&reference, &reference, &none), Errors::default());
        assert_eq!(errors(&none, &none, &none), Errors::default());
    }

    #[test]
    fn leak_is_relative_to_lit_side() {
        let lit = [Vec3::splat(4.0); 3];
        let (black, one) = ([Vec3::ZERO; 4], {
            let mut dark = [Vec3::ZERO; 4];
            dark[2] = Vec3::splat(0.4);
            dark
        });
        // One of four positions is at a tenth: √(1/4) / 10.
        assert!((leak_ratio(&one, &black, &lit) - 0.05).abs() < 1e-7);
        assert!((leak_ratio(&black, &one, &lit) - 0.05).abs() < 1e-7);
        assert_eq!(leak_ratio(&one, &one, &lit), 0.0);
        assert_eq!(leak_ratio(&black, &black, &[]), 0.0);
        assert_eq!(leak_ratio(&one, &black, &black), f64::INFINITY);
        assert!(leak_ratio(&[Vec3::NAN], &[Vec3::ZERO], &lit).is_nan());
    }

    #[test]
    fn metrics_of_nan_are_nan() {
        let mut values = vec![Vec3::ONE; 10];
        values[3].y = f32::NAN;
        let e = errors(&values, &[Vec3::ONE; 10], &[Vec3::ZERO; 10]);
        assert!(e.nrmse.is_nan() && e.bias.is_nan(), "{e:?}");
    }
}
