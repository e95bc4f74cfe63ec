//! Poisson disks under the 5D distance ([L08] §2.3): one independent set of points per level, with
//! radii that halve from level to level.
//!
//! Dart throwing tests importance candidates in order. A candidate is accepted if the distance to
//! every accepted point of its level is at least R under [L08] Eq. (11). Optionally, its openness
//! must also be large enough. A level is full after 2000 consecutive failures ([L08]).
//!
//! A point covers only its own layer ([`SurfaceLayer`]). A candidate on a shelf, or on a wall
//! behind a picture, is accepted at any distance to a point of another layer (our addition).
//!
//! About one position in 2000 is then uncovered, mostly on strips too thin to be hit: the visible
//! edges of ledges and steps. A level that has to cover everything then casts rays from each of its
//! points, and adds uncovered positions.

use super::layer::{SurfaceLayer, free_height};
use super::openness::{OPENNESS_RAYS, openness};
use super::particles::{Candidate, local_candidates, trace_particles};
use super::{F_SQUASH, HashedGrid, Random, distance_5d};
use crate::scene::{Geometry, Surface};
use glam::{IVec3, Vec3};

/// Number of consecutive failures that end a level ([L08] §2.3).
const FAILURES: u32 = 2000;
/// Number of particles traced at a time.
const BATCH: u64 = 4096;
/// Number of particles after which a level ends in any case, if candidates are too rare.
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
    /// `true` if particles drop their first bounces. See [`trace_particles`].
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

    /// Adds the points since the last call. The total is now `count`, and point `i` lies at
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

/// Points accepted so far, at least a radius apart in each layer.
struct Disks<'a> {
    /// `None` if layers are not separated.
    geometry: Option<&'a dyn Geometry>,
    radius: f32,
    points: Vec<Candidate>,
    /// Layer of each point.
    layers: Vec<Option<SurfaceLayer>>,
    buckets: Buckets,
    rays: u64,
}

impl<'a> Disks<'a> {
    fn new(geometry: Option<&'a dyn Geometry>, radius: f32) -> Self {
        Self {
            geometry,
            radius,
            points: Vec::new(),
            layers: Vec::new(),
            buckets: Buckets::new(radius),
            rays: 0,
        }
    }

    /// Distance along the normal up to which points cover positions, meters (\[L08\] Eq. (10)).
    fn reach(&self) -> f32 {
        self.radius / (1.0 + F_SQUASH)
    }

    /// Returns `true` if every point of the candidate's layer is at least a radius away under
    /// \[L08\] Eq. (11).
    fn is_uncovered(&mut self, candidate: &Candidate) -> bool {
        let (x, n) = (candidate.surface.position, candidate.surface.normal);
        let reach = self.reach();
        let (mut free, mut own) = (None, None);
        let covered = self.buckets.any_near(x, |i| {
            let q = &self.points[i as usize].surface;
            if distance_5d(x, n, q.position, q.normal) >= self.radius {
                return false;
            }
            let (Some(geometry), Some(layer)) = (self.geometry, &self.layers[i as usize]) else {
                return true;
            };
            // Most candidates have the height of the point. Only their free height is tested.
            if layer.is_level_with(x, n) {
                let free = free.get_or_insert_with(|| free_height(geometry, x, n, reach));
                return layer.has_similar_height(*free);
            }
            let own = own.get_or_insert_with(|| SurfaceLayer::new(geometry, x, n, reach));
            layer.is_shared_with(own)
        });
        self.rays += u64::from(free.is_some()) + own.map_or(0, |_| SurfaceLayer::RAYS);
        !covered
    }

    fn push(&mut self, candidate: Candidate) {
        let (x, n) = (candidate.surface.position, candidate.surface.normal);
        let layer = self
            .geometry
            .map(|g| SurfaceLayer::new(g, x, n, self.reach()));
        self.rays += layer.map_or(0, |_| SurfaceLayer::RAYS);
        self.layers.push(layer);
        self.points.push(candidate);
        let points = &self.points;
        self.buckets
            .grow(points.len(), |i| points[i].surface.position);
    }
}

/// Fills one level with disks of `settings.radius` from particles that start at `viewpoints`.
#[must_use]
pub fn fill_level(
    geometry: &dyn Geometry,
    viewpoints: &[Vec3],
    settings: &DiskSettings,
) -> PoissonSamples {
    let mut disks = Disks::new(Some(geometry), settings.radius);
    let mut truncated = accept_particles(geometry, viewpoints, settings, &mut disks);
    if !settings.open_only && !truncated {
        let surfaces: Vec<Surface> = disks.points.iter().map(|c| c.surface).collect();
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
        disks.rays += rays;
        for candidate in candidates {
            if disks.points.len() >= settings.max {
                truncated = true;
                break;
            }
            if disks.is_uncovered(&candidate) {
                disks.push(candidate);
            }
        }
    }
    PoissonSamples {
        points: disks.points,
        rays: disks.rays,
        truncated,
    }
}

/// Throws importance particles until the level is full. Returns `true` if it reached its largest
/// number of points.
fn accept_particles(
    geometry: &dyn Geometry,
    viewpoints: &[Vec3],
    settings: &DiskSettings,
    disks: &mut Disks<'_>,
) -> bool {
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
        disks.rays += traced.rays;
        // Bounces of a particle are near one another. A shuffle makes consecutive failures
        // independent.
        for i in (1..traced.candidates.len()).rev() {
            traced.candidates.swap(i, order.below(i + 1));
        }
        for candidate in traced.candidates {
            let (x, n) = (candidate.surface.position, candidate.surface.normal);
            let mut accepted = disks.is_uncovered(&candidate);
            if accepted && settings.open_only {
                let stream = disks.points.len() as u64;
                let mut random = Random::new(settings.seed, 0x6f_70_65_6e, stream);
                disks.rays += u64::from(OPENNESS_RAYS);
                accepted =
                    openness(geometry, x, n, settings.radius, &mut random) >= settings.radius / 6.0;
            }
            if accepted {
                failures = 0;
                disks.push(candidate);
                if disks.points.len() >= settings.max {
                    return true;
                }
            } else {
                failures += 1;
                if failures >= FAILURES {
                    return false;
                }
            }
        }
    }
    false
}

/// Tests all of `candidates` in order, and keeps those that are at least `radius` apart under
/// \[L08\] Eq. (11), `max` at most. Layers of `geometry` are covered separately. Also returns the
/// number of rays cast.
#[must_use]
pub fn throw_darts(
    geometry: Option<&dyn Geometry>,
    candidates: Vec<Candidate>,
    radius: f32,
    max: usize,
) -> (Vec<Candidate>, u64) {
    let mut disks = Disks::new(geometry, radius);
    for candidate in candidates {
        if disks.points.len() >= max {
            break;
        }
        if disks.is_uncovered(&candidate) {
            disks.push(candidate);
        }
    }
    (disks.points, disks.rays)
}

/// Returns the indices of `points` that remain when all are tested in `order`, at least `radius`
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Material, TriangleMesh};

    fn candidate(position: Vec3) -> Candidate {
        Candidate {
            surface: Surface {
                position,
                normal: Vec3::Y,
                albedo: Vec3::ONE,
                emission: Vec3::ZERO,
                front: true,
            },
            free: position,
        }
    }

    #[test]
    fn points_of_one_layer_do_not_cover_another() {
        // A floor and a shelf 5 cm above it.
        let v = Vec3::new;
        let [mut triangles, shelf] = [0.0, 0.05].map(|y| {
            let corners = [
                v(-2.0, y, 2.0),
                v(2.0, y, 2.0),
                v(2.0, y, -2.0),
                v(-2.0, y, -2.0),
            ];
            let [a, b, c, d] = corners;
            vec![[a, b, c], [a, c, d]]
        });
        triangles.extend(shelf);
        let mesh = TriangleMesh::new(triangles, vec![0; 4], vec![Material::default()]);
        let thrown = |geometry: Option<&dyn Geometry>| {
            let positions = [v(0.0, 0.0, 0.0), v(0.1, 0.05, 0.0), v(0.1, 0.0, 0.0)];
            let candidates = positions.map(candidate).to_vec();
            let (points, rays) = throw_darts(geometry, candidates, 0.5, usize::MAX);
            let heights: Vec<f32> = points.iter().map(|p| p.surface.position.y).collect();
            (heights, rays)
        };
        let (heights, rays) = thrown(Some(&mesh));
        assert_eq!(heights, [0.0, 0.05]);
        assert!(rays >= 4);
        assert_eq!(thrown(None), (vec![0.0], 0));
    }
}
