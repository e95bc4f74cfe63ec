//! The hemispherical gather of [L08] Eq. (16): all links of one receiver from one set of rays.
//!
//! Deviation (design D1): reflectance stays out of the link and 1/π goes in, F_ij = (1/π) ∫
//! B_j(r(x_i, ω)) ω dω, so that links are geometry only, dimensionless, and |F_ij| ≤ 1.
//!
//! One shared accumulator a thread, dense over the senders, with a list of what was touched: no map
//! and no allocation per ray (design D4). Two half sums, of even and of odd rays, tell real
//! variation from noise.

use super::occluded_links::Part;
use crate::basis::{Hierarchy, WeightEntry};
use crate::samples::{Random, gather_direction, tangents};
use crate::scene::{Geometry, HitPoint, Ray, SkyRadiance};
use glam::{Vec2, Vec3, Vec3A};

/// Which sender levels a hit is written to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Deposit {
    /// The finest that covers the hit: the rows keep their mass.
    Finest,
    /// Every level, as \[L08\] Eq. (16) has it.
    All,
}

/// How to gather, whatever the hierarchy.
#[derive(Clone, Copy)]
pub struct GatherSettings<'a> {
    /// What rays meet.
    pub geometry: &'a dyn Geometry,
    /// How many levels, from the coarsest, are senders.
    pub sender_levels: usize,
    /// Rays a receiver.
    pub rays: u32,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Which sender levels a hit is written to.
    pub deposit: Deposit,
}

impl<'a> GatherSettings<'a> {
    /// Together with the points as they are now.
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

/// What a gather needs to know of the scene.
#[derive(Clone, Copy)]
pub struct GatherScene<'a> {
    /// What rays meet.
    pub geometry: &'a dyn Geometry,
    /// The functions.
    pub hierarchy: &'a Hierarchy,
    /// How many levels, from the coarsest, are senders.
    pub sender_levels: usize,
    /// Rays a receiver.
    pub rays: u32,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Which sender levels a hit is written to.
    pub deposit: Deposit,
}

/// The sums of one gather; one a thread, used again and again.
pub struct Gathered {
    /// Per sender: the sums F_ij of even rays and of odd rays. Their total is the link.
    pub sums: Vec<[Vec3A; 2]>,
    /// Senders with a sum that may not be zero.
    pub touched: Vec<u32>,
    /// (1/π) ∫ ω dω over the directions that met nothing.
    pub sky: Vec3A,
    /// What of the sums, and of the sky (as the sender behind the last), crossed occluders: ray
    /// after ray.
    pub parts: Vec<Part>,
    /// The part of the normal component that met a surface which no sender covers.
    pub uncovered: f32,
    /// The part that met the back of a single-sided surface, from where no light comes.
    pub unlit: f32,
    marks: Vec<bool>,
    found: Vec<WeightEntry>,
    directions: Vec<(Vec3, f32)>,
    hits: Vec<Hit>,
}

/// What a ray met.
struct Hit {
    site: HitPoint,
    /// Direction × weight.
    value: Vec3A,
    /// 0 for an even ray, 1 for an odd one.
    half: usize,
    /// The occluders on the way.
    crossed: u64,
}

impl Gathered {
    /// For `senders` senders.
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
            directions: Vec::new(),
            hits: Vec::new(),
        }
    }

    /// Forgets everything.
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

    /// Adds `value` to the link to `sender`, to the half sum 0 or 1.
    #[inline]
    pub fn deposit(&mut self, sender: u32, half: usize, value: Vec3A) {
        let j = sender as usize;
        if !self.marks[j] {
            self.marks[j] = true;
            self.touched.push(sender);
        }
        self.sums[j][half] += value;
    }

    /// Notes that `value` of the link to `sender` crossed occluders.
    fn part(&mut self, sender: u32, crossed: u64, value: Vec3A) {
        self.parts.push(Part {
            sender,
            crossed,
            value,
        });
    }

    /// The link F_ij so far.
    #[must_use]
    pub fn link(&self, sender: u32) -> Vec3A {
        let [even, odd] = self.sums[sender as usize];
        even + odd
    }
}

/// Gathers all links of point `i` of the hierarchy into `out`.
pub fn gather(scene: &GatherScene<'_>, i: usize, out: &mut Gathered) {
    out.reset();
    let surface = &scene.hierarchy.surfaces[i];
    let (x, n) = (surface.position, surface.normal);
    let (t, b) = tangents(n);
    let start = x + n * scene.geometry.ray_offset(x);
    let mut random = Random::new(scene.seed, 0x67_61_74_68, i as u64);
    let shift = Vec2::new(random.unit(), random.unit());
    // The lattice misses the hemisphere's closed form Σ w cos θ = 1 by rounding and discrepancy;
    // the ratio mends it, so that a closed room of unit radiosity gathers exactly 1.
    let mut directions = std::mem::take(&mut out.directions);
    directions.clear();
    directions.extend((0..scene.rays).map(|k| gather_direction(k, scene.rays, shift)));
    let norm = 1.0 / directions.iter().fold(0.0, |sum, (d, w)| sum + w * d.z);
    // First all casts, then all look-ups: each has the processor's caches for itself.
    let mut hits = std::mem::take(&mut out.hits);
    hits.clear();
    for (k, &(d, w)) in directions.iter().enumerate() {
        let direction = (t * d.x + b * d.y + n * d.z).normalize();
        let ray = Ray::new(start, direction);
        let value = Vec3A::from(direction) * (w * norm);
        let Some(hit) = scene.geometry.cast(&ray) else {
            out.sky += value;
            let crossed = scene.geometry.crossed_occluders(&ray);
            if crossed != 0 {
                out.part(out.sums.len() as u32, crossed, value);
            }
            continue;
        };
        hits.push(Hit {
            site: scene.geometry.hit_point(&ray, &hit),
            value,
            half: k & 1,
            crossed: scene
                .geometry
                .crossed_occluders(&Ray::segment(start, direction, hit.t)),
        });
    }
    let mut found = std::mem::take(&mut out.found);
    for hit in &hits {
        let mut covered = false;
        for l in (0..scene.sender_levels).rev() {
            let (x, n) = (hit.site.position, hit.site.normal);
            if scene.hierarchy.senders[l].weights(x, n, &mut found) {
                covered = true;
                let first = scene.hierarchy.level_starts[l];
                for entry in &found {
                    let (j, value) = (first + entry.index, hit.value * entry.weight);
                    out.deposit(j, hit.half, value);
                    if hit.crossed != 0 {
                        out.part(j, hit.crossed, value);
                    }
                }
                if scene.deposit == Deposit::Finest {
                    break;
                }
            }
        }
        if !covered {
            let lost = match hit.site.lit {
                true => &mut out.uncovered,
                false => &mut out.unlit,
            };
            *lost += hit.value.dot(n.into());
        }
    }
    out.found = found;
    out.directions = directions;
    out.hits = hits;
}

/// What receiver `i` at (`x`, `n`) sees where no light comes back: (1/π) ∫ ω dω over the directions
/// that meet nothing, and the part along the normal that meets the back of a single-sided surface.
/// By the rays that [`gather`] casts.
#[must_use]
pub fn look_out(
    geometry: &dyn Geometry,
    x: Vec3,
    n: Vec3,
    i: usize,
    rays: u32,
    seed: u64,
) -> (Vec3, f32) {
    let (t, b) = tangents(n);
    let start = x + n * geometry.ray_offset(x);
    let mut random = Random::new(seed, 0x67_61_74_68, i as u64);
    let shift = Vec2::new(random.unit(), random.unit());
    let (mut sky, mut unlit, mut whole) = (Vec3::ZERO, 0.0, 0.0);
    for k in 0..rays {
        let (d, weight) = gather_direction(k, rays, shift);
        whole += weight * d.z;
        let direction = (t * d.x + b * d.y + n * d.z).normalize();
        let ray = Ray::new(start, direction);
        match geometry.cast(&ray) {
            None => sky += direction * weight,
            Some(hit) if !geometry.hit_point(&ray, &hit).lit => unlit += weight * d.z,
            Some(_) => {}
        }
    }
    (sky / whole, unlit / whole)
}

/// What the terms of a sky that is not uniform give receiver `i` at (`x`, `n`): (1/π) ∫ p_k(ω) ω dω
/// over the directions that meet nothing, by the rays that [`gather`] casts. What of it crosses
/// occluders is told to `part`, ray after ray.
#[must_use]
pub fn look_up(
    geometry: &dyn Geometry,
    x: Vec3,
    n: Vec3,
    i: usize,
    rays: u32,
    seed: u64,
    mut part: impl FnMut(u64, &[Vec3; SkyRadiance::TERMS]),
) -> [Vec3; SkyRadiance::TERMS] {
    let (t, b) = tangents(n);
    let start = x + n * geometry.ray_offset(x);
    let mut random = Random::new(seed, 0x67_61_74_68, i as u64);
    let shift = Vec2::new(random.unit(), random.unit());
    let directions: Vec<(Vec3, f32)> = (0..rays)
        .map(|k| gather_direction(k, rays, shift))
        .collect();
    let whole: f32 = directions.iter().fold(0.0, |sum, (d, w)| sum + w * d.z);
    let mut terms = [Vec3::ZERO; SkyRadiance::TERMS];
    for (d, weight) in directions {
        let direction = (t * d.x + b * d.y + n * d.z).normalize();
        let ray = Ray::new(start, direction);
        if geometry.cast(&ray).is_none() {
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

/// Casts the rays of receiver `i` at (`x`, `n`) as [`gather`] does and says how many hit something:
/// the yardstick for everything else.
#[must_use]
pub fn cast_only(geometry: &dyn Geometry, x: Vec3, n: Vec3, i: usize, rays: u32, seed: u64) -> u64 {
    let (t, b) = tangents(n);
    let start = x + n * geometry.ray_offset(x);
    let mut random = Random::new(seed, 0x67_61_74_68, i as u64);
    let shift = Vec2::new(random.unit(), random.unit());
    (0..rays)
        .filter(|&k| {
            let (d, _) = gather_direction(k, rays, shift);
            let direction = (t * d.x + b * d.y + n * d.z).normalize();
            geometry.cast(&Ray::new(start, direction)).is_some()
        })
        .count() as u64
}
