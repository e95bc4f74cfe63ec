//! Expansion terms and parameters that the kernels `fmm_up` and `fmm_down` read in addition to the
//! arrays of an [`FmmOperator`]. Lengths are in units of the scene's side.

use crate::transport::fmm::FmmOperator;
use crate::transport::fmm::tensor::NONE;
use crate::transport::fmm::tree::COINCIDENT;
use bytemuck::{Pod, Zeroable};

pub use crate::transport::fmm::lists::ListEntry as FmmEntry;
pub use crate::transport::fmm::{FmmNode, FmmOperatorPoint};

/// Highest order that the kernels support, limited by the memory of a workgroup.
pub const MAX_FMM_ORDER: usize = 6;
/// Number of terms of that order.
pub const MAX_FMM_TERMS: usize = 84;

/// Term of the expansions. 48 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct FmmTerm {
    /// Indices of the terms that result from division by x, y, z, x², y², z², xy, xz and yz.
    /// [`NO_TERM`] if a term does not exist.
    pub down: [u32; 9],
    /// Exponents of x, y and z, eight bits each.
    pub exponents: u32,
    /// Degree.
    pub degree: u32,
    /// Product of the factorials of the exponents.
    pub factorial: f32,
}

/// Index of a term that does not exist.
pub const NO_TERM: u32 = u32::MAX;

/// Parameters that are equal for all nodes. 32 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct FmmParams {
    /// Order of the expansions.
    pub order: u32,
    /// Number of terms of the expansions.
    pub terms: u32,
    /// 1 if near sources are disks.
    pub disks: u32,
    /// Squared distance up to which points coincide.
    pub nearest: f32,
    /// Index of the sky's coefficient among the radiosities.
    pub sky: u32,
    /// Padding, not used.
    pub pad: [u32; 3],
}

impl FmmParams {
    /// Creates the parameters of an octree. `sky` is the index of the sky's coefficient.
    #[must_use]
    pub fn new(operator: &FmmOperator, sky: u32) -> Self {
        Self {
            order: operator.order,
            terms: operator.terms() as u32,
            disks: u32::from(operator.disks),
            nearest: (COINCIDENT * COINCIDENT) as f32,
            sky,
            pad: [0; 3],
        }
    }
}

/// Returns the terms of an octree's order.
#[must_use]
pub fn fmm_terms(operator: &FmmOperator) -> Vec<FmmTerm> {
    let e = operator.expansions();
    let term = |i: usize| {
        let down = e.derivatives.down()[i];
        let [x, y, z] = e.terms.exponents()[i].map(|k| k as u32);
        FmmTerm {
            down: down.map(|at| if at == NONE { NO_TERM } else { u32::from(at) }),
            exponents: x | y << 8 | z << 16,
            degree: e.terms.degree(i) as u32,
            factorial: e.terms.factorials()[i] as f32,
        }
    };
    (0..e.terms.len()).map(term).collect()
}
