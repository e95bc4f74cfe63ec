//! The sum over all pairs, O(N²): what the fast multipole method is measured against. Shares
//! nothing with it but the definition of the kernel and of what counts as one position
//! ([`COINCIDENT`]).

use super::settings::FmmPoint;
use super::tree::COINCIDENT;
use crate::scene::Geometry;
use glam::{DVec3, Vec3};
use multiversion::multiversion;
use rayon::prelude::*;

/// Irradiance at `receivers` (indices of points) from all points of radiosity `radiosity`, W/m²:
/// \[G08\] Eq. (4) with max(0, ·), as disks where `disks`
/// ([`FmmSettings::disks`](super::FmmSettings::disks)), and where a geometry is given only between
/// points that see each other.
///
/// # Panics
/// Error if there is not one radiosity per point, or a receiver is no point.
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

/// A point that gives light, prepared once for all receivers.
struct Source<'a> {
    point: &'a FmmPoint,
    position: DVec3,
    normal: DVec3,
    share: f64,
    radiosity: DVec3,
}

struct Rules<'a> {
    /// Square of the distance within which two points are one position.
    nearest: f64,
    disks: bool,
    geometry: Option<&'a dyn Geometry>,
}

/// At one point, compiled for AVX2 too, as the method's passes are: what is compared has the same
/// means.
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
    from.distance(to) > 2.0 * (la + lb) && geometry.occluded(from, to)
}
