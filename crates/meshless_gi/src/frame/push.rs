//! Kernel `push`: converts averages to differences, α_j = f_j − Σ_k w_jk α_k over the coarser
//! levels (\[L08\] Eq. (7)). One dispatch per level, coarse to fine. Only operators in the form of
//! differences need it.

use crate::basis::Weights;
use glam::Vec4;
use std::ops::Range;

/// Computes the differences of the senders `level`.
pub fn push(
    parents: &Weights,
    level: Range<usize>,
    senders: &[[f32; 4]],
    differences: &mut [[f32; 4]],
) {
    for j in level {
        let mut alpha = Vec4::from_array(senders[j]);
        for entry in parents.row(j) {
            alpha -= entry.weight * Vec4::from_array(differences[entry.index as usize]);
        }
        differences[j] = alpha.to_array();
    }
}
