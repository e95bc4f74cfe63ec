//! The sum over all pairs, O(N²): what the fast multipole method is measured against. Shares nothing with it but the definition of the kernel and of
//! what counts as one place ([`COINCIDENT`]).

use super::settings::FmmPoint;
use super::tree::COINCIDENT;
use crate::scene::Geometry;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Irradiance at `receivers` (indices of points) from all points of radiosity `radiosity`, W/m²: \[G08\] Eq. (4) with max(0, ·), as disks where `disks`
/// ([`FmmSettings::disks`](super::FmmSettings::disks)), and where a geometry is given only between points that see each other.
///
/// # Panics
/// Where there is not one radiosity a point, or a receiver is no point.
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
    receivers
        .par_iter()
        .map(|&i| {
            let x = &points[i as usize];
            let nx = x.normal.as_dvec3().normalize_or_zero();
            let mut sum = DVec3::ZERO;
            for (y, b) in points.iter().zip(radiosity) {
                let r = x.position.as_dvec3() - y.position.as_dvec3();
                let (out, into) = (y.normal.as_dvec3().normalize_or_zero().dot(r), -nx.dot(r));
                if out <= 0.0 || into <= 0.0 || r.length() <= nearest || *b == Vec3::ZERO {
                    continue;
                }
                if geometry.is_some_and(|g| hidden(g, x, y)) {
                    continue;
                }
                let share = f64::from(y.weight) / core::f64::consts::PI;
                let square = r.length_squared();
                let spread = if disks { square + share } else { square };
                sum += share * out * into / (square * spread) * b.as_dvec3();
            }
            sum.as_vec3()
        })
        .collect()
}

fn hidden(geometry: &dyn Geometry, x: &FmmPoint, y: &FmmPoint) -> bool {
    let lifted = |p: &FmmPoint| {
        let lift = geometry.lift(p.position);
        (p.position + p.normal.normalize() * lift, lift)
    };
    let ((from, la), (to, lb)) = (lifted(x), lifted(y));
    from.distance(to) > 2.0 * (la + lb) && geometry.occluded(from, to)
}
