//! Deringing of a sky in spherical harmonics. The result is the non-negative series nearest to a
//! [`SkyRadiance`], for scenes that receive sky light through openings.
//!
//! Nine coefficients that are fitted to a sky with a bright region on one side are negative on the
//! other side. An unoccluded surface is not affected, because the cosine removes the ringing
//! \[RH01\]. A surface from which only the negative part is visible receives negative light in one
//! or more channels and gets a wrong color. \[Sl08\] multiplies each degree by a window until the
//! series is non-negative. The window also flattens correct parts. Here the series is projected to
//! the nearest non-negative series with the same mean. The distance is the mean square over all
//! directions. This is a convex problem of sixteen variables. By the S-lemma (\[BV04\] appendix
//! B.2), c + d·ω + ω·Q ω ≥ 0 on the unit sphere is equivalent to the following condition. For some
//! t this matrix is positive semidefinite:
//!
//! M(t) = ((Q + t I, d/2), (dᵀ/2, c − t))
//!
//! The solver is the alternating direction method (\[BP11\] §3.1, scaled form). Each of its steps
//! has a closed form. A negative remainder after the last step is removed by scaling the series
//! toward its mean.

use super::SkyRadiance;
use nalgebra::{Matrix4, SymmetricEigen};

/// Mean squares over the sphere: <(d·ω)²> = |d|²/3 and <(ω·Q ω)²> = 2 |Q|²/15. |Q|² is the sum of
/// all nine squares.
const LINEAR_MEAN_SQUARE: f64 = 1.0 / 3.0;
const QUADRATIC_MEAN_SQUARE: f64 = 2.0 / 15.0;
/// Penalty parameter of the method, in units of these weights.
const PENALTY: f64 = 0.3;
/// Largest number of steps. The skies of the tests take at most 230.
const STEPS: u32 = 400;
/// Largest difference between two steps at which the iteration ends. Also the threshold of zero.
/// Relative to a mean of one.
const TOLERANCE: f64 = 1e-6;
/// Limit of the terms relative to a mean of one. The terms of light from a single direction are at
/// most 7.5.
const MAX: f64 = 10.0;

/// Terms of a channel of mean one: d, and Q as xx, yy, xy, xz, yz.
type Terms = [f64; SkyRadiance::TERMS];

impl SkyRadiance {
    /// Returns the nearest sky without negative radiance and with the same mean. Each channel is
    /// projected separately (see the module). A channel without negative radiance is unchanged.
    /// Radiance in W/(m² sr).
    ///
    /// Useful in scenes that receive sky light through windows, in streets and in courts. On
    /// unoccluded surfaces it lowers accuracy by some percent. A channel with a negative mean
    /// becomes black. A sky with coefficients that are not finite is returned unchanged.
    #[must_use]
    pub fn without_ringing(&self) -> Self {
        if !self.is_finite() {
            return *self;
        }
        let mut out = *self;
        for channel in 0..3 {
            let mean = f64::from(self.mean[channel]);
            if mean <= 0.0 {
                out.mean[channel] = 0.0;
                out.terms.iter_mut().for_each(|t| t[channel] = 0.0);
                continue;
            }
            let terms = self.terms.map(|t| f64::from(t[channel]) / mean);
            if let Some(found) = nearest(&terms) {
                for (to, from) in out.terms.iter_mut().zip(found) {
                    to[channel] = (from * mean) as f32;
                }
            }
        }
        out
    }
}

/// Returns the nearest terms for which a channel of mean one is non-negative. `None` if `terms`
/// already meet this condition.
fn nearest(terms: &Terms) -> Option<Terms> {
    if best(terms) >= -TOLERANCE {
        return None;
    }
    // Terms above `MAX` are scaled down first. Terms of a thousand times the mean are unphysical.
    // The result is the same after fewer steps, and no square overflows.
    let size = terms.iter().fold(0.0f64, |a, b| a.max(b.abs()));
    let limited = terms.map(|t| t * (MAX / size).min(1.0));
    let (mut found, mut t) = (limited, 0.0);
    let (mut near, mut dual) = (semidefinite(&matrix(&found, t)), Matrix4::zeros());
    for _ in 0..STEPS {
        // Update of the series and t for a fixed semidefinite matrix. The squares of M contain d/2
        // twice. The Q part has zero trace.
        let to: Matrix4<f64> = near - dual;
        t = (to[(0, 0)] + to[(1, 1)] + to[(2, 2)] + 1.0 - to[(3, 3)]) / 4.0;
        let trace = (to[(0, 0)] + to[(1, 1)] + to[(2, 2)]) / 3.0;
        let first = |w: f64, m: f64| {
            (2.0 * LINEAR_MEAN_SQUARE * w + PENALTY * m)
                / (2.0 * LINEAR_MEAN_SQUARE + PENALTY / 2.0)
        };
        let second = |w: f64, m: f64| {
            (2.0 * QUADRATIC_MEAN_SQUARE * w + PENALTY * m)
                / (2.0 * QUADRATIC_MEAN_SQUARE + PENALTY)
        };
        found = [
            first(limited[0], to[(0, 3)]),
            first(limited[1], to[(1, 3)]),
            first(limited[2], to[(2, 3)]),
            second(limited[3], to[(0, 0)] - trace),
            second(limited[4], to[(1, 1)] - trace),
            second(limited[5], to[(0, 1)]),
            second(limited[6], to[(0, 2)]),
            second(limited[7], to[(1, 2)]),
        ];
        let here = matrix(&found, t);
        let before = near;
        near = semidefinite(&(here + dual));
        dual += here - near;
        if (here - near).amax() < TOLERANCE && (near - before).amax() < TOLERANCE {
            break;
        }
    }
    // f(ω) = (ω, 1)·M (ω, 1) ≥ 2 λ. Scaling toward the mean raises this bound.
    let below = -2.0 * best(&found).min(0.0);
    Some(found.map(|t| t / (1.0 + below)))
}

/// Returns M(t) of a channel of mean one.
fn matrix(terms: &Terms, t: f64) -> Matrix4<f64> {
    let &[x, y, z, xx, yy, xy, xz, yz] = terms;
    let (x, y, z) = (x / 2.0, y / 2.0, z / 2.0);
    #[rustfmt::skip]
    let all = Matrix4::new(
        xx + t, xy, xz, x,
        xy, yy + t, yz, y,
        xz, yz, t - xx - yy, z,
        x, y, z, 1.0 - t,
    );
    all
}

/// Returns the nearest semidefinite matrix. Negative eigenvalues are set to zero.
fn semidefinite(m: &Matrix4<f64>) -> Matrix4<f64> {
    let mut parts = SymmetricEigen::new(*m);
    parts.eigenvalues.apply(|v| *v = v.max(0.0));
    parts.recompose()
}

/// Returns the smallest eigenvalue of M(t), maximized over t. It is at least zero if and only if a
/// channel of mean one is non-negative.
fn best(terms: &Terms) -> f64 {
    let value = |t: f64| SymmetricEigen::new(matrix(terms, t)).eigenvalues.min();
    let size = 1.0 + terms.iter().map(|t| t.abs()).sum::<f64>();
    let (mut low, mut high) = (-size, size);
    // Ternary search: the function is concave.
    for _ in 0..60 {
        let (a, b) = ((2.0 * low + high) / 3.0, (low + 2.0 * high) / 3.0);
        match value(a) < value(b) {
            true => low = a,
            false => high = b,
        }
    }
    value(0.5 * (low + high))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::{Random, lattice, uniform_sphere};
    use glam::{Vec2, Vec3};

    fn ways(count: u32) -> Vec<Vec3> {
        (0..count)
            .map(|k| uniform_sphere(lattice(k, count, Vec2::splat(0.3))).normalize())
            .collect()
    }

    fn min(sky: &SkyRadiance, ways: &[Vec3]) -> Vec3 {
        let all = ways.iter().map(|w| sky.toward(*w));
        all.fold(Vec3::INFINITY, Vec3::min)
    }

    fn any(random: &mut Random, size: f32) -> SkyRadiance {
        let mut color = || Vec3::new(random.unit(), random.unit(), random.unit());
        SkyRadiance {
            mean: color() + 0.05,
            terms: std::array::from_fn(|_| size * (2.0 * color() - 1.0)),
        }
    }

    #[test]
    fn deringing_non_negative_sky_is_unchanged() {
        let mut random = Random::new(1, 2, 3);
        let ways = ways(2000);
        let mut stayed = 0;
        for _ in 0..60 {
            let mut sky = any(&mut random, 0.5);
            sky.mean += 1.0;
            if min(&sky, &ways).min_element() > 0.01 {
                assert_eq!(sky.without_ringing(), sky);
                stayed += 1;
            }
        }
        assert!(stayed > 10, "{stayed}");
        assert_eq!(SkyRadiance::BLACK.without_ringing(), SkyRadiance::BLACK);
        let mut wrong = SkyRadiance::from(Vec3::ONE);
        wrong.terms[3].y = f32::INFINITY;
        assert_eq!(wrong.without_ringing(), wrong);
    }

    #[test]
    fn deringed_sky_is_non_negative_and_keeps_mean() {
        let mut random = Random::new(4, 2, 3);
        let ways = ways(5000);
        for size in [0.3, 1.0, 3.0, 30.0, 1e6, 1e30] {
            for _ in 0..10 {
                let sky = any(&mut random, size);
                let found = sky.without_ringing();
                assert_eq!(found.mean, sky.mean);
                let min = min(&found, &ways) / sky.mean;
                assert!(min.min_element() > -1e-5, "size {size}: {min}");
                // A second call changes the series by rounding errors only.
                let again = found.without_ringing();
                for (a, b) in again.terms.iter().zip(&found.terms) {
                    assert!(((*a - *b) / sky.mean).abs().max_element() < 1e-3);
                }
            }
        }
        let mut dark = any(&mut random, 1.0);
        dark.mean.y = -1.0;
        let found = dark.without_ringing();
        assert!(found.mean.y == 0.0 && found.terms.iter().all(|t| t.y == 0.0));
    }

    /// Checks optimality: no non-negative series of this mean is nearer to the input. All such
    /// series lie on the other side of the plane through the result, normal to the difference. The
    /// test uses squares of linear forms, because all other non-negative series are sums of these.
    #[test]
    fn deringed_sky_is_nearest_non_negative() {
        let mut random = Random::new(5, 2, 3);
        let inner = |a: &[Vec3; 8], b: &[Vec3; 8]| {
            let weights = [5.0 / 15.0; 3].into_iter().chain([2.0 / 15.0; 5]);
            let mut sum: f32 = weights
                .zip(0..)
                .map(|(w, k)| w * if k > 4 { 2.0 } else { 1.0 } * a[k].x * b[k].x)
                .sum();
            // Q_zz is not stored.
            sum += 2.0 / 15.0 * (a[3].x + a[4].x) * (b[3].x + b[4].x);
            sum
        };
        let minus = |a: &[Vec3; 8], b: &[Vec3; 8]| std::array::from_fn(|k| a[k] - b[k]);
        let mut moved = 0;
        for _ in 0..20 {
            let mut sky = any(&mut random, 1.0);
            sky.mean = Vec3::ONE;
            let found = sky.without_ringing();
            let away: [Vec3; 8] = minus(&sky.terms, &found.terms);
            let far = inner(&away, &away).sqrt();
            if far < 0.01 {
                continue;
            }
            moved += 1;
            for _ in 0..2000 {
                let mut part = || 2.0 * random.unit() - 1.0;
                let (a, b) = (part(), 1.7 * Vec3::new(part(), part(), part()));
                let mean = a * a + b.length_squared() / 3.0;
                let q = |i: usize, j: usize| {
                    let diagonal = if i == j {
                        b.length_squared() / 3.0
                    } else {
                        0.0
                    };
                    b[i] * b[j] - diagonal
                };
                let d = 2.0 * a * b;
                let square = [d.x, d.y, d.z, q(0, 0), q(1, 1), q(0, 1), q(0, 2), q(1, 2)];
                let other = square.map(|t| Vec3::splat(t / mean));
                let side = inner(&away, &minus(&other, &found.terms));
                assert!(side < 2e-3 * far.max(0.1), "{side} of {far}");
            }
        }
        assert!(moved > 10, "{moved}");
    }

    /// Compares a sky with the glow of a low sun on unoccluded surfaces and through openings. The
    /// variants are the unchanged series, the window of \[Sl08\] and this projection.
    #[test]
    fn deringed_sky_through_openings_keeps_colors() {
        let ways = ways(20_000);
        let angle = 4.0 * std::f32::consts::PI / ways.len() as f32;
        let sky = |w: Vec3| {
            let up = w.y.max(0.0);
            let glow = (0.5 + 0.5 * w.x).powi(2) * (1.0 - up).powi(2);
            let share = if w.y < 0.0 { 0.25 } else { 1.0 };
            share * (Vec3::new(0.15, 0.2, 0.26) + glow * Vec3::new(5.2, 2.0, 0.6))
        };
        let fitted = SkyRadiance::of_map(ways.iter().map(|w| (*w, 1.0, sky(*w))));
        // The window 1 / (1 + λ (l (l + 1))²) of \[Sl08\], with the smallest λ per channel that
        // leaves no negative value.
        let mut windowed = fitted;
        for channel in 0..3 {
            let by = |lambda: f32| {
                let mut sky = windowed;
                for (k, term) in sky.terms.iter_mut().enumerate() {
                    let degree = if k < 3 { 4.0 } else { 36.0 };
                    term[channel] = fitted.terms[k][channel] / (1.0 + degree * lambda);
                }
                sky
            };
            let steps = (0..1000).map(|k| by(k as f32 * 2e-3));
            let mut right = steps.filter(|s| min(s, &ways)[channel] >= 0.0);
            windowed = right.next().expect("a large λ leaves the mean");
        }
        let found = fitted.without_ringing();
        let mut random = Random::new(9, 1, 1);
        let mut side = || uniform_sphere(Vec2::new(random.unit(), random.unit())).normalize();
        let openings: Vec<_> = (0..400)
            .map(|k| {
                let (mut to, n) = (side(), side());
                to.y = to.y.abs();
                (to, n, (0.2 + 1.3 * (k as f32 / 400.0)).cos())
            })
            .collect();
        let mut errors = [[0.0f32; 2]; 3];
        let mut squares = [0.0f32; 2];
        let mut negative = [0; 3];
        for (to, n, edge) in openings {
            let seen = |w: &Vec3, open: bool| open || (w.dot(to) > edge && w.y > 0.0);
            for open in [false, true] {
                let arrives = |radiance: &dyn Fn(Vec3) -> Vec3| -> Vec3 {
                    let lit = ways.iter().filter(|w| seen(w, open) && w.dot(n) > 0.0);
                    lit.map(|w| radiance(*w) * (w.dot(n) * angle)).sum()
                };
                let right = arrives(&sky);
                squares[usize::from(open)] += right.length_squared();
                for (k, s) in [&fitted, &windowed, &found].into_iter().enumerate() {
                    let shown = arrives(&|w| s.toward(w));
                    errors[k][usize::from(open)] += (shown - right).length_squared();
                    negative[k] += u32::from(shown.min_element() < -1e-4);
                }
            }
        }
        let names = ["as fitted", "by a window", "without ringing"];
        for (k, name) in names.iter().enumerate() {
            let off = |o: usize| 100.0 * (errors[k][o] / squares[o]).sqrt();
            let (through, open, less) = (off(0), off(1), negative[k]);
            println!(
                "{name}: NRMSE {through:.1} % through openings, {open:.1} % in the open, negative {less} times"
            );
        }
        assert!(negative[0] > 10 && negative[1..] == [0, 0]);
        for o in [0, 1] {
            assert!(errors[2][o] < 0.9 * errors[1][o]);
        }
    }
}
