//! Importance particles ([L08] §2.3): surface points that light can reach from a viewpoint.
//! Particles start at the viewpoints and reflect diffusely. Every bounce after the first few adds a
//! candidate.

use super::{Random, cosine_hemisphere, tangents, uniform_sphere};
use crate::scene::{Geometry, Ray, Surface};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Largest number of bounces of a particle ([L08]: 30).
const BOUNCES: u32 = 30;
/// Number of first bounces without a candidate, so that the distribution does not depend on the
/// start ([L08]: 3).
const DROPPED_BOUNCES: u32 = 3;

/// Surface position that light reaches.
#[derive(Clone, Copy, Debug)]
pub struct Candidate {
    /// Surface, on the side that was reached.
    pub surface: Surface,
    /// Position half-way along the ray that found the surface, meters. It lies between surfaces.
    pub free: Vec3,
}

/// Result of tracing particles.
#[derive(Debug, Default)]
pub struct TracedParticles {
    /// Candidates, in the order of the particles.
    pub candidates: Vec<Candidate>,
    /// Number of rays cast.
    pub rays: u64,
}

/// Traces the particles numbered `particles` from `viewpoints`. Particle k starts at viewpoint k
/// mod `viewpoints.len()`. `drop_first` drops the first bounces. Set it to `false` for an open
/// scene, because particles leave the scene after few bounces.
///
/// The result depends on the numbers alone, not on threads.
pub fn trace_particles(
    geometry: &dyn Geometry,
    viewpoints: &[Vec3],
    particles: std::ops::Range<u64>,
    seed: u64,
    drop_first: bool,
) -> TracedParticles {
    if viewpoints.is_empty() {
        return TracedParticles::default();
    }
    let per_particle: Vec<(Vec<Candidate>, u64)> = particles
        .into_par_iter()
        .map(|k| {
            trace_one(
                geometry,
                viewpoints[(k % viewpoints.len() as u64) as usize],
                k,
                seed,
                drop_first,
            )
        })
        .collect();
    let mut out = TracedParticles::default();
    for (candidates, rays) in per_particle {
        out.candidates.extend(candidates);
        out.rays += rays;
    }
    out
}

fn trace_one(
    geometry: &dyn Geometry,
    from: Vec3,
    k: u64,
    seed: u64,
    drop_first: bool,
) -> (Vec<Candidate>, u64) {
    let mut random = Random::new(seed, 0x70_61_72_74, k);
    let mut out = Vec::new();
    let mut rays = 0;
    let mut ray = Ray::new(
        from,
        uniform_sphere(Vec2::new(random.unit(), random.unit())),
    );
    for bounce in 0..BOUNCES {
        rays += 1;
        let Some(hit) = geometry.cast(&ray) else {
            break;
        };
        let surface = geometry.surface(&ray, &hit);
        if !surface.position.is_finite() || !surface.normal.is_finite() {
            break;
        }
        // The back of a single-sided surface neither reflects nor emits.
        if !surface.front && surface.albedo == Vec3::ZERO && surface.emission == Vec3::ZERO {
            break;
        }
        if !drop_first || bounce >= DROPPED_BOUNCES {
            out.push(Candidate {
                surface,
                free: ray.at(0.5 * hit.t),
            });
        }
        let (t, b) = tangents(surface.normal);
        let d = cosine_hemisphere(Vec2::new(random.unit(), random.unit()));
        let start = surface.position + surface.normal * geometry.ray_offset(surface.position);
        ray = Ray::new(
            start,
            (t * d.x + b * d.y + surface.normal * d.z).normalize(),
        );
    }
    (out, rays)
}

/// Returns candidates around the given points of `surfaces`, at most `reach` meters from their
/// point, and the number of rays cast. Each ray starts at a random height above a point. Each point
/// has `rounds` rays. A round visits all points, so that any first part of the result is spread
/// over all of them.
#[must_use]
pub fn local_candidates(
    geometry: &dyn Geometry,
    surfaces: &[Surface],
    around: &[usize],
    reach: f32,
    rounds: u64,
    seed: u64,
) -> (Vec<Candidate>, u64) {
    let found: Vec<Candidate> = (0..rounds)
        .into_par_iter()
        .flat_map_iter(|round| {
            around.iter().filter_map(move |&i| {
                let surface = &surfaces[i];
                let mut random = Random::new(seed, 0x6c_6f_63_61 + round, i as u64);
                let (t, b) = tangents(surface.normal);
                let lift = geometry.ray_offset(surface.position);
                let up = Ray::segment(
                    surface.position + surface.normal * lift,
                    surface.normal,
                    reach,
                );
                let ceiling = geometry.cast(&up).map_or(reach, |hit| hit.t);
                // Random origin below the next surface above, random direction.
                let eye = up.at((0.9 * ceiling * random.unit()).max(0.5 * lift));
                let toward = uniform_sphere(Vec2::new(random.unit(), random.unit()));
                let direction =
                    (t * toward.x + b * toward.y + surface.normal * toward.z).normalize();
                let ray = Ray::segment(eye, direction, 2.0 * reach);
                let hit = geometry.cast(&ray)?;
                let seen = geometry.surface(&ray, &hit);
                let shows = seen.front || seen.albedo != Vec3::ZERO || seen.emission != Vec3::ZERO;
                let near = seen.position.distance_squared(surface.position) <= reach * reach;
                (near && shows && seen.normal.is_finite()).then(|| Candidate {
                    surface: seen,
                    free: ray.at(0.5 * hit.t),
                })
            })
        })
        .collect();
    (found, 2 * rounds * around.len() as u64)
}
