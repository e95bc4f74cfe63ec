//! Kernel `compress`: radiosity of the senders in the bases of an operator of components, c = D b
//! (\[P14\] Eq. (10), without its mean vector). The last column is the sky's. The shader has one
//! workgroup per column. The sums differ by rounding only.

use crate::transport::pca::Compression;
use glam::Vec4;
use rayon::prelude::*;

/// Threads that share a column on the GPU.
pub const LANES: u32 = 64;

/// Returns the coefficient of column `c`, W/m² times the vector's unit (dimensionless).
#[must_use]
#[inline]
pub fn compress_column(compression: &Compression, c: usize, senders: &[[f32; 4]]) -> [f32; 4] {
    let mut sum = Vec4::ZERO;
    for (j, value) in compression.column(c) {
        sum += value * Vec4::from_array(senders[j as usize]);
    }
    sum.to_array()
}

/// Fills the coefficients of all columns.
pub fn compress(compression: &Compression, senders: &[[f32; 4]], components: &mut [[f32; 4]]) {
    components
        .par_iter_mut()
        .with_min_len(16)
        .enumerate()
        .for_each(|(c, out)| *out = compress_column(compression, c, senders));
}
