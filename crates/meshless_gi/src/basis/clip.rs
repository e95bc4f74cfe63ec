//! Clip planes bound a basis function at walls (design D7). They prevent the light leak of [L08]
//! §5.2.
//!
//! A function's support is an ellipsoid that ignores walls. Positions in it that are not visible
//! from the function's center must not exchange light with it. Exact visibility per position would
//! cost a ray per weight. Instead, the bake casts rays once, from each center to the surface
//! positions around it. If a ray is blocked, the plane of the blocker, turned toward the center, is
//! a candidate. The bake keeps at most six planes: those that cut off most blocked positions and no
//! visible ones.
//!
//! All given positions can lie on the near side of a wall whose far side the support still touches.
//! Further rays therefore search walls along the tangent plane of each center. Behind each wall,
//! rays search surface positions, also under covers.
//!
//! A function ends with its layer ([`SurfaceLayer`]): its first planes are those of the layer. A
//! position of another layer counts as blocked, even if it is visible from the center. A plane at
//! the edge of a cover cuts off the surface below it. A plane half-way in height cuts off the
//! surface above or below a step.

use super::layer_edge::edge_plane;
use super::visibility::{ORIGIN_HEIGHT, visibility_origin_height};
use super::weight::{before, is_occluder_plane, kernel, plane_at};
use super::{LevelBasis, support_bounds};
use crate::samples::{
    Candidate, F_SQUASH, HashedGrid, Point, SurfaceLayer, dist, free_height, tangents,
};
use crate::scene::{Bounds, Geometry, Ray};
use glam::{Vec3, Vec4};
use rayon::prelude::*;

/// Largest number of planes of a function. It limits the plane tests at run time.
const MAX_PLANES: usize = 6;
/// Largest visible weight that a plane may cut off per unit of blocked weight.
const MAX_VISIBLE_LOSS: f32 = 0.5;
/// Largest number of given positions whose visibility is tested per function.
const MAX_VISIBILITY_SAMPLES: usize = 64;
/// Largest number of positions whose layer's edge is searched.
const MAX_EDGES: usize = 8;
/// Number of directions along the tangent plane that are searched for walls.
const DIRECTIONS: u32 = 16;
/// Number of distances behind a wall at which surface is searched, per direction.
const DISTANCES_PER_WALL: u32 = 4;
/// Height above the tangent plane, in radii, up to which surface belongs to the support: [L08] Eq.
/// (10).
const SUPPORT_HEIGHT: f32 = 1.0 / (1.0 + F_SQUASH);
/// Height above the tangent plane, in radii, from which surface under a cover is searched.
const COVER_SEARCH_HEIGHT: f32 = 0.01;
/// Smallest gain in blocked weight that justifies a plane. The weight at the function's center is
/// 1.
const MIN_GAIN: f32 = 1e-5;

/// Surface position around a function.
#[derive(Clone, Copy)]
struct SupportSurface {
    /// Position, meters, and unit normal.
    x: Vec3,
    n: Vec3,
    /// Free height above it, meters. `None` if it is not computed yet.
    free: Option<f32>,
}

impl SupportSurface {
    /// Returns the free height above the position, meters, at most `reach`. Adds the rays cast to
    /// `rays`.
    fn free_height(&self, geometry: &dyn Geometry, reach: f32, rays: &mut u64) -> f32 {
        match self.free {
            Some(free) => free.min(reach),
            None => {
                *rays += 1;
                free_height(geometry, self.x, self.n, reach)
            }
        }
    }
}

/// Position in a function's support.
pub(super) struct ClipSample {
    /// Meters.
    pub x: Vec3,
    /// Unit normal. Zero at positions that do not lie on a surface.
    pub n: Vec3,
    /// Weight of the function at the position, dimensionless.
    pub weight: f32,
    /// `true` if the position must not exchange light with the function's center.
    pub blocked: bool,
}

/// Chooses clip planes. The result starts with the planes `first` (n, d), followed by the
/// candidates that cut off the most blocked weight of `samples`. A candidate is left out if it cuts
/// off the center. It is also left out if the visible weight that it cuts off exceeds
/// [`MAX_VISIBLE_LOSS`] times the blocked weight. Blocked samples that are cut off are removed from
/// `samples`. `radius` is the support radius, meters.
pub(super) fn choose_planes(
    samples: &mut Vec<ClipSample>,
    first: &[Vec4],
    candidates: &[Vec4],
    center: Vec3,
    radius: f32,
) -> Vec<[f32; 4]> {
    // Tolerance against rounding: the foot of the wall itself is never cut off.
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
            // A plane must not cut off the function's center.
            if plane.dot(center.extend(1.0)) <= 0.0 {
                continue;
            }
            let mut gain = 0.0;
            for sample in &*samples {
                if before(plane, sample.x, sample.n, radius) < -slack {
                    gain += if sample.blocked {
                        sample.weight
                    } else {
                        -sample.weight / MAX_VISIBLE_LOSS
                    };
                }
            }
            if gain > best.map_or(MIN_GAIN, |(g, _)| g) {
                best = Some((gain, plane));
            }
        }
        let Some((_, plane)) = best else { break };
        kept.push(plane.to_array());
        samples.retain(|sample| !cut_off(sample, plane));
    }
    kept
}

/// Returns the clip planes (n, d) of one function, with n·x + d ≥ 0 on the function's side.
/// `around` are surface points in and near its support. Adds the rays cast to `rays`.
fn clip_planes(
    geometry: &dyn Geometry,
    point: &Point,
    around: impl Iterator<Item = SupportSurface>,
    rays: &mut u64,
) -> Vec<[f32; 4]> {
    // Gather rays pass through occluders, but functions end at them. Otherwise light from one side
    // would appear on the other side of a closed occluder. Occluders do not end a layer, because
    // the surfaces that they cover are lit when they are open.
    let closed = geometry.with_occluders_closed().unwrap_or(geometry);
    let (x_j, n_j, radius) = (point.x(), point.n(), point.radius);
    let reach = SUPPORT_HEIGHT * radius;
    let layer = SurfaceLayer::new(geometry, x_j, n_j, reach);
    *rays += SurfaceLayer::RAYS;
    let lift = (ORIGIN_HEIGHT * radius).max(closed.ray_offset(x_j));
    let height = visibility_origin_height(closed, x_j, n_j, radius, rays);
    let eye = x_j + n_j * height;
    let mut samples: Vec<ClipSample> = Vec::new();
    let mut candidates: Vec<Vec4> = Vec::new();
    let mut covers: Vec<(f32, Vec3)> = Vec::new();
    let (behind, occluders) = behind_walls(closed, point, eye, rays);
    for surrounding in around.chain(behind) {
        let SupportSurface { x, n, .. } = surrounding;
        let cosine = n.dot(n_j);
        let r = dist(x - x_j, n_j);
        if cosine <= 0.0 || r >= radius || !layer.contains(x) {
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
        let hit = closed.cast(&ray);
        let weight = kernel(r / radius) * cosine * cosine;
        let free = surrounding.free_height(geometry, reach, rays);
        let is_covered = !layer.has_similar_height(free);
        let is_apart = hit.is_none() && !is_covered && !layer.is_level_with(x, n) && {
            *rays += SurfaceLayer::RAYS;
            !layer.is_shared_with(&SurfaceLayer::new(geometry, x, n, reach))
        };
        if let Some(hit) = hit {
            candidates.push(plane_at(&closed.barrier(&ray, &hit), radius));
        } else if is_covered {
            covers.push((weight, x));
        }
        if hit.is_some() || is_apart {
            candidates.extend(plane_between(x_j, n_j, x));
        }
        samples.push(ClipSample {
            x,
            n,
            weight,
            blocked: hit.is_some() || is_covered || is_apart,
        });
    }
    covers.sort_by(|a, b| b.0.total_cmp(&a.0));
    for (_, x) in covers.into_iter().take(MAX_EDGES) {
        let is_inside = |p: Vec3, rays: &mut u64| {
            *rays += 1;
            layer.has_similar_height(free_height(geometry, p, n_j, reach))
        };
        candidates.extend(edge_plane(x_j, n_j, x, &mut |p| is_inside(p, rays)));
    }
    let first: Vec<Vec4> = layer.planes().chain(occluders).collect();
    choose_planes(&mut samples, &first, &candidates, x_j, radius)
}

/// Returns the plane parallel to the tangent plane of a function at (`x_j`, `n_j`), half-way to a
/// position above or below it. Returns `None` if the position is on the tangent plane.
fn plane_between(x_j: Vec3, n_j: Vec3, x: Vec3) -> Option<Vec4> {
    let height = n_j.dot(x - x_j);
    let toward = -n_j * height.signum();
    (height != 0.0).then(|| toward.extend(0.5 * height.abs() - toward.dot(x_j)))
}

/// Returns surface points in a function's support behind geometry on its tangent plane. Rays start
/// at `eye`. Also returns the planes of the occluders among that geometry: a jamb behind a door can
/// be too narrow for any sampled position.
fn behind_walls(
    geometry: &dyn Geometry,
    point: &Point,
    eye: Vec3,
    rays: &mut u64,
) -> (Vec<SupportSurface>, Vec<Vec4>) {
    let (x_j, n_j, radius) = (point.x(), point.n(), point.radius);
    let (t, b) = tangents(n_j);
    let tall = SUPPORT_HEIGHT * radius;
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
        if is_occluder_plane(plane) && keeps_center && !occluders.contains(&plane) {
            occluders.push(plane);
        }
        for k in 0..DISTANCES_PER_WALL {
            let across = wall.t + (radius - wall.t) * (k as f32 + 0.5) / DISTANCES_PER_WALL as f32;
            for height in [tall, COVER_SEARCH_HEIGHT * radius] {
                let above = x_j + way * across + n_j * height;
                let down = Ray::segment(above, -n_j, height + tall);
                *rays += 1;
                if let Some(hit) = geometry.cast(&down) {
                    let there = geometry.hit_point(&down, &hit);
                    found.push(SupportSurface {
                        x: there.position,
                        n: there.normal,
                        free: None,
                    });
                }
            }
        }
    }
    (found, occluders)
}

/// Computes the clip planes of each function from the positions in `around`. Returns the level and
/// the number of rays cast.
pub(super) fn with_planes(
    geometry: &dyn Geometry,
    mut points: Vec<Point>,
    around: &[&[Candidate]],
    clip: bool,
) -> (LevelBasis, u64) {
    if !clip || points.is_empty() {
        return (LevelBasis::new(points, Vec::new()), 0);
    }
    let largest = points.iter().fold(0.0f32, |r, p| r.max(p.radius));
    let samples: Vec<SupportSurface> = around
        .iter()
        .flat_map(|level| level.iter())
        .collect::<Vec<_>>()
        .into_par_iter()
        .map(|c| {
            let (x, n) = (c.surface.position, c.surface.normal);
            let free = Some(free_height(geometry, x, n, SUPPORT_HEIGHT * largest));
            SupportSurface { x, n, free }
        })
        .collect();
    // The functions have several radii. Each uses the grid whose cells are about as large as its
    // radius, so that its support touches few cells.
    let smallest = points.iter().fold(f32::INFINITY, |r, p| r.min(p.radius));
    let sizes = std::iter::successors(Some(smallest), |s| Some(4.0 * s));
    let grids: Vec<HashedGrid> = sizes
        .take_while(|&s| s <= largest)
        .take(16)
        .map(|size| {
            HashedGrid::build(samples.len(), size, |i| Bounds {
                min: samples[i].x,
                max: samples[i].x,
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
                let x = samples[i as usize].x;
                if x.cmpge(bounds.min).all() && x.cmple(bounds.max).all() {
                    near.push(i);
                }
            });
            near.sort_unstable();
            // Coarse functions have many fine points around them. A subset is enough.
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
    let mut rays = samples.len() as u64;
    for (point, (own, cast)) in points.iter_mut().zip(found) {
        point.planes = planes.len() as u32 | (own.len() as u32) << 24;
        planes.extend(own);
        rays += cast;
    }
    (LevelBasis::new(points, planes), rays)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::basis::weight;
    use crate::scene::{Material, TriangleMesh};

    /// Floor of 4 m, and a shelf 4 cm above it from x = 0.2 on.
    fn floor_and_shelf() -> TriangleMesh {
        let v = Vec3::new;
        let [floor, shelf] = [(-2.0, 0.0), (0.2, 0.04)].map(|(x, y)| {
            let corners = [v(x, y, 2.0), v(2.0, y, 2.0), v(2.0, y, -2.0), v(x, y, -2.0)];
            let [a, b, c, d] = corners;
            [[a, b, c], [a, c, d]]
        });
        let under = shelf.map(|[a, b, c]| [a, c, b]);
        let triangles = [floor, shelf, under].concat();
        TriangleMesh::new(triangles, vec![0; 6], vec![Material::default()])
    }

    /// Functions of radius 0.6 m at the origin, under the shelf and on it.
    #[test]
    fn functions_end_at_covers_and_between_layers() {
        let mesh = floor_and_shelf();
        let at = |x: f32, y: f32| Vec3::new(x, y, 0.0);
        let points = [at(0.0, 0.0), at(0.5, 0.0), at(0.5, 0.04)];
        let points = points.map(|x| Point::new(x, Vec3::Y, 0.6)).to_vec();
        // Surface positions of the bake, every 10 cm.
        let known: Vec<Candidate> = (0..40 * 40)
            .flat_map(|k| {
                let [x, z] = [k % 40, k / 40].map(|i| 0.1 * i as f32 - 1.95);
                let start = Vec3::new(x, 0.5, z);
                let down = Ray::new(start, Vec3::NEG_Y);
                let top = mesh.cast(&down).map(|hit| mesh.surface(&down, &hit));
                let under = Ray::new(start.with_y(0.02), Vec3::NEG_Y);
                let floor = mesh.cast(&under).map(|hit| mesh.surface(&under, &hit));
                let surfaces = [top, floor].into_iter().flatten();
                surfaces.map(move |surface| Candidate {
                    surface,
                    free: start,
                })
            })
            .collect();
        let (level, rays) = with_planes(&mesh, points, &[&known], true);
        assert!(rays > 300, "{rays}");
        let covers = |x: Vec3| -> Vec<bool> {
            let weights = level.points.iter();
            weights
                .map(|p| weight(p, &level.planes, x, Vec3::Y) > 0.0)
                .collect()
        };
        assert_eq!(
            covers(at(0.15, 0.0)),
            [true, false, false],
            "before the shelf"
        );
        assert_eq!(
            covers(at(0.3, 0.0)),
            [false, true, false],
            "under the shelf"
        );
        assert_eq!(covers(at(0.3, 0.04)), [false, false, true], "on the shelf");
    }
}
