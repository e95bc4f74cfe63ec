//! Points spread evenly over a mesh: how a level of triangles becomes a point cloud. Uniform by
//! area, thinned to Poisson disks of one radius.

use super::{Candidate, Random, throw_darts};
use crate::scene::{Geometry, Hit, PlyPoints, Ray, TriangleMesh};
use glam::Vec3;
use rayon::prelude::*;

/// Darts for each disk's area: leaves few gaps.
const DARTS: f64 = 16.0;
/// No more darts than this.
const MAX: f64 = 3e8;

/// Points on `mesh` of which no two on one surface are nearer than `spacing` (meters), with the
/// normals of the triangles' fronts and their reflectances there. `None` where that would be too
/// many, or `spacing` is no length. The same arguments give the same points.
#[must_use]
pub fn scatter(mesh: &TriangleMesh, spacing: f32, seed: u64) -> Option<PlyPoints> {
    let corners: Vec<[Vec3; 3]> = (0..mesh.len()).filter_map(|i| mesh.triangle(i)).collect();
    let mut sums = Vec::with_capacity(corners.len());
    let mut area = 0.0f64;
    for [a, b, c] in &corners {
        area += 0.5 * f64::from((b - a).cross(c - a).length());
        sums.push(area);
    }
    let darts = DARTS * area / (f64::from(spacing) * f64::from(spacing));
    if !(spacing > 0.0 && darts < MAX) {
        return None;
    }
    let dart = |k: u64| {
        let mut random = Random::new(seed, 0x73_63_61_74, k);
        // Two numbers, because one in single precision is too coarse to choose among a million
        // triangles.
        let at = (f64::from(random.unit()) + f64::from(random.unit()) * 2f64.powi(-24)) * area;
        let index = sums.partition_point(|s| *s < at).min(corners.len() - 1);
        let [a, b, c] = corners[index];
        let (root, v) = (random.unit().sqrt(), random.unit());
        let uv = [root * (1.0 - v), root * v];
        let n = (b - a).cross(c - a).normalize_or_zero();
        let x = a + (b - a) * uv[0] + (c - a) * uv[1];
        let hit = Hit {
            t: 1.0,
            primitive: index as u32,
            uv,
        };
        let surface = mesh.surface(&Ray::new(x + n, -n), &hit);
        Candidate { surface, free: x }
    };
    let candidates: Vec<Candidate> = match corners.is_empty() {
        true => Vec::new(),
        false => (0..darts.ceil() as u64).into_par_iter().map(dart).collect(),
    };
    let (kept, _) = throw_darts(None, candidates, spacing, usize::MAX);
    Some(PlyPoints {
        positions: kept.iter().map(|c| c.surface.position).collect(),
        normals: Some(kept.iter().map(|c| c.surface.normal).collect()),
        albedo: Some(kept.iter().map(|c| c.surface.albedo).collect()),
        faces: 0,
    })
}
