//! Dense systems of equations: LU with partial pivoting, for the Gaussian basis (ϕ^G of [V11]). It
//! is made for a few thousand unknowns. The bake does not use it.

use glam::DVec3;
use rayon::prelude::*;

/// Smallest pivot, relative to the largest, that is not attributed to rounding.
const MIN_PIVOT: f64 = 1e-14;

/// LU factorization of a square matrix.
#[derive(Clone, Debug)]
pub(super) struct Lu {
    /// L below the diagonal and U on and above it, in the order of `order`. The diagonal of L is 1.
    rows: Vec<Vec<f64>>,
    /// Row of the matrix for each row of the factorization.
    order: Vec<usize>,
    /// Smallest over largest absolute pivot. It is about the reciprocal of the condition number,
    /// and never far below it.
    pub pivots: f64,
}

impl Lu {
    /// Factorizes a square matrix, row by row. Returns `None` if it is singular within rounding or
    /// not finite.
    pub fn new(mut rows: Vec<Vec<f64>>) -> Option<Self> {
        let n = rows.len();
        let mut order: Vec<usize> = (0..n).collect();
        let (mut min, mut max) = (f64::INFINITY, 0.0f64);
        for k in 0..n {
            let size = |i: usize| rows[i][k].abs();
            let mut best = k;
            for i in k + 1..n {
                if size(i) > size(best) {
                    best = i;
                }
            }
            let pivot = size(best);
            (min, max) = (min.min(pivot), max.max(pivot));
            // The negated comparison rejects NaN, too.
            if !(pivot.is_finite() && pivot > MIN_PIVOT * max) {
                return None;
            }
            rows.swap(k, best);
            order.swap(k, best);
            let (done, rest) = rows.split_at_mut(k + 1);
            let lead = &done[k];
            rest.par_iter_mut().with_min_len(64).for_each(|row| {
                if row[k] == 0.0 {
                    return;
                }
                let factor = row[k] / lead[k];
                row[k] = factor;
                for (x, l) in row[k + 1..].iter_mut().zip(&lead[k + 1..]) {
                    *x -= factor * l;
                }
            });
        }
        Some(Self {
            rows,
            order,
            pivots: if n == 0 { 1.0 } else { min / max },
        })
    }

    /// Solves the system for three right-hand sides.
    pub fn solve(&self, right: &[DVec3]) -> Vec<DVec3> {
        let mut x: Vec<DVec3> = self.order.iter().map(|&i| right[i]).collect();
        for i in 0..x.len() {
            let below: DVec3 = (0..i).map(|j| self.rows[i][j] * x[j]).sum();
            x[i] -= below;
        }
        for i in (0..x.len()).rev() {
            let above: DVec3 = (i + 1..x.len()).map(|j| self.rows[i][j] * x[j]).sum();
            x[i] = (x[i] - above) / self.rows[i][i];
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use meshless_gi::internals::samples::Random;

    #[test]
    fn dense_solver_solves_regular_and_rejects_singular() {
        let n = 40;
        let mut random = Random::new(5, 0, 0);
        let mut draw = || f64::from(random.unit()) - 0.5;
        let rows: Vec<Vec<f64>> = (0..n).map(|_| (0..n).map(|_| draw()).collect()).collect();
        let x: Vec<DVec3> = (0..n).map(|_| DVec3::new(draw(), draw(), draw())).collect();
        let right: Vec<DVec3> = rows
            .iter()
            .map(|row| row.iter().zip(&x).map(|(a, x)| *a * *x).sum())
            .collect();
        let lu = Lu::new(rows.clone()).expect("regular");
        for (found, right) in lu.solve(&right).iter().zip(&x) {
            assert!((*found - *right).length() < 1e-10);
        }
        assert!(lu.pivots > 1e-6 && lu.pivots <= 1.0);
        let mut twice = rows.clone();
        twice[7] = twice[3].clone();
        assert!(Lu::new(twice).is_none());
        let mut broken = rows;
        broken[2][5] = f64::NAN;
        assert!(Lu::new(broken).is_none());
        assert!(Lu::new(Vec::new()).is_some());
    }
}
