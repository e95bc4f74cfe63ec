//! Sum over all pairs, O(N²): the reference for the fast multipole method. Shares only the
//! definitions of the kernel and of coincident points ([`COINCIDENT`]) with it.

use super::settings::FmmPoint;
use super::tree::COINCIDENT;
use crate::scene::Geometry;
use glam::{DVec3, Vec3};
use multiversion::multiversion;
use rayon::prelude::*;

/// Returns the irradiance at `receivers` (indices of points) from all points, W/m². `radiosity` has
/// one value per point. Evaluates \[G08\] Eq. (4) with max(0, ·). Sources are disks if `disks`
/// ([`FmmSettings::disks`](super::FmmSettings::disks)). With a geometry, occluded pairs of points
/// exchange no light.
///
/// # Panics
/// Error if there is not one radiosity per point, or if a receiver is not a point.
#[must_use]
pub fn direct(
    points: &[FmmPoint],
    radiosity: &[Vec3],
    receivers: &[u32],
    disks: bool,
    geometry: Option<&dyn Geometry>,
) -> Vec<Vec3> {
    assert_eq!(points.len(), radiosity.len());
    let used = |p: &&FmmPoint| p.normal != Vec3::ZERO;
    let corners =
        points
            .iter()
            .filter(used)
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), p| {
                let p = p.position.as_dvec3();
                (min.min(p), max.max(p))
            });
    let nearest = COINCIDENT * (corners.1 - corners.0).max_element();
    let shines = |(p, b): &(&FmmPoint, &Vec3)| p.normal != Vec3::ZERO && **b != Vec3::ZERO;
    let sources: Vec<_> = points
        .iter()
        .zip(radiosity)
        .filter(shines)
        .map(|(point, b)| Source {
            point,
            position: point.position.as_dvec3(),
            normal: point.normal.as_dvec3().normalize_or_zero(),
            share: f64::from(point.weight) / core::f64::consts::PI,
            radiosity: b.as_dvec3(),
        })
        .collect();
    let rules = Rules {
        nearest: nearest * nearest,
        disks,
        geometry,
    };
    receivers
        .par_iter()
        .map(|&i| irradiance(&points[i as usize], &sources, &rules).as_vec3())
        .collect()
}

/// Point that emits, prepared once for all receivers.
struct Source<'a> {
    point: &'a FmmPoint,
    position: DVec3,
    normal: DVec3,
    share: f64,
    radiosity: DVec3,
}

struct Rules<'a> {
    /// Square of the distance within which two points coincide.
    nearest: f64,
    disks: bool,
    geometry: Option<&'a dyn Geometry>,
}

/// Computes the irradiance at one point. It is compiled for AVX2 too, as the passes of the method
/// are, so that timings are comparable.
#[multiversion(targets("x86_64+avx2"))]
fn irradiance(x: &FmmPoint, sources: &[Source<'_>], rules: &Rules<'_>) -> DVec3 {
    let position = x.position.as_dvec3();
    let normal = x.normal.as_dvec3().normalize_or_zero();
    let mut sum = DVec3::ZERO;
    for y in sources {
        let r = position - y.position;
        let (out, into, square) = (y.normal.dot(r), -normal.dot(r), r.length_squared());
        if out <= 0.0 || into <= 0.0 || square <= rules.nearest {
            continue;
        }
        if rules.geometry.is_some_and(|g| hidden(g, x, y.point)) {
            continue;
        }
        let spread = if rules.disks {
            square + y.share
        } else {
            square
        };
        sum += y.share * out * into / (square * spread) * y.radiosity;
    }
    sum
}

fn hidden(geometry: &dyn Geometry, x: &FmmPoint, y: &FmmPoint) -> bool {
    let lifted = |p: &FmmPoint| {
        let lift = geometry.ray_offset(p.position);
        (p.position + p.normal.normalize() * lift, lift)
    };
    let ((from, la), (to, lb)) = (lifted(x), lifted(y));
    from.distance(to) > 2.0 * (la + lb) && geometry.is_occluded(from, to)
}
