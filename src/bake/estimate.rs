//! How wrong a bake is, by its own measurement: indirect irradiance through the frame's own path against unbiased Monte Carlo, at random surface
//! places, for lamps that the bake did not see.

use super::Progress;
use super::progress::Stage;
use super::signals::free_places;
use crate::accuracy::{ReferenceSettings, irradiance_at_all};
use crate::asset::BakedScene;
use crate::frame::{CpuFrame, FrameLight, FrameSettings};
use crate::samples::{Random, trace_particles};
use crate::scene::{Geometry, Light};
use glam::Vec3;

/// Surface places.
const PLACES: usize = 200;
/// Lamps.
const LAMPS: usize = 4;
/// Paths a place and lamp.
const PATHS: u32 = 512;

/// A bake's error, measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Estimate {
    /// NRMSE over places and lamps, without the reference's own noise.
    pub nrmse: f32,
    /// Half width of its 95 % confidence interval.
    pub interval: f32,
}

/// Measures the error of each tier of `scene` on `geometry`, tier 1 first, and says how many rays that took. None when `progress` asks to stop.
pub fn estimate_errors(
    scene: &BakedScene,
    geometry: &dyn Geometry,
    seed: u64,
    progress: &Progress,
) -> Option<(Vec<Estimate>, u64)> {
    // Nothing that the bake drew its points or training lights from.
    let seed = seed ^ 0x65_73_74_69_6d;
    let viewpoints: Vec<Vec3> = scene.info.viewpoints.iter().map(|&v| v.into()).collect();
    let (lamps, mut rays) = free_places(geometry, &viewpoints, LAMPS, seed, true);
    let traced = trace_particles(geometry, &viewpoints, 0..2048, seed, false);
    rays += traced.rays;
    let mut random = Random::new(seed, 0, 0);
    let places: Vec<(Vec3, Vec3)> = (0..PLACES.min(traced.candidates.len()))
        .map(|_| traced.candidates[random.below(traced.candidates.len())].surface)
        .map(|s| (s.position, s.normal))
        .collect();
    let bounces = scene.info.bounces;
    let settings = FrameSettings {
        emission: 0.0,
        ..FrameSettings::bounces(bounces)
    };
    let mut frame = CpuFrame::new(scene);
    // Per tier, place and lamp: squared error; all lamps' mean square of indirect light.
    let mut parts: Vec<Vec<f64>> = vec![Vec::new(); scene.operator.tiers() as usize];
    let mut power = 0.0;
    for (k, &position) in lamps.iter().enumerate() {
        if !progress.set(Stage::Estimate, k as f32 / lamps.len() as f32) {
            return None;
        }
        let lamp = Light::Point {
            position,
            intensity: Vec3::ONE,
            range: f32::INFINITY,
        };
        frame.set_lights(scene, &FrameLight::expand(&lamp, 1));
        // Two references that know nothing of each other: the product of the differences to them has the bake's squared error as its mean, whatever
        // their own noise.
        let [first, second] = [0, 1].map(|half| {
            irradiance_at_all(
                &Lit { geometry },
                &[lamp],
                &places,
                &ReferenceSettings {
                    paths: PATHS / 2,
                    bounces: Some(bounces),
                    seed: seed.wrapping_add(2 * k as u64 + half),
                },
            )
        });
        rays += places.len() as u64 * u64::from(PATHS) * 2 * u64::from(bounces);
        let products = first
            .iter()
            .zip(&second)
            .map(|(a, b)| f64::from(a.indirect.dot(b.indirect)));
        // Lamps count alike by the light that they throw, not by what comes back of it: one that shines into the open has no error to speak of.
        let direct = first.iter().zip(&second);
        let direct = direct.map(|(a, b)| f64::from(a.direct.dot(b.direct)));
        let thrown = direct.sum::<f64>();
        if thrown <= 0.0 {
            continue;
        }
        power += products.sum::<f64>() / thrown;
        let scale = places.len() as f64 / thrown;
        for (parts, tier) in parts.iter_mut().zip(1..) {
            frame.solve(scene, &FrameSettings { tier, ..settings });
            for ((&(x, n), a), b) in places.iter().zip(&first).zip(&second) {
                let value = frame.irradiance(scene, x, n).unwrap_or(Vec3::ZERO);
                parts.push(scale * f64::from((value - a.indirect).dot(value - b.indirect)));
            }
        }
    }
    let estimates = parts
        .into_iter()
        .map(|parts| summarise(parts, power, places.len()))
        .collect();
    Some((estimates, rays))
}

/// The estimate from the squared errors of a tier.
fn summarise(mut parts: Vec<f64>, power: f64, places: usize) -> Estimate {
    let count = parts.len().max(1) as f64;
    let power = power * places as f64 / count;
    if power <= 0.0 {
        return Estimate::default();
    }
    for part in &mut parts {
        *part /= power;
    }
    let mean = parts.iter().sum::<f64>() / count;
    let variance =
        parts.iter().map(|p| (p - mean).powi(2)).sum::<f64>() / count / (count - 1.0).max(1.0);
    let nrmse = mean.max(0.0).sqrt();
    // d√m = dm / 2√m; where m is within its own noise of zero, the root of that noise.
    let spread = 1.96 * variance.sqrt();
    let interval = if nrmse * nrmse > spread {
        spread / (2.0 * nrmse)
    } else {
        spread.sqrt()
    };
    Estimate {
        nrmse: nrmse as f32,
        interval: interval as f32,
    }
}

/// The geometry without its own emission: the estimate is of lamps' light.
pub struct Lit<'a> {
    /// What it is of.
    pub geometry: &'a dyn Geometry,
}

impl Geometry for Lit<'_> {
    fn bounds(&self) -> crate::scene::Bounds {
        self.geometry.bounds()
    }

    fn cast(&self, ray: &crate::scene::Ray) -> Option<crate::scene::Hit> {
        self.geometry.cast(ray)
    }

    fn occluded(&self, from: Vec3, to: Vec3) -> bool {
        self.geometry.occluded(from, to)
    }

    fn surface(&self, ray: &crate::scene::Ray, hit: &crate::scene::Hit) -> crate::scene::Surface {
        crate::scene::Surface {
            emission: Vec3::ZERO,
            ..self.geometry.surface(ray, hit)
        }
    }

    fn lift(&self, p: Vec3) -> f32 {
        self.geometry.lift(p)
    }
}
