//! The weight function of the basis: [L08] Eqs. (8)-(10), with clip planes that stop it at walls
//! (design D7).

use crate::samples::{Point, dist_squared};
use crate::scene::Barrier;
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

/// Squared length of the normal of a clip plane from which on the plane has a lean.
pub const LEAN_FROM: f32 = 1.001;
/// Lean of an occluder's clip plane beyond half of the occluder's thickness, in radii. It covers
/// surfaces drawn on the occluder itself, and rounding.
const LEAN_MARGIN: f32 = 0.01;
/// Longest lean, in radii: no function reaches further.
const LONGEST_LEAN: f32 = 2.0;

/// The clip plane (n, d) of a function of `radius` at a barrier. The normal of an ordinary one is a
/// unit vector. That of an occluder is longer: its squared length is [`LEAN_FROM`] and the lean, in
/// radii.
#[must_use]
pub(super) fn plane_at(barrier: &Barrier, radius: f32) -> Vec4 {
    let plane = barrier.normal.extend(-barrier.normal.dot(barrier.position));
    let half = barrier.half_thickness;
    half.map_or(plane, |half| {
        let lean = (half / radius).min(LONGEST_LEAN) + LEAN_MARGIN;
        plane * (LEAN_FROM + lean).sqrt()
    })
}

/// Returns true if a clip plane is that of an occluder.
pub(super) fn leans(plane: Vec4) -> bool {
    plane.truncate().length_squared() > LEAN_FROM
}

/// Above zero where the position is on the function's side of a clip plane. The plane of an
/// occluder lies in its middle and moves with the normal of what is lit: by its lean away from the
/// function for what faces it, and toward it for what faces away. So all that lies in a shut door
/// is lit from the side that it faces, and floor and jambs from the nearer one.
#[inline]
pub(super) fn before(plane: Vec4, x: Vec3, n: Vec3, radius: f32) -> f32 {
    let m = plane.truncate();
    let lean = (m.length_squared() - LEAN_FROM).max(0.0) * radius;
    plane.dot(x.extend(1.0)) + lean * m.dot(n)
}

/// w_j(x, n) of \[L08\] Eq. (8), dimensionless in [0, 1]; 0 where `x` lies behind one of the
/// function's clip planes. `planes` is the array that `point.planes` points into.
#[must_use]
#[inline]
pub fn weight(point: &Point, planes: &[[f32; 4]], x: Vec3, n: Vec3) -> f32 {
    let (cosine, squared, inside) = reach(point, x, n);
    if inside {
        weight_inside(point, planes, x, n, cosine, squared)
    } else {
        0.0
    }
}

/// The cosine of the normals, the squared distance of \[L08\] Eq. (10), and whether the position is
/// within the radius and on the side that the function faces.
#[inline]
pub(super) fn reach(point: &Point, x: Vec3, n: Vec3) -> (f32, f32, bool) {
    let n_j = point.n();
    let cosine = n.dot(n_j);
    let squared = dist_squared(x - point.x(), n_j);
    let inside = (cosine > 0.0) & (squared < point.radius * point.radius);
    (cosine, squared, inside)
}

/// [`weight`] of a position that [`reach`] says is inside.
#[inline]
pub(super) fn weight_inside(
    point: &Point,
    planes: &[[f32; 4]],
    x: Vec3,
    n: Vec3,
    cosine: f32,
    squared: f32,
) -> f32 {
    for plane in &planes[point.plane_range()] {
        if before(Vec4::from_array(*plane), x, n, point.radius) < 0.0 {
            return 0.0;
        }
    }
    kernel(squared.sqrt() / point.radius) * cosine * cosine
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernel_matches_smoothstep() {
        assert_eq!(kernel(0.0), 1.0);
        assert_eq!(kernel(0.5), 0.5);
        assert_eq!(kernel(1.0), 0.0);
        assert_eq!(kernel(7.0), 0.0);
    }

    #[test]
    fn weight_depends_on_radius_normal_and_clip_planes() {
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

    /// A door 20 cm thick with its middle at x = 1, before a function at the origin.
    #[test]
    fn weight_inside_occluder_belongs_to_faced_side() {
        let barrier = Barrier {
            normal: Vec3::NEG_X,
            position: Vec3::X,
            half_thickness: Some(0.1),
        };
        let plane = plane_at(&barrier, 0.5);
        let before = |x: f32, n: Vec3| before(plane, Vec3::X * x, n, 0.5) >= 0.0;
        for (n, end) in [(Vec3::NEG_X, 1.105), (Vec3::Y, 1.0), (Vec3::X, 0.895)] {
            assert!(before(end - 0.001, n) && !before(end + 0.001, n), "{n}");
        }
        // What stays has no thickness, whatever faces it.
        let wall = Barrier {
            half_thickness: None,
            ..barrier
        };
        let plane = plane_at(&wall, 0.5);
        assert_eq!(plane, Vec4::new(-1.0, 0.0, 0.0, 1.0));
        let at = |n| super::before(plane, Vec3::X * 0.9, n, 0.5);
        assert_eq!(at(Vec3::X), at(Vec3::NEG_X));
    }
}
