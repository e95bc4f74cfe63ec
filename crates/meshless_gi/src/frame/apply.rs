//! Kernel `apply`: product of the operator and the coefficients of the senders, E⃗_i = s_i Σ_j F_ij
//! f_j (\[L08\] Eq. (14) with the links of design D1). The shader processes the rows of the frame's
//! tier in the order of their links ([`row_order`](crate::transport::row_order)). [`LANES`] threads
//! share a row, and each thread sums every [`LANES`]-th link. The sums differ by rounding only.

use super::layout::{SolveParams, VectorIrradiance};
use crate::transport::{Link, Row};
use glam::Vec4;
use rayon::prelude::*;
use std::ops::Range;

/// Threads that share a row on the GPU.
pub const LANES: u32 = 16;

/// Returns E⃗ of one row, W/m². A row without links is black.
#[must_use]
#[inline]
pub fn apply_row(row: &Row, links: &[Link], coefficients: &[[f32; 4]]) -> VectorIrradiance {
    let start = row.start as usize;
    let (mut x, mut y, mut z) = (Vec4::ZERO, Vec4::ZERO, Vec4::ZERO);
    for link in &links[start..start + row.count as usize] {
        let f = Vec4::from_array(coefficients[link.sender() as usize]);
        let v = link.vector();
        x += v.x * f;
        y += v.y * f;
        z += v.z * f;
    }
    VectorIrradiance {
        x: (row.scale * x).to_array(),
        y: (row.scale * y).to_array(),
        z: (row.scale * z).to_array(),
    }
}

/// Fills `out[points]` by `value_of`. Rows that a frame of this tier does not use count as rows
/// without links.
pub(super) fn for_each_row(
    params: &SolveParams,
    rows: &[Row],
    points: Range<usize>,
    out: &mut [VectorIrradiance],
    value_of: impl Fn(&Row) -> VectorIrradiance + Sync,
) {
    let first = points.start;
    out[points]
        .par_iter_mut()
        .with_min_len(64)
        .enumerate()
        .for_each(|(i, e)| {
            let row = &rows[first + i];
            *e = match row.used(params.tier) {
                true => value_of(row),
                false => VectorIrradiance::default(),
            };
        });
}

/// Fills `out[points]`. Rows that a frame of this tier does not use count as rows without links.
pub fn apply(
    params: &SolveParams,
    rows: &[Row],
    links: &[Link],
    points: Range<usize>,
    coefficients: &[[f32; 4]],
    out: &mut [VectorIrradiance],
) {
    for_each_row(params, rows, points, out, |row| {
        apply_row(row, links, coefficients)
    });
}
