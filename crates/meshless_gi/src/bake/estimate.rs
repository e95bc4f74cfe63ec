//! Error estimate of a bake. It compares the bake's indirect irradiance with unbiased Monte Carlo
//! at random surface points. The irradiance is computed as in a frame, for lights that the bake did
//! not use.
//!
//! The estimated quantity is the NRMSE of `meshless_gi_lab::accuracy::errors`, e = ‖E' − E‖ / ‖E‖
//! over the reached surface, under one light. A user who adds a light and compares with a path
//! tracer measures the same. Errors differ between lights, so the interval is a prediction for one
//! more light, not the standard error of a mean. All lights have equal weight. Lights with almost
//! no returned light, such as lights that shine out of the scene, have less.
//!
//! Three lights are evaluated together, one per color channel. Channels are independent, so one
//! solve and one path serve all three.
//!
//! Three methods reduce the variance:
//!
//! - **Importance sampling.** E' is cheap and evaluated at many points (the pool). Ground truth is
//!   computed at few of them. These are drawn with a larger probability at three kinds of points.
//!   They are lit, or their light changes within the width of a basis function, or half of the
//!   links give another value. The mixture has a uniform part, so no weight exceeds [`PARTS`].
//! - **Control variate.** Quantities of the whole pool that need no ground truth: the differences
//!   of tiers to the whole operator, and the light's own mean square.
//! - **Independent halves.** Ground truth is computed twice with independent noise. The product of
//!   the two differences has the squared error as its mean.

mod summary;

use super::Progress;
use super::progress::BakeStage;
use crate::asset::{BakedScene, SceneData};
use crate::eval::{
    NonEmissive, RAYS_PER_POSITION, ReferenceSettings, irradiance, sample_open_positions,
};
use crate::frame::{CpuFrame, FrameLight, FrameSettings, splat};
use crate::samples::{Candidate, Random, morton, tangents, trace_particles};
use crate::scene::{Geometry, Light};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use summary::{LightError, summarize};

/// Fraction of the bake's rays that the estimate casts, between the limits of
/// [`SampleBudget::paths`].
const RAY_FRACTION: f64 = 0.04;
/// Number of lights that are evaluated together, one per color channel.
const COLORS: usize = 3;
/// Number of importance particles that surface points and lights are drawn from.
const PARTICLES: u64 = 4096;
/// Number of candidate positions per light. The one with the largest clearance is used, since
/// lights hang below ceilings and stand on tables.
const CANDIDATES_PER_LIGHT: usize = 4;
/// Smallest mean number of paths per position.
const MIN_PATHS: u32 = 384;
/// Number of parts of the sampling mixture. All have equal weight.
const PARTS: f64 = 4.0;

/// Sample budget of an estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct SampleBudget {
    /// Number of triples of lights.
    triples: usize,
    /// Number of surface points per triple at which the bake is evaluated.
    pool: usize,
    /// Number of these points, per triple, with ground truth.
    positions: usize,
    /// Mean number of paths per point with ground truth, [`MIN_PATHS`] to 8192.
    paths: u32,
}

impl SampleBudget {
    /// Computes the budget in proportion to the bake, with a lower limit. A small bake gets fewer
    /// lights and positions and the same number of paths. The noise of the reference enters with
    /// its fourth power if it exceeds the error.
    fn new(inputs: &EstimateInputs) -> Self {
        let rays_per_path = (RAYS_PER_BOUNCE * u64::from(inputs.bounces)) as f64;
        let paths = RAY_FRACTION * inputs.rays as f64 / rays_per_path;
        let (triples, positions) = if paths >= f64::from(8 * 96 * MIN_PATHS) {
            (8, 96)
        } else {
            (4, 64)
        };
        let paths_per_position = (paths / (triples * positions) as f64) as u32;
        Self {
            triples,
            pool: 2048,
            positions,
            paths: paths_per_position.clamp(MIN_PATHS, 8192),
        }
    }
}

/// Facts about a bake that its estimate depends on.
pub(super) struct EstimateInputs {
    /// Origins of importance particles, in meters.
    pub viewpoints: Vec<Vec3>,
    /// Number of diffuse bounces.
    pub bounces: u32,
    /// Number of rays of the bake.
    pub rays: u64,
    pub seed: u64,
}

/// Path continuation, and a shadow ray per light.
const RAYS_PER_BOUNCE: u64 = 1 + COLORS as u64;

/// Estimated error of a bake.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ErrorEstimate {
    /// NRMSE: root of the mean over lights of each light's squared NRMSE over the surface, without
    /// the reference's own noise.
    pub nrmse: f32,
    /// Half width of the 95 % prediction interval around it, for the NRMSE of one more light.
    pub interval: f32,
}

/// Estimates the error of each tier of `scene` on `geometry`, tier 1 first. Returns the estimates
/// and the number of rays cast, or `None` if canceled.
#[must_use]
pub fn estimate_errors(
    scene: &BakedScene,
    geometry: &dyn Geometry,
    seed: u64,
    progress: &Progress,
) -> Option<(Vec<ErrorEstimate>, u64)> {
    let info = scene.info();
    let inputs = EstimateInputs {
        viewpoints: info.viewpoints.iter().map(|&v| v.into()).collect(),
        bounces: info.bounces,
        rays: info.rays,
        seed,
    };
    estimate_tiers(scene.data(), geometry, &inputs, progress)
}

/// Estimates the error of each tier. See [`estimate_errors`].
pub(super) fn estimate_tiers(
    scene: &SceneData,
    geometry: &dyn Geometry,
    inputs: &EstimateInputs,
    progress: &Progress,
) -> Option<(Vec<ErrorEstimate>, u64)> {
    let budget = SampleBudget::new(inputs);
    let (sources, rays) = light_errors(scene, geometry, &budget, inputs, progress)?;
    let estimates = sources.iter().map(|l| summarize(l)).collect();
    Some((estimates, rays))
}

/// Computes the error of each tier under each light with a given budget. Leaves out lights without
/// indirect light.
fn light_errors(
    scene: &SceneData,
    geometry: &dyn Geometry,
    budget: &SampleBudget,
    inputs: &EstimateInputs,
    progress: &Progress,
) -> Option<(Vec<Vec<LightError>>, u64)> {
    // Differs from the seeds of the points and training lights of the bake.
    let seed = inputs.seed ^ 0x65_73_74_69_6d;
    let traced = trace_particles(geometry, &inputs.viewpoints, 0..PARTICLES, seed, false);
    let mut candidates = traced.candidates;
    let mut random = Random::new(seed, 0, 0);
    let count = COLORS * budget.triples;
    let sources = sample_open_positions(
        geometry,
        &candidates,
        count,
        CANDIDATES_PER_LIGHT,
        &mut random,
    );
    let mut rays = traced.rays + (count * CANDIDATES_PER_LIGHT) as u64 * RAYS_PER_POSITION;
    // Morton order: equal steps spread over the surface.
    let bounds = geometry.bounds();
    candidates.sort_by_cached_key(|c| morton(c.surface.position, &bounds));
    let radii = scene.points.iter().map(|p| p.radius);
    let mut estimator = TripleEstimator {
        scene,
        geometry,
        budget,
        bounces: inputs.bounces,
        seed,
        frame: CpuFrame::from_data(scene),
        reach: 2.0 * radii.fold(f32::INFINITY, f32::min),
    };
    let mut all: Vec<Vec<LightError>> = vec![Vec::new(); scene.tiers() as usize];
    for (k, three) in sources.chunks_exact(COLORS).enumerate() {
        if !progress.set(BakeStage::ErrorEstimate, k as f32 / budget.triples as f32) {
            return None;
        }
        let sources: Vec<Light> = (three.iter().zip([Vec3::X, Vec3::Y, Vec3::Z]))
            .map(|(&position, intensity)| Light::Point {
                position,
                intensity,
                range: f32::INFINITY,
            })
            .collect();
        let pool = select_evenly(&candidates, budget.pool, &mut random);
        let (found, cast) = estimator.errors(&sources, k as u64, &pool, &mut random);
        rays += cast;
        for (all, found) in all.iter_mut().zip(found) {
            all.extend(found);
        }
    }
    Some((all, rays))
}

/// Estimate for three lights. Vectors of three have one number per light.
struct TripleEstimator<'a> {
    scene: &'a SceneData,
    geometry: &'a dyn Geometry,
    budget: &'a SampleBudget,
    bounces: u32,
    seed: u64,
    frame: CpuFrame,
    /// Distance in meters within which a change of the light is a change within a basis function.
    reach: f32,
}

/// Two independent values of ground truth at a point.
struct IndependentPair {
    first: DVec3,
    second: DVec3,
    /// Direct irradiance.
    direct: DVec3,
}

impl TripleEstimator<'_> {
    /// Computes the errors of all tiers under the lights that return light. Also returns the number
    /// of rays cast.
    fn errors(
        &mut self,
        sources: &[Light],
        stream: u64,
        pool: &[Candidate],
        random: &mut Random,
    ) -> (Vec<Vec<LightError>>, u64) {
        let tiers = self.scene.tiers();
        let slots: Vec<FrameLight> = sources
            .iter()
            .flat_map(|l| FrameLight::expand(l, 1))
            .collect();
        self.frame.set_lights_of_data(self.scene, &slots);
        let values: Vec<Vec<DVec3>> = (1..=tiers).map(|tier| self.values(pool, tier)).collect();
        let Some((whole, lower)) = values.split_last() else {
            return (Vec::new(), 0);
        };
        let scores = self.scores(pool, whole, lower.last(), random);
        let drawn = systematic(&scores, self.budget.positions, random);
        let (truth, rays) = self.truth(sources, stream, pool, whole, &scores, &drawn);
        // E f = Σ f(x) / (n p(x)) over n drawn points.
        let weights: Vec<f64> = drawn
            .iter()
            .map(|&i| 1.0 / (scores[i] * drawn.len() as f64))
            .collect();
        let drawn: Vec<(usize, f64, &IndependentPair)> = (drawn.iter().zip(&weights).zip(&truth))
            .map(|((&i, &weight), halves)| (i, weight, halves))
            .collect();
        let mut power = mean(whole.iter().map(|v| v * v));
        let mut direct = DVec3::ZERO;
        for &(i, weight, t) in &drawn {
            power += weight * (t.first * t.second - whole[i] * whole[i]);
            direct += weight * t.direct * t.direct;
        }
        let of_tier = |values: &Vec<DVec3>| {
            // Control variates of the pool.
            let mut square = mean(values.iter().zip(whole).map(|(v, w)| (v - w) * (v - w)));
            let mut noise = DVec3::ZERO;
            for &(i, weight, t) in &drawn {
                let (v, w) = (values[i], whole[i]);
                let product = (v - t.first) * (v - t.second);
                square += weight * (product - (v - w) * (v - w));
                // With halves of variance s², the product has the variance 2 e² s² + s⁴. With h =
                // (a − b)² / 2 that is the mean of 2 h · product + h².
                let h = 0.5 * (t.first - t.second) * (t.first - t.second);
                noise += weight * weight * (2.0 * h * product + h * h);
            }
            (0..COLORS)
                // Without indirect light the relative error is undefined.
                .filter(|&c| power[c] > 1e-6 * direct[c] && power[c].is_finite())
                .map(|c| LightError {
                    square: square[c] / power[c],
                    noise: noise[c] / power[c].powi(2),
                    returns: power[c] / direct[c],
                })
                .filter(|source| source.returns.is_finite())
                .collect()
        };
        (values.iter().map(of_tier).collect(), rays)
    }

    /// Computes the irradiance of the bake at the pool.
    fn values(&mut self, pool: &[Candidate], tier: u32) -> Vec<DVec3> {
        let settings = FrameSettings {
            emission: 0.0,
            tier,
            ..FrameSettings::bounces(self.bounces)
        };
        self.frame.solve_data(self.scene, &settings);
        let at = |c: &Candidate| {
            let found = self.irradiance(c.surface.position, c.surface.normal);
            found.unwrap_or(Vec3::ZERO).as_dvec3()
        };
        pool.par_iter().map(at).collect()
    }

    /// Returns the irradiance of the bake at (x, n) after a solve.
    fn irradiance(&self, x: Vec3, n: Vec3) -> Option<Vec3> {
        let (scene, values) = (self.scene, self.frame.vector_irradiance());
        splat::splat(&scene.points, &scene.display, values, x, n)
    }

    /// Computes the relative sampling probability of each point, with mean one. The frame has the
    /// solution of the whole operator.
    fn scores(
        &self,
        pool: &[Candidate],
        whole: &[DVec3],
        half: Option<&Vec<DVec3>>,
        random: &mut Random,
    ) -> Vec<f64> {
        let angles: Vec<f32> = (0..pool.len())
            .map(|_| random.unit() * core::f32::consts::TAU)
            .collect();
        let steep: Vec<DVec3> = (pool.par_iter().zip(&angles).zip(whole))
            .map(|((c, &angle), &value)| {
                let (x, n) = (c.surface.position, c.surface.normal);
                let (t, b) = tangents(n);
                let step = (t * libm::cosf(angle) + b * libm::sinf(angle)) * self.reach;
                let change = |x: Vec3| match self.irradiance(x, n) {
                    Some(v) => (v.as_dvec3() - value) * (v.as_dvec3() - value),
                    None => DVec3::ZERO,
                };
                change(x + step) + change(x - step)
            })
            .collect();
        let bright: Vec<DVec3> = whole.iter().map(|v| v * v).collect();
        let open: Vec<DVec3> = match half {
            Some(half) => whole
                .iter()
                .zip(half)
                .map(|(v, h)| (v - h) * (v - h))
                .collect(),
            None => bright.clone(),
        };
        let mut scores = vec![1.0 / PARTS; pool.len()];
        for part in [bright, steep, open] {
            let mean = mean(part.iter().copied());
            for (score, part) in scores.iter_mut().zip(part) {
                for c in 0..COLORS {
                    let share = if mean[c] > 0.0 {
                        part[c] / mean[c]
                    } else {
                        1.0
                    };
                    *score += share / (PARTS * COLORS as f64);
                }
            }
        }
        scores
    }

    /// Computes ground truth at the drawn points. Bright points are noisier and get more paths.
    /// Points that were drawn for other reasons than their brightness get fewer.
    fn truth(
        &self,
        sources: &[Light],
        stream: u64,
        pool: &[Candidate],
        whole: &[DVec3],
        scores: &[f64],
        drawn: &[usize],
    ) -> (Vec<IndependentPair>, u64) {
        let lit = NonEmissive {
            geometry: self.geometry,
        };
        let bounces = self.bounces;
        let noise = |i: usize| (whole[i].length_squared() / scores[i]).sqrt();
        let usual = drawn.iter().map(|&i| noise(i)).sum::<f64>() / drawn.len().max(1) as f64;
        let found: Vec<(IndependentPair, u64)> = drawn
            .par_iter()
            .enumerate()
            .map(|(j, &i)| {
                let (x, n) = (pool[i].surface.position, pool[i].surface.normal);
                let share = if usual > 0.0 { noise(i) / usual } else { 1.0 };
                let paths = (0.5 * f64::from(self.budget.paths) * share.clamp(0.25, 4.0)) as u32;
                let settings = ReferenceSettings {
                    paths: paths.max(2),
                    bounces: Some(bounces),
                    seed: self.seed.wrapping_add(stream),
                };
                let [a, b] = [0, 1]
                    .map(|half| irradiance(&lit, sources, x, n, 2 * j as u64 + half, &settings));
                let halves = IndependentPair {
                    first: a.indirect.as_dvec3(),
                    second: b.indirect.as_dvec3(),
                    direct: a.direct.as_dvec3(),
                };
                let paths = 2 * u64::from(settings.paths);
                (halves, paths * RAYS_PER_BOUNCE * u64::from(bounces))
            })
            .collect();
        let rays = found.iter().map(|f| f.1).sum();
        (found.into_iter().map(|f| f.0).collect(), rays)
    }
}

/// Returns the mean, or 0 without values.
fn mean(values: impl ExactSizeIterator<Item = DVec3>) -> DVec3 {
    let count = values.len().max(1) as f64;
    values.sum::<DVec3>() / count
}

/// Draws `count` candidates evenly along their order.
fn select_evenly(candidates: &[Candidate], count: usize, random: &mut Random) -> Vec<Candidate> {
    let start = f64::from(random.unit());
    let step = candidates.len() as f64 / count as f64;
    (0..count)
        .map(|k| (((k as f64 + start) * step) as usize).min(candidates.len() - 1))
        .map(|k| candidates[k])
        .collect()
}

/// Draws `count` indices with probabilities proportional to `scores`, evenly along their order
/// (systematic sampling). A large score is drawn more than once.
fn systematic(scores: &[f64], count: usize, random: &mut Random) -> Vec<usize> {
    let step = scores.iter().sum::<f64>() / count as f64;
    let mut next = f64::from(random.unit()) * step;
    let mut sum = 0.0;
    let mut out = Vec::with_capacity(count);
    for (i, score) in scores.iter().enumerate() {
        sum += score;
        while next < sum && out.len() < count {
            out.push(i);
            next += step;
        }
    }
    out
}

#[cfg(test)]
mod tests;
