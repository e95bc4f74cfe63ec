//! Poisson disks under the 5D distance ([L08] §2.3): one independent set of points per level, with
//! radii that halve from level to level.
//!
//! Dart throwing tries importance candidates in order. A candidate is accepted if no accepted point
//! of its level is nearer than R under [L08] Eq. (11). Optionally, it must also be open enough. A
//! level is full after 2000 consecutive failures ([L08]).
//!
//! About one position in 2000 is then uncovered, mostly on strips too thin to be hit: the visible
//! edges of ledges and steps. A level that has to cover everything then casts rays from each of its
//! points, and adds uncovered positions.

use super::openness::{OPENNESS_RAYS, openness};
use super::particles::{Candidate, local_candidates, trace_particles};
use super::{HashedGrid, Random, distance_5d};
use crate::scene::{Geometry, Surface};
use glam::{IVec3, Vec3};

/// Number of consecutive failures that end a level ([L08] §2.3).
const FAILURES: u32 = 2000;
/// Number of particles traced at a time.
const BATCH: u64 = 4096;
/// Number of particles after which a level ends in any case, because candidates are too rare.
const MAX_PARTICLES: u64 = 1 << 18;

/// Number of rays from each point that search uncovered positions.
const COVERAGE_RAYS: u64 = 16;

/// Settings of one level.
#[derive(Clone, Copy, Debug)]
pub struct DiskSettings {
    /// Disk radius R, meters.
    pub radius: f32,
    /// `true` to reject candidates whose openness is below R / 6 (\[L08\] §2.3). `false` for a
    /// level that covers everything.
    pub open_only: bool,
    /// Largest number of points of the level.
    pub max: usize,
    /// Seed. It should depend on the level, so that levels do not share their candidates.
    pub seed: u64,
    /// `true` if particles drop their first bounces, see [`trace_particles`].
    pub drop_first: bool,
}

/// Level with all its points.
#[derive(Debug, Default)]
pub struct PoissonSamples {
    /// Accepted candidates, in the order of acceptance.
    pub points: Vec<Candidate>,
    /// Number of rays cast.
    pub rays: u64,
    /// `true` if the level reached `max` points.
    pub truncated: bool,
}

/// Accepted points by hash of their cell, as linked lists, because points are added one by one. A
/// bucket may hold points of several cells, and the distance test separates them.
struct Buckets {
    cell: f32,
    heads: Vec<u32>,
    next: Vec<u32>,
}

impl Buckets {
    const NONE: u32 = u32::MAX;

    fn new(cell: f32) -> Self {
        Self {
            cell,
            heads: vec![Self::NONE; 1 << 12],
            next: Vec::new(),
        }
    }

    fn bucket(&self, cell: IVec3) -> usize {
        HashedGrid::hash(cell) as usize & (self.heads.len() - 1)
    }

    fn insert(&mut self, points: &[Candidate]) {
        self.grow(points.len(), |i| points[i].surface.position);
    }

    /// Adds the points since the last call. There are now `count` points; point `i` lies at
    /// `position_of(i)`.
    fn grow(&mut self, count: usize, position_of: impl Fn(usize) -> Vec3) {
        if count > self.heads.len() {
            self.heads = vec![Self::NONE; 4 * self.heads.len()];
            self.next.clear();
        }
        for i in self.next.len()..count {
            let b = self.bucket(HashedGrid::cell(position_of(i), self.cell));
            self.next.push(self.heads[b]);
            self.heads[b] = i as u32;
        }
    }

    fn any_near(&self, x: Vec3, mut test: impl FnMut(u32) -> bool) -> bool {
        let at = HashedGrid::cell(x, self.cell);
        for z in -1..=1 {
            for y in -1..=1 {
                for dx in -1..=1 {
                    let mut i = self.heads[self.bucket(at + IVec3::new(dx, y, z))];
                    while i != Self::NONE {
                        if test(i) {
                            return true;
                        }
                        i = self.next[i as usize];
                    }
                }
            }
        }
        false
    }
}

/// Fills one level with disks of `settings.radius` from particles that start at `viewpoints`.
#[must_use]
pub fn fill_level(
    geometry: &dyn Geometry,
    viewpoints: &[Vec3],
    settings: &DiskSettings,
) -> PoissonSamples {
    let (mut out, mut buckets) = throw_particles(geometry, viewpoints, settings);
    if settings.open_only || out.truncated {
        return out;
    }
    let surfaces: Vec<Surface> = out.points.iter().map(|c| c.surface).collect();
    let all: Vec<usize> = (0..surfaces.len()).collect();
    let reach = 2.0 * settings.radius;
    let (candidates, rays) = local_candidates(
        geometry,
        &surfaces,
        &all,
        reach,
        COVERAGE_RAYS,
        settings.seed,
    );
    out.rays += rays;
    for candidate in candidates {
        if out.points.len() >= settings.max {
            out.truncated = true;
            break;
        }
        if bare(&candidate, settings.radius, &out.points, &buckets) {
            out.points.push(candidate);
            buckets.insert(&out.points);
        }
    }
    out
}

/// Returns `true` if no point is nearer than `radius` under \[L08\] Eq. (11).
fn bare(candidate: &Candidate, radius: f32, points: &[Candidate], buckets: &Buckets) -> bool {
    let (x, n) = (candidate.surface.position, candidate.surface.normal);
    !buckets.any_near(x, |i| {
        let q = &points[i as usize].surface;
        distance_5d(x, n, q.position, q.normal) < radius
    })
}

/// Throws importance particles until the level is full.
fn throw_particles(
    geometry: &dyn Geometry,
    viewpoints: &[Vec3],
    settings: &DiskSettings,
) -> (PoissonSamples, Buckets) {
    let mut out = PoissonSamples::default();
    let mut buckets = Buckets::new(settings.radius);
    let mut failures = 0;
    let mut first = 0;
    let mut order = Random::new(settings.seed, 0x6f_72_64_65, 0);
    while first < MAX_PARTICLES {
        let mut traced = trace_particles(
            geometry,
            viewpoints,
            first..first + BATCH,
            settings.seed,
            settings.drop_first,
        );
        first += BATCH;
        out.rays += traced.rays;
        // Bounces of a particle are near one another. A shuffle makes consecutive failures
        // independent.
        for i in (1..traced.candidates.len()).rev() {
            traced.candidates.swap(i, order.below(i + 1));
        }
        for candidate in traced.candidates {
            let (x, n) = (candidate.surface.position, candidate.surface.normal);
            let mut accepted = bare(&candidate, settings.radius, &out.points, &buckets);
            if accepted && settings.open_only {
                let mut random = Random::new(settings.seed, 0x6f_70_65_6e, out.points.len() as u64);
                out.rays += u64::from(OPENNESS_RAYS);
                accepted =
                    openness(geometry, x, n, settings.radius, &mut random) >= settings.radius / 6.0;
            }
            if accepted {
                failures = 0;
                out.points.push(candidate);
                buckets.insert(&out.points);
                if out.points.len() >= settings.max {
                    out.truncated = true;
                    return (out, buckets);
                }
            } else {
                failures += 1;
                if failures >= FAILURES {
                    return (out, buckets);
                }
            }
        }
    }
    (out, buckets)
}

/// Tries all of `candidates` in order, and keeps those that are at least `radius` apart under
/// \[L08\] Eq. (11), `max` at most.
#[must_use]
pub fn throw_darts(candidates: Vec<Candidate>, radius: f32, max: usize) -> Vec<Candidate> {
    let mut points: Vec<Candidate> = Vec::new();
    let mut buckets = Buckets::new(radius);
    for candidate in candidates {
        if points.len() >= max {
            break;
        }
        if bare(&candidate, radius, &points, &buckets) {
            points.push(candidate);
            buckets.insert(&points);
        }
    }
    points
}

/// Returns the indices of `points` that remain when all are tried in `order`, at least `radius`
/// apart under \[L08\] Eq. (11). `points` are positions (meters) and unit normals. Every other
/// point is nearer than `radius` to one of the result.
#[must_use]
pub fn thin_out(points: &[(Vec3, Vec3)], order: &[u32], radius: f32) -> Vec<u32> {
    let mut kept: Vec<u32> = Vec::new();
    let mut buckets = Buckets::new(radius);
    for &i in order {
        let (x, n) = points[i as usize];
        let near = buckets.any_near(x, |k| {
            let (y, m) = points[kept[k as usize] as usize];
            distance_5d(x, n, y, m) < radius
        });
        if !near {
            kept.push(i);
            buckets.grow(kept.len(), |k| points[kept[k] as usize].0);
        }
    }
    kept
}
