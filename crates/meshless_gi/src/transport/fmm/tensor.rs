//! Derivatives of the kernel's tensor K_ij(r) = r_i r_j / |r|⁴, r = x − y. The kernel of \[G08\]
//! Eq. (4) is −n_x·K n_y / π, so source normals and receiver normals are both outside of K.
//!
//! **Reason against the harmonics.** Expansions about two centers need translation theorems for
//! {r^n Y_{n−2j}^m} with their S M and R M matrices. These need 16 numbers per source and term
//! (n_y, n_y·y, n_y ⊗ y, y (n_y·y)), and coupling coefficients between degrees. Cartesian monomials
//! span the same polynomials degree by degree. There a translation is a binomial, a source is the
//! vector q n_y, and a receiver gets a vector. The truncation by total degree |α| + |β| ≤ p keeps
//! C(p + 6, 6) products per pair. A test below shows degree by degree that the result is the sum of
//! \[G08\] Eqs. (5)-(9).
//!
//! The Taylor coefficients t_γ of |r|⁻⁴ follow from the recurrence of \[DK01\] for |r|^−ν with ν =
//! 4, on the unit sphere: |γ| t_γ + (2|γ| + 2) Σ_i r_i t_{γ−e_i} + (|γ| + 2) Σ_i t_{γ−2e_i} = 0.
//! Those of K are t times the polynomial (r_i + h_i)(r_j + h_j).

use super::real::Real;
use super::terms::{Terms, term_index};

/// The six different entries of K: xx, xy, xz, yy, yz, zz.
pub type SymmetricMatrix<T> = [T; 6];

/// Indices of the two components of each of the six products.
pub const PAIRS: [[usize; 2]; 6] = [[0, 0], [0, 1], [0, 2], [1, 1], [1, 2], [2, 2]];

/// Steps of [`Derivatives::at`], prepared once per order: the indices of γ − e_i and γ − 2e_i.
#[derive(Clone, Debug)]
pub struct Derivatives {
    /// For each γ: indices of γ − e_i, of γ − 2e_i, and of γ − e_i − e_j for i < j. [`NONE`] for a
    /// missing term.
    down: Vec<[u16; 9]>,
    /// For each γ: the recurrence's two factors, and γ!.
    factors: Vec<[f64; 3]>,
}

/// Index of a missing term.
pub const NONE: u16 = u16::MAX;

impl Derivatives {
    /// Creates the steps for all γ of `terms`.
    #[must_use]
    pub fn new(terms: &Terms) -> Self {
        let below = |e: [usize; 3], less: [usize; 3]| -> u16 {
            match (0..3).all(|i| e[i] >= less[i]) {
                true => term_index(std::array::from_fn(|i| e[i] - less[i])) as u16,
                false => NONE,
            }
        };
        let steps = [
            [1, 0, 0],
            [0, 1, 0],
            [0, 0, 1],
            [2, 0, 0],
            [0, 2, 0],
            [0, 0, 2],
            [1, 1, 0],
            [1, 0, 1],
            [0, 1, 1],
        ];
        Self {
            down: terms
                .exponents()
                .iter()
                .map(|&e| steps.map(|s| below(e, s)))
                .collect(),
            factors: (terms.factorials().iter().enumerate())
                .map(|(i, &factorial)| {
                    let n = terms.degree(i) as f64;
                    [-(2.0 * n + 2.0) / n, -(n + 2.0) / n, factorial]
                })
                .collect(),
        }
    }

    /// Returns the indices of the nine lower terms of each γ: −x, −y, −z, −2x, −2y, −2z, −x−y,
    /// −x−z, −y−z.
    #[must_use]
    pub fn down(&self) -> &[[u16; 9]] {
        &self.down
    }

    /// Computes ∂^γ K(r) at the unit vector `r` for all γ. `scalar` is a buffer for the derivatives
    /// of |r|⁻⁴.
    #[inline(always)]
    pub fn at<T: Real>(&self, r: [T; 3], scalar: &mut Vec<T>, out: &mut Vec<SymmetricMatrix<T>>) {
        // One more entry, which is zero, for missing terms.
        let none = self.down.len();
        scalar.clear();
        scalar.resize(none + 1, T::default());
        out.clear();
        out.resize(none, [T::default(); 6]);
        let square = PAIRS.map(|[i, j]| r[i] * r[j]);
        scalar[0] = T::from_f64(1.0);
        out[0] = square;
        for (k, (down, factors)) in self.down.iter().zip(&self.factors).enumerate().skip(1) {
            let below = |i: usize| scalar[usize::from(down[i]).min(none)];
            let (x, y, z) = (below(0), below(1), below(2));
            let (xx, yy, zz) = (below(3), below(4), below(5));
            let (xy, xz, yz) = (below(6), below(7), below(8));
            let [one, two, f] = factors.map(T::from_f64);
            let t = one * (r[0] * x + r[1] * y + r[2] * z) + two * (xx + yy + zz);
            scalar[k] = t;
            out[k] = [
                f * (square[0] * t + (r[0] * x + r[0] * x) + xx),
                f * (square[1] * t + (r[0] * y + r[1] * x) + xy),
                f * (square[2] * t + (r[0] * z + r[2] * x) + xz),
                f * (square[3] * t + (r[1] * y + r[1] * y) + yy),
                f * (square[4] * t + (r[1] * z + r[2] * y) + yz),
                f * (square[5] * t + (r[2] * z + r[2] * z) + zz),
            ];
        }
        scalar.truncate(none);
    }
}

#[cfg(test)]
mod tests {
    use super::super::harmonics::{inverse_fourth, vector_by_degree};
    use super::*;
    use crate::samples::Random;

    fn unit(random: &mut Random) -> [f64; 3] {
        let v: [f64; 3] = std::array::from_fn(|_| f64::from(random.unit()) - 0.5);
        let l = v.iter().map(|c| c * c).sum::<f64>().sqrt();
        v.map(|c| c / l)
    }

    fn monomial(y: [f64; 3], e: [usize; 3]) -> f64 {
        (0..3).map(|i| (-y[i]).powi(e[i] as i32)).product()
    }

    /// Σ_{|γ| = n} (−y)^γ/γ! ∂^γ of |x|⁻⁴ is the n-th term of Eq. (5), and that of −K(x) n_y is the
    /// n-th term of Eqs. (6)-(9). Tested for every n up to 16.
    #[test]
    fn tensor_degrees_match_series_terms() {
        let terms = Terms::new(16);
        let derivatives = Derivatives::new(&terms);
        let mut random = Random::new(4, 5, 6);
        let (mut scalar, mut tensor) = (Vec::new(), Vec::new());
        for _ in 0..20 {
            let (x, n) = (unit(&mut random), unit(&mut random));
            let y = unit(&mut random).map(|c| 0.7 * c);
            derivatives.at(x, &mut scalar, &mut tensor);
            let expected = inverse_fourth(16, x, y);
            let vectors = vector_by_degree(16, x, y, n);
            for degree in 0..=16 {
                let (mut sum, mut vector) = (0.0, [0.0; 3]);
                for k in (0..terms.len()).filter(|&k| terms.degree(k) == degree) {
                    let m = monomial(y, terms.exponents()[k]);
                    sum += m * scalar[k];
                    for (p, [i, j]) in PAIRS.into_iter().enumerate() {
                        let value = m / terms.factorials()[k] * tensor[k][p];
                        vector[i] -= value * n[j];
                        if i != j {
                            vector[j] -= value * n[i];
                        }
                    }
                }
                let scale = 0.7f64.powi(degree as i32) * (degree as f64 + 1.0).powi(3);
                assert!(
                    (sum - expected[degree]).abs() < 1e-11 * scale,
                    "degree {degree}: {sum} {}",
                    expected[degree]
                );
                for i in 0..3 {
                    let error = (vector[i] - vectors[degree][i]).abs();
                    assert!(error < 1e-10 * scale, "degree {degree}: {error:e}");
                }
            }
        }
    }
}
