//! Points spread evenly over a mesh: conversion of a triangle mesh to a point cloud. The points are
//! uniform by area, thinned to Poisson disks of one radius.

use super::{Candidate, Random, throw_darts};
use crate::scene::{Geometry, Hit, PlyPoints, Ray, TriangleMesh};
use glam::Vec3;
use rayon::prelude::*;

/// Number of darts per disk area. This number leaves few gaps.
const DARTS_PER_DISK: f64 = 16.0;
/// Largest number of darts.
const MAX: f64 = 3e8;

/// Returns points on `mesh`, at least `spacing` meters apart on one surface. They have the normals
/// of the triangles' fronts and the reflectances at the points. Returns `None` if the number of
/// darts would be too large or `spacing` is not above zero. The same arguments give the same
/// points.
#[must_use]
pub fn scatter(mesh: &TriangleMesh, spacing: f32, seed: u64) -> Option<PlyPoints> {
    let corners: Vec<[Vec3; 3]> = (0..mesh.len()).filter_map(|i| mesh.triangle(i)).collect();
    let mut sums = Vec::with_capacity(corners.len());
    let mut area = 0.0f64;
    for [a, b, c] in &corners {
        area += 0.5 * f64::from((b - a).cross(c - a).length());
        sums.push(area);
    }
    let darts = DARTS_PER_DISK * area / (f64::from(spacing) * f64::from(spacing));
    if !(spacing > 0.0 && darts < MAX) {
        return None;
    }
    let dart = |k: u64| {
        let mut random = Random::new(seed, 0x73_63_61_74, k);
        // Two numbers, because one in single precision is too coarse to select among a million
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
