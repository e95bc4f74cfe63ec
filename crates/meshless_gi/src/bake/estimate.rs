//! How wrong a bake is, by its own measurement: indirect irradiance through the frame's own path
//! against unbiased Monte Carlo, at random places of the surface, for lamps that the bake did not
//! see.
//!
//! What is estimated is the NRMSE as [`meshless_gi_lab::accuracy::errors`] defines it, e = ‖E' − E‖
//! / ‖E‖ over the reached surface, under one lamp: what a user finds who puts a lamp into the level
//! and compares with a path tracer. Lamps differ in their error, so that the interval is a
//! prediction for one more of them, not the standard error of a mean. Each lamp counts alike, as it
//! may be the one that a user places, but for those of whose light next to nothing comes back: one
//! that shines into the open has no error to speak of.
//!
//! Three lamps shine at a time, a red, a green and a blue one: light of one color knows nothing of
//! the others, so that a solve and a path serve all three.
//!
//! Three things make few paths say much. E' costs next to nothing, so that it is asked at many
//! places (the pool), and the truth at few of them, drawn where errors are to be expected: where
//! there is light, where it changes within the width of a basis function, and where half of the
//! links say something else, but everywhere sometimes; weights undo the choice (importance sampling
//! with a mixture that holds a uniform part, so that no weight is above [`PARTS`]). What all places
//! can say without truth (the differences of tiers to the whole, the light's own mean square) is a
//! control variate. And the truth comes as two halves that know nothing of each other: the product
//! of the differences to them has the squared error as its mean, whatever their own noise.

use super::Progress;
use super::progress::BakeStage;
use crate::asset::BakedScene;
use crate::eval::{
    NonEmissive, RAYS_PER_POSITION, ReferenceSettings, irradiance, sample_open_positions,
};
use crate::frame::{CpuFrame, FrameLight, FrameSettings};
use crate::samples::{Candidate, Random, morton, tangents, trace_particles};
use crate::scene::{Geometry, Light};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Share of the bake's rays that the estimate may cast.
const SHARE: f64 = 0.04;
/// Lamps that shine together, each in a color of its own.
const COLORS: usize = 3;
/// Importance particles that places and lamps are drawn from.
const PARTICLES: u64 = 4096;
/// Free places of which the one with the most room becomes a lamp: lamps hang under ceilings and
/// stand on tables.
const TRIED: usize = 4;
/// A lamp of whose light less comes back than this share of the usual one's counts the less.
const RETURNS: f64 = 0.1;
/// Reasons to draw a place; each has the same weight.
const PARTS: f64 = 4.0;

/// How much work an estimate takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Effort {
    /// Triples of lamps.
    triples: usize,
    /// Surface places a triple at which the bake alone is asked.
    pool: usize,
    /// How many of them, for each triple, the truth is computed at.
    places: usize,
    /// Paths at each of these, in the mean.
    paths: u32,
}

impl Effort {
    /// What is in proportion to a bake, but enough for an answer.
    fn of(scene: &BakedScene) -> Self {
        let (triples, places) = (8, 96);
        let each =
            (triples * places) as f64 * RAYS_PER_BOUNCE as f64 * f64::from(scene.info.bounces);
        let paths = SHARE * scene.info.rays as f64 / each;
        Self {
            triples,
            pool: 2048,
            places,
            paths: (paths as u32).clamp(384, 8192),
        }
    }
}

/// A ray on, and a shadow ray for each lamp.
const RAYS_PER_BOUNCE: u64 = 1 + COLORS as u64;

/// A bake's error, measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ErrorEstimate {
    /// NRMSE: root of the mean over lamps of each one's squared NRMSE over the surface; without the
    /// reference's own noise.
    pub nrmse: f32,
    /// Half width of the 95 % prediction interval around it for the NRMSE of one more lamp.
    pub interval: f32,
}

/// What one lamp says of one tier.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct LampError {
    /// Squared NRMSE; its noise may make it negative.
    square: f64,
    /// Variance of that by the paths of the reference alone.
    noise: f64,
    /// Mean square of what comes back of its light, over that of the light itself.
    returns: f64,
}

/// Measures the error of each tier of `scene` on `geometry`, tier 1 first, and says how many rays
/// that took. None when `progress` asks to stop.
#[must_use]
pub fn estimate_errors(
    scene: &BakedScene,
    geometry: &dyn Geometry,
    seed: u64,
    progress: &Progress,
) -> Option<(Vec<ErrorEstimate>, u64)> {
    let (lamps, rays) = lamp_errors(scene, geometry, &Effort::of(scene), seed, progress)?;
    let estimates = lamps.iter().map(|l| summarize(l)).collect();
    Some((estimates, rays))
}

/// As [`estimate_errors`], with so much work, and lamp by lamp: a list for each tier, of the lamps
/// whose light comes back from anything.
fn lamp_errors(
    scene: &BakedScene,
    geometry: &dyn Geometry,
    effort: &Effort,
    seed: u64,
    progress: &Progress,
) -> Option<(Vec<Vec<LampError>>, u64)> {
    // Nothing that the bake drew its points or training lights from.
    let seed = seed ^ 0x65_73_74_69_6d;
    let viewpoints: Vec<Vec3> = scene.info.viewpoints.iter().map(|&v| v.into()).collect();
    let traced = trace_particles(geometry, &viewpoints, 0..PARTICLES, seed, false);
    let mut candidates = traced.candidates;
    let mut random = Random::new(seed, 0, 0);
    let count = COLORS * effort.triples;
    let lamps = sample_open_positions(geometry, &candidates, count, TRIED, &mut random);
    let mut rays = traced.rays + (count * TRIED) as u64 * RAYS_PER_POSITION;
    // Steps along this order spread over the surface.
    let bounds = geometry.bounds();
    candidates.sort_by_cached_key(|c| morton(c.surface.position, &bounds));
    let radii = scene.points.iter().map(|p| p.radius);
    let mut question = Question {
        scene,
        geometry,
        effort,
        seed,
        frame: CpuFrame::new(scene),
        reach: 2.0 * radii.fold(f32::INFINITY, f32::min),
    };
    let mut all: Vec<Vec<LampError>> = vec![Vec::new(); scene.tiers() as usize];
    for (k, three) in lamps.chunks_exact(COLORS).enumerate() {
        if !progress.set(BakeStage::ErrorEstimate, k as f32 / effort.triples as f32) {
            return None;
        }
        let lamps: Vec<Light> = (three.iter().zip([Vec3::X, Vec3::Y, Vec3::Z]))
            .map(|(&position, intensity)| Light::Point {
                position,
                intensity,
                range: f32::INFINITY,
            })
            .collect();
        let pool = spread(&candidates, effort.pool, &mut random);
        let (found, cast) = question.ask(&lamps, k as u64, &pool, &mut random);
        rays += cast;
        for (all, found) in all.iter_mut().zip(found) {
            all.extend(found);
        }
    }
    Some((all, rays))
}

/// Three lamps' share of the work. Vectors of three hold a number for each of them: its color's.
struct Question<'a> {
    scene: &'a BakedScene,
    geometry: &'a dyn Geometry,
    effort: &'a Effort,
    seed: u64,
    frame: CpuFrame,
    /// Over how many meters a change of the light is a change within a basis function.
    reach: f32,
}

/// The truth at a place, twice.
struct Halves {
    first: DVec3,
    second: DVec3,
    /// Straight from the lamps.
    direct: DVec3,
}

impl Question<'_> {
    /// The errors of all tiers under the lamps, those of whose light anything comes back, and the
    /// rays cast.
    fn ask(
        &mut self,
        lamps: &[Light],
        stream: u64,
        pool: &[Candidate],
        random: &mut Random,
    ) -> (Vec<Vec<LampError>>, u64) {
        let tiers = self.scene.tiers();
        let slots: Vec<FrameLight> = lamps
            .iter()
            .flat_map(|l| FrameLight::expand(l, 1))
            .collect();
        self.frame.set_lights(self.scene, &slots);
        let values: Vec<Vec<DVec3>> = (1..=tiers).map(|tier| self.values(pool, tier)).collect();
        let Some((whole, lower)) = values.split_last() else {
            return (Vec::new(), 0);
        };
        let scores = self.scores(pool, whole, lower.last(), random);
        let drawn = systematic(&scores, self.effort.places, random);
        let (truth, rays) = self.truth(lamps, stream, pool, whole, &scores, &drawn);
        // E f = Σ f(x) / (n p(x)) over n places drawn.
        let weights: Vec<f64> = drawn
            .iter()
            .map(|&i| 1.0 / (scores[i] * drawn.len() as f64))
            .collect();
        let drawn: Vec<(usize, f64, &Halves)> = (drawn.iter().zip(&weights).zip(&truth))
            .map(|((&i, &weight), halves)| (i, weight, halves))
            .collect();
        let mut power = mean(whole.iter().map(|v| v * v));
        let mut direct = DVec3::ZERO;
        for &(i, weight, t) in &drawn {
            power += weight * (t.first * t.second - whole[i] * whole[i]);
            direct += weight * t.direct * t.direct;
        }
        let of_tier = |values: &Vec<DVec3>| {
            // What the pool knows without any truth.
            let mut square = mean(values.iter().zip(whole).map(|(v, w)| (v - w) * (v - w)));
            let mut noise = DVec3::ZERO;
            for &(i, weight, t) in &drawn {
                let (v, w) = (values[i], whole[i]);
                let product = (v - t.first) * (v - t.second);
                square += weight * (product - (v - w) * (v - w));
                // With halves of variance s², the product has the variance 2 e² s² + s⁴; with h =
                // (a − b)² / 2 that is the mean of 2 h · product + h².
                let h = 0.5 * (t.first - t.second) * (t.first - t.second);
                noise += weight * weight * (2.0 * h * product + h * h);
            }
            (0..COLORS)
                // Where next to nothing comes back there is no error to speak of, and no number
                // either.
                .filter(|&c| power[c] > 1e-6 * direct[c] && power[c].is_finite())
                .map(|c| LampError {
                    square: square[c] / power[c],
                    noise: noise[c] / power[c].powi(2),
                    returns: power[c] / direct[c],
                })
                .filter(|lamp| lamp.returns.is_finite())
                .collect()
        };
        (values.iter().map(of_tier).collect(), rays)
    }

    /// What the bake says.
    fn values(&mut self, pool: &[Candidate], tier: u32) -> Vec<DVec3> {
        let settings = FrameSettings {
            emission: 0.0,
            tier,
            ..FrameSettings::bounces(self.scene.info.bounces)
        };
        self.frame.solve(self.scene, &settings);
        let at = |c: &Candidate| {
            let found = self
                .frame
                .irradiance(self.scene, c.surface.position, c.surface.normal);
            found.unwrap_or(Vec3::ZERO).as_dvec3()
        };
        pool.par_iter().map(at).collect()
    }

    /// How much each place is worth the truth; one in the mean. The frame holds the whole
    /// operator's light.
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
                let change = |x: Vec3| match self.frame.irradiance(self.scene, x, n) {
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

    /// The truth at the places drawn. Bright places are noisier: they get more paths, those that
    /// were drawn for other reasons than their light fewer.
    fn truth(
        &self,
        lamps: &[Light],
        stream: u64,
        pool: &[Candidate],
        whole: &[DVec3],
        scores: &[f64],
        drawn: &[usize],
    ) -> (Vec<Halves>, u64) {
        let lit = NonEmissive {
            geometry: self.geometry,
        };
        let bounces = self.scene.info.bounces;
        let noise = |i: usize| (whole[i].length_squared() / scores[i]).sqrt();
        let usual = drawn.iter().map(|&i| noise(i)).sum::<f64>() / drawn.len().max(1) as f64;
        let found: Vec<(Halves, u64)> = drawn
            .par_iter()
            .enumerate()
            .map(|(j, &i)| {
                let (x, n) = (pool[i].surface.position, pool[i].surface.normal);
                let share = if usual > 0.0 { noise(i) / usual } else { 1.0 };
                let paths = (0.5 * f64::from(self.effort.paths) * share.clamp(0.25, 4.0)) as u32;
                let settings = ReferenceSettings {
                    paths: paths.max(2),
                    bounces: Some(bounces),
                    seed: self.seed.wrapping_add(stream),
                };
                let [a, b] = [0, 1]
                    .map(|half| irradiance(&lit, lamps, x, n, 2 * j as u64 + half, &settings));
                let halves = Halves {
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

/// 0 of nothing.
fn mean(values: impl ExactSizeIterator<Item = DVec3>) -> DVec3 {
    let count = values.len().max(1) as f64;
    values.sum::<DVec3>() / count
}

/// `count` of the candidates, evenly along their order.
fn spread(candidates: &[Candidate], count: usize, random: &mut Random) -> Vec<Candidate> {
    let start = f64::from(random.unit());
    let step = candidates.len() as f64 / count as f64;
    (0..count)
        .map(|k| (((k as f64 + start) * step) as usize).min(candidates.len() - 1))
        .map(|k| candidates[k])
        .collect()
}

/// Draws `count` indices with probabilities in proportion to `scores`, evenly along their order
/// (systematic sampling). A great score is drawn more than once.
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

/// Zero of nothing.
fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// The estimate from what the lamps say.
///
/// Lamps differ, and so do the handfuls of places that each was examined at: the spread of their
/// squared errors tells both, and is what one more lamp will show. Only what the reference's paths
/// put on it is taken off. With m the mean and s² the variance of that, 95 % of lamps would stay
/// below m + t s √(1 + 1/n) if squares were normal, with Student's t for n − 1 degrees of freedom;
/// they are skewed to larger errors, so that the upper end makes the width for both sides.
fn summarize(lamps: &[LampError]) -> ErrorEstimate {
    let usual = RETURNS * median(lamps.iter().map(|l| l.returns));
    let weights: Vec<f64> = lamps.iter().map(|l| (l.returns / usual).min(1.0)).collect();
    let total: f64 = weights.iter().sum();
    if total <= 0.0 {
        return ErrorEstimate::default();
    }
    let mean = |of: &dyn Fn(&LampError) -> f64| {
        let parts = lamps.iter().zip(&weights).map(|(l, weight)| weight * of(l));
        parts.sum::<f64>() / total
    };
    let m = mean(&|l| l.square).max(0.0);
    // As many lamps of equal weight.
    let count = total * total / weights.iter().map(|w| w * w).sum::<f64>();
    let nrmse = m.sqrt();
    if count < 1.5 {
        return ErrorEstimate {
            nrmse: nrmse as f32,
            // One lamp says nothing of others.
            interval: nrmse as f32,
        };
    }
    let seen = mean(&|l| (l.square - m).powi(2)) * count / (count - 1.0);
    // The usual lamp's: a single one of great noise is one of great error as often as not.
    let noise = median(lamps.iter().map(|l| l.noise)).clamp(0.0, seen);
    let width = student(count - 1.0) * (seen - noise + seen / count).sqrt();
    ErrorEstimate {
        nrmse: nrmse as f32,
        interval: ((m + width).sqrt() - nrmse) as f32,
    }
}

/// 97.5 % quantile of Student's distribution with `freedom` degrees of freedom (two at least), by
/// the first terms of its expansion in 1 / `freedom`.
fn student(freedom: f64) -> f64 {
    const Z: f64 = 1.959_964;
    let (f, z3, z5) = (freedom.max(2.0), Z.powi(3), Z.powi(5));
    Z + (z3 + Z) / (4.0 * f) + (5.0 * z5 + 16.0 * z3 + 3.0 * Z) / (96.0 * f * f)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lamp(square: f64, noise: f64, returns: f64) -> LampError {
        LampError {
            square,
            noise,
            returns,
        }
    }

    #[test]
    fn student_quantiles_match_tables() {
        for (freedom, q) in [(5.0, 2.5706), (10.0, 2.2281), (30.0, 2.0423), (1e9, 1.9600)] {
            assert!((student(freedom) / q - 1.0).abs() < 0.02, "{freedom}");
        }
    }

    #[test]
    fn interval_differing_lights_is_wide_and_noise_is_narrow() {
        let alike = summarize(&[lamp(0.01, 0.0, 1.0); 20]);
        assert!(
            (alike.nrmse - 0.1).abs() < 1e-6 && alike.interval < 1e-6,
            "{alike:?}"
        );
        let differ = |noise| -> Vec<LampError> {
            let squares = (0..20).map(|k| if k % 2 == 0 { 0.005 } else { 0.015 });
            squares.map(|square| lamp(square, noise, 1.0)).collect()
        };
        let (wide, known) = (summarize(&differ(0.0)), summarize(&differ(1.0)));
        assert!(
            (wide.nrmse - 0.1).abs() < 1e-6 && (0.03..0.06).contains(&wide.interval),
            "{wide:?}"
        );
        assert!(known.interval < 0.4 * wide.interval, "{known:?}");
        // What next to no light comes back of hardly counts.
        let mut lamps = vec![lamp(0.01, 0.0, 1.0); 20];
        lamps.push(lamp(1.0, 0.0, 1e-5));
        assert!((summarize(&lamps).nrmse - 0.1).abs() < 1e-3);
        assert_eq!(summarize(&[]), ErrorEstimate::default());
        let one = summarize(&[lamp(0.01, 0.0, 1.0)]);
        assert_eq!(one.nrmse, one.interval);
    }

    #[test]
    fn importance_draws_match_scores() {
        let scores: Vec<f64> = (0..100).map(|k| if k < 50 { 0.5 } else { 1.5 }).collect();
        let mut random = Random::new(1, 2, 3);
        let drawn = systematic(&scores, 40, &mut random);
        assert_eq!(drawn.len(), 40);
        let low = drawn.iter().filter(|&&i| i < 50).count();
        assert!((9..=11).contains(&low) && drawn.is_sorted(), "{drawn:?}");
    }
}
