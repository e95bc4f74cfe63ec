//! Kernel `apply_one`: [`apply`](super::apply::apply()) in one channel. It requires gray surfaces
//! and light of one chromaticity ([`Channels::One`](super::Channels::One)): E⃗_i = h s_i Σ_j F_ij
//! f_j (\[L08\] Eq. (14)). f_j is the channel of the coefficients that is largest in the
//! chromaticity h. The kernel computes a third of the products and loads a third of the
//! coefficients. The output has three channels, so that later kernels do not differ.

use super::apply::for_each_row;
use super::layout::{SolveParams, VectorIrradiance};
use crate::transport::{Link, Row};
use glam::Vec3;
use std::ops::Range;

/// Returns E⃗ of one row, W/m², from channel `channel` of the coefficients. `hue` has the ratio of
/// each channel to that channel. A row without links is black.
#[must_use]
#[inline]
pub fn apply_one_row(
    row: &Row,
    links: &[Link],
    coefficients: &[[f32; 4]],
    channel: usize,
    hue: [f32; 4],
) -> VectorIrradiance {
    let start = row.start as usize;
    let mut sum = Vec3::ZERO;
    for link in &links[start..start + row.count as usize] {
        sum += link.vector() * coefficients[link.sender() as usize][channel];
    }
    let e = row.scale * sum;
    let [x, y, z] = e.to_array().map(|e| {
        let [r, g, b, _] = hue.map(|h| h * e);
        [r, g, b, 0.0]
    });
    VectorIrradiance { x, y, z }
}

/// Fills `out[points]`. Rows that a frame of this tier does not use count as rows without links.
pub fn apply_one(
    params: &SolveParams,
    rows: &[Row],
    links: &[Link],
    points: Range<usize>,
    coefficients: &[[f32; 4]],
    out: &mut [VectorIrradiance],
) {
    let (channel, hue) = (params.channel as usize, params.hue);
    for_each_row(params, rows, points, out, |row| {
        apply_one_row(row, links, coefficients, channel, hue)
    });
}
