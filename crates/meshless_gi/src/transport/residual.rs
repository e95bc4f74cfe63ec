//! Residual of a receiver: the difference between its gathered row and the value that its parents
//! predict ([L08] Eq. (17)).

use super::gather::Gathered;
use super::quantized_row::QuantizedRow;
use super::refine::RawRow;
use super::training::{TRAINING_LIGHTS, TrainingRadiosity};
use crate::basis::{WeightEntry, Weights};
use glam::{Vec3, Vec3A};
use std::collections::BTreeMap;

/// Vector irradiance at a point for each training light and for a sky of unit radiosity, from the
/// even and from the odd rays.
pub(super) type Response = [[Vec3A; TRAINING_LIGHTS + 1]; 2];

/// Values of the finished points.
#[derive(Default)]
pub(super) struct Predictors {
    pub responses: Vec<Response>,
    /// Squared residual. Its noise can make it negative.
    pub errors: Vec<f32>,
    /// Gathered rows before truncation. Empty for points that inherit.
    pub quantized: Vec<QuantizedRow>,
}

/// Normal components of a row and of its prediction. One per thread.
pub(super) struct RowResidual {
    /// Twice the gathered even and odd sums of each sender that rays hit.
    halves: Vec<(u32, [f32; 2])>,
    /// Predicted link per sender.
    expected: Vec<f32>,
}

impl RowResidual {
    /// Creates scratch memory for `senders` senders.
    pub fn new(senders: usize) -> Self {
        Self {
            halves: Vec::new(),
            expected: vec![0.0; senders],
        }
    }

    /// Stores the gathered sums along the normal `n`.
    pub fn set(&mut self, gathered: &Gathered, n: Vec3A) {
        self.halves.clear();
        let touched = gathered.touched.iter();
        self.halves.extend(touched.map(|&j| {
            let sums = gathered.sums[j as usize];
            (j, sums.map(|half| 2.0 * half.dot(n)))
        }));
    }

    /// Computes the squared residual of single links, weighted by exposure. The prediction uses the
    /// rows of the parents before truncation. For parents that inherit, it uses the rows of their
    /// parents. The square is the product of the even and the odd rays' residuals.
    pub fn links(
        &mut self,
        rows: &[RawRow],
        predictors: &Predictors,
        parents: &Weights,
        i: usize,
        n: Vec3A,
        exposure: &[f32],
    ) -> f32 {
        let Self { halves, expected } = self;
        let n = Vec3::from(n);
        let row = parents.row(i);
        let mut open: BTreeMap<u32, f32> = row.iter().map(|w| (w.index, w.weight)).collect();
        // Parents have lower indices than their children. Descending order visits each point once.
        while let Some((k, weight)) = open.pop_last() {
            predictors.quantized[k as usize]
                .for_each(n, weight, |j, part| expected[j as usize] += part);
            if !rows[k as usize].active {
                for w in parents.row(k as usize) {
                    *open.entry(w.index).or_default() += weight * w.weight;
                }
            }
        }
        let mut sum = 0.0;
        for &(j, [a, b]) in &*halves {
            let e = std::mem::take(&mut expected[j as usize]);
            sum += (a - e) * (b - e) * exposure[j as usize];
        }
        // Predicted senders without a hit. They are few, but a list of them takes longer.
        sum + take_weighted_squares(expected, exposure)
    }
}

/// Returns Σ weights · values² and sets the values to zero.
fn take_weighted_squares(values: &mut [f32], weights: &[f32]) -> f32 {
    const LANES: usize = 8;
    let mut sums = [0.0f32; LANES];
    let (values, rest) = values.as_chunks_mut::<LANES>();
    let (weights, last_weights) = weights.as_chunks::<LANES>();
    for (v, w) in values.iter_mut().zip(weights) {
        for k in 0..LANES {
            sums[k] += v[k] * v[k] * w[k];
        }
        *v = [0.0; LANES];
    }
    let mut sum = sums.iter().sum();
    for (v, w) in rest.iter_mut().zip(last_weights) {
        sum += *v * *v * w;
        *v = 0.0;
    }
    sum
}

/// Computes the responses of the even and the odd rays of a gathered row to each training light,
/// and the row's mass. The sky is not split by ray parity.
pub(super) fn respond(gathered: &Gathered, signals: &TrainingRadiosity) -> (Response, Vec3A) {
    let mut response = [[Vec3A::ZERO; TRAINING_LIGHTS + 1]; 2];
    for (half, response) in response.iter_mut().enumerate() {
        // One array per component, so that the sums of all lights stay in registers.
        let [mut x, mut y, mut z] = [[0.0f32; TRAINING_LIGHTS]; 3];
        for &j in &gathered.touched {
            let link = gathered.sums[j as usize][half];
            // Most senders are hit by the rays of one half only.
            if link == Vec3A::ZERO {
                continue;
            }
            for (t, &b) in signals[j as usize].iter().enumerate() {
                x[t] += link.x * b;
                y[t] += link.y * b;
                z[t] += link.z * b;
            }
        }
        for (t, e) in response[..TRAINING_LIGHTS].iter_mut().enumerate() {
            *e = Vec3A::new(x[t], y[t], z[t]);
        }
        response[TRAINING_LIGHTS] = 0.5 * gathered.sky;
    }
    let row_sum = (gathered.touched.iter()).map(|&j| gathered.link(j)).sum();
    (response, row_sum)
}

/// Computes the response that a point's parents predict.
pub(super) fn interpolate(responses: &[Response], parents: &[WeightEntry]) -> Response {
    let mut expected = [[Vec3A::ZERO; TRAINING_LIGHTS + 1]; 2];
    for w in parents {
        for (expected, parent) in expected.iter_mut().zip(&responses[w.index as usize]) {
            for (e, p) in expected.iter_mut().zip(parent) {
                *e += w.weight * *p;
            }
        }
    }
    expected
}

/// Computes the sky visibility that a point's parents predict.
pub(super) fn interpolate_sky(sky: &[Vec3], parents: &[WeightEntry]) -> Vec3A {
    parents
        .iter()
        .map(|w| w.weight * Vec3A::from(sky[w.index as usize]))
        .sum()
}

/// Computes the mean square of the residual over the training lights. The product of the two halves
/// is unbiased, since their noise is independent. The square of the normal component has weight 1.
/// The square of the tangential component, which only normal maps use, has weight 0.1.
pub(super) fn difference(found: &Response, expected: &Response, n: Vec3A, sky: f32) -> f32 {
    let mut sum = 0.0;
    for t in 0..=TRAINING_LIGHTS {
        let a = found[0][t] - expected[0][t];
        let b = found[1][t] - expected[1][t];
        let scale = if t < TRAINING_LIGHTS { 1.0 } else { sky };
        sum += (0.9 * a.dot(n) * b.dot(n) + 0.1 * a.dot(b)) * scale;
    }
    4.0 * sum / (TRAINING_LIGHTS + 1) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weighted_squares_include_values_behind_last_chunk() {
        let mut values: Vec<f32> = (0..19).map(|k| k as f32).collect();
        let weights: Vec<f32> = (0..19).map(|k| f32::from(k % 2 == 0)).collect();
        // 0² + 2² + … + 18².
        assert_eq!(take_weighted_squares(&mut values, &weights), 1140.0);
        assert_eq!(values, [0.0; 19]);
    }
}
