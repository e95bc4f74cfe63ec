//! Kernel `flatten`: converts all points to one level (\[L08\] §4.1 "Flattening"), so that the
//! screen needs one basis only. A point without its own row takes the value of the coarser basis
//! functions there. The same applies to a point with a row that the frame's tier omits (design
//! D11).

use super::layout::{SolveParams, VectorIrradiance};
use crate::basis::Weights;
use crate::transport::Row;
use rayon::prelude::*;
use std::ops::Range;

/// Computes the values of averages. Points of `level` get the weighted mean of their parents if a
/// frame of this tier does not use their rows. The other points keep the values that `apply` wrote.
/// Coarse levels come first.
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

/// Computes the values of differences. The value of a point is the sum of its own difference and
/// those of all coarser functions there (\[L08\] Eq. (17)). One call covers all levels, because the
/// differences do not change. `applied` is zero for points without rows. Differences have one tier.
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
