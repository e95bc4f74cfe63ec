//! The reference integrator: unbiased Monte Carlo irradiance at surface points, with standard
//! errors.
//!
//! Path tracing from the position: cosine-weighted directions, next-event estimation of the light
//! sources at every vertex, emission and sky by the directions themselves. With the density cos θ /
//! π a direction's share of the irradiance is the radiosity that it meets, so that E = Σ_m Π ρ ·
//! E_direct(y_m) along a path ([L08] Eq. (12) unrolled). "Direct" is what goes from a light source
//! (emissive surfaces and the sky among them) to the position; "indirect" is what was diffusely
//! reflected once or more.
//!
//! Unbiased for any number of reflections, but for rays that start a hair's breadth above the
//! surface ([`Geometry::ray_offset`]): Russian roulette divides what goes on by the probability
//! with which it does. A path's first direction comes from a lattice, shifted at random for each
//! position, which makes the mean less noisy than independent paths; the standard error is that of
//! independent paths and so rather too large than too small.

use crate::samples::{Random, cosine_hemisphere, tangents};
use crate::scene::{Geometry, Light, Ray, SkyRadiance};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Largest probability with which Russian roulette lets a path go on. A path that goes on weighs ρ
/// / s as much, so that the sum over a path has a finite variance, and a standard error a meaning,
/// only while ρ² < s: with 0.999 for ρ up to 0.9995 in a closed room.
const MAX_SURVIVE: f32 = 0.999;

/// Effort of the reference integrator.
#[derive(Clone, Copy, Debug)]
pub struct ReferenceSettings {
    /// Paths per position.
    pub paths: u32,
    /// Most diffuse reflections that count; none for all (paths then end by Russian roulette).
    pub bounces: Option<u32>,
    /// Seed of the random numbers.
    pub seed: u64,
}

/// Irradiance at a position, W/m², with standard errors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Irradiance {
    /// Without reflection.
    pub direct: Vec3,
    /// Standard error of it.
    pub direct_error: Vec3,
    /// With one reflection or more.
    pub indirect: Vec3,
    /// Standard error of it.
    pub indirect_error: Vec3,
}

/// Smooth end of a light's reach, as Bevy's shader has it: (1 − (d²/r²)²)² up to r.
fn window(square: f32, range: f32) -> f32 {
    let t = square / (range * range);
    let f = (1.0 - t * t).max(0.0);
    if range.is_finite() { f * f } else { 1.0 }
}

/// Irradiance of one light source (not the sky) at a position lifted to `start`; a rectangle is
/// sampled at one random position. W/m².
#[must_use]
pub fn direct_irradiance(
    geometry: &dyn Geometry,
    light: &Light,
    start: Vec3,
    n: Vec3,
    random: &mut Random,
) -> Vec3 {
    let light_source = |position: Vec3, intensity: Vec3, range: f32| {
        let to = position - start;
        let square = to.length_squared();
        let cosine = to.dot(n);
        if cosine <= 0.0 || square <= 0.0 {
            return None;
        }
        let distance = square.sqrt();
        let e = intensity * (cosine / (square * distance) * window(square, range));
        Some((e, -to / distance, position))
    };
    let shadowed = |found: Option<(Vec3, Vec3, Vec3)>| match found {
        Some((e, _, position)) if e != Vec3::ZERO && !geometry.occluded(start, position) => e,
        _ => Vec3::ZERO,
    };
    match *light {
        Light::Point {
            position,
            intensity,
            range,
        } => shadowed(light_source(position, intensity, range)),
        Light::Spot {
            position,
            direction,
            intensity,
            inner,
            outer,
            range,
        } => shadowed(
            light_source(position, intensity, range).map(|(e, toward, position)| {
                let span = (inner.cos() - outer.cos()).max(1e-4);
                let f = ((toward.dot(direction) - outer.cos()) / span).clamp(0.0, 1.0);
                (e * f * f, toward, position)
            }),
        ),
        Light::Directional {
            direction,
            irradiance,
        } => {
            let cosine = -direction.dot(n);
            if cosine <= 0.0 || geometry.cast(&Ray::new(start, -direction)).is_some() {
                Vec3::ZERO
            } else {
                irradiance * cosine
            }
        }
        Light::Rect {
            center,
            u,
            v,
            radiance,
        } => {
            let position =
                center + u * (2.0 * random.unit() - 1.0) + v * (2.0 * random.unit() - 1.0);
            let facing = u.cross(v);
            // The light's own model may lie in its plane: the shadow ray ends a little before it.
            let position = position + facing.normalize_or_zero() * geometry.ray_offset(position);
            // Area 4 |u × v| and the emitter's cosine together: 4 (u × v) · direction.
            shadowed(light_source(position, radiance, f32::INFINITY).map(
                |(e, toward, position)| (e * (4.0 * facing.dot(toward)).max(0.0), toward, position),
            ))
        }
        Light::Sky { .. } => Vec3::ZERO,
    }
}

/// Irradiance at surface point (`x`, `n`). `stream` numbers the position: the same position, stream
/// and settings give the same answer.
#[must_use]
pub fn irradiance(
    geometry: &dyn Geometry,
    lights: &[Light],
    x: Vec3,
    n: Vec3,
    stream: u64,
    settings: &ReferenceSettings,
) -> Irradiance {
    let sky: SkyRadiance = lights
        .iter()
        .filter_map(|light| match light {
            Light::Sky { radiance } => Some(*radiance * core::f32::consts::PI),
            _ => None,
        })
        .sum();
    let light_sources = |start: Vec3, n: Vec3, random: &mut Random| -> Vec3 {
        lights
            .iter()
            .map(|light| direct_irradiance(geometry, light, start, n, random))
            .sum()
    };
    // Only rectangles are sampled at random. Others give every path the same direct light.
    let start = x + n * geometry.ray_offset(x);
    let is_random = lights.iter().any(|l| matches!(l, Light::Rect { .. }));
    let same_direct =
        (!is_random).then(|| light_sources(start, n, &mut Random::new(settings.seed, stream, 0)));
    let max = settings.bounces.unwrap_or(u32::MAX);
    let mut sums = [glam::DVec3::ZERO; 4];
    for path in 0..settings.paths {
        let mut random = Random::new(settings.seed ^ 0x72_65_66, stream, u64::from(path));
        let mut position = start;
        let mut normal = n;
        let mut throughput = Vec3::ONE;
        let mut direct =
            same_direct.unwrap_or_else(|| light_sources(position, normal, &mut random));
        let mut indirect = Vec3::ZERO;
        // The light that comes along the next direction has `depth` reflections behind it once it
        // is emitted there, and one more once reflected.
        let mut depth = 0u32;
        loop {
            let (t, b) = tangents(normal);
            // The first two dimensions are stratified over the paths by a lattice.
            let u = if depth == 0 {
                let mut shift = Random::new(settings.seed ^ 0x73_68, stream, 0);
                crate::samples::lattice(path, settings.paths, Vec2::new(shift.unit(), shift.unit()))
            } else {
                Vec2::new(random.unit(), random.unit())
            };
            let d = cosine_hemisphere(u);
            let ray = Ray::new(position, (t * d.x + b * d.y + normal * d.z).normalize());
            let hit = geometry.cast(&ray);
            let seen = hit.map(|hit| geometry.surface(&ray, &hit));
            let emitted =
                throughput * seen.map_or_else(|| sky.toward(ray.direction), |s| s.emission);
            if depth == 0 {
                direct += emitted;
            } else {
                indirect += emitted;
            }
            let Some(seen) = seen else { break };
            depth += 1;
            if depth > max {
                break;
            }
            throughput *= seen.albedo;
            if settings.bounces.is_none() && depth > 3 {
                let survive = throughput.max_element().min(MAX_SURVIVE);
                if random.unit() >= survive {
                    break;
                }
                throughput /= survive;
            }
            if throughput == Vec3::ZERO {
                break;
            }
            position = seen.position + seen.normal * geometry.ray_offset(seen.position);
            normal = seen.normal;
            indirect += throughput * light_sources(position, normal, &mut random);
        }
        // Squares in double precision: their difference to the squared mean is small.
        let (direct, indirect) = (direct.as_dvec3(), indirect.as_dvec3());
        let values = [direct, direct * direct, indirect, indirect * indirect];
        for (sum, value) in sums.iter_mut().zip(values) {
            *sum += value;
        }
    }
    let count = f64::from(settings.paths.max(1));
    let [direct, direct_square, indirect, indirect_square] = sums.map(|s| s / count);
    let error = |mean: glam::DVec3, square: glam::DVec3| {
        let variance = (square - mean * mean).max(glam::DVec3::ZERO) / (count - 1.0).max(1.0);
        glam::DVec3::new(variance.x.sqrt(), variance.y.sqrt(), variance.z.sqrt()).as_vec3()
    };
    Irradiance {
        direct: direct.as_vec3(),
        direct_error: error(direct, direct_square),
        indirect: indirect.as_vec3(),
        indirect_error: error(indirect, indirect_square),
    }
}

/// [`irradiance`] at many positions, in parallel; position k is stream k.
#[must_use]
pub fn irradiance_at_all(
    geometry: &dyn Geometry,
    lights: &[Light],
    positions: &[(Vec3, Vec3)],
    settings: &ReferenceSettings,
) -> Vec<Irradiance> {
    positions
        .par_iter()
        .enumerate()
        .map(|(k, &(x, n))| irradiance(geometry, lights, x, n, k as u64, settings))
        .collect()
}
