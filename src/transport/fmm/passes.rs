//! The upward and the downward pass node by node (\[G08\] §3.0.1 to §3.1.6), in either precision: what threads share out on the CPU, and what the kernels `fmm_up` and
//! `fmm_down` do on the GPU.
//!
//! | pass | step | of \[G08\] |
//! |---|---|---|
//! | up | [`Field::leaf`] | §3.0.1: S-expansions of the leaves |
//! | up | [`Field::gather`] | §3.0.2: S→S, level after level |
//! | down | [`Field::receive`] | §3.1.1 to §3.1.3: far list, local list, R→R, level after level |
//! | down | [`Field::evaluate`] | §3.1.4 to §3.1.6: R-expansion, near list, multipole list, at every point |

use super::expansion::{Expansions, Scratch, Term};
use super::lists::{List, Lists};
use super::real::Real;
use super::tree::{COINCIDENT, Tree};

/// A point as the passes need it, in units of the scene.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FieldPoint<T> {
    /// Position.
    pub position: [T; 3],
    /// Unit normal.
    pub normal: [T; 3],
    /// Weight over π.
    pub share: T,
}

/// Everything that does not change from one solve to the next.
#[derive(Clone, Debug)]
pub struct Field<'a, T> {
    /// Nodes.
    pub tree: &'a Tree,
    /// Lists.
    pub lists: &'a Lists,
    /// Tables.
    pub expansions: &'a Expansions,
    /// Points in the tree's order.
    pub points: Vec<FieldPoint<T>>,
    /// Sources near by are disks.
    pub disks: bool,
}

fn minus<T: Real>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    std::array::from_fn(|i| a[i] - b[i])
}

fn times<T: Real>(a: [T; 3], f: T) -> [T; 3] {
    a.map(|c| c * f)
}

fn dot<T: Real>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// n·F in each colour.
fn facing<T: Real>(n: [T; 3], f: &Term<T>) -> [T; 4] {
    std::array::from_fn(|c| n[0] * f[0][c] + n[1] * f[1][c] + n[2] * f[2][c])
}

impl<'a, T: Real> Field<'a, T> {
    /// Of a tree and its lists.
    #[must_use]
    pub fn new(tree: &'a Tree, lists: &'a Lists, expansions: &'a Expansions, disks: bool) -> Self {
        let narrow = |v: glam::DVec3| v.to_array().map(T::of);
        let points = tree.points.iter().map(|p| FieldPoint {
            position: narrow(p.position),
            normal: narrow(p.normal),
            share: T::of(p.weight / core::f64::consts::PI),
        });
        Self {
            tree,
            lists,
            expansions,
            points: points.collect(),
            disks,
        }
    }

    /// Terms of an expansion.
    #[must_use]
    pub fn terms(&self) -> usize {
        self.expansions.terms.len()
    }

    fn center(&self, node: usize) -> [T; 3] {
        self.tree.nodes[node].center.to_array().map(T::of)
    }

    fn size(&self, node: usize) -> T {
        T::of(self.tree.nodes[node].size)
    }

    /// −w B / π n of a point: its radiosity as a source.
    fn source(&self, point: usize, radiosity: [T; 4]) -> Term<T> {
        let p = &self.points[point];
        let q = T::default() - p.share;
        p.normal.map(|n| radiosity.map(|b| q * n * b))
    }

    /// The S-expansion of a leaf, from nothing.
    pub fn leaf(
        &self,
        node: usize,
        radiosity: &[[T; 4]],
        scratch: &mut Scratch<T>,
        out: &mut [Term<T>],
    ) {
        out.fill(Term::default());
        let (center, inverse) = (self.center(node), self.size(node).reciprocal());
        for i in self.tree.nodes[node].points() {
            let v = times(minus(center, self.points[i].position), inverse);
            let source = self.source(i, radiosity[i]);
            self.expansions.source(v, &source, scratch, out);
        }
    }

    /// The S-expansion of a node from its children's, which `below` holds from node `first` on.
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
        for c in self.tree.nodes[node].child_range() {
            let v = times(minus(center, self.center(c)), inverse);
            let child = &below[(c - first) * n..(c - first + 1) * n];
            let ratio = self.size(c) * inverse;
            self.expansions.s_to_s(v, ratio, child, scratch, out);
        }
    }

    /// The R-expansion of a node, from nothing: its far and local lists, and its parent's expansion. `sources` are all S-expansions.
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
        for entry in self.lists.far.of(node) {
            let s = entry.source as usize;
            let r = minus(center, self.center(s));
            let sizes = [self.size(s), size];
            let weight = T::of(f64::from(entry.weight));
            let source = &sources[s * n..(s + 1) * n];
            self.expansions
                .s_to_r(r, sizes, weight, source, scratch, out);
        }
        for entry in self.lists.local.of(node) {
            let weight = T::of(f64::from(entry.weight));
            for i in self.tree.nodes[entry.source as usize].points() {
                let r = minus(center, self.points[i].position);
                let source = self.source(i, radiosity[i]);
                self.expansions
                    .point_to_r(r, size, weight, &source, scratch, out);
            }
        }
        if let Some(parent) = parent {
            let of = self.tree.nodes[node].parent as usize;
            let inverse = self.size(of).reciprocal();
            let v = times(minus(center, self.center(of)), inverse);
            self.expansions
                .r_to_r(v, size * inverse, parent, scratch, out);
        }
    }

    /// Irradiance at the points of a leaf, W/m², not below zero. `local` is its R-expansion, `sources` are all S-expansions.
    pub fn evaluate(
        &self,
        node: usize,
        sources: &[Term<T>],
        local: &[Term<T>],
        radiosity: &[[T; 4]],
        scratch: &mut Scratch<T>,
        out: &mut [[T; 4]],
    ) {
        let n = self.terms();
        let (center, inverse) = (self.center(node), self.size(node).reciprocal());
        let range = self.tree.nodes[node].points();
        for (x, e) in self.points[range].iter().zip(out) {
            let v = times(minus(x.position, center), inverse);
            *e = facing(x.normal, &self.expansions.r_at(v, local, scratch));
            for entry in self.lists.multipole.of(node) {
                let s = entry.source as usize;
                let r = minus(x.position, self.center(s));
                let source = &sources[s * n..(s + 1) * n];
                let f = self.expansions.s_at(r, self.size(s), source, scratch);
                add(e, T::of(f64::from(entry.weight)), facing(x.normal, &f));
            }
            self.near(x, &self.lists.near, node, radiosity, e);
            for c in e {
                // A comparison that takes NaN to zero too; there is none in a test.
                *c = if *c > T::default() { *c } else { T::default() };
            }
        }
    }

    /// The near list: \[G08\] Eq. (4) with max(0, ·), between points.
    fn near(
        &self,
        x: &FieldPoint<T>,
        near: &List,
        node: usize,
        radiosity: &[[T; 4]],
        e: &mut [T; 4],
    ) {
        let zero = T::default();
        let nearest = T::of(COINCIDENT * COINCIDENT);
        for entry in near.of(node) {
            let mut sum = [zero; 4];
            for i in self.tree.nodes[entry.source as usize].points() {
                let y = &self.points[i];
                let r = minus(x.position, y.position);
                let (out, into) = (dot(y.normal, r), zero - dot(x.normal, r));
                let square = dot(r, r);
                if out > zero && into > zero && square > nearest {
                    let spread = if self.disks { square + y.share } else { square };
                    let k = y.share * out * into * (square * spread).reciprocal();
                    add(&mut sum, k, radiosity[i]);
                }
            }
            add(e, T::of(f64::from(entry.weight)), sum);
        }
    }
}

fn add<T: Real>(out: &mut [T; 4], factor: T, value: [T; 4]) {
    for c in 0..4 {
        out[c] += factor * value[c];
    }
}
