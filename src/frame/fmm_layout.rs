//! What the kernels `fmm_up` and `fmm_down` read, as it lies in buffers: nodes, list entries, points and terms of a [`Fmm`]. Lengths are in units of the scene's side.

use crate::transport::fmm::Fmm;
use crate::transport::fmm::lists::Entry;
use crate::transport::fmm::tensor::NONE;
use crate::transport::fmm::tree::COINCIDENT;
use bytemuck::{Pod, Zeroable};

/// Highest order that the kernels take: what a workgroup's memory holds.
pub const MOST_FMM_ORDER: usize = 6;
/// Terms of that order.
pub const MOST_FMM_TERMS: usize = 84;

/// A node of the octree. 64 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct FmmNode {
    /// Centre of its expansions.
    pub center: [f32; 3],
    /// Their unit of length.
    pub size: f32,
    /// First of its points.
    pub start: u32,
    /// One past the last.
    pub end: u32,
    /// First child.
    pub first_child: u32,
    /// How many children; none for a leaf.
    pub children: u32,
    /// Its parent.
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
    /// Not used.
    pub pad: [u32; 2],
}

/// An entry of a list. 8 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct FmmEntry {
    /// The source's node.
    pub source: u32,
    /// The part of its light that arrives.
    pub weight: f32,
}

/// A point. 32 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct FmmPlace {
    /// Position.
    pub position: [f32; 3],
    /// Its surface over π.
    pub share: f32,
    /// Unit normal.
    pub normal: [f32; 3],
    /// Not used.
    pub pad: u32,
}

/// A term of the expansions. 48 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct FmmTerm {
    /// Places of the terms that are less by one x, y, z, by two x, y, z, by xy, xz, yz; [`NO_TERM`] where there is none.
    pub down: [u32; 9],
    /// Exponents of x, y and z, eight bits each.
    pub exponents: u32,
    /// Degree.
    pub degree: u32,
    /// Product of the factorials of the exponents.
    pub factorial: f32,
}

/// No such term.
pub const NO_TERM: u32 = u32::MAX;

/// What does not change from node to node. 16 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct FmmParams {
    /// Order of the expansions.
    pub order: u32,
    /// Terms of the expansions.
    pub terms: u32,
    /// 1 where sources near by are disks.
    pub disks: u32,
    /// Squared distance up to which points are one place.
    pub nearest: f32,
}

/// Everything that goes onto a device once.
#[derive(Clone, Debug, Default)]
pub struct FmmArrays {
    /// Parameters.
    pub params: FmmParams,
    /// Nodes, level after level.
    pub nodes: Vec<FmmNode>,
    /// List entries, node after node: far, local, multipole, near.
    pub entries: Vec<FmmEntry>,
    /// Points in the tree's order.
    pub places: Vec<FmmPlace>,
    /// Terms.
    pub terms: Vec<FmmTerm>,
}

impl FmmArrays {
    /// Of a tree and its lists.
    #[must_use]
    pub fn new(fmm: &Fmm) -> Self {
        let (tree, lists, e) = (fmm.tree(), fmm.lists(), fmm.expansions());
        let mut entries = Vec::new();
        let mut put = |list: &[Entry]| {
            let first = entries.len() as u32;
            entries.extend(list.iter().map(|e| FmmEntry {
                source: e.source,
                weight: e.weight,
            }));
            first
        };
        let nodes = tree.nodes.iter().enumerate().map(|(i, n)| {
            let [far, local, multipole, near] =
                [&lists.far, &lists.local, &lists.multipole, &lists.near]
                    .map(|list| put(list.of(i)));
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
                finish: near + lists.near.of(i).len() as u32,
                pad: [0; 2],
            }
        });
        let nodes = nodes.collect();
        let places = tree.points.iter().map(|p| FmmPlace {
            position: p.position.as_vec3().to_array(),
            share: (p.weight / core::f64::consts::PI) as f32,
            normal: p.normal.as_vec3().to_array(),
            pad: 0,
        });
        let terms = (0..e.terms.len()).map(|i| {
            let down = e.derivatives.down()[i];
            let [x, y, z] = e.terms.exponents()[i].map(|k| k as u32);
            FmmTerm {
                down: down.map(|at| if at == NONE { NO_TERM } else { u32::from(at) }),
                exponents: x | y << 8 | z << 16,
                degree: e.terms.degree(i) as u32,
                factorial: e.terms.factorials()[i] as f32,
            }
        });
        Self {
            params: FmmParams {
                order: e.terms.order() as u32,
                terms: e.terms.len() as u32,
                disks: u32::from(fmm.settings().disks),
                nearest: (COINCIDENT * COINCIDENT) as f32,
            },
            nodes,
            entries,
            places: places.collect(),
            terms: terms.collect(),
        }
    }
}
