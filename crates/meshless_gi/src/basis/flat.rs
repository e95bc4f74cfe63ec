//! Flat display basis ([L08] §4.1 "Flattening"): all points of all levels on one level, each with
//! its own radius.
//!
//! \[L08\] gives every function the radius of the finest level. Our finer levels exist only where
//! the light needs detail. A function's radius therefore follows from the points around it. The
//! function reaches every position that has it among its [`FUNCTIONS_PER_POSITION`] nearest visible
//! points. At evenly spaced points all radii are equal. At the border of a denser region the radii
//! are large enough to leave no position uncovered. The tested positions are the points themselves,
//! surface positions around each of them, and hits of importance particles.

use super::clip::with_planes;
use super::visibility::Viewer;
use super::weight::{before, is_occluder_plane};
use super::{Hierarchy, HierarchySettings, LevelBasis, WeightEntry};
use crate::samples::{
    Candidate, F_SQUASH, Point, SurfaceLayer, dist, free_height, has_similar_height,
    local_candidates, trace_particles,
};
use crate::scene::Geometry;
use glam::{Vec3, Vec4};
use rayon::prelude::*;

/// Number of functions that reach a position.
const FUNCTIONS_PER_POSITION: usize = 5;
/// Largest distance of a near function, relative to the second nearest.
const MAX_DISTANCE_RATIO: f32 = 3.0;
/// Radius of a function relative to the distance of its farthest tested position.
const RADIUS_MARGIN: f32 = 1.1;
/// Number of importance particles.
const PATHS: u64 = 6_144;
/// Number of rays from each point that search further test positions.
const RAYS_PER_POINT: u64 = 8;

impl Hierarchy {
    /// Builds the flat basis of all points. Also returns the number of rays cast.
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
        let (extra_samples, extra_rays) = self.extra_samples(geometry, settings.levels - 1, seed);
        let samples: Vec<(Vec3, Vec3, f32)> = sure.chain(extra_samples).collect();
        let (nearest, seen): (Vec<Vec<(u32, f32)>>, Vec<u64>) = samples
            .par_iter()
            .map_init(
                || (Vec::new(), Vec::new()),
                |(found, near), &(x, n, max)| {
                    let (mut nearest, rays) = self.nearest(geometry, x, n, found, near);
                    if nearest.first().is_none_or(|&(_, d)| d > max) {
                        nearest.clear();
                    }
                    (nearest, rays)
                },
            )
            .unzip();
        let seen: u64 = seen.into_iter().sum();
        let min = 0.5 * self.levels.last().map_or(0.0, LevelBasis::radius);
        let mut radius = vec![min; self.surfaces.len()];
        for &(i, d) in nearest.iter().flatten() {
            let r = &mut radius[i as usize];
            *r = r.max(RADIUS_MARGIN * d);
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
        let opened = remove_blocking_planes(geometry, &mut flat, &samples, &nearest);
        (flat, rays + traced.rays + extra_rays + seen + opened)
    }

    /// Returns positions around each point from level `first` on, in its layer and in adjacent
    /// layers. Each has the largest allowed distance of its nearest point. Only coarse functions
    /// reach behind walls that no light reaches. Also returns the number of rays cast.
    fn extra_samples(
        &self,
        geometry: &dyn Geometry,
        first: usize,
        seed: u64,
    ) -> (Vec<(Vec3, Vec3, f32)>, u64) {
        let points: Vec<usize> = (self.level_starts[first] as usize..self.surfaces.len()).collect();
        let own = self.levels[first].radius();
        let (found, rays) = local_candidates(
            geometry,
            &self.surfaces,
            &points,
            own,
            RAYS_PER_POINT,
            seed ^ 0x62,
        );
        let found = found.iter().map(|c| &c.surface);
        let found = found.map(|s| (s.position, s.normal, own));
        (found.collect(), rays)
    }

    /// Returns the nearest visible points of a position: their indices and dist_j(x). The
    /// candidates are the points whose functions on their own level reach the position. They are
    /// sorted by \[L08\] Eq. (10) over the squared cosine of the normals, as in Eq. (11). The
    /// nearest one is not farther than the radius of the finest level, or it shares the layer of
    /// the position. Also returns the number of rays cast.
    fn nearest(
        &self,
        geometry: &dyn Geometry,
        x: Vec3,
        n: Vec3,
        found: &mut Vec<WeightEntry>,
        near: &mut Vec<(f32, u32, f32)>,
    ) -> (Vec<(u32, f32)>, u64) {
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
        near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut rays = 1;
        let mut max = f32::INFINITY;
        let viewer = Viewer::new(geometry, x, n, self.levels[0].radius());
        let own = self.levels.last().map_or(0.0, LevelBasis::radius);
        let mut nearest = Vec::with_capacity(FUNCTIONS_PER_POSITION);
        for &(distance, i, d) in &*near {
            if nearest.len() == FUNCTIONS_PER_POSITION || distance > max {
                break;
            }
            let l = self.level_of(i as usize);
            let point = &self.levels[l].points[(i - self.level_starts[l]) as usize];
            rays += 1;
            let from = viewer.origin(point.radius);
            let is_reached = !geometry.is_occluded(from, self.origins[i as usize])
                && (d <= own
                    || !nearest.is_empty()
                    || has_same_layer(geometry, point, x, n, &mut rays));
            if is_reached {
                nearest.push((i, d));
                // At a sparsely covered position, distant functions are left out.
                if nearest.len() == 2 {
                    max = MAX_DISTANCE_RATIO * distance;
                }
            }
        }
        (nearest, rays)
    }
}

/// Removes clip planes that leave a position without any function. They are the planes of the
/// nearest function in the position's layer whose own level reaches the position. Planes of
/// occluders stay. Returns the number of rays cast.
fn remove_blocking_planes(
    geometry: &dyn Geometry,
    flat: &mut LevelBasis,
    samples: &[(Vec3, Vec3, f32)],
    nearest: &[Vec<(u32, f32)>],
) -> u64 {
    let closed: Vec<usize> = (0..samples.len())
        .into_par_iter()
        .map_init(Vec::new, |found, i| {
            let (x, n, _) = samples[i];
            (!nearest[i].is_empty() && !flat.weights(x, n, found)).then_some(i)
        })
        .flatten()
        .collect();
    let mut rays = 0;
    for i in closed {
        let (x, n, _) = samples[i];
        let before =
            |plane: &[f32; 4], radius| before(Vec4::from_array(*plane), x, n, radius) >= 0.0;
        let mut reaches = |&&(j, _): &&(u32, f32)| {
            let point = &flat.points[j as usize];
            // Planes of occluders still separate positions.
            let mut occluders = flat.planes[point.plane_range()].iter();
            let is_open = occluders
                .all(|p| !is_occluder_plane(Vec4::from_array(*p)) || before(p, point.radius));
            let reach = point.radius / (1.0 + F_SQUASH);
            rays += 2;
            let height = |x, n| free_height(geometry, x, n, reach);
            is_open && has_similar_height(height(x, n), height(point.x(), point.n()))
        };
        let Some(&(j, _)) = nearest[i].iter().find(&mut reaches) else {
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
    rays
}

/// Returns `true` if a position (x, n) is in the layer of a point. Adds the rays cast to `rays`.
fn has_same_layer(
    geometry: &dyn Geometry,
    point: &Point,
    x: Vec3,
    n: Vec3,
    rays: &mut u64,
) -> bool {
    let reach = point.radius / (1.0 + F_SQUASH);
    *rays += 2 * SurfaceLayer::RAYS;
    let own = SurfaceLayer::new(geometry, point.x(), point.n(), reach);
    own.is_shared_with(&SurfaceLayer::new(geometry, x, n, reach))
}
