//! Upward and downward pass per node (\[G08\] §3.0.1 to §3.1.6), in single or double precision. CPU
//! threads run these steps, and the kernels `fmm_up` and `fmm_down` compute them on the GPU.
//!
//! | pass | step | section of \[G08\] |
//! |---|---|---|
//! | up | [`Field::leaf`] | §3.0.1: S-expansions of the leaves |
//! | up | [`Field::gather`] | §3.0.2: S→S, level by level |
//! | down | [`Field::receive`] | §3.1.1 to §3.1.3: far list, local list, R→R, level by level |
//! | down | [`Field::evaluate`] | §3.1.4 to §3.1.6: R-expansion, near, multipole list, per point |

use super::expansion::{Expansions, Scratch, Term};
use super::lists::{ListEntry, Lists};
use super::operator::{FmmNode, FmmOperator};
use super::real::Real;
use super::tree::{COINCIDENT, Tree};
use std::borrow::Cow;
use std::ops::Range;

/// Point of the passes, in units of the scene.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FieldPoint<T> {
    /// Position.
    pub position: [T; 3],
    /// Unit normal.
    pub normal: [T; 3],
    /// Weight over π. 0 if it does not emit.
    pub share: T,
    /// Index of its radiosity.
    pub point: u32,
}

/// Data that does not change between solves.
#[derive(Clone, Debug)]
pub struct Field<'a, T> {
    /// Nodes: their points, children, parent and lists.
    pub nodes: Cow<'a, [FmmNode]>,
    /// First node of each level, and one past the last node.
    pub level_starts: &'a [u32],
    /// Entries of the nodes' lists.
    pub entries: Cow<'a, [ListEntry]>,
    /// Tables.
    pub expansions: Cow<'a, Expansions>,
    /// Points in the tree's order.
    pub points: Vec<FieldPoint<T>>,
    /// `true` if close sources are disks.
    pub disks: bool,
    /// Center of each node's expansions, and their unit of length.
    centers: Vec<([T; 3], T)>,
}

#[inline(always)]
fn minus<T: Real>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    std::array::from_fn(|i| a[i] - b[i])
}

#[inline(always)]
fn times<T: Real>(a: [T; 3], f: T) -> [T; 3] {
    a.map(|c| c * f)
}

#[inline(always)]
fn dot<T: Real>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl<'a, T: Real> Field<'a, T> {
    /// Creates the field of a tree and its lists. Point i of the tree's input has the radiosity i.
    #[must_use]
    pub fn new(tree: &'a Tree, lists: &Lists, expansions: &'a Expansions, disks: bool) -> Self {
        let order = expansions.terms.order();
        let operator = FmmOperator::new(tree, lists, order, disks, |at| at);
        let wide = |v: glam::DVec3| v.to_array().map(T::from_f64);
        let points = tree
            .points
            .iter()
            .zip(&tree.order)
            .map(|(p, &at)| FieldPoint {
                position: wide(p.position),
                normal: wide(p.normal),
                share: T::from_f64(p.weight / core::f64::consts::PI),
                point: at,
            });
        let centers = tree
            .nodes
            .iter()
            .map(|n| (wide(n.center), T::from_f64(n.size)));
        Self {
            centers: centers.collect(),
            points: points.collect(),
            nodes: operator.nodes.into(),
            level_starts: &tree.level_starts,
            entries: operator.entries.into(),
            expansions: Cow::Borrowed(expansions),
            disks,
        }
    }

    /// Creates the field of a baked octree.
    #[must_use]
    pub fn from_operator(operator: &'a FmmOperator) -> Self {
        let narrow = |v: [f32; 3]| v.map(|c| T::from_f64(c.into()));
        let points = operator.points.iter().map(|p| FieldPoint {
            position: narrow(p.position),
            normal: narrow(p.normal),
            share: T::from_f64(p.share.into()),
            point: p.point,
        });
        let centers =
            (operator.nodes.iter()).map(|n| (narrow(n.center), T::from_f64(n.size.into())));
        Self {
            centers: centers.collect(),
            points: points.collect(),
            nodes: Cow::Borrowed(&operator.nodes),
            level_starts: &operator.level_starts,
            entries: Cow::Borrowed(&operator.entries),
            expansions: Cow::Owned(operator.expansions()),
            disks: operator.disks,
        }
    }

    /// Returns the number of terms of an expansion.
    #[must_use]
    pub fn terms(&self) -> usize {
        self.expansions.terms.len()
    }

    /// Returns the number of levels of nodes.
    #[must_use]
    pub fn levels(&self) -> usize {
        self.level_starts.len().saturating_sub(1)
    }

    /// Returns the nodes of a level.
    #[must_use]
    pub fn level(&self, l: usize) -> Range<usize> {
        self.level_starts[l] as usize..self.level_starts[l + 1] as usize
    }

    #[inline(always)]
    fn center(&self, node: usize) -> [T; 3] {
        self.centers[node].0
    }

    #[inline(always)]
    fn size(&self, node: usize) -> T {
        self.centers[node].1
    }

    fn list(&self, node: usize, which: usize) -> &[ListEntry] {
        &self.entries[self.nodes[node].lists()[which].clone()]
    }

    /// Sorts the radiosity of the tree's input points into the order of the tree. All steps take
    /// this order, in which close points are adjacent.
    pub fn in_order(&self, radiosity: &[[T; 4]], out: &mut Vec<[T; 4]>) {
        out.clear();
        out.extend(self.points.iter().map(|p| radiosity[p.point as usize]));
    }

    /// Returns −w B / π n of a point: its radiosity as a source.
    #[inline(always)]
    fn source(&self, point: usize, radiosity: &[[T; 4]]) -> Term<T> {
        let p = &self.points[point];
        let q = T::default() - p.share;
        let b = radiosity[point];
        p.normal.map(|n| b.map(|b| q * n * b))
    }

    /// Computes the S-expansion of a leaf. Overwrites `out`.
    #[inline(always)]
    pub fn leaf(
        &self,
        node: usize,
        radiosity: &[[T; 4]],
        scratch: &mut Scratch<T>,
        out: &mut [Term<T>],
    ) {
        out.fill(Term::default());
        let (center, inverse) = (self.center(node), self.size(node).reciprocal());
        for i in self.nodes[node].source_range() {
            let v = times(minus(center, self.points[i].position), inverse);
            let source = self.source(i, radiosity);
            self.expansions.source(v, &source, scratch, out);
        }
    }

    /// Computes the S-expansion of a node from those of its children. `below` contains them from
    /// node `first` on.
    #[inline(always)]
    pub fn gather(
        &self,
        node: usize,
        below: &[Term<T>],
        first: usize,
        scratch: &mut Scratch<T>,
        out: &mut [Term<T>],
    ) {
        out.fill(Term::default());
        let n = self.terms();
        let (center, inverse) = (self.center(node), self.size(node).reciprocal());
        for c in self.nodes[node].child_range() {
            let v = times(minus(center, self.center(c)), inverse);
            let child = &below[(c - first) * n..(c - first + 1) * n];
            let ratio = self.size(c) * inverse;
            self.expansions.s_to_s(v, ratio, child, scratch, out);
        }
    }

    /// Computes the R-expansion of a node from its far and local lists and its parent's expansion.
    /// Overwrites the output. `sources` are all S-expansions.
    #[inline(always)]
    pub fn receive(
        &self,
        node: usize,
        sources: &[Term<T>],
        parent: Option<&[Term<T>]>,
        radiosity: &[[T; 4]],
        scratch: &mut Scratch<T>,
        out: &mut [Term<T>],
    ) {
        out.fill(Term::default());
        let n = self.terms();
        let (center, size) = (self.center(node), self.size(node));
        for entry in self.list(node, 0) {
            let s = entry.source as usize;
            let r = minus(center, self.center(s));
            let sizes = [self.size(s), size];
            let weight = T::from_f64(f64::from(entry.weight));
            let source = &sources[s * n..(s + 1) * n];
            self.expansions
                .s_to_r(r, sizes, weight, source, scratch, out);
        }
        for entry in self.list(node, 1) {
            let weight = T::from_f64(f64::from(entry.weight));
            for i in self.nodes[entry.source as usize].source_range() {
                let r = minus(center, self.points[i].position);
                let source = self.source(i, radiosity);
                self.expansions
                    .point_to_r(r, size, weight, &source, scratch, out);
            }
        }
        if let Some(parent) = parent {
            let of = self.nodes[node].parent as usize;
            let inverse = self.size(of).reciprocal();
            let v = times(minus(center, self.center(of)), inverse);
            self.expansions
                .r_to_r(v, size * inverse, parent, scratch, out);
        }
    }

    /// Computes the vector irradiance at the receivers of a leaf, W/m². Its component along a
    /// point's normal is the irradiance, except for the band of the slack. `local` is the
    /// R-expansion of the leaf. `sources` are all S-expansions.
    #[inline(always)]
    pub fn evaluate(
        &self,
        node: usize,
        sources: &[Term<T>],
        local: &[Term<T>],
        radiosity: &[[T; 4]],
        scratch: &mut Scratch<T>,
        out: &mut [Term<T>],
    ) {
        let n = self.terms();
        let (center, inverse) = (self.center(node), self.size(node).reciprocal());
        let receivers = &self.points[self.nodes[node].receiver_range()];
        for (x, e) in receivers.iter().zip(out.iter_mut()) {
            let v = times(minus(x.position, center), inverse);
            *e = self.expansions.r_at(v, local, scratch);
            for entry in self.list(node, 2) {
                let s = entry.source as usize;
                let r = minus(x.position, self.center(s));
                let source = &sources[s * n..(s + 1) * n];
                let f = self.expansions.s_at(r, self.size(s), source, scratch);
                add(e, T::from_f64(f64::from(entry.weight)), &f);
            }
        }
        // One leaf of sources at a time for all receivers: it stays in the cache.
        for entry in self.list(node, 3) {
            let range = self.nodes[entry.source as usize].source_range();
            let (points, radiosity) = (&self.points[range.clone()], &radiosity[range]);
            let weight = T::from_f64(f64::from(entry.weight));
            for (x, e) in receivers.iter().zip(out.iter_mut()) {
                add(e, weight, &self.evaluate_near(x, points, radiosity));
            }
        }
    }

    /// Evaluates the near list: \[G08\] Eq. (4) with max(0, ·), between points.
    #[inline(always)]
    fn evaluate_near(
        &self,
        x: &FieldPoint<T>,
        sources: &[FieldPoint<T>],
        radiosity: &[[T; 4]],
    ) -> Term<T> {
        let zero = T::default();
        let nearest = T::from_f64(COINCIDENT * COINCIDENT);
        let mut sum = Term::default();
        for (y, b) in sources.iter().zip(radiosity) {
            let r = minus(x.position, y.position);
            let (out, into) = (dot(y.normal, r), zero - dot(x.normal, r));
            let square = dot(r, r);
            if out > zero && into > zero && square > nearest {
                let spread = if self.disks { square + y.share } else { square };
                let k = zero - y.share * out * (square * spread).reciprocal();
                for (sum, r) in sum.iter_mut().zip(r) {
                    for (sum, &b) in sum.iter_mut().zip(b) {
                        *sum += k * r * b;
                    }
                }
            }
        }
        sum
    }
}

#[inline(always)]
fn add<T: Real>(out: &mut Term<T>, factor: T, value: &Term<T>) {
    for (out, value) in out.iter_mut().zip(value) {
        for (out, value) in out.iter_mut().zip(value) {
            *out += factor * *value;
        }
    }
}

/// Returns n·F per color, clamped to zero. NaN becomes zero.
#[must_use]
pub fn component_along<T: Real>(n: [T; 3], f: &Term<T>) -> [T; 4] {
    std::array::from_fn(|c| {
        let e = n[0] * f[0][c] + n[1] * f[1][c] + n[2] * f[2][c];
        if e > T::default() { e } else { T::default() }
    })
}
