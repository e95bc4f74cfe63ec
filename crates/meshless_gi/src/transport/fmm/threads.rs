//! The passes on several threads. One thread computes a node, so that results are bit-identical for
//! any number of threads (design D5). [`Field`] defines the computation of a node. Here it is
//! compiled a second time for AVX2, which an x86-64 processor may have. The results stay
//! bit-identical: color channels are SIMD lanes, sums have the same order, and products are not
//! fused.

use super::expansion::{Scratch, Term};
use super::passes::Field;
use super::real::Real;
use multiversion::multiversion;
use rayon::prelude::*;
use std::time::{Duration, Instant};

/// Times of the parts of a pass.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PassTimes {
    /// S-expansions and S→S.
    pub up: Duration,
    /// Downward pass and evaluation.
    pub down: Duration,
}

/// Minimum number of nodes per thread.
const NODES: usize = 8;

/// Buffers of the passes, reused between runs.
pub struct Passes<'a, T> {
    /// Field of the passes.
    pub field: Field<'a, T>,
    /// S-expansions, sorted by node.
    pub sources: Vec<Term<T>>,
    /// R-expansions.
    pub locals: Vec<Term<T>>,
    /// Vector irradiance at the receivers in the tree's order, W/m². Zero at other points.
    pub values: Vec<Term<T>>,
    /// Leaves that receive, sorted by their points.
    leaves: Vec<usize>,
    /// Radiosity in the tree's order.
    ordered: Vec<[T; 4]>,
}

impl<'a, T: Real> Passes<'a, T> {
    /// Allocates the buffers for all expansions.
    #[must_use]
    pub fn new(field: Field<'a, T>) -> Self {
        let terms = field.terms() * field.nodes.len();
        let receives = |&i: &usize| {
            let node = &field.nodes[i];
            node.is_leaf() && !node.receiver_range().is_empty()
        };
        let mut leaves: Vec<_> = (0..field.nodes.len()).filter(receives).collect();
        leaves.sort_by_key(|&i| field.nodes[i].start);
        Self {
            sources: vec![Term::default(); terms],
            locals: vec![Term::default(); terms],
            values: vec![Term::default(); field.points.len()],
            leaves,
            ordered: Vec::with_capacity(field.points.len()),
            field,
        }
    }

    /// Runs both passes for the radiosity of every point in the order of the tree's input.
    pub fn run(&mut self, radiosity: &[[T; 4]]) -> PassTimes {
        let start = Instant::now();
        self.up(radiosity);
        let up = start.elapsed();
        let start = Instant::now();
        self.down(radiosity);
        let down = start.elapsed();
        PassTimes { up, down }
    }

    /// Runs the upward pass for the radiosity of every point in the order of the tree's input.
    pub fn up(&mut self, radiosity: &[[T; 4]]) {
        let (field, n) = (&self.field, self.field.terms());
        field.in_order(radiosity, &mut self.ordered);
        let radiosity = self.ordered.as_slice();
        for l in (0..field.levels()).rev() {
            let level = field.level(l);
            let (own, below) = self.sources.split_at_mut(level.end * n);
            own[level.start * n..]
                .par_chunks_mut(n)
                .with_min_len(NODES)
                .enumerate()
                .for_each_init(Scratch::default, |scratch, (i, out)| {
                    let node = level.start + i;
                    ascend(field, node, radiosity, below, level.end, scratch, out);
                });
        }
    }

    /// Runs the downward pass and the evaluation for the same radiosity.
    pub fn down(&mut self, radiosity: &[[T; 4]]) {
        let (field, n) = (&self.field, self.field.terms());
        field.in_order(radiosity, &mut self.ordered);
        let radiosity = self.ordered.as_slice();
        let sources = &self.sources;
        for l in 0..field.levels() {
            let level = field.level(l);
            let (above, own) = self.locals.split_at_mut(level.start * n);
            own[..level.len() * n]
                .par_chunks_mut(n)
                .with_min_len(NODES)
                .enumerate()
                .for_each_init(Scratch::default, |scratch, (i, out)| {
                    let node = level.start + i;
                    let parent = field.nodes[node].parent as usize;
                    let parent = (l > 0).then(|| &above[parent * n..(parent + 1) * n]);
                    descend(field, node, sources, parent, radiosity, scratch, out);
                });
        }
        let mut rest = self.values.as_mut_slice();
        let mut at = 0;
        let mut parts = Vec::with_capacity(self.leaves.len());
        for &node in &self.leaves {
            let range = field.nodes[node].receiver_range();
            let (own, other) = rest[range.start - at..].split_at_mut(range.len());
            parts.push((node, own));
            (rest, at) = (other, range.end);
        }
        let locals = &self.locals;
        parts.into_par_iter().with_min_len(NODES).for_each_init(
            Scratch::default,
            |scratch, (node, out)| {
                let local = &locals[node * n..(node + 1) * n];
                arrive(field, node, sources, local, radiosity, scratch, out);
            },
        );
    }
}

/// Computes the upward pass of a node, with AVX2 if available. The order of sums and thus the bits
/// do not change.
#[multiversion(targets("x86_64+avx2"))]
fn ascend<T: Real>(
    field: &Field<'_, T>,
    node: usize,
    radiosity: &[[T; 4]],
    below: &[Term<T>],
    first: usize,
    scratch: &mut Scratch<T>,
    out: &mut [Term<T>],
) {
    match field.nodes[node].is_leaf() {
        true => field.leaf(node, radiosity, scratch, out),
        false => field.gather(node, below, first, scratch, out),
    }
}

/// Computes the downward pass of a node, with AVX2 if available.
#[multiversion(targets("x86_64+avx2"))]
fn descend<T: Real>(
    field: &Field<'_, T>,
    node: usize,
    sources: &[Term<T>],
    parent: Option<&[Term<T>]>,
    radiosity: &[[T; 4]],
    scratch: &mut Scratch<T>,
    out: &mut [Term<T>],
) {
    field.receive(node, sources, parent, radiosity, scratch, out);
}

/// Evaluates the irradiance at the receivers of a leaf.
#[multiversion(targets("x86_64+avx2"))]
fn arrive<T: Real>(
    field: &Field<'_, T>,
    node: usize,
    sources: &[Term<T>],
    local: &[Term<T>],
    radiosity: &[[T; 4]],
    scratch: &mut Scratch<T>,
    out: &mut [Term<T>],
) {
    field.evaluate(node, sources, local, radiosity, scratch, out);
}

#[cfg(test)]
mod tests {
    use super::super::settings::{FmmPoint, FmmSettings};
    use super::super::solve::Fmm;
    use super::*;
    use crate::samples::Random;
    use glam::Vec3;

    /// Runs the steps as compiled for every machine, sequentially.
    fn one_by_one<T: Real>(field: &Field<'_, T>, radiosity: &[[T; 4]]) -> Vec<Term<T>> {
        let n = field.terms();
        let none = vec![Term::default(); n * field.nodes.len()];
        let (mut sources, mut locals) = (none.clone(), none);
        let mut values = vec![Term::default(); field.points.len()];
        let mut ordered = Vec::new();
        field.in_order(radiosity, &mut ordered);
        let scratch = &mut Scratch::default();
        for node in (0..field.nodes.len()).rev() {
            let (own, below) = sources.split_at_mut((node + 1) * n);
            let own = &mut own[node * n..];
            match field.nodes[node].is_leaf() {
                true => field.leaf(node, &ordered, scratch, own),
                false => field.gather(node, below, node + 1, scratch, own),
            }
        }
        for node in 0..field.nodes.len() {
            let (above, own) = locals.split_at_mut(node * n);
            let parent = field.nodes[node].parent as usize;
            let parent = (node > 0).then(|| &above[parent * n..(parent + 1) * n]);
            let own = &mut own[..n];
            field.receive(node, &sources, parent, &ordered, scratch, own);
            if field.nodes[node].is_leaf() {
                let out = &mut values[field.nodes[node].receiver_range()];
                field.evaluate(node, &sources, own, &ordered, scratch, out);
            }
        }
        values
    }

    fn same_bits<T: Real + std::fmt::Debug>(field: Field<'_, T>, radiosity: &[[T; 4]]) {
        let right = one_by_one(&field, radiosity);
        let mut passes = Passes::new(field);
        passes.run(radiosity);
        let bits = |values: &[Term<T>]| -> Vec<u64> {
            let all = values.as_flattened().as_flattened().iter();
            all.map(|v| v.wide().to_bits()).collect()
        };
        assert_eq!(bits(&passes.values), bits(&right));
        let lit = right.iter().filter(|v| **v != Term::default());
        assert!(lit.count() * 2 > right.len());
    }

    #[test]
    fn avx2_kernels_match_scalar_bits() {
        let mut random = Random::new(2, 7, 1);
        // The inside of a ball and a smaller ball in it: uses all four lists.
        let points: Vec<_> = (0..3000)
            .map(|i| {
                let v = Vec3::from_array(std::array::from_fn(|_| random.unit() - 0.5)).normalize();
                let (radius, side) = if i % 4 == 0 { (0.2, 1.0) } else { (1.0, -1.0) };
                FmmPoint {
                    position: radius * v,
                    normal: side * v,
                    weight: 0.004 * radius * radius,
                    receives: true,
                }
            })
            .collect();
        let fmm = Fmm::new(&points, &FmmSettings::default(), None).expect("good points");
        let lists = fmm.lists();
        for list in [&lists.far, &lists.local, &lists.multipole, &lists.near] {
            assert!(!list.entries.is_empty());
        }
        let radiosity: Vec<[f64; 4]> = points
            .iter()
            .map(|p| [p.position.x + 1.0, p.position.y + 1.0, 0.3, 0.0].map(f64::from))
            .collect();
        same_bits(
            Field::new(fmm.tree(), lists, fmm.expansions(), true),
            &radiosity,
        );
        let narrow: Vec<[f32; 4]> = radiosity.iter().map(|b| b.map(|c| c as f32)).collect();
        same_bits(Field::from_operator(&fmm.operator(|at| at)), &narrow);
    }
}
