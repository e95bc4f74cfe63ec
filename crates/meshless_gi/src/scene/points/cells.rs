//! Cells of a point cloud: the flat, convex surface piece of each point in its tangent plane. Its
//! area is the point's weight in [G08] §2.4 and Eq. (9). Its outline, slightly enlarged, is the
//! geometry for ray casts.
//!
//! [G08] specifies the weights only as a local property computed from the normals. This project
//! uses the part of the tangent plane that is nearer to the point than to its neighbors. It is a
//! Voronoi cell of the neighbors projected along the normal. The cells of a flat surface tile it.
//! Their areas sum up to its area for any sampling density. A cell ends with its surface:
//!
//! - **At a crease**, the cell ends at the tangent plane of a neighbor with a normal that differs
//!   by more than 40 degrees. This applies only if none of the point's own surface lies beyond
//!   that plane. Walls meet in their true edges, without gaps and without overhang.
//! - **At a border**, on a side without neighbors, the cell ends three quarters of a spacing away.
//!   At a hole of a random sample it extends up to two spacings. In both cases its area is the mean
//!   area of its closed neighbors, because all points of an even sample represent the same area.
//! - Neighbors with opposite normals (the far side of a thin sheet) are ignored. Neighbors of
//!   another sheet are also ignored: their height above the plane exceeds their distance in the
//!   plane.
//!
//! Cells overlap for ray casts, by a fiftieth of a spacing because of rounding. They also overlap
//! by twice the step between two tangent planes half-way between their points, so that a noisy
//! cloud has no slits. The start of a ray on a cell must clear the cell rims above it. This
//! distance is the ray offset.

use super::nearest::{Neighbor, PointTree};
use core::f64::consts::PI;
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

/// Number of neighbors that may bound a cell.
const NEIGHBORS: usize = 24;
/// Number of neighbors for a cell that the first [`NEIGHBORS`] leave open. Points behind the
/// opening distinguish a hole in a random sample from a border.
const MORE_NEIGHBORS: usize = 96;
/// Size limit of such a cell, relative to the distance of the farthest of these neighbors (5.5
/// spacings). Cells at a border also close, but farther away.
const MAX_WIDE_CELL_RADIUS: f64 = 0.42;
/// Size limit of a cell, relative to the distance of the farthest neighbor. Beyond 0.5 a neighbor
/// may be missing from the list. Random samples have holes of up to two spacings, and 24 neighbors
/// lie within 2.8 spacings.
const MAX_CELL_RADIUS: f64 = 0.7;
/// Smallest cosine between normals of one surface: 40 degrees.
const MIN_SURFACE_COSINE: f64 = 0.766;
/// Cosine below which normals belong to opposite sides: 120 degrees.
const OPPOSITE_COSINE: f64 = -0.5;
/// Overlap of neighboring cells, spacings.
const OVERLAP: f64 = 0.02;
/// Distance that a cell extends over an open border, spacings.
const BORDER_EXTENT: f64 = 0.75;
/// Largest number of corners of a cell.
pub(super) const MAX_CORNERS: usize = 16;
/// Tag of an edge without a neighbor.
const OPEN_EDGE: u8 = u8::MAX;

/// Surface piece of a point.
#[derive(Clone, Debug, Default)]
pub(super) struct Cell {
    /// Area, m².
    pub(super) area: f32,
    /// Ray offset from the cell that clears the rims of its neighbors, meters.
    pub(super) lift: f32,
    /// Corners in meters, counter-clockwise seen from the side of the normal. Empty if the point
    /// represents no surface.
    pub(super) outline: Vec<Vec3>,
    /// Distance between neighbors, meters.
    pub(super) spacing: f32,
    /// `true` if neighbors or creases bound the cell on all sides.
    closed: bool,
}

/// Computes the cells of points with unit normals.
pub(super) fn cells(points: &[Vec3], normals: &[Vec3], tree: &PointTree) -> Vec<Cell> {
    let around = |i: usize, (count, reach): (usize, f64), near: &mut Vec<Neighbor>| {
        tree.nearest(points[i], count, Some(i as u32), near);
        Plane::new(i, near, reach, points, normals)
    };
    let few = (NEIGHBORS, MAX_CELL_RADIUS);
    let mut cells: Vec<Cell> = (0..points.len())
        .into_par_iter()
        .map_init(Vec::new, |near, i| match around(i, few, near) {
            Some(plane) => plane.cell(None),
            None => Cell::default(),
        })
        .collect();
    let borders: Vec<(usize, Cell)> = (0..points.len())
        .into_par_iter()
        .filter(|&i| !cells[i].closed && cells[i].spacing > 0.0)
        .map_init(Vec::new, |near, i| {
            let plane = around(i, few, near)?;
            let beside = plane.own.iter().map(|o| &cells[o.index as usize]);
            let closed = beside.filter(|c| c.closed);
            let (sum, count) = closed.fold((0.0, 0), |(sum, count), c| {
                (sum + f64::from(c.area), count + 1)
            });
            let area = if count > 0 {
                sum / f64::from(count)
            } else {
                plane.spacing * plane.spacing
            };
            let mut wide = around(i, (MORE_NEIGHBORS, MAX_WIDE_CELL_RADIUS), near)?.cell(None);
            if wide.closed {
                wide.area = wide.area.min(area as f32);
                return Some((i, wide));
            }
            Some((i, plane.cell(Some(area))))
        })
        .flatten_iter()
        .collect();
    for (i, cell) in borders {
        cells[i] = cell;
    }
    cells
}

/// Neighbor on the same surface.
struct SurfaceNeighbor {
    index: u32,
    /// Position in the tangent plane.
    at: DVec2,
    /// Step between the two tangent planes half-way between the points.
    step: f64,
    /// Sine of the angle between the two normals.
    sine: f64,
}

/// Half-plane of the tangent plane: a · y ≤ b, a of unit length.
#[derive(Clone, Copy)]
struct Bound {
    a: DVec2,
    b: f64,
}

/// Tangent plane of a point, with the bounds of its cell.
struct Plane {
    x: DVec3,
    u: DVec3,
    v: DVec3,
    reach: f64,
    spacing: f64,
    own: Vec<SurfaceNeighbor>,
    creases: Vec<Bound>,
}

/// Corners in counter-clockwise order. Each has the tag of the edge that starts there: the index of
/// a neighbor in `own`, [`CREASE_EDGE`] or [`OPEN_EDGE`].
type Polygon = Vec<(DVec2, u8)>;
/// Tag of an edge on a crease.
const CREASE_EDGE: u8 = u8::MAX - 1;

impl Plane {
    /// Creates the plane of point `i`. `None` if the point has no neighbors at other positions.
    fn new(
        i: usize,
        near: &[Neighbor],
        reach: f64,
        points: &[Vec3],
        normals: &[Vec3],
    ) -> Option<Self> {
        let far = f64::from(near.last()?.square).sqrt();
        if far <= 0.0 {
            return None;
        }
        let (x, n) = (points[i].as_dvec3(), normals[i].as_dvec3().normalize());
        let (u, v) = n.any_orthonormal_pair();
        let mut plane = Self {
            x,
            u,
            v,
            reach: reach * far,
            // Spacing of this number of neighbors in a circle.
            spacing: far * (PI / near.len() as f64).sqrt(),
            own: Vec::with_capacity(near.len()),
            creases: Vec::new(),
        };
        let mut tilted = Vec::new();
        for neighbor in near {
            let j = neighbor.index as usize;
            let (d, n_j) = (points[j].as_dvec3() - x, normals[j].as_dvec3().normalize());
            let (at, cosine, height) = (DVec2::new(d.dot(u), d.dot(v)), n.dot(n_j), d.dot(n));
            if cosine > MIN_SURFACE_COSINE {
                if height.abs() <= at.length() && at.length_squared() > 0.0 {
                    plane.own.push(SurfaceNeighbor {
                        index: neighbor.index,
                        at,
                        step: 0.5 * (height + d.dot(n_j)).abs(),
                        sine: (1.0 - cosine * cosine).max(0.0).sqrt(),
                    });
                }
            } else if cosine > OPPOSITE_COSINE {
                tilted.push((n_j, d.dot(n_j)));
            }
        }
        for (n_j, b) in tilted {
            // The neighbor's plane intersects this plane in the line a · y = b. The point itself is
            // the origin.
            let a = DVec2::new(n_j.dot(u), n_j.dot(v));
            let (a, b) = if b < 0.0 { (-a, -b) } else { (a, b) };
            let length = a.length();
            let bound = Bound {
                a: a / length,
                b: b / length,
            };
            let beyond = |o: &SurfaceNeighbor| o.at.dot(bound.a) > bound.b + 0.1 * plane.spacing;
            if bound.b > 1e-6 * plane.spacing
                && bound.b < plane.reach
                && !plane.own.iter().any(beyond)
            {
                plane.creases.push(bound);
            }
        }
        Some(plane)
    }

    /// Returns the octagon that bounds a cell on open sides.
    fn frame(&self) -> Polygon {
        (0..8)
            .map(|k| {
                // Corners of an octagon: (±1, ±t) and (±t, ±1), t = tan 22.5°.
                const T: f64 = core::f64::consts::SQRT_2 - 1.0;
                const CORNERS: [[f64; 2]; 8] = [
                    [1.0, -T],
                    [1.0, T],
                    [T, 1.0],
                    [-T, 1.0],
                    [-1.0, T],
                    [-1.0, -T],
                    [-T, -1.0],
                    [T, -1.0],
                ];
                (DVec2::from_array(CORNERS[k]) * self.reach, OPEN_EDGE)
            })
            .collect()
    }

    /// Returns the frame cut by neighbors and creases, each moved outward by these distances.
    fn bounded(&self, overlap: f64, over_creases: f64) -> Polygon {
        let mut polygon = self.frame();
        for (k, own) in self.own.iter().enumerate() {
            let length = own.at.length();
            let bound = Bound {
                a: own.at / length,
                b: 0.5 * length + overlap,
            };
            clip(&mut polygon, bound, k as u8);
        }
        for bound in &self.creases {
            clip(
                &mut polygon,
                Bound {
                    b: bound.b + over_creases,
                    ..*bound
                },
                CREASE_EDGE,
            );
        }
        polygon
    }

    /// Returns the cell. `border` is the area of a cell with an open side. Without `border` such a
    /// cell is incomplete.
    fn cell(&self, border: Option<f64>) -> Cell {
        let bare = self.bounded(0.0, 0.0);
        let closed = bare.iter().all(|(_, tag)| *tag != OPEN_EDGE);
        let mut cell = Cell {
            area: area(&bare) as f32,
            spacing: self.spacing as f32,
            closed,
            ..Cell::default()
        };
        if !closed && border.is_none() {
            return cell;
        }
        let beside = || {
            bare.iter()
                .filter_map(|(_, tag)| self.own.get(usize::from(*tag)))
        };
        let step = beside().map(|o| o.step).fold(0.0, f64::max);
        let overlap = (OVERLAP * self.spacing + 2.0 * step).min(BORDER_EXTENT * self.spacing);
        let over_creases = OVERLAP * self.spacing;
        let mut outline = self.bounded(overlap, over_creases);
        if let Some(border) = border.filter(|_| !closed) {
            cell.area = cell.area.min(border as f32);
            let limit = BORDER_EXTENT * border.sqrt();
            for k in 0..bare.len() {
                let ((from, tag), (to, _)) = (bare[k], bare[(k + 1) % bare.len()]);
                if let Some(a) = (from - to)
                    .perp()
                    .try_normalize()
                    .filter(|_| tag == OPEN_EDGE)
                {
                    // The outward direction of a counter-clockwise polygon is to the right.
                    clip(&mut outline, Bound { a, b: limit }, OPEN_EDGE);
                }
            }
        }
        let rise = beside()
            .map(|o| o.sine * overlap + o.step)
            .fold(0.0, f64::max);
        cell.lift = rise.min(self.spacing) as f32;
        let corner = |y: &DVec2| (self.x + self.u * y.x + self.v * y.y).as_vec3();
        outline.truncate(MAX_CORNERS);
        cell.outline = outline.iter().map(|(y, _)| corner(y)).collect();
        cell
    }
}

/// Clips a convex polygon (Sutherland and Hodgman).
fn clip(polygon: &mut Polygon, bound: Bound, tag: u8) {
    let over = |y: DVec2| y.dot(bound.a) - bound.b;
    if polygon.iter().all(|(y, _)| over(*y) <= 0.0) {
        return;
    }
    let mut out = Polygon::with_capacity(polygon.len() + 1);
    for k in 0..polygon.len() {
        let ((y, edge), (next, _)) = (polygon[k], polygon[(k + 1) % polygon.len()]);
        let (a, b) = (over(y), over(next));
        if a <= 0.0 {
            out.push((y, edge));
        }
        if (a <= 0.0) != (b <= 0.0) {
            let cut = y + (next - y) * (a / (a - b));
            // The new edge starts at the exit point. The old edge continues at the entry point.
            out.push((cut, if a <= 0.0 { tag } else { edge }));
        }
    }
    *polygon = out;
}

fn area(polygon: &Polygon) -> f64 {
    let edges =
        (0..polygon.len()).map(|k| polygon[k].0.perp_dot(polygon[(k + 1) % polygon.len()].0));
    0.5 * edges.sum::<f64>().max(0.0)
}
