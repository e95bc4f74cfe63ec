//! Two-sided test whether two estimates agree. It uses the noise of both, for irradiances at many
//! positions.
//!
//! Differences are divided by their standard error, z = (a − b) / √(σ_a² + σ_b²). Each color
//! channel has three tests. The largest |z| finds a single position that is too far off (Šidák's
//! correction for independent positions). Σz² against χ² tests all positions together. Σz / √k
//! against the normal distribution finds a small bias that single positions do not show. Channels
//! share their paths and are not independent. So the smallest of the nine probabilities is
//! multiplied by nine (Bonferroni's correction, which holds for any dependence).
//!
//! The estimate at a position that few paths light is skewed, and its standard error is unreliable.
//! The standard error is zero if no path found the light. Such positions are summed in order until
//! both sums have a relative error of at most 0.1, which takes some hundred paths. A sum counts as
//! one position.

use glam::Vec3;

/// Relative standard error above which positions are summed.
const MAX_RELATIVE_ERROR: f64 = 0.1;

/// Values with their standard errors, of equal length.
#[derive(Clone, Copy, Debug)]
pub struct Estimates<'a> {
    /// One value per position.
    pub values: &'a [Vec3],
    /// Standard errors, at least 0. 0 for exact values.
    pub errors: &'a [Vec3],
}

/// Result of [`test_equality`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TestStatistics {
    /// Probability of such or larger differences if both estimate the same. 0 if a value is not
    /// finite.
    pub p: f64,
    /// Number of compared positions and sums of positions, per channel.
    pub count: [usize; 3],
    /// Mean of z per channel.
    pub mean_z: [f64; 3],
    /// Mean of z² per channel. It is one if the standard errors are right.
    pub mean_square_z: [f64; 3],
    /// Largest |z|.
    pub largest: f64,
    /// Position of the largest |z|, or the last position of its sum.
    pub at: usize,
}

/// Compares two estimates. `tolerance` is a relative difference that is tolerated in addition to
/// noise, such as rounding or ray offsets above the surface. Each difference is first reduced by
/// this fraction of the larger value.
///
/// # Panics
/// Panics if lists differ in length.
#[must_use]
pub fn test_equality(a: Estimates<'_>, b: Estimates<'_>, tolerance: f64) -> TestStatistics {
    assert!(
        [a.errors.len(), b.values.len(), b.errors.len()] == [a.values.len(); 3],
        "lists of one length"
    );
    let mut out = TestStatistics {
        p: 1.0,
        count: [0; 3],
        mean_z: [0.0; 3],
        mean_square_z: [0.0; 3],
        largest: 0.0,
        at: 0,
    };
    if a.values.is_empty() {
        return out;
    }
    let mut min: f64 = 1.0;
    for c in 0..3 {
        let pairs = pairs(&a, &b, c);
        let count = pairs.len() as f64;
        let (mut sum, mut square, mut largest) = (0.0, 0.0, 0.0f64);
        for pair in &pairs {
            let z = pair.z_score(tolerance);
            sum += z;
            square += z * z;
            largest = largest.max(z.abs());
            if z.abs() > out.largest {
                (out.largest, out.at) = (z.abs(), pair.at);
            }
        }
        out.count[c] = pairs.len();
        out.mean_z[c] = sum / count;
        out.mean_square_z[c] = square / count;
        if !square.is_finite() {
            min = 0.0;
            continue;
        }
        // 1 − (1 − p)^k without loss of precision for small p.
        let any = -f64::exp_m1(count * f64::ln_1p(-two_sided(largest).min(1.0 - f64::EPSILON)));
        min = min
            .min(any)
            .min(chi_square_tail(square, count))
            .min(two_sided(sum / count.sqrt()));
    }
    out.p = (9.0 * min).min(1.0);
    out
}

/// Two values with their variances, of one position or of a sum of positions.
#[derive(Clone, Copy, Default)]
struct Pair {
    values: [f64; 2],
    variances: [f64; 2],
    at: usize,
}

impl Pair {
    fn plus(self, other: Self) -> Self {
        Self {
            values: [0, 1].map(|k| self.values[k] + other.values[k]),
            variances: [0, 1].map(|k| self.variances[k] + other.variances[k]),
            at: other.at,
        }
    }

    fn size(&self) -> f64 {
        self.values[0].abs().max(self.values[1].abs())
    }

    /// Returns `true` if both values have a standard error of at most 0.1 of the larger one. Also
    /// returns `true` if both are exact, and for NaN, which is not summed.
    fn is_precise(&self) -> bool {
        let max = MAX_RELATIVE_ERROR * self.size();
        let exact = self.variances == [0.0; 2];
        exact || !self.variances.iter().any(|v| v.sqrt() > max) && !self.is_without_light()
    }

    /// Returns `true` if one estimate is positive and the other is zero without variance.
    fn is_without_light(&self) -> bool {
        (0..2).any(|k| self.values[k] == 0.0 && self.variances[k] == 0.0) && self.size() > 0.0
    }

    /// Returns z. 0 if the values are equal within the tolerance. Infinite if they differ without
    /// noise or are invalid.
    fn z_score(&self, tolerance: f64) -> f64 {
        let off = self.values[0] - self.values[1];
        let beyond = off.abs() - tolerance * self.size();
        let sigma = (self.variances[0] + self.variances[1]).sqrt();
        if !beyond.is_finite() || !sigma.is_finite() {
            f64::INFINITY
        } else if beyond <= 0.0 {
            0.0
        } else {
            beyond.copysign(off) / sigma
        }
    }
}

/// Returns the values to compare in channel `c`: positions, and sums of noisy positions.
fn pairs(a: &Estimates<'_>, b: &Estimates<'_>, c: usize) -> Vec<Pair> {
    let mut out = Vec::new();
    let (mut open, mut summed): (Option<Pair>, Option<usize>) = (None, None);
    for at in 0..a.values.len() {
        let pair = Pair {
            values: [a, b].map(|e| f64::from(e.values[at][c])),
            variances: [a, b].map(|e| f64::from(e.errors[at][c]).powi(2)),
            at,
        };
        if pair.is_precise() {
            out.push(pair);
            continue;
        }
        let sum = open.map_or(pair, |sum| sum.plus(pair));
        if sum.is_precise() {
            summed = Some(out.len());
            out.push(sum);
            open = None;
        } else {
            open = Some(sum);
        }
    }
    // The remainder joins the last sum if there is one.
    match (open, summed) {
        (Some(rest), Some(last)) => out[last] = out[last].plus(rest),
        (Some(rest), None) => out.push(rest),
        (None, _) => {}
    }
    out
}

/// Returns the probability of a normal deviate beyond ±z.
fn two_sided(z: f64) -> f64 {
    libm::erfc(z.abs() * core::f64::consts::FRAC_1_SQRT_2)
}

/// Returns the probability of χ² above `x` with `k` degrees of freedom, by the cube root that makes
/// it approximately normal (\[WH31\]).
fn chi_square_tail(x: f64, k: f64) -> f64 {
    let v = 2.0 / (9.0 * k);
    let z = ((x / k).cbrt() - (1.0 - v)) / v.sqrt();
    0.5 * libm::erfc(z * core::f64::consts::FRAC_1_SQRT_2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use meshless_gi::internals::samples::Random;

    #[test]
    fn probabilities_match_tables() {
        for (z, p) in [(1.959_964, 0.05), (3.290_527, 0.001), (0.0, 1.0)] {
            assert!((two_sided(z) - p).abs() < 1e-6 * (1.0 + p), "{z}");
        }
        for (x, k, p) in [
            (18.307, 10.0, 0.05),
            (79.082, 60.0, 0.05),
            (149.449, 100.0, 0.001),
            (1074.679, 1000.0, 0.05),
        ] {
            assert!((chi_square_tail(x, k) / p - 1.0).abs() < 0.02, "{x} {k}");
        }
    }

    /// Returns deviates of variance one: a sum of twelve uniform numbers.
    fn noise(random: &mut Random) -> f32 {
        (0..12).map(|_| random.unit()).sum::<f32>() - 6.0
    }

    /// Returns the test result for two noisy estimates of the same values at 200 positions. The
    /// second is off by `change` standard errors of a position. All channels are equal, as for gray
    /// light.
    fn p(run: u64, change: impl Fn(usize) -> f32) -> f64 {
        let mut random = Random::new(1, run, 2);
        let (mut a, mut b, mut s) = (Vec::new(), Vec::new(), Vec::new());
        for i in 0..200 {
            let sigma = 0.01 * (1 + i % 7) as f32;
            a.push(Vec3::splat(2.0 + sigma * noise(&mut random)));
            b.push(Vec3::splat(2.0 + sigma * (noise(&mut random) + change(i))));
            s.push(Vec3::splat(sigma));
        }
        let estimates = |values| Estimates { values, errors: &s };
        test_equality(estimates(&a), estimates(&b), 0.0).p
    }

    #[test]
    fn equality_test_accepts_noise_and_rejects_errors() {
        let runs = 400;
        let failed = |level: f64, change: &dyn Fn(usize) -> f32| {
            (0..runs).filter(|&run| p(run, change) < level).count()
        };
        // The smallest of nine probabilities, three of them independent, is multiplied by nine. The
        // failure rate is at most the significance level and not zero.
        let by_chance = failed(0.15, &|_| 0.0);
        assert!((1..=60).contains(&by_chance), "{by_chance} of {runs}");
        assert_eq!(failed(1e-4, &|_| 0.0), 0);
        // A bias of 0.7 standard errors everywhere. Noise 1.5 times as large as stated. One
        // position that is off by 12 standard errors.
        let biased = failed(1e-3, &|_| 0.7);
        let noisier = failed(1e-3, &|i| if i % 2 == 0 { 1.5 } else { -1.5 });
        let single = failed(1e-3, &|i| if i == 77 { 12.0 } else { 0.0 });
        assert_eq!(
            [biased, noisier, single].map(|n| n > 390),
            [true; 3],
            "{biased} {noisier} {single}"
        );
    }

    /// Positions at which three of a thousand paths find light. Often none finds it.
    #[test]
    fn equality_test_pools_rarely_lit_samples() {
        let found = |run: u64, brightness: f32| {
            let few = |stream: u64| -> (Vec<Vec3>, Vec<Vec3>) {
                (0..300)
                    .map(|i| {
                        let mut random = Random::new(stream, run, i);
                        let hits = (0..1000).filter(|_| random.unit() < 0.003).count() as f32;
                        (Vec3::splat(hits), Vec3::splat(hits.sqrt()))
                    })
                    .unzip()
            };
            let (a, b) = (few(1), few(2));
            let brighter: Vec<Vec3> = b.0.iter().map(|v| brightness * *v).collect();
            let ours = Estimates {
                values: &a.0,
                errors: &a.1,
            };
            let theirs = Estimates {
                values: &brighter,
                errors: &b.1,
            };
            test_equality(ours, theirs, 0.0)
        };
        let failed = |brightness| (0..60).filter(|&r| found(r, brightness).p < 1e-3).count();
        assert!((4..20).contains(&found(0, 1.0).count[0]));
        assert_eq!([failed(1.0), failed(1.5)], [0, 60]);
    }

    #[test]
    fn exact_values_must_match_within_known_error() {
        let none = [Vec3::ZERO; 2];
        let exact = |values| Estimates {
            values,
            errors: &none,
        };
        let (a, b) = ([Vec3::ONE; 2], [Vec3::ONE, Vec3::new(1.0, 1.0, 1.001)]);
        assert_eq!(test_equality(exact(&a), exact(&a), 0.0).p, 1.0);
        let off = test_equality(exact(&a), exact(&b), 0.0);
        assert!(off.p == 0.0 && off.at == 1 && off.largest == f64::INFINITY);
        assert_eq!(test_equality(exact(&a), exact(&b), 0.002).p, 1.0);
        let odd = [Vec3::ONE, Vec3::new(1.0, f32::NAN, 1.0)];
        assert_eq!(test_equality(exact(&a), exact(&odd), 0.1).p, 0.0);
        // The dark estimate has zero standard error, and the other one has light.
        let dark = Estimates {
            values: &none,
            errors: &none,
        };
        let dim = Estimates {
            values: &[Vec3::ONE; 2],
            errors: &[Vec3::splat(0.6); 2],
        };
        let found = test_equality(dark, dim, 0.0);
        assert!(found.count == [1; 3] && found.p > 0.01, "{found:?}");
        let nothing = Estimates {
            values: &[],
            errors: &[],
        };
        assert_eq!(test_equality(nothing, nothing, 0.0).p, 1.0);
    }
}
