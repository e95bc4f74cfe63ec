//! Compression of a visibility cluster: principal components of its encoded depths, quantized
//! ([P14] §4.2.1).

use super::decompose::Components;
use super::visibility::{from_short, from_snorm, pack, to_short, to_snorm};
use super::visibility_bake::weights;
use super::{Visibility, VisibilityCluster, VisibilitySettings, VisiblePoint, decompose};
use glam::Vec3;

/// Encoded depths of the points of a cluster.
pub(super) struct ClusterDepths {
    pub members: Vec<u32>,
    pub tangent: Vec3,
    /// Distance s of the rows, in meters.
    pub near: f32,
    /// Values e of each member, row after row.
    pub rows: Vec<f32>,
}

/// Compressed cluster.
pub(super) struct CompressedCluster {
    pub members: Vec<u32>,
    pub cluster: VisibilityCluster,
    /// Scales of the mean, of the error, then of each component.
    pub scales: Vec<f32>,
    pub basis: Vec<u32>,
    /// One entry per member.
    pub points: Vec<StoredPoint>,
}

/// Stored coefficients of a point: a mask of their components, the numbers, and their error.
pub(super) struct StoredPoint {
    pub mask: [u32; 4],
    pub coefficients: Vec<u16>,
    pub error: u32,
}

/// Compresses a cluster. Returns it, its error, and each member's coefficient of the first
/// component.
pub(super) fn compress(
    depths: &ClusterDepths,
    settings: &VisibilitySettings,
    seed: u64,
) -> (CompressedCluster, f32, Vec<f32>) {
    let grid = settings.grid();
    let length = grid.len();
    // Directions have the same weights as in irradiance.
    let weights = weights(grid);
    let (mean, mut rows) = center(depths, &weights);
    let max_components = settings.recipe.coefficients.min(Visibility::MAX_COMPONENTS) as usize;
    let components = decompose(&rows, length, max_components, seed);
    let stride = components.count();
    let coefficients = coefficients(&rows, &components);
    let first: Vec<f32> = match stride {
        0 => vec![0.0; depths.members.len()],
        _ => coefficients.iter().copied().step_by(stride).collect(),
    };
    let quantized = QuantizedBasis::new(&components, &coefficients, &weights, settings);
    let (points, error) = quantized.points(&coefficients, stride, &weights, &mut rows);
    let (scales, basis) = quantized.pack(&mean, &rows, depths.members.len());
    let part = CompressedCluster {
        members: depths.members.clone(),
        cluster: VisibilityCluster {
            tangent: depths.tangent.to_array(),
            components: quantized.scales.len() as u32,
            near: depths.near,
            ..VisibilityCluster::default()
        },
        scales,
        basis,
        points,
    };
    (part, error, first)
}

/// Computes the products of each row with each component, row after row ([P14] Eq. (8)).
fn coefficients(rows: &[f32], components: &Components) -> Vec<f32> {
    let (length, count) = (components.length, components.count());
    if count == 0 {
        return Vec::new();
    }
    // All components of one direction are adjacent, so that the sums of a row are independent.
    let transposed: Vec<f64> = (0..length)
        .flat_map(|i| (0..count).map(move |j| f64::from(components.vector(j)[i])))
        .collect();
    let mut out = Vec::with_capacity(rows.len() / length * count);
    let mut sums = vec![0.0f64; count];
    for row in rows.chunks_exact(length) {
        sums.fill(0.0);
        for (&e, vectors) in row.iter().zip(transposed.chunks_exact(count)) {
            let e = f64::from(e);
            (sums.iter_mut().zip(vectors)).for_each(|(sum, v)| *sum += e * v);
        }
        out.extend(sums.iter().map(|&sum| sum as f32));
    }
    out
}

/// Computes the mean of the rows of a cluster, and the weighted differences of the rows from it.
fn center(depths: &ClusterDepths, weights: &[f32]) -> (Vec<f32>, Vec<f32>) {
    let length = weights.len();
    let mut rows = depths.rows.clone();
    let mut mean = vec![0.0f64; length];
    for row in rows.chunks_exact(length) {
        mean.iter_mut()
            .zip(row)
            .for_each(|(m, e)| *m += f64::from(*e));
    }
    let members = depths.members.len() as f64;
    let mean: Vec<f32> = mean.iter().map(|m| (m / members) as f32).collect();
    for row in rows.chunks_exact_mut(length) {
        row.iter_mut().zip(&mean).for_each(|(e, m)| *e -= m);
    }
    for row in rows.chunks_exact_mut(length) {
        row.iter_mut().zip(weights).for_each(|(e, w)| *e *= w);
    }
    (mean, rows)
}

/// Returns the quotient, or 0 if `scale` is not positive.
fn over(v: f32, scale: f32) -> f32 {
    if scale > 0.0 { v / scale } else { 0.0 }
}

/// Stored components of a cluster. The largest absolute number of each is one. The coefficients
/// include its scale.
struct QuantizedBasis {
    /// Number of directions.
    length: usize,
    /// Smallest absolute coefficient that a point stores.
    min_coefficient: f32,
    /// Largest absolute coefficient of each component.
    max_coefficients: Vec<f32>,
    /// Largest absolute number of each component.
    scales: Vec<f32>,
    /// Numbers, component after component.
    numbers: Vec<u8>,
}

impl QuantizedBasis {
    /// Quantizes the components that points use.
    fn new(
        components: &Components,
        coefficients: &[f32],
        weights: &[f32],
        settings: &VisibilitySettings,
    ) -> Self {
        let length = weights.len();
        let stride = components.count();
        let component = |j: usize, i: usize| components.vector(j)[i] / weights[i];
        let largest_of = |j: usize| {
            let all = coefficients.iter().skip(j).step_by(stride.max(1));
            all.fold(0.0f32, |max, v| max.max(v.abs()))
        };
        let max_coefficients: Vec<f32> = (0..stride).map(largest_of).collect();
        // Components have length one. In the mean, a coefficient changes e by its value over the
        // root of the number of directions.
        let min_coefficient = settings.tolerance * (length as f32).sqrt();
        let used = (max_coefficients.iter()).rposition(|&v| v >= min_coefficient && v > 0.0);
        let count = used.map_or(0, |last| last + 1);
        let scales: Vec<f32> = (0..count)
            .map(|j| (0..length).fold(0.0f32, |max, i| max.max(component(j, i).abs())))
            .collect();
        let numbers = (0..count)
            .flat_map(|j| (0..length).map(move |i| (j, i)))
            .map(|(j, i)| to_short(over(component(j, i), scales[j])))
            .collect();
        Self {
            length,
            min_coefficient,
            max_coefficients,
            scales,
            numbers,
        }
    }

    /// Computes the stored coefficients of the members, and the cluster's error. Leaves the error
    /// of each direction in `rows`.
    fn points(
        &self,
        coefficients: &[f32],
        stride: usize,
        weights: &[f32],
        rows: &mut [f32],
    ) -> (Vec<StoredPoint>, f32) {
        let members = rows.len() / self.length;
        let mut squares = Vec::with_capacity(members);
        let mut points: Vec<StoredPoint> = rows
            .chunks_exact_mut(self.length)
            .enumerate()
            .map(|(m, row)| {
                (row.iter_mut().zip(weights)).for_each(|(e, w)| *e /= w);
                let kept = self.keep(&coefficients[m * stride..][..stride], row);
                let own = row.iter().zip(weights).map(|(e, w)| (e * w) * (e * w));
                squares.push(own.sum::<f32>());
                kept
            })
            .collect();
        let mean_square = squares.iter().sum::<f32>() / members as f32;
        for (point, square) in points.iter_mut().zip(&squares) {
            point.error = VisiblePoint::error_of(*square, mean_square);
        }
        let total_weight: f32 = weights.iter().map(|w| w * w).sum();
        (points, (mean_square / total_weight).sqrt())
    }

    /// Stores the coefficients of a point and subtracts them from its row.
    fn keep(&self, coefficients: &[f32], row: &mut [f32]) -> StoredPoint {
        let mut kept = StoredPoint {
            mask: [0; 4],
            coefficients: Vec::new(),
            error: 0,
        };
        for (j, (&v, &scale)) in coefficients.iter().zip(&self.scales).enumerate() {
            if v.abs() >= self.min_coefficient && v != 0.0 {
                kept.mask[j / 32] |= 1 << (j % 32);
                let max = self.max_coefficients[j];
                let bits = to_snorm(v / max);
                kept.coefficients.push(bits);
                let factor = from_snorm(bits) * max * scale;
                let numbers = &self.numbers[j * self.length..(j + 1) * self.length];
                (row.iter_mut().zip(numbers)).for_each(|(e, c)| *e -= factor * from_short(*c));
            }
        }
        kept
    }

    /// Packs the scales and numbers of mean, error and components in the layout of [`Visibility`].
    /// `rows` are the errors of the members.
    fn pack(&self, mean: &[f32], rows: &[f32], members: usize) -> (Vec<f32>, Vec<u32>) {
        let (length, count) = (self.length, self.scales.len());
        let mut error = vec![0.0f32; length];
        for row in rows.chunks_exact(length) {
            (error.iter_mut().zip(row)).for_each(|(s, e)| *s += e * e / members as f32);
        }
        error.iter_mut().for_each(|s| *s = s.sqrt());
        let largest = |v: &[f32]| v.iter().fold(0.0f32, |max, v| max.max(v.abs()));
        let mut scales = vec![largest(mean), largest(&error)];
        scales.extend((0..count).map(|j| self.max_coefficients[j] * self.scales[j]));
        let mut basis = Vec::with_capacity(length * (count.div_ceil(4) + 1));
        for i in 0..length {
            let first = [
                to_snorm(over(mean[i], scales[0])),
                to_snorm(over(error[i], scales[1])),
            ];
            basis.extend(pack(&first));
            basis.extend((0..count).step_by(4).map(|j| {
                let of = |k: usize| (j + k < count).then(|| self.numbers[(j + k) * length + i]);
                u32::from_le_bytes([0, 1, 2, 3].map(|k| of(k).unwrap_or(0)))
            }));
        }
        (scales, basis)
    }
}
