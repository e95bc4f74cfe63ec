//! Senders on emissive surfaces.
//!
//! A small emitter close to another surface, such as a sign on a wall, lies within the support of
//! that surface's functions. Its light would be spread over them, and few gather rays would meet
//! it. Emitters therefore have senders of their own. A hit on an emissive triangle belongs to these
//! alone, every other hit to the other senders. Gathers then sample emitters by area
//! ([`crate::transport::gather()`]).

use super::hierarchy::normalize;
use super::{Hierarchy, WeightEntry};
use crate::samples::{Candidate, Random, throw_darts, trace_particles};
use crate::scene::{Emitters, Geometry, Ray, Surface};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Number of importance particles. Each of their bounces tries one position on an emitter.
const PARTICLES: u64 = 1024;
/// Divisor of a level's largest number of points. The quotient limits the points on emitters.
const MAX_PART: usize = 4;

/// Returns `true` if a point of the surface lies on an emissive triangle.
fn is_on_emitter(geometry: &dyn Geometry, emitters: &Emitters, surface: &Surface) -> bool {
    let lift = 2.0 * geometry.ray_offset(surface.position);
    let start = surface.position + lift * surface.normal;
    let hit = geometry.cast(&Ray::segment(start, -surface.normal, 2.0 * lift));
    hit.is_some_and(|hit| emitters.contains(hit.primitive))
}

/// Returns positions on emitters that importance particles from the viewpoints can reach, and the
/// number of rays cast.
pub(super) fn emitter_candidates(
    geometry: &dyn Geometry,
    emitters: &Emitters,
    viewpoints: &[Vec3],
    seed: u64,
) -> (Vec<Candidate>, u64) {
    let seed = seed ^ 0x65_6d_69_74;
    let traced = trace_particles(geometry, viewpoints, 0..PARTICLES, seed, false);
    let from = |(k, c): (usize, &Candidate)| {
        let n = c.surface.normal;
        let start = c.surface.position + n * geometry.ray_offset(c.surface.position);
        let mut random = Random::new(seed, 1, k as u64);
        let u = Vec2::new(random.unit(), random.unit());
        let (ray, hit) = emitters.seen_from(start).visible(geometry, start, n, u)?;
        let surface = geometry.surface(&ray, &hit);
        let is_lit = geometry.hit_point(&ray, &hit).lit;
        is_lit.then(|| Candidate {
            surface,
            free: ray.at(0.5 * hit.t),
        })
    };
    let rays = traced.rays + traced.candidates.len() as u64;
    let found = traced.candidates.par_iter().enumerate().filter_map(from);
    (found.collect(), rays)
}

/// Replaces the points on emitters by disks of `radius` meters among `candidates`. The level keeps
/// at most `max` points. Returns the number of rays cast.
pub(super) fn separate_emitters(
    geometry: &dyn Geometry,
    emitters: &Emitters,
    candidates: &[Candidate],
    points: &mut Vec<Candidate>,
    radius: f32,
    max: usize,
) -> u64 {
    let (own, rays) = throw_darts(Some(geometry), candidates.to_vec(), radius, max / MAX_PART);
    points.retain(|c| !is_on_emitter(geometry, emitters, &c.surface));
    points.truncate(max - own.len());
    points.extend(own);
    rays
}

/// Tests each surface: `true` if it lies on an emitter.
pub(super) fn on_emitters(
    geometry: &dyn Geometry,
    emitters: &Emitters,
    surfaces: &[Surface],
) -> Vec<bool> {
    surfaces
        .par_iter()
        .map(|surface| is_on_emitter(geometry, emitters, surface))
        .collect()
}

impl Hierarchy {
    /// Computes the basis functions of sender level `l` that are not zero at (x, n). Their weights
    /// sum to one. At a position on an emitter these are the functions on emitters, elsewhere the
    /// others. `near` is the list of the level's grid at `x`. Replaces `out`. Returns `false` if no
    /// function covers the position.
    #[inline]
    pub fn sender_weights(
        &self,
        l: usize,
        near: &[u32],
        x: Vec3,
        n: Vec3,
        is_emitter: bool,
        out: &mut Vec<WeightEntry>,
    ) -> bool {
        if self.emissive.is_empty() {
            return self.senders[l].weights_among(near, x, n, out);
        }
        self.raw_sender_weights(l, near, x, n, is_emitter, out);
        normalize(out);
        !out.is_empty()
    }

    /// Computes the weights of [`sender_weights`](Self::sender_weights) before normalization.
    pub(super) fn raw_sender_weights(
        &self,
        l: usize,
        near: &[u32],
        x: Vec3,
        n: Vec3,
        is_emitter: bool,
        out: &mut Vec<WeightEntry>,
    ) {
        out.clear();
        self.senders[l].raw_weights_among(near, x, n, out);
        let first = self.level_starts[l];
        let is_on_emitter = |w: &WeightEntry| self.is_on_emitter((first + w.index) as usize);
        out.retain(|w| is_on_emitter(w) == is_emitter);
    }

    /// Returns `true` if sender `j` lies on an emitter and emitters are separate.
    #[must_use]
    pub fn is_on_emitter(&self, j: usize) -> bool {
        self.emissive.get(j).is_some_and(|&e| e)
    }

    /// Returns the emitters of the geometry if they have senders of their own.
    #[must_use]
    pub fn separate_emitters<'a>(&self, geometry: &'a dyn Geometry) -> Option<&'a Emitters> {
        geometry.emitters().filter(|_| !self.emissive.is_empty())
    }
}
