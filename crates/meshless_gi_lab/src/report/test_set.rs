//! Test set of a report: irradiance at surface points under lights that are not part of any bake,
//! by the reference integrator. All bakes share it, so that they differ by their own errors and not
//! by the noise of the reference.

use crate::accuracy::{Errors, errors};
use glam::Vec3;
use meshless_gi::internals::eval::{NonEmissive, irradiance_at_all, sample_open_positions};
use meshless_gi::internals::samples::{Random, find_viewpoints, trace_particles};
use meshless_gi::{
    BakedScene, CpuFrame, FrameLight, FrameSettings, Geometry, Irradiance, Light,
    ReferenceSettings, SkyRadiance, irradiance,
};
use rayon::prelude::*;

/// Seed of the test set. Nothing else uses it, so the test set shares no position or light with a
/// bake.
const SEED: u64 = 0x65_78_61_6d;
/// Number of candidate positions per light. The one with the largest clearance is taken.
const CANDIDATES_PER_LIGHT: usize = 6;
/// Paths of the pilot that estimates the noise of a position. Nothing else uses them.
const PILOT_PATHS: u32 = 256;

/// Effort of the reference.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TestSetSize {
    /// Number of lights. One is on at a time.
    pub light_sources: usize,
    /// Surface points for each light.
    pub positions: usize,
    /// Mean number of reference paths per position. Noisy positions get more of them.
    pub paths: u32,
}

/// Light with positions and their reference values.
struct TestCase {
    light_source: Light,
    positions: Vec<(Vec3, Vec3)>,
    /// Values after [`TestSet::bounces`] reflections.
    truth: ReferenceValues,
    /// Values after all reflections.
    all: ReferenceValues,
}

/// Irradiances and their standard errors, W/m².
#[derive(Default)]
struct ReferenceValues(Vec<Vec3>, Vec<Vec3>);

impl ReferenceValues {
    fn new(found: &[Irradiance], scale: f32) -> Self {
        Self(
            found.iter().map(|e| e.indirect * scale).collect(),
            found.iter().map(|e| e.indirect_error * scale).collect(),
        )
    }

    /// Returns ‖standard errors‖ / ‖values‖.
    fn noise(all: &[&Self]) -> f64 {
        let square = |of: fn(&Self) -> &[Vec3]| -> f64 {
            let values = all.iter().flat_map(|t| of(t));
            values.map(|v| f64::from(v.length_squared())).sum()
        };
        let power = square(|t| &t.0);
        if power > 0.0 {
            (square(|t| &t.1) / power).sqrt()
        } else {
            0.0
        }
    }
}

/// Positions and lights with reference values.
pub struct TestSet {
    cases: Vec<TestCase>,
    bounces: u32,
}

/// Score of a bake.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TestScore {
    /// Errors against the reference with [`TestSet::bounces`] reflections.
    pub errors: Errors,
    /// Half width of the 95 % confidence interval of the NRMSE over random positions.
    pub interval: f64,
    /// Errors against the reference with all reflections.
    pub all: Errors,
    /// Fraction of positions that no basis function covers. They count as dark.
    pub uncovered: f64,
}

impl TestSet {
    /// Computes the reference for `bounces` reflections and for all of them. Lights are white point
    /// lights in the space between surfaces. The root mean square of the direct light of each is 1
    /// W/m², so that they have equal weight. Emissive surfaces count as dark. Returns `None` if no
    /// light reaches a surface.
    #[must_use]
    pub fn new(
        geometry: &dyn Geometry,
        viewpoints: &[[f32; 3]],
        size: &TestSetSize,
        bounces: u32,
    ) -> Option<Self> {
        let viewpoints = match viewpoints {
            [] => find_viewpoints(geometry, SEED).0,
            named => named.iter().map(|&v| v.into()).collect(),
        };
        let particles = (size.light_sources * size.positions / 4).max(256) as u64;
        let candidates =
            trace_particles(geometry, &viewpoints, 0..particles, SEED, false).candidates;
        if candidates.is_empty() {
            return None;
        }
        let mut random = Random::new(SEED, 0, 0);
        let light_sources = sample_open_positions(
            geometry,
            &candidates,
            size.light_sources,
            CANDIDATES_PER_LIGHT,
            &mut random,
        );
        let lit = NonEmissive { geometry };
        let cases: Vec<TestCase> = (0..)
            .zip(light_sources)
            .filter_map(|(k, position)| {
                let positions: Vec<(Vec3, Vec3)> = (0..size.positions)
                    .map(|_| candidates[random.below(candidates.len())].surface)
                    .map(|s| (s.position, s.normal))
                    .collect();
                let light_source = |intensity| Light::Point {
                    position,
                    intensity: Vec3::splat(intensity),
                    range: f32::INFINITY,
                };
                let paths =
                    allocate_paths(&lit, light_source(1.0), &positions, size.paths, SEED ^ k);
                let few: Vec<u32> = paths.iter().map(|p| p / 4).collect();
                let truth = |bounces, paths: &[u32]| {
                    reference(
                        &lit,
                        light_source(1.0),
                        &positions,
                        paths,
                        bounces,
                        SEED + k,
                    )
                };
                // Only a chart of large errors needs all reflections, so fewer paths suffice.
                let (some, all) = (truth(Some(bounces), &paths), truth(None, &few));
                let direct: f32 = some.iter().map(|e| e.direct.length_squared() / 3.0).sum();
                let strength = (positions.len() as f32 / direct).sqrt();
                strength.is_finite().then(|| TestCase {
                    light_source: light_source(strength),
                    positions,
                    truth: ReferenceValues::new(&some, strength),
                    all: ReferenceValues::new(&all, strength),
                })
            })
            .collect();
        (!cases.is_empty()).then_some(Self { cases, bounces })
    }

    /// Returns the number of reflections of the limited reference.
    #[must_use]
    pub fn bounces(&self) -> u32 {
        self.bounces
    }

    /// Returns the lights that reach a surface.
    #[must_use]
    pub fn light_sources(&self) -> Vec<Light> {
        self.cases.iter().map(|q| q.light_source).collect()
    }

    /// Returns all positions in the order of the lights: position in meters and unit normal.
    pub fn positions(&self) -> impl Iterator<Item = (Vec3, Vec3)> {
        self.cases.iter().flat_map(|q| q.positions.iter().copied())
    }

    /// Returns the standard error of the reference over its values, both as root mean squares. The
    /// first has [`TestSet::bounces`] reflections, the second all.
    #[must_use]
    pub fn noise(&self) -> (f64, f64) {
        let of = |truth: fn(&TestCase) -> &ReferenceValues| {
            let all: Vec<&ReferenceValues> = self.cases.iter().map(truth).collect();
            ReferenceValues::noise(&all)
        };
        (of(|q| &q.truth), of(|q| &q.all))
    }

    /// Measures a bake whose frame runs with `settings`.
    #[must_use]
    pub fn score(&self, scene: &BakedScene, settings: &FrameSettings) -> TestScore {
        let settings = FrameSettings {
            emission: 0.0,
            sky: SkyRadiance::BLACK,
            ..*settings
        };
        let mut frame = CpuFrame::new(scene);
        let (mut values, mut dark) = (Vec::new(), 0usize);
        for q in &self.cases {
            frame.set_lights(scene, &FrameLight::expand(&q.light_source, 1));
            frame.solve(scene, &settings);
            for &(x, n) in &q.positions {
                let found = frame.irradiance(scene, x, n);
                dark += usize::from(found.is_none());
                values.push(found.unwrap_or_default());
            }
        }
        let of = |truth: fn(&TestCase) -> &ReferenceValues| -> ReferenceValues {
            let mut all = ReferenceValues::default();
            for q in &self.cases {
                all.0.extend(&truth(q).0);
                all.1.extend(&truth(q).1);
            }
            all
        };
        let (truth, all) = (of(|q| &q.truth), of(|q| &q.all));
        let errors_of = |t: &ReferenceValues| errors(&values, &t.0, &t.1);
        let found = errors_of(&truth);
        TestScore {
            errors: found,
            interval: interval(&values, &truth, found.nrmse),
            all: errors_of(&all),
            uncovered: dark as f64 / values.len().max(1) as f64,
        }
    }
}

/// Returns the number of paths per position, `paths` in the mean. It is proportional to the noise
/// in a pilot, which minimizes the total noise for a given number of paths. The pilot's own paths
/// are not used again, so that the reference stays unbiased.
fn allocate_paths(
    geometry: &dyn Geometry,
    light_source: Light,
    positions: &[(Vec3, Vec3)],
    paths: u32,
    seed: u64,
) -> Vec<u32> {
    let settings = ReferenceSettings {
        paths: PILOT_PATHS,
        bounces: Some(2),
        seed,
    };
    let noise: Vec<f32> = irradiance_at_all(geometry, &[light_source], positions, &settings)
        .iter()
        .map(|e| e.indirect_error.length())
        .collect();
    let mean = noise.iter().sum::<f32>() / positions.len().max(1) as f32;
    noise
        .iter()
        .map(|n| {
            // The limits keep a single position from taking most of the paths.
            let share = if mean > 0.0 { n / mean } else { 1.0 };
            (paths as f32 * share.clamp(0.25, 16.0)) as u32
        })
        .collect()
}

/// Computes the reference at all positions with the number of paths of each.
fn reference(
    geometry: &dyn Geometry,
    light_source: Light,
    positions: &[(Vec3, Vec3)],
    paths: &[u32],
    bounces: Option<u32>,
    seed: u64,
) -> Vec<Irradiance> {
    let one = |(k, (&(x, n), &paths)): (usize, (&(Vec3, Vec3), &u32))| {
        let settings = ReferenceSettings {
            paths,
            bounces,
            seed,
        };
        irradiance(geometry, &[light_source], x, n, k as u64, &settings)
    };
    positions
        .par_iter()
        .zip(paths)
        .enumerate()
        .map(one)
        .collect()
}

/// Returns the half width of the 95 % confidence interval of an NRMSE over random positions.
fn interval(values: &[Vec3], truth: &ReferenceValues, nrmse: f64) -> f64 {
    let square = |v: Vec3| f64::from(v.length_squared());
    let count = values.len().max(2) as f64;
    let power = truth.0.iter().map(|t| square(*t)).sum::<f64>() / count;
    if power <= 0.0 {
        return 0.0;
    }
    let parts = values.iter().zip(&truth.0).zip(&truth.1);
    let parts: Vec<f64> = parts
        .map(|((x, t), s)| (square(*x - *t) - square(*s)) / power)
        .collect();
    let mean = parts.iter().sum::<f64>() / count;
    let variance = parts.iter().map(|p| (p - mean).powi(2)).sum::<f64>() / count / (count - 1.0);
    // d√m = dm / 2√m. If m is within its own noise of zero, the result is the root of that noise.
    let spread = 1.96 * variance.sqrt();
    if nrmse * nrmse > spread {
        spread / (2.0 * nrmse)
    } else {
        spread.sqrt()
    }
}
