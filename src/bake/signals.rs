//! Training lights: what a handful of lamps in the level's free space would make of the senders' radiosity. The refinement asks them whether a
//! receiver says anything that its parents do not.

use crate::basis::{Hierarchy, Weights};
use crate::samples::trace_particles;
use crate::scene::Geometry;
use crate::transport::SIGNALS;
use glam::Vec3;
use rayon::prelude::*;

/// Radiosities of the senders for every training light.
pub struct TrainingSignals {
    /// One row a sender, W/m².
    pub values: Vec<[f32; SIGNALS]>,
    /// Rays cast.
    pub rays: u64,
}

/// Places in free space: half-way between the bounces of importance particles, those with the most room around them of the ones tried: a lamp a
/// hair's breadth from a wall says much of that wall and nothing of the level.
#[must_use]
pub fn free_places(
    geometry: &dyn Geometry,
    viewpoints: &[Vec3],
    count: usize,
    seed: u64,
    drop_first: bool,
) -> (Vec<Vec3>, u64) {
    const TRIED: usize = 4;
    let traced = trace_particles(
        geometry,
        viewpoints,
        0..4 * (TRIED * count) as u64,
        seed ^ 0x66_72_65_65,
        drop_first,
    );
    let stride = (traced.candidates.len() / (TRIED * count).max(1)).max(1);
    let tried: Vec<_> = traced
        .candidates
        .iter()
        .step_by(stride)
        .take(TRIED * count)
        .collect();
    let places = tried
        .chunks(TRIED)
        .filter_map(|few| {
            few.iter()
                .map(|c| (c.free.distance(c.surface.position), c.free))
                .max_by(|a, b| a.0.total_cmp(&b.0))
        })
        .map(|best| best.1)
        .collect();
    (places, traced.rays)
}

/// Projects white point lamps of 1 W/sr at free places and pulls them to the senders ([L08] §2.1).
#[must_use]
pub fn training_signals(
    hierarchy: &Hierarchy,
    geometry: &dyn Geometry,
    viewpoints: &[Vec3],
    pull: &Weights,
    senders: usize,
    seed: u64,
    drop_first: bool,
) -> TrainingSignals {
    let (lamps, mut rays) = free_places(geometry, viewpoints, SIGNALS, seed, drop_first);
    let lit = pull
        .entries
        .iter()
        .map(|w| w.index as usize + 1)
        .max()
        .unwrap_or(0)
        .max(senders);
    let mut values: Vec<[f32; SIGNALS]> = hierarchy.surfaces[..lit]
        .par_iter()
        .map(|s| {
            let start = s.position + s.normal * geometry.lift(s.position);
            // Rec. 709 luminance stands for the three channels.
            let albedo = s.albedo.dot(Vec3::new(0.2126, 0.7152, 0.0722));
            let mut row = [0.0; SIGNALS];
            for (value, &lamp) in row.iter_mut().zip(&lamps) {
                let to = lamp - start;
                let square = to.length_squared();
                let cosine = to.dot(s.normal);
                if cosine > 0.0 && square > 0.0 && !geometry.occluded(start, lamp) {
                    *value = albedo * cosine / (square * square.sqrt());
                }
            }
            row
        })
        .collect();
    rays += (lit * lamps.len()) as u64;
    // Fine to coarse: children have higher indices than their parents.
    for k in (0..senders).rev() {
        let row = pull.row(k);
        if !row.is_empty() {
            let mut mean = [0.0; SIGNALS];
            for w in row {
                for (m, v) in mean.iter_mut().zip(&values[w.index as usize]) {
                    *m += w.weight * v;
                }
            }
            values[k] = mean;
        }
    }
    values.truncate(senders);
    TrainingSignals { values, rays }
}
