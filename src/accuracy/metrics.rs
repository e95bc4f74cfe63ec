//! Errors of irradiances against a reference that has noise of its own.

use glam::Vec3;

/// How far values are from a reference, over all places and colour channels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Errors {
    /// ‖x − ref‖₂ / ‖ref‖₂, the reference's own variance subtracted; 0 where the reference is.
    pub nrmse: f64,
    /// The same without the subtraction.
    pub raw_nrmse: f64,
    /// (Σx − Σref) / Σref.
    pub bias: f64,
    /// 99th percentile of |x − ref| over the root mean square of the reference.
    pub p99: f64,
}

/// Compares `values` with `reference` and its `standard_errors` (zero where it has none), all of equal length.
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
    all.sort_by(f64::total_cmp);
    let at = ((all.len() as f64 * 0.99) as usize).min(all.len() - 1);
    Errors {
        // A comparison, not `max`: that would turn NaN into a perfect score.
        nrmse: if square < noise {
            0.0
        } else {
            ((square - noise) / power).sqrt()
        },
        raw_nrmse: (square / power).sqrt(),
        bias: sum / total,
        p99: all[at] / (power / all.len() as f64).sqrt(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_per_cent_everywhere_reads_four_per_cent() {
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
        // Noise of the reference is not the value's fault.
        let noise: Vec<Vec3> = reference.iter().map(|r| 0.04 * *r).collect();
        assert!(errors(&values, &reference, &noise).nrmse < 1e-3);
        assert_eq!(errors(&reference, &reference, &none), Errors::default());
        assert_eq!(errors(&none, &none, &none), Errors::default());
    }

    #[test]
    fn a_value_that_is_not_a_number_is_no_perfect_score() {
        let mut values = vec![Vec3::ONE; 10];
        values[3].y = f32::NAN;
        let e = errors(&values, &[Vec3::ONE; 10], &[Vec3::ZERO; 10]);
        assert!(e.nrmse.is_nan() && e.bias.is_nan(), "{e:?}");
    }
}
