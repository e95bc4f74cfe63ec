//! The hemispherical gather of [L08] Eq. (16): all links of one receiver from one set of rays.
//!
//! Deviation (design D1): reflectance is not part of the link, and 1/π is. F_ij = (1/π) ∫
//! B_j(r(x_i, ω)) ω dω depends on geometry only, is dimensionless, and |F_ij| ≤ 1.
//!
//! Each thread has one accumulator, dense over the senders, with a list of non-zero entries: no map
//! and no allocation per ray (design D4). Two half sums, of even and of odd rays, separate
//! variation from noise.

use super::occluded_links::LinkTerm;
use crate::basis::{Hierarchy, WeightEntry};
use crate::samples::{Random, gather_direction, tangents};
use crate::scene::{Geometry, HitPoint, Ray, SkyRadiance};
use glam::{Vec2, Vec3, Vec3A};

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
    /// Input of a gather with the current points.
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
    /// Sums F_ij of even rays and of odd rays, for each sender. Their total is the link.
    pub sums: Vec<[Vec3A; 2]>,
    /// Senders with sums that can differ from zero.
    pub touched: Vec<u32>,
    /// (1/π) ∫ ω dω over the directions without a hit.
    pub sky: Vec3A,
    /// Parts of the sums, and of the sky (as the sender behind the last), that crossed occluders:
    /// ray after ray.
    pub parts: Vec<LinkTerm>,
    /// Part of the normal component that hit a surface without a sender.
    pub uncovered: f32,
    /// Part that hit the back of a single-sided surface, which emits nothing.
    pub unlit: f32,
    marks: Vec<bool>,
    found: Vec<WeightEntry>,
    directions: Vec<(Vec3, f32)>,
    hits: Vec<Hit>,
}

/// Hit of a ray.
struct Hit {
    site: HitPoint,
    /// Direction × weight.
    value: Vec3A,
    /// 0 for an even ray, 1 for an odd one.
    half: usize,
    /// Occluders on the way.
    crossed: u64,
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
            directions: Vec::new(),
            hits: Vec::new(),
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
    fn part(&mut self, sender: u32, crossed: u64, value: Vec3A) {
        self.parts.push(LinkTerm {
            sender,
            crossed,
            value,
        });
    }

    /// Link F_ij.
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
    // The lattice deviates from the closed form Σ w cos θ = 1 by rounding and discrepancy. The
    // ratio corrects that, so that a closed room of unit radiosity gathers exactly 1.
    let mut directions = std::mem::take(&mut out.directions);
    directions.clear();
    directions.extend((0..scene.rays).map(|k| gather_direction(k, scene.rays, shift)));
    let norm = 1.0 / directions.iter().fold(0.0, |sum, (d, w)| sum + w * d.z);
    // All casts run before all look-ups, so that each has the processor's caches for itself.
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

/// Sky visibility of receiver `i` at (`x`, `n`), by the directions of [`gather`]: (1/π) ∫ ω dω over
/// the directions without a hit, and the part along the normal that hits the back of a single-sided
/// surface.
#[must_use]
pub fn gather_sky_visibility(
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

/// Sky harmonics of receiver `i` at (`x`, `n`), by the directions of [`gather`]: (1/π) ∫ p_k(ω) ω
/// dω over the directions without a hit. Calls `part` with the parts that cross occluders, ray
/// after ray.
#[must_use]
pub fn gather_sky_harmonics(
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

/// Casts the rays of [`gather`] for receiver `i` at (`x`, `n`) and returns the number of hits. Its
/// time is a lower bound for the gather.
#[must_use]
pub fn trace_gather_rays(
    geometry: &dyn Geometry,
    x: Vec3,
    n: Vec3,
    i: usize,
    rays: u32,
    seed: u64,
) -> u64 {
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
