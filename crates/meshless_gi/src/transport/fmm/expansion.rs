//! Operations of the fast multipole method on one pair of nodes: S-expansion, S→S, S→R, R→R,
//! evaluation (\[G08\] §2.2, §2.3, §3.0.1 to §3.1.6). Red, green and blue are computed together.
//!
//! With q = −w B / π of a source at y, its S-expansion about c is M_α = Σ q n_y ((c − y)/s)^α / α!,
//! one vector per term. This is \[G08\] Eq. (9) with the matrices S M reduced to n_y. An
//! R-expansion about c is the vector irradiance F(x) = Σ_β L_β ((x − c)/s)^β / β!, W/m², and E(x) =
//! n_x·F. Lengths are in units of a node's size s. All numbers stay near one, as single precision
//! requires.

use super::real::Real;
use super::tensor::{Derivatives, SymmetricMatrix};
use super::terms::{Terms, count};

/// Term of an expansion: components x, y, z, each in red, green and blue (and a lane that is zero).
pub type Term<T> = [[T; 4]; 3];

/// Tables of one order that all operations read.
#[derive(Clone, Debug)]
pub struct Expansions {
    /// Terms.
    pub terms: Terms,
    /// Derivatives of the kernel.
    pub derivatives: Derivatives,
}

/// Buffers of one thread.
#[derive(Clone, Debug)]
pub struct Scratch<T> {
    powers: Vec<T>,
    scalar: Vec<T>,
    tensor: Vec<SymmetricMatrix<T>>,
    scaled: Vec<Term<T>>,
}

impl<T> Default for Scratch<T> {
    fn default() -> Self {
        Self {
            powers: Vec::new(),
            scalar: Vec::new(),
            tensor: Vec::new(),
            scaled: Vec::new(),
        }
    }
}

/// Computes K n for the vector n in three colors.
#[inline(always)]
fn product<T: Real>(k: &SymmetricMatrix<T>, m: &Term<T>, out: &mut Term<T>) {
    for c in 0..4 {
        let (x, y, z) = (m[0][c], m[1][c], m[2][c]);
        out[0][c] += k[0] * x + k[1] * y + k[2] * z;
        out[1][c] += k[1] * x + k[3] * y + k[4] * z;
        out[2][c] += k[2] * x + k[4] * y + k[5] * z;
    }
}

#[inline(always)]
fn add<T: Real>(out: &mut Term<T>, factor: T, m: &Term<T>) {
    for i in 0..3 {
        for c in 0..4 {
            out[i][c] += factor * m[i][c];
        }
    }
}

#[inline(always)]
fn length<T: Real>(v: [T; 3]) -> T {
    (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt()
}

impl Expansions {
    /// Creates the tables up to degree `order`, at most [`MAX_ORDER`](super::terms::MAX_ORDER).
    #[must_use]
    pub fn new(order: usize) -> Self {
        let terms = Terms::new(order);
        Self {
            derivatives: Derivatives::new(&terms),
            terms,
        }
    }

    /// Computes v^α / α! of all terms.
    #[inline(always)]
    fn powers<T: Real>(&self, v: [T; 3], out: &mut Vec<T>) {
        out.clear();
        out.push(T::from_f64(1.0));
        for step in &self.terms.steps()[1..] {
            let power = out[step.from as usize] * v[step.axis as usize];
            out.push(power * T::from_f64(1.0 / step.exponent));
        }
    }

    /// Adds a source to an S-expansion: `v` = (c − y) / s, `source` = q n_y.
    #[inline(always)]
    pub fn source<T: Real>(
        &self,
        v: [T; 3],
        source: &Term<T>,
        scratch: &mut Scratch<T>,
        out: &mut [Term<T>],
    ) {
        self.powers(v, &mut scratch.powers);
        for (term, &power) in out.iter_mut().zip(&scratch.powers) {
            add(term, power, source);
        }
    }

    /// S→S: adds the expansion of a child to that of its parent. `v` = (c_parent − c_child) /
    /// s_parent, `ratio` = s_child / s_parent.
    #[inline(always)]
    pub fn s_to_s<T: Real>(
        &self,
        v: [T; 3],
        ratio: T,
        child: &[Term<T>],
        scratch: &mut Scratch<T>,
        out: &mut [Term<T>],
    ) {
        self.powers(v, &mut scratch.powers);
        let mut shrink = T::from_f64(1.0);
        let mut first = 0;
        for degree in 0..=self.terms.order() {
            for (a, term) in child.iter().enumerate().take(count(degree)).skip(first) {
                for (&sum, &power) in self.terms.sums(a).iter().zip(&scratch.powers) {
                    add(&mut out[sum as usize], shrink * power, term);
                }
            }
            first = count(degree);
            shrink = shrink * ratio;
        }
    }

    /// R→R: adds the expansion of a parent to that of its child. `v` = (c_child − c_parent) /
    /// s_parent, `ratio` = s_child / s_parent.
    #[inline(always)]
    pub fn r_to_r<T: Real>(
        &self,
        v: [T; 3],
        ratio: T,
        parent: &[Term<T>],
        scratch: &mut Scratch<T>,
        out: &mut [Term<T>],
    ) {
        self.powers(v, &mut scratch.powers);
        let mut shrink = T::from_f64(1.0);
        let mut first = 0;
        for degree in 0..=self.terms.order() {
            for (a, term) in out.iter_mut().enumerate().take(count(degree)).skip(first) {
                let mut moved = Term::default();
                for (&sum, &power) in self.terms.sums(a).iter().zip(&scratch.powers) {
                    add(&mut moved, power, &parent[sum as usize]);
                }
                add(term, shrink, &moved);
            }
            first = count(degree);
            shrink = shrink * ratio;
        }
    }

    /// Computes the derivatives at r / |r| and returns 1 / |r|.
    #[inline(always)]
    fn kernel<T: Real>(&self, r: [T; 3], scratch: &mut Scratch<T>) -> T {
        let inverse = length(r).reciprocal();
        let unit = r.map(|c| c * inverse);
        self.derivatives
            .at(unit, &mut scratch.scalar, &mut scratch.tensor);
        inverse
    }

    /// S→R, far list: converts the S-expansion `source` about c_s and adds it to the R-expansion
    /// about c_r. `r` = c_r − c_s, `sizes` = [s_s, s_r] in the same unit. `weight` is the
    /// unoccluded fraction of the light.
    #[inline(always)]
    pub fn s_to_r<T: Real>(
        &self,
        r: [T; 3],
        sizes: [T; 2],
        weight: T,
        source: &[Term<T>],
        scratch: &mut Scratch<T>,
        out: &mut [Term<T>],
    ) {
        let inverse = self.kernel(r, scratch);
        self.scale(source, sizes[0] * inverse, scratch);
        let step = sizes[1] * inverse;
        let mut factor = weight * inverse * inverse;
        let mut first = 0;
        for degree in 0..=self.terms.order() {
            for (b, term) in out.iter_mut().enumerate().take(count(degree)).skip(first) {
                let mut sum = Term::default();
                for (&at, m) in self.terms.sums(b).iter().zip(&scratch.scaled) {
                    product(&scratch.tensor[at as usize], m, &mut sum);
                }
                add(term, factor, &sum);
            }
            first = count(degree);
            factor = factor * step;
        }
    }

    /// Sets `scratch.scaled` to `source` with terms of degree n times `ratio`ⁿ.
    #[inline(always)]
    fn scale<T: Real>(&self, source: &[Term<T>], ratio: T, scratch: &mut Scratch<T>) {
        scratch.scaled.clear();
        scratch.scaled.extend_from_slice(source);
        let mut factor = ratio;
        for degree in 1..=self.terms.order() {
            let terms = &mut scratch.scaled[count(degree - 1)..count(degree)];
            for c in terms.as_flattened_mut().as_flattened_mut() {
                *c = factor * *c;
            }
            factor = factor * ratio;
        }
    }

    /// Local list: adds one source to an R-expansion. `r` = c_r − y, `size` = s_r.
    #[inline(always)]
    pub fn point_to_r<T: Real>(
        &self,
        r: [T; 3],
        size: T,
        weight: T,
        source: &Term<T>,
        scratch: &mut Scratch<T>,
        out: &mut [Term<T>],
    ) {
        let inverse = self.kernel(r, scratch);
        let step = size * inverse;
        let mut factor = weight * inverse * inverse;
        let mut first = 0;
        for degree in 0..=self.terms.order() {
            for (b, term) in out.iter_mut().enumerate().take(count(degree)).skip(first) {
                let mut sum = Term::default();
                product(&scratch.tensor[b], source, &mut sum);
                add(term, factor, &sum);
            }
            first = count(degree);
            factor = factor * step;
        }
    }

    /// Multipole list: evaluates F at a point from an S-expansion. `r` = x − c_s, `size` = s_s.
    #[inline(always)]
    pub fn s_at<T: Real>(
        &self,
        r: [T; 3],
        size: T,
        source: &[Term<T>],
        scratch: &mut Scratch<T>,
    ) -> Term<T> {
        let inverse = self.kernel(r, scratch);
        let step = size * inverse;
        let mut factor = inverse * inverse;
        let mut out = Term::default();
        let mut first = 0;
        for degree in 0..=self.terms.order() {
            let mut sum = Term::default();
            for (k, m) in scratch.tensor[first..count(degree)]
                .iter()
                .zip(&source[first..count(degree)])
            {
                product(k, m, &mut sum);
            }
            add(&mut out, factor, &sum);
            first = count(degree);
            factor = factor * step;
        }
        out
    }

    /// Evaluates F at a point from an R-expansion: `v` = (x − c) / s.
    #[inline(always)]
    pub fn r_at<T: Real>(&self, v: [T; 3], local: &[Term<T>], scratch: &mut Scratch<T>) -> Term<T> {
        self.powers(v, &mut scratch.powers);
        let mut out = Term::default();
        for (term, &power) in local.iter().zip(&scratch.powers) {
            add(&mut out, power, term);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Random;

    struct Case {
        sources: Vec<([f64; 3], Term<f64>)>,
        receivers: Vec<[f64; 3]>,
    }

    fn ball(random: &mut Random, center: [f64; 3], radius: f64) -> [f64; 3] {
        loop {
            let v: [f64; 3] = std::array::from_fn(|_| 2.0 * f64::from(random.unit()) - 1.0);
            if length(v) <= 1.0 {
                return std::array::from_fn(|i| center[i] + radius * v[i]);
            }
        }
    }

    /// Creates sources in a ball of radius 0.5 about the origin and receivers in one of radius 0.5
    /// about (0, 0, 4).
    fn case() -> Case {
        let mut random = Random::new(7, 8, 9);
        Case {
            sources: (0..40)
                .map(|_| {
                    let term = std::array::from_fn(|_| {
                        std::array::from_fn(|c| match c {
                            3 => 0.0,
                            _ => f64::from(random.unit()) - 0.3,
                        })
                    });
                    (ball(&mut random, [0.0; 3], 0.5), term)
                })
                .collect(),
            receivers: (0..40)
                .map(|_| ball(&mut random, [0.0, 0.0, 4.0], 0.5))
                .collect(),
        }
    }

    fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|i| a[i] - b[i])
    }

    fn exact(case: &Case, x: [f64; 3]) -> Term<f64> {
        let mut out = Term::default();
        for (y, source) in &case.sources {
            let r = minus(x, *y);
            let square = length(r).powi(2);
            let k = super::super::tensor::PAIRS.map(|[i, j]| r[i] * r[j] / (square * square));
            product(&k, source, &mut out);
        }
        out
    }

    /// Returns the RMS of the difference over the RMS of the exact values.
    fn error(case: &Case, found: impl Fn([f64; 3]) -> Term<f64>) -> f64 {
        let (mut off, mut all) = (0.0, 0.0);
        for &x in &case.receivers {
            let (a, b) = (found(x), exact(case, x));
            for (a, b) in a.as_flattened().iter().zip(b.as_flattened()) {
                off += (a - b).powi(2);
                all += b * b;
            }
        }
        (off / all).sqrt()
    }

    /// Each path from sources to receivers converges with its ratio of size to distance to the
    /// power of order + 1. The ratio is 0.5/4 for one expansion and 1/4 for both.
    #[test]
    fn expansions_of_every_translation_converge() {
        let case = case();
        let mut errors = Vec::new();
        for order in [0, 1, 2, 4, 8, 16] {
            let e = Expansions::new(order);
            let n = e.terms.len();
            let scratch = &mut Scratch::default();
            let (cs, cr, ss, sr) = ([0.1, 0.0, 0.0], [0.0, 0.1, 4.0], 0.6, 0.7);
            let mut s = vec![Term::default(); n];
            let mut local = vec![Term::default(); n];
            for (y, source) in &case.sources {
                let v = minus(cs, *y).map(|c| c / ss);
                e.source(v, source, scratch, &mut s);
                e.point_to_r(minus(cr, *y), sr, 1.0, source, scratch, &mut local);
            }
            // A parent with a different center, and a child of the receivers' node.
            let (cp, sp) = ([0.0, 0.2, 0.1], 0.8);
            let mut parent = vec![Term::default(); n];
            e.s_to_s(
                minus(cp, cs).map(|c| c / sp),
                ss / sp,
                &s,
                scratch,
                &mut parent,
            );
            let mut r = vec![Term::default(); n];
            e.s_to_r(minus(cr, cp), [sp, sr], 1.0, &parent, scratch, &mut r);
            let (cc, sc) = ([0.1, 0.0, 3.9], 0.65);
            let mut child = vec![Term::default(); n];
            e.r_to_r(
                minus(cc, cr).map(|c| c / sr),
                sc / sr,
                &r,
                scratch,
                &mut child,
            );
            let scratch = std::cell::RefCell::new(Scratch::default());
            let found = [
                error(&case, |x| {
                    e.s_at(minus(x, cs), ss, &s, &mut scratch.borrow_mut())
                }),
                error(&case, |x| {
                    e.s_at(minus(x, cp), sp, &parent, &mut scratch.borrow_mut())
                }),
                error(&case, |x| {
                    e.r_at(
                        minus(x, cr).map(|c| c / sr),
                        &local,
                        &mut scratch.borrow_mut(),
                    )
                }),
                error(&case, |x| {
                    e.r_at(minus(x, cr).map(|c| c / sr), &r, &mut scratch.borrow_mut())
                }),
                error(&case, |x| {
                    e.r_at(
                        minus(x, cc).map(|c| c / sc),
                        &child,
                        &mut scratch.borrow_mut(),
                    )
                }),
            ];
            // R→R is exact: the same polynomial about another center.
            let same = (found[3] / found[4]).ln().abs() < 1e-3 || found[3] < 1e-13;
            assert!(same, "order {order}: {found:?}");
            errors.push((order, found));
        }
        for (order, found) in &errors {
            eprintln!(
                "order {order:2}: {}",
                found.map(|e| format!("{e:.1e}")).join(" ")
            );
            for (k, ratio) in [0.6 / 4.0, 0.75 / 4.0, 0.6 / 4.0, 1.3 / 4.0]
                .into_iter()
                .enumerate()
            {
                let bound = 4.0 * (*order as f64 + 1.0) * f64::powi(ratio, *order as i32 + 1);
                assert!(found[k] < bound, "order {order}, way {k}: {:e}", found[k]);
            }
        }
        // The low orders have an error.
        assert!(errors[0].1.iter().all(|e| *e > 1e-2));
    }

    #[test]
    fn expansion_f32_matches_f64() {
        let case = case();
        let e = Expansions::new(6);
        let n = e.terms.len();
        let narrow = |v: [f64; 3]| v.map(|c| c as f32);
        let scratch = &mut Scratch::default();
        let (mut s, mut r) = (vec![Term::default(); n], vec![Term::default(); n]);
        // Lengths of 1e-6 of the size. Unscaled sixth powers would underflow.
        for (y, source) in &case.sources {
            let source = source.map(|v| v.map(|c| c as f32));
            e.source(narrow(y.map(|c| -c)), &source, scratch, &mut s);
        }
        let tiny = 1e-6;
        e.s_to_r(
            [0.0, 0.0, 4.0 * tiny],
            [tiny, tiny],
            1.0,
            &s,
            scratch,
            &mut r,
        );
        let cell = std::cell::RefCell::new(Scratch::default());
        let found = error(&case, |x| {
            let v = narrow(minus(x, [0.0, 0.0, 4.0]));
            let value = e.r_at(v, &r, &mut cell.borrow_mut());
            value.map(|v| v.map(|c| f64::from(c) * 1e-12))
        });
        assert!(found < 1e-3, "{found:e}");
    }
}
