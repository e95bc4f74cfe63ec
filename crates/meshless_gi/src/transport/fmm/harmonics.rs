//! \[G08\] Eqs. (5)-(9) as printed: the factorization of 1/|r_y − r_x|⁴ into normalized spherical
//! harmonics, and of the kernel into the matrices of receiver and source.
//!
//! The solver's expansions are the same sums in another basis of the same polynomials
//! ([`super::tensor`]). This file is the reference of their tests, degree by degree. Deviation: the
//! printed coefficient of Eq. (5) lacks a π. With ½! = √π/2 the product (n−j+1)! (j+½)! / ((n−j+½)!
//! j!) is rational, and e_n^j = 4π (n−j+1)! (j+½)! / ((n−j+½)! j!).

/// Vector at the receiver: the matrices of \[G08\] Eqs. (6)-(8) contracted with the normal of the
/// source.
type Vector = [f64; 3];

/// Returns e_n^j of \[G08\] Eq. (5).
#[must_use]
pub fn coefficient(n: usize, j: usize) -> f64 {
    // (j + ½)! / (n − j + ½)! is a product over the half-integers between the two.
    let ratio: f64 = (j + 1..=n - j).map(|k| 1.0 / (k as f64 + 0.5)).product();
    let rising: f64 = (j + 1..=n - j + 1).map(|k| k as f64).product();
    4.0 * core::f64::consts::PI * rising * ratio
}

/// Returns the normalized spherical harmonics Y_l^m of a unit direction in real form, m = −l … l
/// for each l up to `max`. Y_l^m has index l² + l + m.
///
/// The sum over m of products of real harmonics equals that of \[G08\]'s complex ones with their
/// conjugates.
#[must_use]
pub fn harmonics(max: usize, d: Vector) -> Vec<f64> {
    let [x, y, z] = d;
    let mut out = vec![0.0; (max + 1) * (max + 1)];
    // cos mφ sin^m θ and sin mφ sin^m θ by repeated rotation. The associated Legendre functions
    // have no factor sin^m θ.
    let (mut c, mut s) = (1.0f64, 0.0f64);
    let mut diagonal = (0.25 / core::f64::consts::PI).sqrt();
    for m in 0..=max {
        let (mut older, mut p) = (0.0, diagonal);
        for l in m..=max {
            let at = l * l + l;
            match m {
                0 => out[at] = p,
                _ => {
                    out[at + m] = core::f64::consts::SQRT_2 * p * c;
                    out[at - m] = core::f64::consts::SQRT_2 * p * s;
                }
            }
            let (lf, mf) = ((l + 1) as f64, m as f64);
            let a = ((4.0 * lf * lf - 1.0) / (lf * lf - mf * mf)).sqrt();
            let b = (((lf - 1.0).powi(2) - mf * mf) / (4.0 * (lf - 1.0).powi(2) - 1.0)).max(0.0);
            let next = a * (z * p - b.sqrt() * older);
            (older, p) = (p, next);
        }
        (c, s) = (c * x - s * y, c * y + s * x);
        diagonal *= ((2 * m + 3) as f64 / (2 * m + 2) as f64).sqrt();
    }
    out
}

/// Returns the terms of \[G08\] Eq. (5) with r_y^n, n = 0 … `order`. Their sum converges to 1/|x −
/// y|⁴ if |y| < |x|. Meters⁻⁴.
#[must_use]
pub fn inverse_fourth(order: usize, x: Vector, y: Vector) -> Vec<f64> {
    let (rx, ry) = (length(x), length(y));
    let unit = |v: Vector, r: f64| v.map(|c| if r > 0.0 { c / r } else { 0.0 });
    let outer = harmonics(order, unit(x, rx));
    let inner = harmonics(order, unit(y, ry));
    (0..=order)
        .map(|n| {
            let radial = ry.powi(n as i32) / rx.powi(n as i32 + 4);
            let angular = |j: usize| -> f64 {
                let l = n - 2 * j;
                (l * l..(l + 1) * (l + 1))
                    .map(|i| outer[i] * inner[i])
                    .sum()
            };
            let sum: f64 = (0..=n / 2).map(|j| coefficient(n, j) * angular(j)).sum();
            sum * radial
        })
        .collect()
}

/// Returns the irradiance at `x` from the source at `y` with normal `ny`, weight 1 and radiosity π,
/// by degree in y: \[G08\] Eqs. (6)-(9). The sum converges to the vector [n_y·(x − y)] (y − x) / |x
/// − y|⁴. Its product with n_x is the kernel of Eq. (4) times π.
///
/// The product of brackets is R M(x) ⊗ S M(y): with u = n_y·x and v = n_y·y it is −u x + (v x + u
/// y) − v y, of degrees 0, 1 and 2 in y.
#[must_use]
pub fn vector_by_degree(order: usize, x: Vector, y: Vector, ny: Vector) -> Vec<Vector> {
    let scalar = inverse_fourth(order, x, y);
    let dot = |a: Vector, b: Vector| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let (u, v) = (dot(ny, x), dot(ny, y));
    let at = |n: usize, back: usize| n.checked_sub(back).map_or(0.0, |k| scalar[k]);
    (0..=order)
        .map(|n| {
            std::array::from_fn(|i| {
                -u * x[i] * at(n, 0) + (v * x[i] + u * y[i]) * at(n, 1) - v * y[i] * at(n, 2)
            })
        })
        .collect()
}

fn length(v: Vector) -> f64 {
    (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Random;

    fn direction(random: &mut Random) -> Vector {
        let v = std::array::from_fn(|_| f64::from(random.unit()) - 0.5);
        v.map(|c| c / length(v))
    }

    #[test]
    fn spherical_harmonics_are_orthonormal() {
        // A product quadrature that is exact for these degrees: Gauss-Legendre nodes by Newton's
        // method. The midpoint quadrature with 24 heights would not be exact.
        let (max, heights) = (8usize, 12usize);
        let mut sums = vec![0.0; (max + 1).pow(4)];
        let n = (max + 1).pow(2);
        for k in 0..heights {
            let mut z = (core::f64::consts::PI * (k as f64 + 0.75) / (heights as f64 + 0.5)).cos();
            let mut slope = 1.0;
            for _ in 0..50 {
                let (mut p0, mut p1) = (1.0, z);
                for l in 2..=heights {
                    let l = l as f64;
                    (p0, p1) = (p1, ((2.0 * l - 1.0) * z * p1 - (l - 1.0) * p0) / l);
                }
                slope = heights as f64 * (z * p1 - p0) / (z * z - 1.0);
                z -= p1 / slope;
            }
            let weight = 2.0 / ((1.0 - z * z) * slope * slope);
            for t in 0..20 {
                let phi = core::f64::consts::TAU * t as f64 / 20.0;
                let s = (1.0 - z * z).sqrt();
                let y = harmonics(max, [s * phi.cos(), s * phi.sin(), z]);
                for a in 0..n {
                    for b in 0..n {
                        sums[a * n + b] += weight * core::f64::consts::TAU / 20.0 * y[a] * y[b];
                    }
                }
            }
        }
        for a in 0..n {
            for b in 0..n {
                let right = if a == b { 1.0 } else { 0.0 };
                assert!((sums[a * n + b] - right).abs() < 1e-12, "{a} {b}");
            }
        }
    }

    #[test]
    fn harmonic_sum_converges_to_inverse_fourth_power() {
        // At r_y / r_x = 0.4, with the median over directions: n ≤ 2, n ≤ 8, n ≤ 16. Without the π
        // of the coefficient the sum converges to a third of the value.
        let mut random = Random::new(1, 2, 3);
        let mut found = [const { Vec::new() }; 3];
        for _ in 0..301 {
            let (x, y) = (
                direction(&mut random),
                direction(&mut random).map(|c| 0.4 * c),
            );
            let exact = 1.0 / length(std::array::from_fn(|i| x[i] - y[i])).powi(4);
            let terms = inverse_fourth(16, x, y);
            for (k, last) in [2, 8, 16].into_iter().enumerate() {
                let sum: f64 = terms[..=last].iter().sum();
                found[k].push((sum / exact - 1.0).abs());
            }
        }
        let medians = found.map(|mut errors: Vec<f64>| {
            errors.sort_by(f64::total_cmp);
            errors[150]
        });
        eprintln!("relative errors (medians), n ≤ 2, 8, 16: {medians:?}");
        assert!((0.05..0.2).contains(&medians[0]), "{medians:?}");
        assert!(medians[1] < 3e-3 && medians[2] < 5e-6, "{medians:?}");
    }
}
