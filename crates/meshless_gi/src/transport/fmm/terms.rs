//! Terms of an expansion: exponents (a, b, c) of the homogeneous polynomials v_x^a v_y^b v_z^c up
//! to an order, and the tables of translations.
//!
//! Terms are sorted by degree, so that those up to any degree are a prefix. The monomials of degree
//! n span the same space as the functions r^n Y_{n−2j}^m of \[G08\] Eq. (5), j = 0 … n/2. Both have
//! (n + 1)(n + 2) / 2 elements.

/// Highest supported order: C(19, 3) = 969 terms.
pub const MAX_ORDER: usize = 16;

/// Returns the number of terms up to degree `order`.
#[must_use]
pub const fn count(order: usize) -> usize {
    (order + 1) * (order + 2) * (order + 3) / 6
}

/// Returns the index of exponents (a, b, c) in the order of the terms.
#[must_use]
pub const fn term_index(e: [usize; 3]) -> usize {
    let (n, m) = (e[0] + e[1] + e[2], e[1] + e[2]);
    n * (n + 1) * (n + 2) / 6 + m * (m + 1) / 2 + e[2]
}

/// Step from a term of the next lower degree: times component `axis` over `exponent`.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// Index of the term of the next lower degree.
    pub from: u32,
    /// Component.
    pub axis: u32,
    /// Its exponent in the term.
    pub exponent: f64,
}

/// Tables of one order.
#[derive(Clone, Debug)]
pub struct Terms {
    order: usize,
    exponents: Vec<[usize; 3]>,
    /// a! b! c! of each term.
    factorials: Vec<f64>,
    steps: Vec<Step>,
    /// For each term α, the indices of α + β for all β up to degree order − |α|.
    sums: Vec<Vec<u16>>,
}

impl Terms {
    /// Creates the tables for expansions up to degree `order`, at most [`MAX_ORDER`].
    #[must_use]
    pub fn new(order: usize) -> Self {
        let order = order.min(MAX_ORDER);
        let mut exponents = Vec::with_capacity(count(order));
        for n in 0..=order {
            for m in 0..=n {
                exponents.extend((0..=m).map(|c| [n - m, m - c, c]));
            }
        }
        let factorial = |n: usize| (1..=n).map(|k| k as f64).product::<f64>();
        let steps = exponents.iter().map(|e| {
            let axis = (0..3).find(|&i| e[i] > 0).unwrap_or(0);
            let mut from = *e;
            from[axis] = from[axis].saturating_sub(1);
            Step {
                from: term_index(from) as u32,
                axis: axis as u32,
                exponent: e[axis] as f64,
            }
        });
        let degree = |e: &[usize; 3]| e.iter().sum::<usize>();
        let sums = exponents.iter().map(|a| {
            exponents[..count(order - degree(a))]
                .iter()
                .map(|b| term_index([a[0] + b[0], a[1] + b[1], a[2] + b[2]]) as u16)
                .collect()
        });
        Self {
            order,
            factorials: exponents
                .iter()
                .map(|e| e.iter().map(|&k| factorial(k)).product())
                .collect(),
            steps: steps.collect(),
            sums: sums.collect(),
            exponents,
        }
    }

    /// Returns the order.
    #[must_use]
    pub fn order(&self) -> usize {
        self.order
    }

    /// Returns the number of terms of an expansion.
    #[must_use]
    pub fn len(&self) -> usize {
        self.exponents.len()
    }

    /// Returns `false`: the constant term always exists.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.exponents.is_empty()
    }

    /// Returns the exponents of all terms.
    #[must_use]
    pub fn exponents(&self) -> &[[usize; 3]] {
        &self.exponents
    }

    /// Returns a! b! c! of all terms.
    #[must_use]
    pub fn factorials(&self) -> &[f64] {
        &self.factorials
    }

    /// Returns the step to each term from an earlier one. The step of the first term is not used.
    #[must_use]
    pub fn steps(&self) -> &[Step] {
        &self.steps
    }

    /// Returns the indices of term `a` plus each of the terms that keep the sum within the order.
    #[must_use]
    pub fn sums(&self, a: usize) -> &[u16] {
        &self.sums[a]
    }

    /// Returns the degree of a term.
    #[must_use]
    pub fn degree(&self, term: usize) -> usize {
        self.exponents[term].iter().sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tensor_terms_are_ordered_by_degree() {
        for order in 0..=MAX_ORDER {
            let terms = Terms::new(order);
            assert_eq!(terms.len(), count(order));
            for (i, e) in terms.exponents().iter().enumerate() {
                assert_eq!(term_index(*e), i);
                assert!(i < count(terms.degree(i)));
                assert!(terms.degree(i) == 0 || i >= count(terms.degree(i) - 1));
                let step = terms.steps()[i];
                if i > 0 {
                    let mut from = terms.exponents()[step.from as usize];
                    from[step.axis as usize] += 1;
                    assert_eq!(from, *e);
                    assert_eq!(step.exponent, e[step.axis as usize] as f64);
                }
                for (b, &sum) in terms.sums(i).iter().enumerate() {
                    let (sum, b) = (terms.exponents()[sum as usize], terms.exponents()[b]);
                    assert_eq!(sum, std::array::from_fn(|k| e[k] + b[k]));
                }
            }
            // As many terms of a degree as functions r^n Y_{n-2j}^m.
            for n in 0..=order {
                let spherical: usize = (0..=n / 2).map(|j| 2 * (n - 2 * j) + 1).sum();
                let cartesian = (0..terms.len()).filter(|&i| terms.degree(i) == n).count();
                assert_eq!(cartesian, spherical);
            }
        }
    }
}
