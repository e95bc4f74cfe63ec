//! Hemispherical gather of [L08] Eq. (16): all links of one receiver from one set of rays.
//!
//! Deviation (design D1): a link excludes reflectance and includes 1/π.
//! F_ij = (1/π) ∫ B_j(r(x_i, ω)) ω dω depends on geometry only. It is dimensionless, and
//! |F_ij| ≤ 1.
//!
//! Each thread has one accumulator, dense over the senders, with a list of nonzero entries. It
//! needs neither a map nor an allocation per ray (design D4). Separate sums of even and of odd rays
//! distinguish variation from noise.

use super::occluded_links::LinkTerm;
use super::receiver_rays::{ReceiverRay, ReceiverRays};
use crate::basis::{GatherHit, Hierarchy, WeightEntry};
use crate::samples::{gather_weight, lattice};
use crate::scene::{EmitterView, Geometry, Hit, Ray, SkyRadiance};
use core::f32::consts::PI;
use glam::{Vec2, Vec3, Vec3A};
use std::ops::Range;

/// Number of rays of the hemisphere for each ray toward an emitter.
const RAYS_PER_EMITTER_RAY: u32 = 2;

/// Sender levels that a hit is added to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Deposit {
    /// Finest level that covers the hit. Rows keep their mass.
    Finest,
    /// Every level (\[L08\] Eq. (16)).
    All,
}

/// Settings of a gather, for any hierarchy.
#[derive(Clone, Copy)]
pub struct GatherSettings<'a> {
    /// Geometry that rays intersect.
    pub geometry: &'a dyn Geometry,
    /// Number of levels, from the coarsest, that are senders.
    pub sender_levels: usize,
    /// Number of rays per receiver.
    pub rays: u32,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Sender levels that a hit is added to.
    pub deposit: Deposit,
}

impl<'a> GatherSettings<'a> {
    /// Returns the input of a gather with the current points.
    #[must_use]
    pub fn scene(&self, hierarchy: &'a Hierarchy) -> GatherScene<'a> {
        GatherScene {
            geometry: self.geometry,
            hierarchy,
            sender_levels: self.sender_levels,
            rays: self.rays,
            seed: self.seed,
            deposit: self.deposit,
        }
    }
}

/// Input of a gather.
#[derive(Clone, Copy)]
pub struct GatherScene<'a> {
    /// Geometry that rays intersect.
    pub geometry: &'a dyn Geometry,
    /// Basis functions.
    pub hierarchy: &'a Hierarchy,
    /// Number of levels, from the coarsest, that are senders.
    pub sender_levels: usize,
    /// Number of rays per receiver.
    pub rays: u32,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Sender levels that a hit is added to.
    pub deposit: Deposit,
}

/// Sums of one gather. Reused, one per thread.
pub struct Gathered {
    /// Sums F_ij of even rays and of odd rays per sender. Their total is the link.
    pub sums: Vec<[Vec3A; 2]>,
    /// Senders with sums that can be nonzero.
    pub touched: Vec<u32>,
    /// (1/π) ∫ ω dω over the directions without a hit.
    pub sky: Vec3A,
    /// Parts of the sums and of the sky that crossed occluders, in the order of rays. The sky has
    /// the index "number of senders".
    pub parts: Vec<LinkTerm>,
    /// Part of the normal component that hit a surface without a sender.
    pub uncovered: f32,
    /// Part that hit the back of a single-sided surface, which emits nothing.
    pub unlit: f32,
    marks: Vec<bool>,
    found: Vec<WeightEntry>,
    samples: Vec<GatherSample>,
}

/// Direction of a gather, and its hit.
struct GatherSample {
    direction: Vec3,
    /// Cosine of the direction and the normal.
    cosine: f32,
    /// Weight before normalization over all directions.
    weight: f32,
    /// `None` if the direction reaches the sky.
    hit: Option<SampleHit>,
    /// 0 for an even ray, 1 for an odd one.
    half: usize,
    /// Crossed occluders, bit k for occluder k.
    crossed: u64,
}

/// Hit of a direction.
struct SampleHit {
    hit: GatherHit,
    /// Range of entries of the finest level's grid at the hit.
    near: Range<u32>,
}

impl SampleHit {
    fn new(geometry: &dyn Geometry, ray: &Ray, hit: &Hit, is_emitter: bool) -> Self {
        let at = geometry.hit_point(ray, hit);
        Self {
            hit: GatherHit {
                position: at.position,
                normal: at.normal,
                distance: hit.t,
                is_emitter,
                is_lit: at.lit,
            },
            near: 0..0,
        }
    }
}

impl Gathered {
    /// Creates empty sums for `senders` senders.
    #[must_use]
    pub fn new(senders: usize) -> Self {
        Self {
            sums: vec![[Vec3A::ZERO; 2]; senders],
            touched: Vec::new(),
            sky: Vec3A::ZERO,
            parts: Vec::new(),
            uncovered: 0.0,
            unlit: 0.0,
            marks: vec![false; senders],
            found: Vec::new(),
            samples: Vec::new(),
        }
    }

    /// Resets all sums.
    pub fn reset(&mut self) {
        for &j in &self.touched {
            self.sums[j as usize] = [Vec3A::ZERO; 2];
            self.marks[j as usize] = false;
        }
        self.touched.clear();
        self.sky = Vec3A::ZERO;
        self.parts.clear();
        self.uncovered = 0.0;
        self.unlit = 0.0;
    }

    /// Adds `value` to half sum 0 or 1 of the link to `sender`.
    #[inline]
    pub fn deposit(&mut self, sender: u32, half: usize, value: Vec3A) {
        let j = sender as usize;
        if !self.marks[j] {
            self.marks[j] = true;
            self.touched.push(sender);
        }
        self.sums[j][half] += value;
    }

    /// Adds `value` to the part of the link to `sender` that crossed occluders.
    fn add_term(&mut self, sender: u32, crossed: u64, value: Vec3A) {
        self.parts.push(LinkTerm {
            sender,
            crossed,
            value,
        });
    }

    /// Adds `value` to the senders that cover a hit.
    fn deposit_hit(
        &mut self,
        scene: &GatherScene<'_>,
        sample: &GatherSample,
        hit: &SampleHit,
        value: Vec3A,
        n: Vec3,
        found: &mut Vec<WeightEntry>,
    ) {
        let hierarchy = scene.hierarchy;
        let finest = scene.sender_levels - 1;
        let near = hit.near.start as usize..hit.near.end as usize;
        let near = &hierarchy.senders[finest].grid.entries[near];
        let covered = match scene.deposit {
            Deposit::Finest => {
                hierarchy.hit_senders(scene.geometry, scene.sender_levels, near, &hit.hit, found)
            }
            Deposit::All => hierarchy.senders_of_levels(scene.sender_levels, &hit.hit, found),
        };
        for entry in &*found {
            let value = value * entry.weight;
            self.deposit(entry.index, sample.half, value);
            if sample.crossed != 0 {
                self.add_term(entry.index, sample.crossed, value);
            }
        }
        if !covered {
            let lost = match hit.hit.is_lit {
                true => &mut self.uncovered,
                false => &mut self.unlit,
            };
            *lost += value.dot(n.into());
        }
    }

    /// Returns the link F_ij.
    #[must_use]
    pub fn link(&self, sender: u32) -> Vec3A {
        let [even, odd] = self.sums[sender as usize];
        even + odd
    }
}

/// Gathers all links of point `i` of the hierarchy into `out`.
///
/// Emitters that have their own senders are also sampled by area, with the balance heuristic
/// (\[VG95\] §3.2). A direction has density p_h from N_h rays of the hemisphere and p_e from N_e
/// samples of emitters. Its weight is 1 / (π (N_h p_h + N_e p_e)). Both sampling strategies are
/// needed. Few rays of the hemisphere hit a small sign. A large panel next to the receiver has few
/// area samples in its nearest part.
pub fn gather(scene: &GatherScene<'_>, i: usize, out: &mut Gathered) {
    out.reset();
    let mut samples = std::mem::take(&mut out.samples);
    samples.clear();
    // All casts run before all grid queries, so that they do not share the processor's caches.
    cast_samples(scene, i, &mut samples);
    // All queries of the finest level's grid run first, so that their memory accesses overlap.
    let grid = &scene.hierarchy.senders[scene.sender_levels - 1].grid;
    for hit in samples.iter_mut().filter_map(|s| s.hit.as_mut()) {
        hit.near = grid.range_near(hit.hit.position);
    }
    // The samples deviate from the closed form Σ w cos θ = 1 by rounding, discrepancy and the noise
    // of area samples. Division by the sum corrects this, so that a closed room of unit radiosity
    // gathers exactly 1.
    let norm = 1.0 / samples.iter().fold(0.0, |sum, s| sum + s.weight * s.cosine);
    let n = scene.hierarchy.surfaces[i].normal;
    let mut found = std::mem::take(&mut out.found);
    for sample in &samples {
        let value = Vec3A::from(sample.direction) * (sample.weight * norm);
        match &sample.hit {
            Some(hit) => out.deposit_hit(scene, sample, hit, value, n, &mut found),
            None => {
                out.sky += value;
                if sample.crossed != 0 {
                    out.add_term(out.sums.len() as u32, sample.crossed, value);
                }
            }
        }
    }
    out.found = found;
    out.samples = samples;
}

/// Casts the rays of the hemisphere around point `i`, then those toward emitters.
fn cast_samples(scene: &GatherScene<'_>, i: usize, out: &mut Vec<GatherSample>) {
    let geometry = scene.geometry;
    let mut rays = ReceiverRays::over_cell(geometry, scene.hierarchy, i, scene.rays, scene.seed);
    let n = rays.normal;
    let emitters = scene.hierarchy.separate_emitters(geometry);
    let center = scene.hierarchy.surfaces[i].position;
    let view = emitters.map(|e| e.seen_from(center));
    let emitter_rays = emitters.map_or(0, |_| scene.rays.div_ceil(RAYS_PER_EMITTER_RAY));
    // Weight w = 1 / (π N_h p_h) of a ray of the hemisphere, balanced with the area samples.
    let balanced = |w: f32, emitters: &EmitterView<'_>, ray: &Ray, hit: &Hit| {
        w / (1.0 + PI * w * emitter_rays as f32 * emitters.density(ray, hit))
    };
    for (k, sample) in rays.iter().enumerate() {
        let (ray, w) = (sample.ray, sample.weight);
        let hit = geometry.cast(&ray);
        let length = hit.map_or(f32::INFINITY, |hit| hit.t);
        let emitter = match (emitters, &hit) {
            (Some(emitters), Some(hit)) if emitters.contains(hit.primitive) => view.as_ref(),
            _ => None,
        };
        out.push(GatherSample {
            direction: ray.direction,
            cosine: sample.cosine,
            weight: match (emitter, &hit) {
                (Some(view), Some(hit)) => balanced(w, view, &ray, hit),
                _ => w,
            },
            hit: hit.map(|hit| SampleHit::new(geometry, &ray, &hit, emitter.is_some())),
            half: k & 1,
            crossed: geometry.crossed_occluders(&Ray {
                max_t: length,
                ..ray
            }),
        });
    }
    let Some(view) = view else { return };
    let shift = Vec2::new(rays.random.unit(), rays.random.unit());
    for k in 0..emitter_rays {
        let start = rays.start(k);
        let u = lattice(k, emitter_rays, shift);
        let Some((ray, hit)) = view.visible(geometry, start, n, u) else {
            continue;
        };
        let (direction, cosine) = (ray.direction, ray.direction.dot(n));
        let w = gather_weight(cosine, scene.rays);
        out.push(GatherSample {
            direction,
            cosine,
            weight: balanced(w, &view, &ray, &hit),
            hit: Some(SampleHit::new(geometry, &ray, &hit, true)),
            half: k as usize & 1,
            crossed: geometry.crossed_occluders(&Ray::segment(start, direction, hit.t)),
        });
    }
}

/// Computes the sky visibility of a receiver with the directions of [`gather`]. Returns
/// (1/π) ∫ ω dω over the directions without a hit, and the part along the normal that hits the back
/// of a single-sided surface.
#[must_use]
pub fn gather_sky_visibility(geometry: &dyn Geometry, rays: &ReceiverRays) -> (Vec3, f32) {
    let (mut sky, mut unlit, mut whole) = (Vec3::ZERO, 0.0, 0.0);
    for sample in rays.iter() {
        let mass = sample.weight * sample.cosine;
        whole += mass;
        match geometry.cast(&sample.ray) {
            None => sky += sample.ray.direction * sample.weight,
            Some(hit) if !geometry.hit_point(&sample.ray, &hit).lit => unlit += mass,
            Some(_) => {}
        }
    }
    (sky / whole, unlit / whole)
}

/// Computes the sky harmonics of a receiver with the directions of [`gather`]: (1/π) ∫ p_k(ω) ω dω
/// over the directions without a hit. Calls `part` with the parts that cross occluders, in the
/// order of rays.
#[must_use]
pub fn gather_sky_harmonics(
    geometry: &dyn Geometry,
    rays: &ReceiverRays,
    mut part: impl FnMut(u64, &[Vec3; SkyRadiance::TERMS]),
) -> [Vec3; SkyRadiance::TERMS] {
    let whole = rays.iter().fold(0.0, |sum, s| sum + s.weight * s.cosine);
    let mut terms = [Vec3::ZERO; SkyRadiance::TERMS];
    for ReceiverRay { ray, weight, .. } in rays.iter() {
        if geometry.cast(&ray).is_none() {
            let direction = ray.direction;
            let parts = SkyRadiance::polynomials(direction).map(|p| direction * (weight * p));
            for (term, p) in terms.iter_mut().zip(&parts) {
                *term += *p;
            }
            let crossed = geometry.crossed_occluders(&ray);
            if crossed != 0 {
                part(crossed, &parts.map(|p| p / whole));
            }
        }
    }
    terms.map(|t| t / whole)
}

/// Casts the rays of [`gather`] for a receiver and returns the number of hits. Its time is a lower
/// bound for the gather.
#[must_use]
pub fn trace_gather_rays(geometry: &dyn Geometry, rays: &ReceiverRays) -> u64 {
    let hits = rays.iter().filter(|s| geometry.cast(&s.ray).is_some());
    hits.count() as u64
}
