//! Poisson disks under the 5D distance ([L08] §2.3): one independent set of points a level, radius halved from level to level.
//!
//! Dart throwing: importance candidates are tried in order; one is accepted when no accepted point of its level is nearer than R
//! under [L08] Eq. (11), and, where asked for, when it is open enough. A level is full after 2000 failures in a row ([L08]).

use super::openness::{OPENNESS_RAYS, openness};
use super::particles::{Candidate, trace_particles};
use super::{HashedGrid, Random, distance_5d};
use crate::scene::Geometry;
use glam::{IVec3, Vec3};

/// Failures in a row that end a level ([L08] §2.3).
const FAILURES: u32 = 2000;
/// Particles traced at a time.
const BATCH: u64 = 4096;
/// Particles after which a level ends whatever happens: a scene in which candidates are this rare is out of reach.
const MOST_PARTICLES: u64 = 1 << 18;

/// How one level is filled.
#[derive(Clone, Copy, Debug)]
pub struct DiskSettings {
    /// Disk radius R, metres.
    pub radius: f32,
    /// Reject candidates whose openness is below R / 6 (\[L08\] §2.3).
    pub open_only: bool,
    /// Most points the level may have.
    pub most: usize,
    /// Seed; the level's number should be in it, so that levels do not share their candidates.
    pub seed: u64,
    /// Whether particles drop their first bounces, see [`trace_particles`].
    pub drop_first: bool,
}

/// A filled level.
#[derive(Debug, Default)]
pub struct Disks {
    /// The accepted candidates, in the order of acceptance.
    pub points: Vec<Candidate>,
    /// Rays that it took.
    pub rays: u64,
    /// True when `most` cut it short.
    pub truncated: bool,
}

/// Accepted points by hash of their cell: chains, because points come one by one. A bucket may hold several cells' points; the
/// distance test sorts them out.
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
        if points.len() > self.heads.len() {
            self.heads = vec![Self::NONE; 4 * self.heads.len()];
            self.next.clear();
        }
        for (i, point) in points.iter().enumerate().skip(self.next.len()) {
            let b = self.bucket(HashedGrid::cell(point.surface.position, self.cell));
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
pub fn fill_level(geometry: &dyn Geometry, viewpoints: &[Vec3], settings: &DiskSettings) -> Disks {
    let mut out = Disks::default();
    let mut buckets = Buckets::new(settings.radius);
    let mut failures = 0;
    let mut first = 0;
    let mut order = Random::new(settings.seed, 0x6f_72_64_65, 0);
    while first < MOST_PARTICLES {
        let mut traced = trace_particles(
            geometry,
            viewpoints,
            first..first + BATCH,
            settings.seed,
            settings.drop_first,
        );
        first += BATCH;
        out.rays += traced.rays;
        // A particle's bounces are near one another; a shuffle makes the failures in a row mean what they should.
        for i in (1..traced.candidates.len()).rev() {
            traced.candidates.swap(i, order.below(i + 1));
        }
        for candidate in traced.candidates {
            let (x, n) = (candidate.surface.position, candidate.surface.normal);
            let near = buckets.any_near(x, |i| {
                let q = &out.points[i as usize].surface;
                distance_5d(x, n, q.position, q.normal) < settings.radius
            });
            let mut accepted = !near;
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
                if out.points.len() >= settings.most {
                    out.truncated = true;
                    return out;
                }
            } else {
                failures += 1;
                if failures >= FAILURES {
                    return out;
                }
            }
        }
    }
    out
}

/// Throws all of `candidates`, in order, and keeps those that are at least `radius` apart under \[L08\] Eq. (11), `most` at most.
#[must_use]
pub fn throw_darts(candidates: Vec<Candidate>, radius: f32, most: usize) -> Vec<Candidate> {
    let mut points: Vec<Candidate> = Vec::new();
    let mut buckets = Buckets::new(radius);
    for candidate in candidates {
        if points.len() >= most {
            break;
        }
        let (x, n) = (candidate.surface.position, candidate.surface.normal);
        let near = buckets.any_near(x, |i| {
            let q = &points[i as usize].surface;
            distance_5d(x, n, q.position, q.normal) < radius
        });
        if !near {
            points.push(candidate);
            buckets.insert(&points);
        }
    }
    points
}
