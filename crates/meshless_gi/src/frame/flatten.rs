//! Kernel `flatten`: brings all points to one level (\[L08\] §4.1 "Flattening"), so that the screen
//! needs one basis only. A point without a row of its own, or with one that the frame's tier leaves
//! out (design D11), takes what the coarser functions say there.

use super::layout::{SolveParams, VectorIrradiance};
use crate::basis::Weights;
use crate::transport::Row;
use rayon::prelude::*;
use std::ops::Range;

/// Averages: the points of `level` whose rows a frame of this tier does not use take the weighted
/// mean of their parents. Coarse levels first; the others keep what `apply` wrote.
pub fn averages(
    params: &SolveParams,
    rows: &[Row],
    parents: &Weights,
    level: Range<usize>,
    values: &mut [VectorIrradiance],
) {
    let first = level.start;
    let (coarser, rest) = values.split_at_mut(first);
    rest[..level.len()]
        .par_iter_mut()
        .with_min_len(256)
        .enumerate()
        .for_each(|(i, value)| {
            let i = first + i;
            if rows[i].used(params.tier) {
                return;
            }
            let mut sum = VectorIrradiance::default();
            for entry in parents.row(i) {
                sum.add_scaled(entry.weight, &coarser[entry.index as usize]);
            }
            *value = sum;
        });
}

/// Differences: the value of a point is its own difference and those of all coarser functions there
/// (\[L08\] Eq. (17)). All levels at once, for the differences are not changed. `applied` is zero
/// for points without rows; differences have one tier.
pub fn differences(
    parents: &Weights,
    points: Range<usize>,
    applied: &[VectorIrradiance],
    values: &mut [VectorIrradiance],
) {
    let first = points.start;
    values[points]
        .par_iter_mut()
        .with_min_len(256)
        .enumerate()
        .for_each(|(i, value)| {
            let i = first + i;
            let mut sum = applied[i];
            for entry in parents.row(i) {
                sum.add_scaled(entry.weight, &applied[entry.index as usize]);
            }
            *value = sum;
        });
}
