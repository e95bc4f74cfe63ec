//! The weight function of the basis: [L08] Eqs. (8)-(10), with clip planes that stop it at walls (design D7).

use crate::samples::{Point, dist_squared};
use glam::{Vec3, Vec4};

/// K(t) of \[L08\] Eq. (9) for t = r / r_j: 2t³ − 3t² + 1 up to 1, then 0.
#[must_use]
#[inline]
pub fn kernel(t: f32) -> f32 {
    if t < 1.0 {
        (2.0 * t - 3.0) * t * t + 1.0
    } else {
        0.0
    }
}

/// w_j(x, n) of \[L08\] Eq. (8), dimensionless in [0, 1]; 0 where `x` lies behind one of the function's clip planes. `planes` is the
/// array that `point.planes` points into.
#[must_use]
#[inline]
pub fn weight(point: &Point, planes: &[[f32; 4]], x: Vec3, n: Vec3) -> f32 {
    let (cosine, squared, inside) = reach(point, x, n);
    if inside {
        weight_inside(point, planes, x, cosine, squared)
    } else {
        0.0
    }
}

/// The cosine of the normals, the squared distance of \[L08\] Eq. (10), and whether the place is within the radius and on the side that the function
/// faces.
#[inline]
pub(super) fn reach(point: &Point, x: Vec3, n: Vec3) -> (f32, f32, bool) {
    let n_j = point.n();
    let cosine = n.dot(n_j);
    let squared = dist_squared(x - point.x(), n_j);
    let inside = (cosine > 0.0) & (squared < point.radius * point.radius);
    (cosine, squared, inside)
}

/// [`weight`] of a place that [`reach`] says is inside.
#[inline]
pub(super) fn weight_inside(
    point: &Point,
    planes: &[[f32; 4]],
    x: Vec3,
    cosine: f32,
    squared: f32,
) -> f32 {
    for plane in &planes[point.plane_range()] {
        if Vec4::from_array(*plane).dot(x.extend(1.0)) < 0.0 {
            return 0.0;
        }
    }
    kernel(squared.sqrt() / point.radius) * cosine * cosine
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernel_is_the_smooth_ramp() {
        assert_eq!(kernel(0.0), 1.0);
        assert_eq!(kernel(0.5), 0.5);
        assert_eq!(kernel(1.0), 0.0);
        assert_eq!(kernel(7.0), 0.0);
    }

    #[test]
    fn weight_knows_radius_normal_and_planes() {
        let mut p = Point::new(Vec3::ZERO, Vec3::Y, 2.0);
        assert_eq!(weight(&p, &[], Vec3::X, Vec3::Y), 0.5);
        assert_eq!(weight(&p, &[], Vec3::X, Vec3::NEG_Y), 0.0);
        assert_eq!(weight(&p, &[], Vec3::X * 2.0, Vec3::Y), 0.0);
        // Along the normal the support is 1 / (1 + F_squash) as long.
        assert_eq!(weight(&p, &[], Vec3::Y * 0.67, Vec3::Y), 0.0);
        // A wall at x = 0.9 that faces the function.
        let planes = [[-1.0, 0.0, 0.0, 0.9]];
        p.planes = 1 << 24;
        assert_eq!(weight(&p, &planes, Vec3::X, Vec3::Y), 0.0);
        assert!(weight(&p, &planes, Vec3::X * 0.89, Vec3::Y) > 0.5);
    }
}
