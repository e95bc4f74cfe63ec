//! Clip planes bound a basis function at walls (design D7). They prevent the light leak of [L08]
//! §5.2.
//!
//! A function's support is a ball-like region that ignores walls. Positions in it that the
//! function's center cannot see must not get light from it, nor give any. Exact visibility per
//! position would cost a ray per weight; instead the bake looks, once, from each center at the
//! surface positions around it. Where the view is blocked, the plane of the blocker, turned toward
//! the center, is a candidate; the planes that cut off most blocked positions and no visible one
//! are kept, four at most.
//!
//! Positions that happen to be known may all lie on the near side of a wall whose far side the
//! support still touches. So each center also looks around along its tangent plane for walls, and
//! behind each one for surface.

use super::kernel::{before, kernel, leans, plane_at};
use super::{LevelBasis, support_bounds};
use crate::samples::{Candidate, F_SQUASH, HashedGrid, Point, dist, tangents};
use crate::scene::{Bounds, Geometry, Ray};
use glam::{Vec3, Vec4};
use rayon::prelude::*;

/// Planes a function may have at most: what the display can afford to test.
const MAX_PLANES: usize = 4;
/// A plane may cut off this share of the visible weight for each share of blocked weight.
const LOSS: f32 = 0.5;
/// Height above the surface, in radii, from which one looks: over gravel, not over walls.
const ORIGIN_HEIGHT: f32 = 0.1;

/// Positions at most that a function looks at for its clip planes.
const MAX_VISIBILITY_SAMPLES: usize = 64;
/// Directions along the tangent plane in which it looks for walls.
const DIRECTIONS: u32 = 16;
/// Positions behind a wall in each of them.
const BEHIND: u32 = 4;
/// Height above the tangent plane, in radii, up to which surface belongs to the support: [L08] Eq.
/// (10).
const TALL: f32 = 1.0 / (1.0 + F_SQUASH);
/// Blocked weight, out of a function's own 1, that is worth a plane.
const WORTH: f32 = 1e-5;

/// A position in a function's support.
pub(super) struct ClipSample {
    /// Meters.
    pub x: Vec3,
    /// Its normal; zero in free space.
    pub n: Vec3,
    /// Weight of the function there, dimensionless.
    pub weight: f32,
    /// `true` if it is hidden from the function's center.
    pub blocked: bool,
}

/// The planes `first` (n, d), then of the `candidates` those that cut off most blocked weight of
/// `samples` and no more visible weight than that is worth. A candidate that cuts off the center is
/// left out. Positions that are cut off leave the list. `radius` is that of the support, meters.
pub(super) fn choose_planes(
    samples: &mut Vec<ClipSample>,
    first: &[Vec4],
    candidates: &[Vec4],
    center: Vec3,
    radius: f32,
) -> Vec<[f32; 4]> {
    // A hair's breadth, so that the wall's own foot is on neither side by rounding.
    let slack = 1e-3 * radius;
    let cut_off = |sample: &ClipSample, plane: Vec4| {
        sample.blocked && before(plane, sample.x, sample.n, radius) < -slack
    };
    let first = &first[..first.len().min(MAX_PLANES)];
    samples.retain(|sample| !first.iter().any(|&plane| cut_off(sample, plane)));
    let mut kept: Vec<[f32; 4]> = first.iter().map(Vec4::to_array).collect();
    while kept.len() < MAX_PLANES {
        let mut best: Option<(f32, Vec4)> = None;
        for &plane in candidates {
            // The function's own position stays, however near the wall it is.
            if plane.dot(center.extend(1.0)) <= 0.0 {
                continue;
            }
            let mut gain = 0.0;
            for sample in &*samples {
                if before(plane, sample.x, sample.n, radius) < -slack {
                    gain += if sample.blocked {
                        sample.weight
                    } else {
                        -sample.weight / LOSS
                    };
                }
            }
            if gain > best.map_or(WORTH, |(g, _)| g) {
                best = Some((gain, plane));
            }
        }
        let Some((_, plane)) = best else { break };
        kept.push(plane.to_array());
        samples.retain(|sample| !cut_off(sample, plane));
    }
    kept
}

/// The clip planes of one function: `around` are surface points (x, n) in and near its support.
/// Returns planes (n, d) with n·x + d ≥ 0 on the function's side, and adds the rays cast to `rays`.
pub fn clip_planes(
    geometry: &dyn Geometry,
    point: &Point,
    around: impl Iterator<Item = (Vec3, Vec3)>,
    rays: &mut u64,
) -> Vec<[f32; 4]> {
    // Occluders stand open for light, but functions end at them: else what is lit on one side would
    // shine on the other when they shut.
    let geometry = geometry.with_occluders_closed().unwrap_or(geometry);
    let (x_j, n_j, radius) = (point.x(), point.n(), point.radius);
    let lift = (ORIGIN_HEIGHT * radius).max(geometry.ray_offset(x_j));
    let height = visibility_origin_height(geometry, x_j, n_j, radius, rays);
    let eye = x_j + n_j * height;
    let mut samples: Vec<ClipSample> = Vec::new();
    let mut candidates: Vec<Vec4> = Vec::new();
    let (behind, occluders) = behind_walls(geometry, point, eye, rays);
    for (x, n) in around.chain(behind) {
        let cosine = n.dot(n_j);
        let r = dist(x - x_j, n_j);
        if cosine <= 0.0 || r >= radius {
            continue;
        }
        let target = x + n * height.min(lift);
        let way = target - eye;
        let length = way.length();
        if length < 1e-3 * radius {
            continue;
        }
        let ray = Ray::segment(eye, way / length, length);
        *rays += 1;
        let hit = geometry.cast(&ray);
        if let Some(hit) = hit {
            candidates.push(plane_at(&geometry.barrier(&ray, &hit), radius));
        }
        samples.push(ClipSample {
            x,
            n,
            weight: kernel(r / radius) * cosine * cosine,
            blocked: hit.is_some(),
        });
    }
    choose_planes(&mut samples, &occluders, &candidates, x_j, radius)
}

/// Height of the visibility origin above the center (x, n) of a function with this radius, in
/// meters. It sees over gravel and around bends, and is at most half-way to the geometry above.
pub(super) fn visibility_origin_height(
    geometry: &dyn Geometry,
    x: Vec3,
    n: Vec3,
    radius: f32,
    rays: &mut u64,
) -> f32 {
    let lift = geometry.ray_offset(x);
    let high = (ORIGIN_HEIGHT * radius).max(lift);
    *rays += 1;
    let up = Ray::segment(x + n * lift, n, 2.0 * high);
    geometry.cast(&up).map_or(high, |hit| 0.5 * hit.t)
}

/// Surface points within a function's support behind whatever stands on its tangent plane, as seen
/// from `eye`, and the planes of the occluders that stand there. A jamb beyond a door may be so
/// narrow that no position of it is found.
fn behind_walls(
    geometry: &dyn Geometry,
    point: &Point,
    eye: Vec3,
    rays: &mut u64,
) -> (Vec<(Vec3, Vec3)>, Vec<Vec4>) {
    let (x_j, n_j, radius) = (point.x(), point.n(), point.radius);
    let (t, b) = tangents(n_j);
    let tall = TALL * radius;
    let mut found = Vec::new();
    let mut occluders: Vec<Vec4> = Vec::new();
    for k in 0..DIRECTIONS {
        let angle = core::f32::consts::TAU * (k as f32 + 0.5) / DIRECTIONS as f32;
        let way = t * libm::cosf(angle) + b * libm::sinf(angle);
        *rays += 1;
        let ray = Ray::segment(eye, way, radius);
        let Some(wall) = geometry.cast(&ray) else {
            continue;
        };
        let plane = plane_at(&geometry.barrier(&ray, &wall), radius);
        let keeps_center = before(plane, x_j, n_j, radius) > 0.0;
        if leans(plane) && keeps_center && !occluders.contains(&plane) {
            occluders.push(plane);
        }
        for k in 0..BEHIND {
            let across = wall.t + (radius - wall.t) * (k as f32 + 0.5) / BEHIND as f32;
            let above = x_j + way * across + n_j * tall;
            let down = Ray::segment(above, -n_j, 2.0 * tall);
            *rays += 1;
            if let Some(hit) = geometry.cast(&down) {
                let there = geometry.hit_point(&down, &hit);
                found.push((there.position, there.normal));
            }
        }
    }
    (found, occluders)
}

/// Gives each function its clip planes, looking at the positions in `around`. Also says how many
/// rays it took.
pub(super) fn with_planes(
    geometry: &dyn Geometry,
    mut points: Vec<Point>,
    around: &[&[Candidate]],
    clip: bool,
) -> (LevelBasis, u64) {
    if !clip || points.is_empty() {
        return (LevelBasis::new(points, Vec::new()), 0);
    }
    // The positions by cell; a position is looked up from the cell of the function's center, so its
    // box is as large as a support.
    let samples: Vec<(Vec3, Vec3)> = around
        .iter()
        .flat_map(|level| level.iter().map(|c| (c.surface.position, c.surface.normal)))
        .collect();
    // Functions of several radii: each looks through the few cells that its support touches, of a
    // grid about as coarse as itself.
    let (smallest, largest) = points.iter().fold((f32::INFINITY, 0.0f32), |(a, b), p| {
        (a.min(p.radius), b.max(p.radius))
    });
    let sizes = std::iter::successors(Some(smallest), |s| Some(4.0 * s));
    let grids: Vec<HashedGrid> = sizes
        .take_while(|&s| s <= largest)
        .take(16)
        .map(|size| {
            HashedGrid::build(samples.len(), size, |i| Bounds {
                min: samples[i].0,
                max: samples[i].0,
            })
        })
        .collect();
    let found: Vec<(Vec<[f32; 4]>, u64)> = points
        .par_iter()
        .map_init(Vec::new, |near, point| {
            near.clear();
            let bounds = support_bounds(point);
            let fits = grids.partition_point(|g| g.cell_size <= point.radius);
            grids[fits.max(1) - 1].for_each_in(bounds, |i| {
                let x = samples[i as usize].0;
                if x.cmpge(bounds.min).all() && x.cmple(bounds.max).all() {
                    near.push(i);
                }
            });
            near.sort_unstable();
            // Coarse functions among fine points need not look at all of them.
            let stride = near.len().div_ceil(MAX_VISIBILITY_SAMPLES);
            let around = near
                .iter()
                .step_by(stride.max(1))
                .map(|&i| samples[i as usize]);
            let mut rays = 0;
            (clip_planes(geometry, point, around, &mut rays), rays)
        })
        .collect();
    let mut planes: Vec<[f32; 4]> = Vec::new();
    let mut rays = 0;
    for (point, (own, cast)) in points.iter_mut().zip(found) {
        point.planes = planes.len() as u32 | (own.len() as u32) << 24;
        planes.extend(own);
        rays += cast;
    }
    (LevelBasis::new(points, planes), rays)
}
