//! Principal components of a set of rows: the orthonormal vectors with the best approximation of
//! the rows ([P14] §3.3, Eq. (7) to (9)). Used for light bases and for depths.
//!
//! \[P14\] Eq. (7) decomposes A − M = U Σ Vᵀ, with the mean row M. This module decomposes A itself,
//! and the caller subtracts the mean if needed. The mean must not be subtracted for a light basis.
//! The right singular vectors are the eigenvectors of AᵀA, or follow from those of AAᵀ. The smaller
//! of the two matrices is used. If both are large, random combinations of the rows replace A. Their
//! number is slightly above the number of requested vectors. They span nearly all of the first
//! components. Two power iterations improve slowly decreasing singular values ([HMT11] Algorithms
//! 4.4 and 5.1).
//!
//! A bake gives the same result on every machine (design D5). Products are sums in fixed order and
//! in double precision. The small eigenproblem uses nalgebra, with `libm` for functions that
//! machines round differently. The random numbers are counter-based.

use crate::samples::Random;
use nalgebra::{DMatrix, SymmetricEigen};

/// Maximum of the smaller side of matrices that are decomposed directly.
const MAX_DIRECT_SIZE: usize = 128;
/// Number of combinations of rows beyond the requested components ([HMT11] §4.2: five or ten).
const OVERSAMPLING: usize = 10;
/// Number of power iterations ([HMT11] §4.5).
const POWERS: usize = 2;
/// Relative size below which singular values are rounding errors.
const ROUNDING: f64 = 1e-6;
/// Maximum number of steps per row of the eigenproblem. It needs two or three.
const STEPS: usize = 64;

/// Principal components, in descending order of singular values.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Components {
    /// Length of a component and of a row.
    pub length: usize,
    /// Orthonormal components, one after the other. The entry of largest magnitude of each is
    /// positive.
    pub vectors: Vec<f32>,
    /// Singular values, descending, in the unit of the rows.
    pub values: Vec<f32>,
}

impl Components {
    /// Returns the number of components.
    #[must_use]
    pub fn count(&self) -> usize {
        self.values.len()
    }

    /// Returns component `j`.
    #[must_use]
    pub fn vector(&self, j: usize) -> &[f32] {
        &self.vectors[j * self.length..(j + 1) * self.length]
    }
}

/// Computes the first principal components, at most `max`, of `rows`. These are numbers of any
/// unit, `length` per row. The result has fewer components if the rows span less, and none for rows
/// of zeros. Numbers that are not finite count as zero.
#[must_use]
pub fn decompose(rows: &[f32], length: usize, max: usize, seed: u64) -> Components {
    let empty = Components {
        length,
        ..Components::default()
    };
    if length == 0 || max == 0 {
        return empty;
    }
    let whole: Vec<f32>;
    let rows = match rows.iter().all(|v| v.is_finite()) {
        true => rows,
        false => {
            whole = (rows.iter())
                .map(|v| if v.is_finite() { *v } else { 0.0 })
                .collect();
            &whole
        }
    };
    let a = Rows { rows, length };
    let smaller = a.count().min(length);
    let r = max + OVERSAMPLING;
    let found = if length <= MAX_DIRECT_SIZE || (length <= a.count() && 2 * r >= length) {
        // AᵀA = V Σ² Vᵀ.
        let mut gram = vec![0.0; length * length];
        for row in a.iter() {
            for (&v, out) in row.iter().zip(gram.chunks_exact_mut(length)) {
                if v != 0.0 {
                    add(out, row, f64::from(v));
                }
            }
        }
        eigen(&gram, length)
    } else {
        // B is A or has fewer rows, with BᵀB = AᵀA exactly or nearly. The eigenvectors W of
        // BBᵀ = W Σ² Wᵀ give V = BᵀW / Σ.
        let b = match smaller <= MAX_DIRECT_SIZE || 2 * r >= smaller {
            true => a.rows.iter().map(|&v| f64::from(v)).collect(),
            false => a.range(r, seed),
        };
        let gram = gram(&b, length);
        let mut found = eigen(&gram, b.len() / length);
        for (value, vector) in &mut found {
            let mut v = vec![0.0; length];
            for (b, &w) in b.chunks_exact(length).zip(&*vector) {
                for (v, b) in v.iter_mut().zip(b) {
                    *v += w * b / *value;
                }
            }
            *vector = v;
        }
        found
    };
    let mut out = empty;
    let mut vectors: Vec<Vec<f64>> = Vec::new();
    for (value, mut vector) in found.into_iter().take(max) {
        if !orthonormalize_to(&vectors, &mut vector) {
            continue;
        }
        let largest = vector
            .iter()
            .fold(0.0f64, |max, v| match v.abs() > max.abs() {
                true => *v,
                false => max,
            });
        let sign = 1f64.copysign(largest);
        out.vectors.extend(vector.iter().map(|v| (sign * v) as f32));
        out.values.push(value as f32);
        vectors.push(vector);
    }
    out
}

/// Matrix, row after row.
#[derive(Clone, Copy)]
struct Rows<'a> {
    rows: &'a [f32],
    length: usize,
}

impl<'a> Rows<'a> {
    fn count(self) -> usize {
        self.rows.len() / self.length
    }

    fn iter(self) -> impl Iterator<Item = &'a [f32]> {
        self.rows.chunks_exact(self.length)
    }

    /// Computes `r` rows QᵀA, with an orthonormal basis Q of nearly all of the range of A.
    fn range(self, r: usize, seed: u64) -> Vec<f64> {
        let mut random = Random::new(seed, 0x70_63_61, 0);
        let mut x: Vec<f64> = (0..self.length * r)
            .map(|_| f64::from(2.0 * random.unit() - 1.0))
            .collect();
        for power in 0..=POWERS {
            if power > 0 {
                orthonormalize(&mut x, r);
            }
            // Y = A X, then X = Aᵀ Q.
            let mut y = vec![0.0; self.count() * r];
            for (row, y) in self.iter().zip(y.chunks_exact_mut(r)) {
                for (&v, x) in row.iter().zip(x.chunks_exact(r)) {
                    let v = f64::from(v);
                    y.iter_mut().zip(x).for_each(|(y, x)| *y += v * x);
                }
            }
            orthonormalize(&mut y, r);
            x.fill(0.0);
            for (row, y) in self.iter().zip(y.chunks_exact(r)) {
                for (&v, x) in row.iter().zip(x.chunks_exact_mut(r)) {
                    let v = f64::from(v);
                    x.iter_mut().zip(y).for_each(|(x, y)| *x += v * y);
                }
            }
        }
        // X = AᵀQ. Its columns are the rows of QᵀA.
        (0..r)
            .flat_map(|j| x.iter().skip(j).step_by(r).copied())
            .collect()
    }
}

fn add(out: &mut [f64], row: &[f32], factor: f64) {
    for (out, v) in out.iter_mut().zip(row) {
        *out += factor * f64::from(*v);
    }
}

/// Computes B Bᵀ of the rows `b`.
fn gram(b: &[f64], length: usize) -> Vec<f64> {
    let n = b.len() / length;
    let mut gram = vec![0.0; n * n];
    for (i, x) in b.chunks_exact(length).enumerate() {
        for (j, y) in b.chunks_exact(length).enumerate().take(i + 1) {
            gram[i * n + j] = dot(x, y);
            gram[j * n + i] = gram[i * n + j];
        }
    }
    gram
}

/// Computes the dot product with four parallel sums in fixed order.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (a, b) = (a.chunks(4), b.chunks(4));
    for (a, b) in a.zip(b) {
        for ((s, a), b) in sums.iter_mut().zip(a).zip(b) {
            *s += a * b;
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}

/// Computes the square roots of the eigenvalues, descending, and the eigenvectors of a symmetric
/// matrix without negative eigenvalues. Drops rounding errors. Returns an empty list if the
/// iteration does not converge.
fn eigen(matrix: &[f64], n: usize) -> Vec<(f64, Vec<f64>)> {
    let matrix = DMatrix::from_row_slice(n, n, matrix);
    let Some(eigen) = SymmetricEigen::try_new(matrix, f64::EPSILON, STEPS * n.max(1)) else {
        return Vec::new();
    };
    let mut found: Vec<(f64, Vec<f64>)> = (eigen.eigenvalues.iter().enumerate())
        .map(|(j, value)| {
            let vector = eigen.eigenvectors.column(j).iter().copied().collect();
            (value.max(0.0).sqrt(), vector)
        })
        .collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let min = found.first().map_or(0.0, |f| ROUNDING * f.0);
    found.retain(|f| f.0 > min);
    found
}

/// Orthonormalizes the columns of `x`, `r` numbers per row. Dependent columns become zero.
fn orthonormalize(x: &mut [f64], r: usize) {
    let mut columns: Vec<Vec<f64>> = Vec::with_capacity(r);
    for j in 0..r {
        let mut column: Vec<f64> = x.iter().skip(j).step_by(r).copied().collect();
        if !orthonormalize_to(&columns, &mut column) {
            column.fill(0.0);
        }
        columns.push(column);
    }
    for (j, column) in columns.iter().enumerate() {
        for (x, c) in x.iter_mut().skip(j).step_by(r).zip(column) {
            *x = *c;
        }
    }
}

/// Orthogonalizes `vector` to the orthonormal `others` and normalizes it. Runs twice, since the
/// first pass leaves rounding errors. Returns `false` if the remainder is negligible.
fn orthonormalize_to(others: &[Vec<f64>], vector: &mut [f64]) -> bool {
    for _ in 0..2 {
        let before = dot(vector, vector).sqrt();
        for other in others {
            let part = dot(other, vector);
            for (v, o) in vector.iter_mut().zip(other) {
                *v -= part * o;
            }
        }
        let length = dot(vector, vector).sqrt();
        if length <= 1e-9 * before || !length.is_normal() {
            return false;
        }
        vector.iter_mut().for_each(|v| *v /= length);
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Creates `count` rows of `length` numbers. They are combinations of `rank` random vectors,
    /// and vector k has the amplitude `fall`^k.
    fn rows(count: usize, length: usize, rank: usize, fall: f32) -> Vec<f32> {
        let mut random = Random::new(3, count as u64, length as u64);
        let mut draw = |n: usize| -> Vec<f32> { (0..n).map(|_| random.unit() - 0.5).collect() };
        let (left, right) = (draw(count * rank), draw(rank * length));
        let mut out = vec![0.0; count * length];
        for (row, left) in out.chunks_exact_mut(length).zip(left.chunks_exact(rank)) {
            let mut amplitude = 1.0;
            for (l, right) in left.iter().zip(right.chunks_exact(length)) {
                row.iter_mut()
                    .zip(right)
                    .for_each(|(o, r)| *o += amplitude * l * r);
                amplitude *= fall;
            }
        }
        out
    }

    /// Computes the part of the rows' squares that is not in the components, and the largest
    /// deviation of the components from orthonormality.
    fn left_out(rows: &[f32], found: &Components) -> (f64, f64) {
        let f = |v: &[f32]| -> Vec<f64> { v.iter().map(|&v| f64::from(v)).collect() };
        let vectors: Vec<Vec<f64>> = (0..found.count()).map(|j| f(found.vector(j))).collect();
        let (mut left, mut all, mut skew) = (0.0, 0.0, 0.0f64);
        for row in rows.chunks_exact(found.length) {
            let mut row = f(row);
            all += dot(&row, &row);
            for v in &vectors {
                let part = dot(&row, v);
                row.iter_mut().zip(v).for_each(|(r, v)| *r -= part * v);
            }
            left += dot(&row, &row);
        }
        for (i, a) in vectors.iter().enumerate() {
            for (j, b) in vectors.iter().enumerate() {
                let one = if i == j { 1.0 } else { 0.0 };
                skew = skew.max((dot(a, b) - one).abs());
            }
        }
        (left / all, skew)
    }

    #[test]
    fn svd_low_rank_matrix_is_exact_for_any_shape() {
        for (count, length) in [
            (40, 300),
            (300, 40),
            (300, 500),
            (500, 300),
            (90, 90),
            (1, 700),
            (700, 1),
        ] {
            let rank = 6.min(count).min(length);
            let rows = rows(count, length, 6, 0.7);
            let found = decompose(&rows, length, 20, 1);
            assert_eq!(found.count(), rank, "{count} × {length}");
            let (left, skew) = left_out(&rows, &found);
            assert!(
                left < 1e-12 && skew < 1e-6,
                "{count} × {length}: {left} {skew}"
            );
            assert!(found.values.is_sorted_by(|a, b| a >= b));
            let held: f64 = found.values.iter().map(|&v| f64::from(v).powi(2)).sum();
            let all: f64 = rows.iter().map(|&v| f64::from(v).powi(2)).sum();
            assert!((held / all - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn svd_truncation_is_optimal() {
        // Slowly decreasing singular values. The full decomposition gives the minimum loss of eight
        // components.
        let all = rows(400, 300, 60, 0.96);
        let best = decompose(&all, 300, 300, 1);
        assert_eq!(best.count(), 60);
        let square = |v: &f32| f64::from(*v).powi(2);
        let total: f64 = best.values.iter().map(square).sum();
        let min = best.values[8..].iter().map(square).sum::<f64>() / total;
        let few = decompose(&all, 300, 8, 1);
        let (left, skew) = left_out(&all, &few);
        assert!(skew < 1e-6 && left < 1.02 * min, "{left} is not {min}");
        assert!(left > 0.999 * min);
        // Eight arbitrary vectors do not suffice: those of eight rows have a larger loss.
        let any = decompose(&all[..8 * 300], 300, 8, 1);
        let (left, _) = left_out(&all, &any);
        assert!(any.count() == 8 && left > 1.3 * min, "{left}, min {min}");
    }

    #[test]
    fn svd_zero_matrix_has_no_components() {
        assert_eq!(decompose(&[], 5, 3, 0).count(), 0);
        assert_eq!(decompose(&[0.0; 20], 5, 3, 0).count(), 0);
        assert_eq!(decompose(&[0.0; 90_000], 300, 3, 0).count(), 0);
        assert_eq!(decompose(&[1.0; 20], 5, 0, 0).count(), 0);
        assert_eq!(decompose(&[], 0, 3, 0).count(), 0);
        let constant = decompose(&vec![2.0; 90_000], 300, 3, 0);
        assert_eq!(constant.count(), 1);
        let flat = 1.0 / 300f32.sqrt();
        assert!(constant.vectors.iter().all(|v| (v - flat).abs() < 1e-6));
        assert!((constant.values[0] - 600.0).abs() < 1e-3);
        let odd = decompose(&[f32::NAN, 3.0, f32::INFINITY, 4.0], 2, 2, 0);
        assert_eq!(
            (odd.count(), odd.vector(0), odd.values[0]),
            (1, &[0.0, 1.0][..], 5.0)
        );
        // Very large and very small numbers.
        for scale in [1e30, 1e-30] {
            let rows: Vec<f32> = rows(200, 200, 3, 0.5).iter().map(|v| v * scale).collect();
            let found = decompose(&rows, 200, 8, 0);
            assert_eq!(found.count(), 3);
            assert!(left_out(&rows, &found).0 < 1e-12);
        }
    }
}
