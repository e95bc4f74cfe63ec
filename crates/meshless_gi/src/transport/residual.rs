//! Residual of a receiver: the difference between its gathered row and the value that its parents
//! predict ([L08] Eq. (17)).

use super::gather::Gathered;
use super::quantized_row::QuantizedRow;
use super::refine::RawRow;
use super::training::{TRAINING_LIGHTS, TrainingRadiosity};
use crate::basis::{WeightEntry, Weights};
use glam::{Vec3, Vec3A};
use std::collections::BTreeMap;

/// Vector irradiance at a point for each training light, and for a sky of unit radiosity, by the
/// even and by the odd rays.
pub(super) type Response = [[Vec3A; TRAINING_LIGHTS + 1]; 2];

/// Values of the points that are finished.
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
    /// Senders of the prediction.
    predicted: Vec<u32>,
}

impl RowResidual {
    /// Creates scratch memory for `senders` senders.
    pub fn new(senders: usize) -> Self {
        Self {
            halves: Vec::new(),
            expected: vec![0.0; senders],
            predicted: Vec::new(),
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

    /// Squared residual of single links, weighted by exposure. The prediction uses the rows of the
    /// parents before truncation, and those of the points that they inherit from. The square is the
    /// product of the even and the odd rays' residuals.
    pub fn links(
        &mut self,
        rows: &[RawRow],
        predictors: &Predictors,
        parents: &Weights,
        i: usize,
        n: Vec3A,
        exposure: &[f32],
    ) -> f32 {
        let Self {
            halves,
            expected,
            predicted,
        } = self;
        predicted.clear();
        let n = Vec3::from(n);
        let row = parents.row(i);
        let mut open: BTreeMap<u32, f32> = row.iter().map(|w| (w.index, w.weight)).collect();
        // Parents have lower indices than their children. Descending order visits each point once.
        while let Some((k, weight)) = open.pop_last() {
            predictors.quantized[k as usize].for_each(n, weight, |j, part| {
                let e = &mut expected[j as usize];
                if *e == 0.0 {
                    predicted.push(j);
                }
                *e += part;
            });
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
        // Predicted senders that no ray hit.
        for &j in &*predicted {
            let e = std::mem::take(&mut expected[j as usize]);
            sum += e * e * exposure[j as usize];
        }
        sum
    }
}

/// Responses of the even and the odd rays of a gathered row to each training light, and the row's
/// mass. The sky is not split.
pub(super) fn respond(gathered: &Gathered, signals: &TrainingRadiosity) -> (Response, Vec3A) {
    let mut response = [[Vec3A::ZERO; TRAINING_LIGHTS + 1]; 2];
    let mut row_sum = Vec3A::ZERO;
    for &j in &gathered.touched {
        let sums = gathered.sums[j as usize];
        row_sum += sums[0] + sums[1];
        for (half, link) in response.iter_mut().zip(sums) {
            for (e, &b) in half.iter_mut().zip(&signals[j as usize]) {
                *e += link * b;
            }
        }
    }
    response[0][TRAINING_LIGHTS] = 0.5 * gathered.sky;
    response[1][TRAINING_LIGHTS] = 0.5 * gathered.sky;
    (response, row_sum)
}

/// Response that a point's parents predict.
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

/// Sky visibility that a point's parents predict.
pub(super) fn interpolate_sky(sky: &[Vec3], parents: &[WeightEntry]) -> Vec3A {
    parents
        .iter()
        .map(|w| w.weight * Vec3A::from(sky[w.index as usize]))
        .sum()
}

/// Mean square over the training lights of the residual. The product of the two halves is unbiased,
/// since their noise is independent. The normal component counts fully. The tangential component,
/// which only normal maps show, counts by a tenth of its square.
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
