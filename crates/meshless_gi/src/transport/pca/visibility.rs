//! Stored visibility of surface points: compressed hemispherical depth ([P14] §4.2, §4.4).
//! [`bake_visibility`](super::bake_visibility) computes it, the asset stores it, and soft shadows
//! read it.
//!
//! A depth is the mean of the point's cluster plus the point's coefficients times the cluster's
//! components (\[P14\] Eq. (9)). Deviations:
//!
//! - **e = d² / (d² + s²) instead of d**, with s per cluster. No hit is e = 1. Exact distances of
//!   near geometry do not matter, since it occludes a light in any case. Differences of far depths
//!   separate a light from objects in front of it. With d, or d / (d + s), the components represent
//!   mainly near geometry.
//! - **Errors are stored**: each cluster has the root mean square error of its components for each
//!   direction. Each point has its error relative to that of the cluster. The error determines the
//!   width of a depth comparison.
//! - **Components are signed 8-bit numbers**. Means, errors and coefficients are signed 16-bit
//!   numbers, with a scale for each component of each cluster. \[P14\] §4.4 stores all numbers with
//!   16 bits. Components take most of the memory, and more directions are worth more than higher
//!   precision. The stored error includes their rounding.
//! - **Coefficients are sparse** (\[P14\] §4.4): a mask has one bit per stored component.

use super::HemisphereGrid;
use crate::samples::tangents;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// Largest depth relative to s.
pub const MAX_RATIO: f32 = 1e9;

/// Basis of a cluster. 32 bytes, the layout of `VisibilityCluster` in the shaders.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct VisibilityCluster {
    /// Unit vector of the first axis of its points' frames.
    pub tangent: [f32; 3],
    /// Number of components, without the mean.
    pub components: u32,
    /// Start of its part of [`Visibility::basis`]: direction after direction,
    /// [`words`](Self::words) each.
    pub basis: u32,
    /// Start of its part of [`Visibility::scales`]: of the mean, of the error, then of each
    /// component.
    pub scales: u32,
    /// s of e = d² / (d² + s²), meters.
    pub near: f32,
    /// Padding, not used.
    pub pad: u32,
}

impl VisibilityCluster {
    /// Returns the value e of a hit at `distance` meters.
    #[must_use]
    #[inline]
    pub fn encode(&self, distance: f32) -> f32 {
        encode(distance, self.near)
    }

    /// Returns the number of words of the basis per direction: one for mean and error, then one per
    /// four components.
    #[must_use]
    pub fn words(&self) -> usize {
        (self.components as usize).div_ceil(4) + 1
    }
}

/// Coefficients of a point. 32 bytes, the layout of `VisiblePoint` in the shaders.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct VisiblePoint {
    /// Cluster.
    pub cluster: u32,
    /// First coefficient, in halves of the words of [`Visibility::coefficients`].
    pub first: u32,
    /// Error of its depths relative to that of its cluster, in units of 1 / [`VisiblePoint::ONE`].
    pub error: u32,
    /// Padding, not used.
    pub pad: u32,
    /// Mask of the components with a coefficient, bit j for component j.
    pub mask: [u32; 4],
}

impl VisiblePoint {
    /// Value of [`VisiblePoint::error`] for a point with the same error as its cluster.
    pub const ONE: u32 = 32;

    /// Computes the error of a point with mean square `square` in a cluster with mean square
    /// `mean`. The result is rounded up and at least 1.
    pub(super) fn error_of(square: f32, mean: f32) -> u32 {
        if mean > 0.0 {
            ((square / mean).sqrt() * Self::ONE as f32).ceil().max(1.0) as u32
        } else {
            Self::ONE
        }
    }

    /// Returns the number of coefficients.
    #[must_use]
    pub fn count(&self) -> u32 {
        self.mask.iter().map(|m| m.count_ones()).sum()
    }
}

/// Visibility of the first points of a baked scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Visibility {
    /// Directions.
    pub grid: HemisphereGrid,
    /// Clusters.
    pub clusters: Vec<VisibilityCluster>,
    /// One entry per point.
    pub points: Vec<VisiblePoint>,
    /// Mean and error of each direction as two signed normalized 16-bit numbers in a word, then its
    /// components as four signed normalized 8-bit numbers per word.
    pub basis: Vec<u32>,
    /// Scales of the basis and of the coefficients.
    pub scales: Vec<f32>,
    /// Coefficients, two signed normalized 16-bit numbers per word.
    pub coefficients: Vec<u32>,
}

impl Visibility {
    /// Largest number of components of a cluster: the number of bits of a point's mask.
    pub const MAX_COMPONENTS: u32 = 128;

    /// Returns the size of all arrays in bytes, in memory and on the device.
    #[must_use]
    pub fn bytes(&self) -> usize {
        32 * (self.clusters.len() + self.points.len())
            + 4 * (self.basis.len() + self.scales.len() + self.coefficients.len())
    }

    /// Returns the part of the coefficients that is stored.
    #[must_use]
    pub fn kept(&self) -> f64 {
        let all: u64 = self
            .points
            .iter()
            .map(|p| u64::from(self.clusters[p.cluster as usize].components))
            .sum();
        let kept: u64 = self.points.iter().map(|p| u64::from(p.count())).sum();
        kept as f64 / all.max(1) as f64
    }

    /// Sets the start of the arrays of each cluster and point from their numbers of components and
    /// coefficients. Returns the lengths of the arrays: words of the basis, scales, words of the
    /// coefficients. Returns `None` if a length exceeds 32 bits, or a point has an invalid cluster.
    #[must_use]
    pub fn layout(&mut self) -> Option<(usize, usize, usize)> {
        let (mut basis, mut scales) = (0u32, 0u32);
        for cluster in &mut self.clusters {
            (cluster.basis, cluster.scales) = (basis, scales);
            let words = cluster.components.min(Self::MAX_COMPONENTS).div_ceil(4) + 1;
            let length = u32::try_from(self.grid.len()).ok()?;
            basis = basis.checked_add(words.checked_mul(length)?)?;
            scales = scales.checked_add(cluster.components.min(Self::MAX_COMPONENTS) + 2)?;
        }
        // Ordered by cluster, then by index of the point.
        let mut next = vec![0u32; self.clusters.len() + 1];
        for point in &self.points {
            let count = next.get_mut(point.cluster as usize + 1)?;
            *count = count.checked_add(point.count())?;
        }
        for c in 0..self.clusters.len() {
            next[c + 1] = next[c + 1].checked_add(next[c])?;
        }
        let end = next[self.clusters.len()];
        for point in &mut self.points {
            let first = &mut next[point.cluster as usize];
            point.first = *first;
            *first += point.count();
        }
        Some((basis as usize, scales as usize, end.div_ceil(2) as usize))
    }

    /// Returns the stored coefficient at `at`.
    pub(super) fn coefficient(&self, at: u32) -> u16 {
        (self.coefficients[at as usize / 2] >> (16 * (at % 2))) as u16
    }

    /// Writes the coefficients of point `i` with their scales to `out`: one for the mean, one for
    /// the error, then one per component. Returns their number.
    #[inline]
    pub fn decode(&self, i: usize, out: &mut [f32; Self::MAX_COMPONENTS as usize + 2]) -> usize {
        let point = &self.points[i];
        let cluster = &self.clusters[point.cluster as usize];
        let scales = &self.scales[cluster.scales as usize..];
        let own = point.error as f32 / VisiblePoint::ONE as f32;
        (out[0], out[1]) = (scales[0], scales[1] * own);
        let mut at = point.first;
        for j in 0..cluster.components as usize {
            out[j + 2] = 0.0;
            if point.mask[j / 32] >> (j % 32) & 1 != 0 {
                out[j + 2] = scales[j + 2] * from_snorm(self.coefficient(at));
                at += 1;
            }
        }
        cluster.components as usize + 2
    }

    /// Computes the value e in direction `texel` of a point of `cluster` with these decoded
    /// coefficients (\[P14\] Eq. (9)). Also returns its root mean square error over the points of
    /// the cluster.
    #[must_use]
    #[inline]
    pub fn reconstruct(
        &self,
        cluster: &VisibilityCluster,
        decoded: &[f32],
        texel: u32,
    ) -> (f32, f32) {
        let words = cluster.words();
        let start = cluster.basis as usize + texel as usize * words;
        let basis = &self.basis[start..start + words];
        let mut e = decoded[0] * from_snorm(basis[0] as u16);
        let error = decoded[1] * from_snorm((basis[0] >> 16) as u16);
        for (word, four) in basis[1..].iter().zip(decoded[2..].chunks(4)) {
            for (bits, v) in word.to_le_bytes().into_iter().zip(four) {
                e += v * from_short(bits);
            }
        }
        (e, error)
    }
}

/// Computes e = d² / (d² + s²). Infinite distances (no hit) give 1.
#[must_use]
#[inline]
pub fn encode(distance: f32, near: f32) -> f32 {
    // The clamp prevents overflow of the square.
    let q = (distance / near).min(MAX_RATIO);
    q * q / (1.0 + q * q)
}

/// Decodes a signed normalized 16-bit number like WGSL's `unpack2x16snorm`.
#[inline]
pub(super) fn from_snorm(bits: u16) -> f32 {
    (f32::from(bits as i16) / 32767.0).max(-1.0)
}

/// Decodes a signed normalized 8-bit number like WGSL's `unpack4x8snorm`.
#[inline]
pub(super) fn from_short(bits: u8) -> f32 {
    (f32::from(bits as i8) / 127.0).max(-1.0)
}

pub(super) fn to_short(v: f32) -> u8 {
    (v.clamp(-1.0, 1.0) * 127.0).round() as i8 as u8
}

pub(super) fn to_snorm(v: f32) -> u16 {
    (v.clamp(-1.0, 1.0) * 32767.0).round() as i16 as u16
}

pub(super) fn pack(numbers: &[u16]) -> impl Iterator<Item = u32> + '_ {
    numbers
        .chunks(2)
        .map(|pair| u32::from(pair[0]) | u32::from(pair.get(1).copied().unwrap_or(0)) << 16)
}

/// Returns the x and y axes of a point's directions. The x axis is the tangent of its cluster,
/// projected onto the surface. The z axis is the point's normal.
#[must_use]
#[inline]
pub fn frame(tangent: Vec3, n: Vec3) -> (Vec3, Vec3) {
    let along = tangent - n * n.dot(tangent);
    let square = along.dot(along);
    if square > 1e-6 {
        let t = along / square.sqrt();
        (t, n.cross(t))
    } else {
        tangents(n)
    }
}
