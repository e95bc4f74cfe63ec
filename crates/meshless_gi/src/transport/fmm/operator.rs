//! Octree with its lists, as a bake stores it, a frame reads it and the GPU binds it: plain arrays
//! in single precision. Lengths are in units of the scene's side, so that the data does not depend
//! on the scene's size.

use super::expansion::Expansions;
use super::lists::{ListEntry, Lists};
use super::tree::Tree;
use bytemuck::{Pod, Zeroable};
use std::ops::Range;

/// Node of the octree. 64 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct FmmNode {
    /// Center of its expansions.
    pub center: [f32; 3],
    /// Unit of length of its expansions.
    pub size: f32,
    /// First of its points.
    pub start: u32,
    /// One past the last.
    pub end: u32,
    /// First child.
    pub first_child: u32,
    /// Number of children. 0 for a leaf.
    pub children: u32,
    /// Its parent. The root is its own parent.
    pub parent: u32,
    /// First entry of its far list.
    pub far: u32,
    /// First entry of its local list, and one past the far list.
    pub local: u32,
    /// First entry of its multipole list, and one past the local list.
    pub multipole: u32,
    /// First entry of its near list, and one past the multipole list.
    pub near: u32,
    /// One past its near list.
    pub finish: u32,
    /// One past the points of a leaf that emit.
    pub sources: u32,
    /// First of the points of a leaf that receive.
    pub receivers: u32,
}

impl FmmNode {
    /// Returns `true` if it has no children.
    #[must_use]
    pub fn is_leaf(&self) -> bool {
        self.children == 0
    }

    /// Returns the range of its points.
    #[must_use]
    pub fn points(&self) -> Range<usize> {
        self.start as usize..self.end as usize
    }

    /// Returns the points of a leaf that emit.
    #[must_use]
    pub fn source_range(&self) -> Range<usize> {
        self.start as usize..self.sources as usize
    }

    /// Returns the points of a leaf that receive.
    #[must_use]
    pub fn receiver_range(&self) -> Range<usize> {
        self.receivers as usize..self.end as usize
    }

    /// Returns the range of its children.
    #[must_use]
    pub fn child_range(&self) -> Range<usize> {
        self.first_child as usize..(self.first_child + self.children) as usize
    }

    /// Returns the entries of its four lists: far, local, multipole, near.
    #[must_use]
    pub fn lists(&self) -> [Range<usize>; 4] {
        let ends = [self.far, self.local, self.multipole, self.near, self.finish];
        [0, 1, 2, 3].map(|k| ends[k] as usize..ends[k + 1] as usize)
    }
}

/// Point of the octree. 48 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct FmmOperatorPoint {
    /// Position.
    pub position: [f32; 3],
    /// Its surface area over π. 0 if it does not emit.
    pub share: f32,
    /// Unit normal.
    pub normal: [f32; 3],
    /// Index of the point of the octree's input whose radiosity it sends and whose irradiance it
    /// receives.
    pub point: u32,
    /// (1/π) ∫ ω dω over the visible sky, if it receives.
    pub sky: [f32; 3],
    /// Factor of the irradiance from other points. It makes the irradiance of uniform light exact.
    pub factor: f32,
}

/// Octree: the data of the fast multipole method that does not depend on the lights.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FmmOperator {
    /// Order of the expansions.
    pub order: u32,
    /// `true` if close sources are disks ([`FmmSettings::disks`](super::FmmSettings::disks)).
    pub disks: bool,
    /// First node of each level, and one past the last node.
    pub level_starts: Vec<u32>,
    /// Nodes, sorted by level from the root.
    pub nodes: Vec<FmmNode>,
    /// List entries, sorted by node: far, local, multipole, near.
    pub entries: Vec<ListEntry>,
    /// Points, sorted by leaf.
    pub points: Vec<FmmOperatorPoint>,
}

impl FmmOperator {
    /// Builds the operator from a tree and its lists. Sky visibility is zero until it is set.
    /// `point` maps a point of the tree's input to the baked point that sends and receives for it.
    #[must_use]
    pub fn new(
        tree: &Tree,
        lists: &Lists,
        order: usize,
        disks: bool,
        point: impl Fn(u32) -> u32,
    ) -> Self {
        let mut entries = Vec::new();
        let mut put = |list: &[ListEntry]| {
            let first = entries.len() as u32;
            entries.extend_from_slice(list);
            first
        };
        let nodes = tree.nodes.iter().enumerate().map(|(i, n)| {
            let [far, local, multipole, near] =
                [&lists.far, &lists.local, &lists.multipole, &lists.near]
                    .map(|list| put(list.entries_of(i)));
            FmmNode {
                center: n.center.as_vec3().to_array(),
                size: n.size as f32,
                start: n.start,
                end: n.end,
                first_child: n.first_child,
                children: n.children,
                parent: n.parent,
                far,
                local,
                multipole,
                near,
                finish: near + lists.near.entries_of(i).len() as u32,
                sources: n.source_range().end as u32,
                receivers: n.receiver_range().start as u32,
            }
        });
        let nodes = nodes.collect();
        let points = tree
            .points
            .iter()
            .zip(&tree.order)
            .map(|(p, &at)| FmmOperatorPoint {
                position: p.position.as_vec3().to_array(),
                share: (p.weight / core::f64::consts::PI) as f32,
                normal: p.normal.as_vec3().to_array(),
                point: point(at),
                sky: [0.0; 3],
                factor: 1.0,
            });
        Self {
            order: order as u32,
            disks,
            level_starts: tree.level_starts.clone(),
            nodes,
            entries,
            points: points.collect(),
        }
    }

    /// Returns the number of levels.
    #[must_use]
    pub fn levels(&self) -> usize {
        self.level_starts.len().saturating_sub(1)
    }

    /// Returns the nodes of a level.
    #[must_use]
    pub fn level(&self, l: usize) -> Range<usize> {
        self.level_starts[l] as usize..self.level_starts[l + 1] as usize
    }

    /// Computes the tables of its order.
    #[must_use]
    pub fn expansions(&self) -> Expansions {
        Expansions::new(self.order as usize)
    }

    /// Returns the number of terms of an expansion.
    #[must_use]
    pub fn terms(&self) -> usize {
        super::terms::count(self.order as usize)
    }

    /// Returns the size of its arrays in bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        (size_of_val(&self.level_starts[..])
            + size_of_val(&self.nodes[..])
            + size_of_val(&self.entries[..])
            + size_of_val(&self.points[..])) as u64
    }

    /// Returns the size in bytes of the S- or R-expansions of all nodes, the largest array of a
    /// solve.
    #[must_use]
    pub fn expansion_bytes(&self) -> u64 {
        (48 * self.terms() * self.nodes.len()) as u64
    }

    /// Returns the approximate cost of a pass, in products of three numbers and a color. A link of
    /// the sparse operator costs one such product.
    #[must_use]
    pub fn work(&self) -> u64 {
        let p = f64::from(self.order);
        let terms = self.terms() as f64;
        let pair: f64 = (1..=6).map(|k| (p + f64::from(k)) / f64::from(k)).product();
        let mut work = 0.0;
        for node in &self.nodes {
            let [far, local, multipole, near] = node.lists();
            let receivers = node.receiver_range().len() as f64;
            let sources = |range: Range<usize>| -> f64 {
                let of = |e: &ListEntry| self.nodes[e.source as usize].source_range().len() as f64;
                self.entries[range].iter().map(of).sum()
            };
            // Six different numbers per derivative, nine products. Includes the translations to the
            // parent and back.
            work += 3.0 * far.len() as f64 * (pair + 3.0 * terms)
                + 3.0 * sources(local) * terms
                + 3.0 * multipole.len() as f64 * receivers * terms
                + sources(near) * receivers
                + 2.0 * pair;
            if node.is_leaf() {
                work += terms * (node.source_range().len() as f64 + receivers);
            }
        }
        work as u64
    }
}
