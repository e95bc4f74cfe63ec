//! Training lights of refinement: the senders' radiosity under lights in open space, see
//! [`Training`].

use super::point_set::PointSet;
use super::survey::Survey;
use crate::asset::LightSamples;
use crate::basis::{Hierarchy, Weights};
use crate::samples::trace_particles;
use crate::scene::Geometry;
use crate::transport::{
    GatherSettings, NormalRow, SenderTree, TRAINING_LIGHTS, Training, coarse_rows, mean_squares,
};
use glam::Vec3;
use rayon::prelude::*;

/// Number of batches of [`TRAINING_LIGHTS`] lights that exposures are averaged over. The first
/// batch has the training lights.
const BATCHES: usize = 8;
/// Number of training lights that emission replaces in a scene with emitters.
const EMISSION_LIGHTS: usize = 2;
/// Rec. 709 luminance, which represents the three channels.
const LUMINANCE: Vec3 = Vec3::new(0.2126, 0.7152, 0.0722);

/// Samples light positions in open space. Also returns the number of rays cast. Candidates lie
/// half-way between bounces of importance particles. Each position has the largest clearance of its
/// candidates: a light that almost touches a wall is not representative.
#[must_use]
pub fn sample_light_positions(
    geometry: &dyn Geometry,
    viewpoints: &[Vec3],
    count: usize,
    seed: u64,
    drop_first: bool,
) -> (Vec<Vec3>, u64) {
    const CANDIDATES_PER_LIGHT: usize = 4;
    let traced = trace_particles(
        geometry,
        viewpoints,
        0..4 * (CANDIDATES_PER_LIGHT * count) as u64,
        seed ^ 0x66_72_65_65,
        drop_first,
    );
    let stride = (traced.candidates.len() / (CANDIDATES_PER_LIGHT * count).max(1)).max(1);
    let tried: Vec<_> = traced
        .candidates
        .iter()
        .step_by(stride)
        .take(CANDIDATES_PER_LIGHT * count)
        .collect();
    let samples = tried
        .chunks(CANDIDATES_PER_LIGHT)
        .filter_map(|few| {
            few.iter()
                .map(|c| (c.free.distance(c.surface.position), c.free))
                .max_by(|a, b| a.0.total_cmp(&b.0))
        })
        .map(|best| best.1)
        .collect();
    (samples, traced.rays)
}

/// Trains on white point lights of 1 W/sr at open positions, pulled to the senders (\[L08\] §2.1).
/// Returns the training and the number of rays cast.
pub(super) fn train(
    gathering: &GatherSettings<'_>,
    points: &PointSet,
    survey: &Survey,
    tree: &SenderTree,
) -> (Training, u64) {
    let geometry = gathering.geometry;
    let hierarchy = &points.hierarchy;
    let senders = tree.parent.len();
    let (sources, mut rays) = sample_light_positions(
        geometry,
        &survey.viewpoints,
        BATCHES * TRAINING_LIGHTS,
        gathering.seed,
        survey.drop_first,
    );
    let rows = coarse_rows(&gathering.scene(hierarchy), senders);
    rays += rows.len() as u64 * u64::from(gathering.rays);
    let mut signals = Vec::new();
    let mut exposure = vec![0.0f32; senders];
    let mut counted = 0;
    for batch in sources.chunks(TRAINING_LIGHTS) {
        // Training lights use light samples, like a frame. Exposures use the senders' own points.
        let own = LightSamples::default();
        let samples = if signals.is_empty() {
            &points.light_samples
        } else {
            &own
        };
        let mut values = radiosity(hierarchy, geometry, batch, samples, &points.pull, senders);
        rays += ((senders + samples.list.len()) * batch.len()) as u64;
        let scale = mean_squares(&rows, &values).map(|s| if s > 0.0 { 1.0 / s } else { 0.0 });
        counted += scale.iter().filter(|&&s| s > 0.0).count();
        for (sum, row) in exposure.iter_mut().zip(&mut values) {
            for (value, scale) in row.iter_mut().zip(scale) {
                *sum += *value * *value * scale;
                *value *= scale.sqrt();
            }
        }
        if signals.is_empty() {
            signals = values;
        }
    }
    signals.resize(senders, [0.0; TRAINING_LIGHTS]);
    for e in &mut exposure {
        *e /= counted.max(1) as f32;
    }
    add_emission(hierarchy, &points.pull, &rows, &mut signals, &mut exposure);
    let sky = rows.iter().map(|row| row.1 * row.1).sum::<f32>() / rows.len().max(1) as f32;
    let sky = if sky > 0.0 { 1.0 / sky } else { 0.0 };
    (Training::new(signals, exposure, sky, tree), rays)
}

/// Adds the emission of the senders on emitters to the training. It replaces the last
/// [`EMISSION_LIGHTS`] lights, and the same fraction of the exposures.
fn add_emission(
    hierarchy: &Hierarchy,
    pull: &Weights,
    rows: &[NormalRow],
    signals: &mut [[f32; TRAINING_LIGHTS]],
    exposure: &mut [f32],
) {
    let mut emission = vec![[0.0f32; TRAINING_LIGHTS]; signals.len()];
    for k in (0..signals.len())
        .rev()
        .filter(|&k| hierarchy.is_on_emitter(k))
    {
        emission[k][0] = match pull.row(k) {
            [] => hierarchy.surfaces[k].emission.dot(LUMINANCE),
            row => row
                .iter()
                .map(|w| w.weight * emission[w.index as usize][0])
                .sum(),
        };
    }
    let [square, ..] = mean_squares(rows, &emission);
    if square <= 0.0 {
        return;
    }
    let part = EMISSION_LIGHTS as f32 / TRAINING_LIGHTS as f32;
    for ((signal, exposure), emission) in signals.iter_mut().zip(exposure).zip(&emission) {
        let relative = emission[0] / square.sqrt();
        signal[TRAINING_LIGHTS - EMISSION_LIGHTS..].fill(relative);
        *exposure += part * (relative * relative - *exposure);
    }
}

/// Computes the radiosity of the senders for each light. Finest senders use their light samples,
/// the others are pulled.
fn radiosity(
    hierarchy: &Hierarchy,
    geometry: &dyn Geometry,
    sources: &[Vec3],
    samples: &LightSamples,
    pull: &Weights,
    senders: usize,
) -> Vec<[f32; TRAINING_LIGHTS]> {
    let finest = hierarchy.level_starts[hierarchy.senders.len() - 1] as usize;
    let count = samples.per_sender as usize;
    let mut values: Vec<[f32; TRAINING_LIGHTS]> = (0..senders)
        .into_par_iter()
        .map(|j| {
            let s = &hierarchy.surfaces[j];
            let mut row = [0.0; TRAINING_LIGHTS];
            if j < finest || count == 0 {
                add_irradiance(geometry, sources, s.position, s.normal, 1.0, &mut row);
            } else {
                let first = (j - finest) * count;
                let own = &samples.list[first..first + count];
                for sample in own {
                    let share = 1.0 / count as f32;
                    add_irradiance(geometry, sources, sample.x(), sample.n(), share, &mut row);
                }
            }
            let albedo = s.albedo.dot(LUMINANCE);
            row.map(|e| albedo * e)
        })
        .collect();
    // Fine to coarse: children have higher indices than their parents.
    for k in (0..senders).rev() {
        let row = pull.row(k);
        if !row.is_empty() {
            let mut mean = [0.0; TRAINING_LIGHTS];
            for w in row {
                for (m, v) in mean.iter_mut().zip(&values[w.index as usize]) {
                    *m += w.weight * v;
                }
            }
            values[k] = mean;
        }
    }
    values
}

/// Adds the irradiance at (x, n) of lights of 1 W/sr, scaled by `share`.
fn add_irradiance(
    geometry: &dyn Geometry,
    sources: &[Vec3],
    x: Vec3,
    n: Vec3,
    share: f32,
    row: &mut [f32; TRAINING_LIGHTS],
) {
    let start = x + n * geometry.ray_offset(x);
    for (value, &source) in row.iter_mut().zip(sources) {
        let to = source - start;
        let square = to.length_squared();
        let cosine = to.dot(n);
        if cosine > 0.0 && square > 0.0 && !geometry.is_occluded(start, source) {
            *value += share * cosine / (square * square.sqrt());
        }
    }
}
