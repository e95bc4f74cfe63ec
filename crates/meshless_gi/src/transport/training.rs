//! Training data of refinement: radiosity under training lights, and the exposure of each sender.
//!
//! An error of a row matters only where there is light. The training lights measure coherent
//! errors, caused by light that covers many senders. Sixteen lights cannot light every corner. Each
//! sender therefore also has an exposure, the root mean square of its radiosity over many more
//! lights. Errors of single senders, such as a lit ledge, are weighted by the squared exposures.
//! This corresponds to lighting each sender alone. All values are relative: each light is scaled so
//! that its indirect irradiance over the coarsest points has a root mean square of one.

use super::bounded_truncation::SenderTree;
use super::gather::{GatherScene, Gathered, gather};
use glam::Vec3A;
use rayon::prelude::*;

/// Number of training lights of a bake.
pub const TRAINING_LIGHTS: usize = 16;

/// Radiosity of every sender for [`TRAINING_LIGHTS`] lights, in W/m² or relative, see [`Training`].
pub type TrainingRadiosity = [[f32; TRAINING_LIGHTS]];

/// Training data.
#[derive(Debug)]
pub struct Training {
    /// Relative radiosity of every sender for every training light.
    pub signals: Vec<[f32; TRAINING_LIGHTS]>,
    /// Mean square relative radiosity of every sender over all lights.
    pub exposure: Vec<f32>,
    /// Sum of `exposure` over each sender's children.
    pub family: Vec<f32>,
    /// Inverse of the mean square irradiance of a sky of unit radiosity. 0 without sky.
    pub sky: f32,
}

impl Training {
    /// Creates the data from relative radiosities and exposures, one of each per sender.
    #[must_use]
    pub fn new(
        signals: Vec<[f32; TRAINING_LIGHTS]>,
        exposure: Vec<f32>,
        sky: f32,
        tree: &SenderTree,
    ) -> Self {
        let mut family = vec![0.0; exposure.len()];
        for (i, &p) in tree.parent.iter().enumerate() {
            if p as usize != i {
                family[p as usize] += exposure[i];
            }
        }
        Self {
            signals,
            exposure,
            family,
            sky,
        }
    }
}

/// Gathered row along its point's normal: senders and F·n, and the part of the sky.
pub type NormalRow = (Vec<(u32, f32)>, f32);

/// Gathers the rows of the coarsest points, which determine the scale of lights.
#[must_use]
pub fn coarse_rows(scene: &GatherScene<'_>, senders: usize) -> Vec<NormalRow> {
    scene
        .hierarchy
        .level(0)
        .into_par_iter()
        .map_init(
            || Gathered::new(senders),
            |gathered, i| {
                gather(scene, i, gathered);
                let n = Vec3A::from(scene.hierarchy.surfaces[i].normal);
                let links = gathered.touched.iter();
                let links = links.map(|&j| (j, gathered.link(j).dot(n)));
                (links.collect(), gathered.sky.dot(n))
            },
        )
        .collect()
}

/// Computes the mean square irradiance of each light over `rows`.
#[must_use]
pub fn mean_squares(rows: &[NormalRow], signals: &TrainingRadiosity) -> [f32; TRAINING_LIGHTS] {
    let squares: Vec<[f64; TRAINING_LIGHTS]> = rows
        .par_iter()
        .map(|(links, _)| {
            let mut e = [0.0f64; TRAINING_LIGHTS];
            for &(j, a) in links {
                for (e, &f) in e.iter_mut().zip(&signals[j as usize]) {
                    *e += f64::from(a * f);
                }
            }
            e.map(|e| e * e)
        })
        .collect();
    let mut sums = [0.0; TRAINING_LIGHTS];
    for square in &squares {
        for (s, e) in sums.iter_mut().zip(square) {
            *s += e;
        }
    }
    sums.map(|s| (s / rows.len().max(1) as f64) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn training_squares_and_family_sums_match_hand_values() {
        let rows = vec![(vec![(0, 0.5), (1, 0.25)], 0.25), (vec![(1, 1.0)], 0.0)];
        let mut signals = vec![[0.0; TRAINING_LIGHTS]; 3];
        signals[0][0] = 2.0;
        signals[1] = [4.0; TRAINING_LIGHTS];
        let squares = mean_squares(&rows, &signals);
        // (2² + 4²) / 2 for the first light, (1² + 4²) / 2 for the second.
        assert_eq!(&squares[..2], &[10.0, 8.5]);
        let tree = SenderTree::new(&[0, 0, 0], &[0, 1, 3]);
        let training = Training::new(signals, vec![9.0, 1.0, 2.0], 0.0, &tree);
        assert_eq!(training.family, [3.0, 0.0, 0.0]);
    }
}
