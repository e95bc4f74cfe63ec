//! The flat display basis ([L08] §4.1 "Flattening"): all points of all levels on one level, each
//! with a radius of its own.
//!
//! \[L08\] gives every function the radius of the finest level. Our finer levels lie only where
//! light asks for them, so a function's radius follows from the points around it: it reaches every
//! position that has it among its [`NEAREST`] nearest points. Where points are even that is the
//! same radius for all; beside denser points it is as wide as the other side needs, and no position
//! between levels is left without functions. The positions tested are the points themselves, one
//! beside each of them, and hits of importance particles.

use super::clip::with_planes;
use super::kernel::{before, leans};
use super::{Hierarchy, HierarchySettings, LevelBasis, WeightEntry};
use crate::samples::{Candidate, Point, Random, dist, tangents, trace_particles};
use crate::scene::{Geometry, Ray};
use glam::{Vec3, Vec4};
use rayon::prelude::*;

/// Functions that reach a position.
const NEAREST: usize = 5;
/// Largest distance of a near function, relative to the second nearest.
const FAR: f32 = 3.0;
/// Range of a function relative to that of the tested positions.
const MARGIN: f32 = 1.1;
/// Paths of the importance particles.
const PATHS: u64 = 6_144;
/// Distance of the additional test positions of a point, relative to the radius of its own level.
const BESIDE: f32 = 0.5;

impl Hierarchy {
    /// The flat basis of all points. Also says how many rays it took.
    #[must_use]
    pub fn flat(
        &self,
        geometry: &dyn Geometry,
        viewpoints: &[Vec3],
        settings: &HierarchySettings,
    ) -> (LevelBasis, u64) {
        let seed = settings.seed ^ 0x68_6f;
        let traced = trace_particles(geometry, viewpoints, 0..PATHS, seed, settings.drop_first);
        let sure = self.surfaces.iter();
        let sure = sure.chain(traced.candidates.iter().map(|c| &c.surface));
        let sure = sure.map(|s| (s.position, s.normal, f32::INFINITY));
        let (beside, asked) = self.beside(geometry, settings.levels - 1, seed);
        let samples: Vec<(Vec3, Vec3, f32)> = sure.chain(beside).collect();
        let nearest: Vec<Vec<(u32, f32)>> = samples
            .par_iter()
            .map_init(
                || (Vec::new(), Vec::new()),
                |(found, near), &(x, n, max)| {
                    let mut nearest = self.nearest(x, n, found, near);
                    if nearest.first().is_none_or(|&(_, d)| d > max) {
                        nearest.clear();
                    }
                    nearest
                },
            )
            .collect();
        let min = 0.5 * self.levels.last().map_or(0.0, reach);
        let mut radius = vec![min; self.surfaces.len()];
        for &(i, d) in nearest.iter().flatten() {
            let r = &mut radius[i as usize];
            *r = r.max(MARGIN * d);
        }
        let points: Vec<Point> = self
            .surfaces
            .iter()
            .zip(&radius)
            .map(|(s, &r)| Point::new(s.position, s.normal, r))
            .collect();
        let around: Vec<Candidate> = self
            .surfaces
            .iter()
            .map(|&surface| Candidate {
                surface,
                free: surface.position,
            })
            .collect();
        let (mut flat, rays) = with_planes(geometry, points, &[&around], settings.clip);
        self.open(&mut flat, &samples, &nearest);
        (flat, rays + traced.rays + asked)
    }

    /// A position beside each point from level `first` on, where a way of half its own level's
    /// radius across its tangent plane and down meets a surface; and how far its nearest point may
    /// be: behind walls, where no light comes, only coarse functions reach. Also says how many rays
    /// it took.
    fn beside(
        &self,
        geometry: &dyn Geometry,
        first: usize,
        seed: u64,
    ) -> (Vec<(Vec3, Vec3, f32)>, u64) {
        let points = self.level_starts[first] as usize..self.surfaces.len();
        let rays = points.len() as u64;
        let found: Vec<Option<_>> = points
            .into_par_iter()
            .map(|i| {
                let s = &self.surfaces[i];
                let l = self.level_of(i);
                let own = self.levels[l].points[i - self.level_starts[l] as usize].radius;
                let (t, b) = tangents(s.normal);
                let angle = std::f32::consts::TAU * Random::new(seed, 0x62, i as u64).unit();
                let across = (t * libm::cosf(angle) + b * libm::sinf(angle)) * (BESIDE * own);
                let start = s.position + across + s.normal * own;
                let ray = Ray::segment(start, -s.normal, 2.0 * own);
                let hit = geometry.cast(&ray)?;
                let there = geometry.hit_point(&ray, &hit);
                Some((there.position, there.normal, own))
            })
            .collect();
        (found.into_iter().flatten().collect(), rays)
    }

    /// The nearest points of a position by \[L08\] Eq. (10) over the squared cosine of the normals,
    /// as Eq. (11) has it, among those whose functions on their own level reach it: indices and
    /// dist_j(x).
    fn nearest(
        &self,
        x: Vec3,
        n: Vec3,
        found: &mut Vec<WeightEntry>,
        near: &mut Vec<(f32, u32, f32)>,
    ) -> Vec<(u32, f32)> {
        near.clear();
        for (l, level) in self.levels.iter().enumerate() {
            found.clear();
            level.raw_weights(x, n, found);
            near.extend(found.iter().map(|w| {
                let p = &level.points[w.index as usize];
                let d = dist(x - p.x(), p.n());
                let cosine = n.dot(p.n());
                (d / (cosine * cosine), self.level_starts[l] + w.index, d)
            }));
        }
        let order =
            |a: &(f32, u32, f32), b: &(f32, u32, f32)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
        if near.len() > NEAREST {
            near.select_nth_unstable_by(NEAREST, order);
            near.truncate(NEAREST);
        }
        near.sort_unstable_by(order);
        // Where little is near, what is far does not help.
        let max = near.get(1).map_or(0.0, |second| FAR * second.0);
        near.iter()
            .enumerate()
            .filter(|&(k, n)| k < 2 || n.0 <= max)
            .map(|(_, &(_, i, d))| (i, d))
            .collect()
    }

    /// Removes clip planes where they leave a position without any function: those of the nearest
    /// function whose own level reaches it. Planes of occluders stay.
    fn open(
        &self,
        flat: &mut LevelBasis,
        samples: &[(Vec3, Vec3, f32)],
        nearest: &[Vec<(u32, f32)>],
    ) {
        let closed: Vec<usize> = (0..samples.len())
            .into_par_iter()
            .map_init(Vec::new, |found, i| {
                let (x, n, _) = samples[i];
                (!nearest[i].is_empty() && !flat.weights(x, n, found)).then_some(i)
            })
            .flatten()
            .collect();
        for i in closed {
            let (x, n, _) = samples[i];
            let before =
                |plane: &[f32; 4], radius| before(Vec4::from_array(*plane), x, n, radius) >= 0.0;
            // Those on the other side of an occluder stay there.
            let reaches = |&&(j, _): &&(u32, f32)| {
                let point = &flat.points[j as usize];
                let mut occluders = flat.planes[point.plane_range()].iter();
                occluders.all(|p| !leans(Vec4::from_array(*p)) || before(p, point.radius))
            };
            let Some(&(j, _)) = nearest[i].iter().find(reaches) else {
                continue;
            };
            let point = &mut flat.points[j as usize];
            let range = point.plane_range();
            let kept: Vec<[f32; 4]> = flat.planes[range.clone()]
                .iter()
                .copied()
                .filter(|plane| before(plane, point.radius))
                .collect();
            flat.planes[range.start..range.start + kept.len()].copy_from_slice(&kept);
            point.planes = range.start as u32 | (kept.len() as u32) << 24;
        }
    }
}

fn reach(level: &LevelBasis) -> f32 {
    level.points.first().map_or(0.0, |p| p.radius)
}
