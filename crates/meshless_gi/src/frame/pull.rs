//! Kernel `pull`: sets a sender's coefficient to the mean of the next finer level over its support
//! (\[L08\] §2.1, the "pull" half of pull-push). One dispatch per level, fine to coarse.

use crate::basis::Weights;
use glam::Vec4;
use std::ops::Range;

/// Replaces the coefficients of the senders `level` by means over the next finer level. A sender
/// with an empty row keeps its coefficient.
pub fn pull(weights: &Weights, level: Range<usize>, senders: &mut [[f32; 4]]) {
    for k in level {
        let row = weights.row(k);
        if row.is_empty() {
            continue;
        }
        let mut sum = Vec4::ZERO;
        for entry in row {
            sum += entry.weight * Vec4::from_array(senders[entry.index as usize]);
        }
        senders[k] = sum.to_array();
    }
}
