//! Training set of the light bases of method `pca` ([P14] §4.3.1): lights and the radiosity that
//! they cause on senders.
//!
//! \[P14\] positions point lights uniformly. Here they are at open positions with large clearance,
//! like the training lights of refinement. Every fourth is a sun if the scene has sky. Each light
//! uses one light sample per sender, a different one for each light. Shadow edges are therefore
//! correct in the mean at the cost of a single sample. Each light is scaled by the root mean square
//! of its irradiance over the coarsest points.

use super::PcaRecipe;
use super::point_set::PointSet;
use super::survey::Survey;
use super::training_lights::sample_light_positions;
use crate::asset::LightSamples;
use crate::basis::{Hierarchy, Weights};
use crate::samples::{Random, mix, uniform_sphere};
use crate::scene::Geometry;
use crate::transport::pca::{LightBasis, TrainingSet, cluster};
use crate::transport::{GatherSettings, TRAINING_LIGHTS, coarse_rows, mean_squares};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Period of suns among the lights, in scenes with sky.
const SUN_OF: usize = 4;

/// Lower limit of the returned fraction of a light, relative to the median light.
const MIN_RETURNED_FRACTION: f64 = 0.5;

/// Training light of unit strength.
#[derive(Clone, Copy, Debug)]
enum TrainingLight {
    /// Point light of 1 W/sr at this position.
    Point(Vec3),
    /// Sun of 1 W/m² from this direction.
    Sun(Vec3),
}

/// Computes the light bases of the sender clusters. Also returns the number of rays cast.
pub(super) fn light_basis(
    gathering: &GatherSettings<'_>,
    points: &PointSet,
    survey: &Survey,
    settings: &PcaRecipe,
) -> (LightBasis, u64) {
    let PointSet {
        hierarchy, pull, ..
    } = points;
    let finest = hierarchy.level_starts[hierarchy.senders.len() - 1] as usize;
    let own: Vec<u32> = (0..pull.len())
        .filter(|&j| j >= finest || pull.row(j).is_empty())
        .map(|j| j as u32)
        .collect();
    let positions: Vec<(Vec3, Vec3)> = (own.iter())
        .map(|&j| &hierarchy.surfaces[j as usize])
        .map(|s| (s.position, s.normal))
        .collect();
    let cluster_size = settings.cluster_size.unwrap_or(1) as usize;
    let clusters = cluster(&positions, cluster_size, gathering.seed);
    let (examples, rays) = training_set(gathering, points, survey, own, settings.training_lights);
    let coefficients = settings.coefficients as usize;
    let basis = LightBasis::new(&examples, &clusters, coefficients, pull, gathering.seed);
    (basis, rays)
}

/// Computes the radiosity of the senders `own` under the training lights. Also returns the number
/// of rays cast.
fn training_set(
    gathering: &GatherSettings<'_>,
    points: &PointSet,
    survey: &Survey,
    own: Vec<u32>,
    lights: u32,
) -> (TrainingSet, u64) {
    let PointSet {
        hierarchy,
        pull,
        light_samples,
        ..
    } = points;
    let geometry = gathering.geometry;
    let senders = pull.len();
    // These differ from the training lights of refinement, which estimate the error of rows.
    let seed = gathering.seed ^ 0x65_78_61_6d;
    let rows = coarse_rows(&gathering.scene(hierarchy), senders);
    let mut rays = rows.len() as u64 * u64::from(gathering.rays);
    let open = rows.iter().any(|row| row.1 > 0.0);
    let (free, cast) = sample_light_positions(
        geometry,
        &survey.viewpoints,
        lights as usize,
        seed,
        survey.drop_first,
    );
    rays += cast;
    let mut random = Random::new(seed, 0, 0);
    let sources: Vec<TrainingLight> = (free.iter().enumerate())
        .map(|(k, &x)| match open && k % SUN_OF == SUN_OF - 1 {
            true => TrainingLight::Sun(uniform_sphere(Vec2::new(random.unit(), random.unit()))),
            false => TrainingLight::Point(x),
        })
        .collect();
    let mut light = Vec::with_capacity(own.len() * sources.len());
    let mut powers: Vec<[f64; 2]> = Vec::with_capacity(sources.len());
    for (batch, sources) in sources.chunks(TRAINING_LIGHTS).enumerate() {
        let scene = (hierarchy, geometry, light_samples, pull);
        let values = radiosity(scene, sources, batch * TRAINING_LIGHTS);
        rays += (own.len() * sources.len()) as u64;
        let back = mean_squares(&rows, &values);
        for (source, back) in back.into_iter().enumerate().take(sources.len()) {
            let first = light.len();
            light.extend(own.iter().map(|&j| values[j as usize][source]));
            let square: f64 = light[first..].iter().map(|v| f64::from(v * v)).sum();
            powers.push([f64::from(back), square / own.len().max(1) as f64].map(f64::sqrt));
        }
    }
    // A light that shines out of the scene, or on back sides, would dominate without a lower limit.
    let mut shares: Vec<f64> = (powers.iter())
        .filter(|[_, direct]| *direct > 0.0)
        .map(|[back, direct]| back / direct)
        .collect();
    shares.sort_by(f64::total_cmp);
    let usual = shares.get(shares.len() / 2).copied().unwrap_or(0.0);
    for (row, [back, direct]) in light.chunks_exact_mut(own.len().max(1)).zip(powers) {
        let power = back.max(MIN_RETURNED_FRACTION * usual * direct);
        let scale = if power > 0.0 {
            (1.0 / power) as f32
        } else {
            0.0
        };
        let scale = if scale.is_finite() { scale } else { 0.0 };
        row.iter_mut().for_each(|v| *v *= scale);
    }
    (TrainingSet { own, light }, rays)
}

/// Computes the radiosity of the senders for each light, in one color channel per light. `first` is
/// the index of the first light.
fn radiosity(
    (hierarchy, geometry, samples, pull): (&Hierarchy, &dyn Geometry, &LightSamples, &Weights),
    sources: &[TrainingLight],
    first: usize,
) -> Vec<[f32; TRAINING_LIGHTS]> {
    let finest = hierarchy.level_starts[hierarchy.senders.len() - 1] as usize;
    let count = samples.per_sender as usize;
    let far = 2.0 * geometry.bounds().size().length();
    let mut values: Vec<[f32; TRAINING_LIGHTS]> = (0..pull.len())
        .into_par_iter()
        .map(|j| {
            let mut row = [0.0; TRAINING_LIGHTS];
            if j < finest && !pull.row(j).is_empty() {
                return row;
            }
            let s = &hierarchy.surfaces[j];
            for (k, (value, source)) in row.iter_mut().zip(sources).enumerate() {
                let number = first + k;
                let (x, n) = match j < finest || count == 0 {
                    true => (s.position, s.normal),
                    false => {
                        let sample = &samples.list[(j - finest) * count + turn(number, count)];
                        (sample.x(), sample.n())
                    }
                };
                *value = s.albedo[number % 3] * irradiance_of_light(geometry, source, x, n, far);
            }
            row
        })
        .collect();
    for k in (0..finest).rev() {
        for w in pull.row(k) {
            let (mean, child) = (values[k], values[w.index as usize]);
            values[k] = std::array::from_fn(|t| mean[t] + w.weight * child[t]);
        }
    }
    values
}

/// Returns the index of the light sample that a light uses, the same in every call.
fn turn(number: usize, count: usize) -> usize {
    (mix(number as u64) % count.max(1) as u64) as usize
}

/// Computes the irradiance at (x, n), W/m².
fn irradiance_of_light(
    geometry: &dyn Geometry,
    source: &TrainingLight,
    x: Vec3,
    n: Vec3,
    far: f32,
) -> f32 {
    let start = x + n * geometry.ray_offset(x);
    match *source {
        TrainingLight::Point(source) => {
            let to = source - start;
            let (square, cosine) = (to.length_squared(), to.dot(n));
            let lit = cosine > 0.0 && square > 0.0 && !geometry.is_occluded(start, source);
            if lit {
                cosine / (square * square.sqrt())
            } else {
                0.0
            }
        }
        TrainingLight::Sun(to) => {
            let cosine = to.dot(n);
            let lit = cosine > 0.0 && !geometry.is_occluded(start, start + far * to);
            if lit { cosine } else { 0.0 }
        }
    }
}
