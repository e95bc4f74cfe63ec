//! Weight function of the basis: [L08] Eqs. (8)-(10), with clip planes that end it at walls (design
//! D7).

use crate::samples::{Point, dist_squared};
use crate::scene::Barrier;
use glam::{Vec3, Vec4};

/// Computes K(t) of \[L08\] Eq. (9) with t = r / r_j: 2t³ − 3t² + 1 for t < 1, otherwise 0.
#[must_use]
#[inline]
pub fn kernel(t: f32) -> f32 {
    if t < 1.0 {
        (2.0 * t - 3.0) * t * t + 1.0
    } else {
        0.0
    }
}

/// Squared length of a clip plane's normal above which the plane has a lean.
pub const LEAN_FROM: f32 = 1.001;
/// Lean of an occluder's clip plane beyond half of the occluder's thickness, in radii. It covers
/// surfaces drawn on the occluder itself, and rounding.
const LEAN_MARGIN: f32 = 0.01;
/// Largest lean, in radii. Functions do not reach farther.
const MAX_LEAN: f32 = 2.0;

/// Computes the clip plane (n, d) of a function of `radius` at a barrier. The normal of an ordinary
/// plane is a unit vector. The normal of an occluder's plane is longer: its squared length is
/// [`LEAN_FROM`] plus the lean, in radii.
#[must_use]
pub(super) fn plane_at(barrier: &Barrier, radius: f32) -> Vec4 {
    let plane = barrier.normal.extend(-barrier.normal.dot(barrier.position));
    let half = barrier.half_thickness;
    half.map_or(plane, |half| {
        let lean = (half / radius).min(MAX_LEAN) + LEAN_MARGIN;
        plane * (LEAN_FROM + lean).sqrt()
    })
}

/// Returns `true` if a clip plane belongs to an occluder.
pub(super) fn is_occluder_plane(plane: Vec4) -> bool {
    plane.truncate().length_squared() > LEAN_FROM
}

/// Computes a value that is at least zero if the position is on the function's side of a clip
/// plane. The plane of an occluder lies in the middle of the occluder and shifts by its lean. It
/// shifts away from the function if the normal `n` faces the function, and toward it if `n` faces
/// away. A surface inside a closed door is thus lit from the side that it faces. Floor and jambs
/// are lit from the nearer side.
#[inline]
pub(super) fn before(plane: Vec4, x: Vec3, n: Vec3, radius: f32) -> f32 {
    let m = plane.truncate();
    let lean = (m.length_squared() - LEAN_FROM).max(0.0) * radius;
    plane.dot(x.extend(1.0)) + lean * m.dot(n)
}

/// Computes w_j(x, n) of \[L08\] Eq. (8), dimensionless in [0, 1]. The weight is 0 if `x` lies
/// behind one of the function's clip planes. `planes` is the array that `point.planes` refers to.
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

/// Computes (w / r)² in 1/m², the weight of a function in the flat basis, from its [`weight`].
/// Deviation from \[L08\] Eq. (3), where all functions have one radius. Here radii differ (module
/// `frame::splat`).
#[must_use]
#[inline]
pub fn flat_weight(point: &Point, w: f32) -> f32 {
    (w / point.radius) * (w / point.radius)
}

/// Tolerance of [`crease_weight`] in radii: positions are interpolated from depth, and a clip plane
/// may lie on the surface itself.
pub const CREASE_MARGIN: f32 = 0.02;

/// Computes the weight of a function for a surface of another orientation that meets its own in a
/// crease: (K / r)² in 1/m², with K(t) of \[L08\] Eq. (9). It is 0 unless each of the two surfaces
/// is in front of the other, and `x` is on the function's side of its clip planes. Not in \[L08\],
/// whose functions reach similar normals only.
#[must_use]
pub fn crease_weight(point: &Point, planes: &[[f32; 4]], x: Vec3, n: Vec3) -> f32 {
    let (offset, n_j) = (x - point.x(), point.n());
    let squared = dist_squared(offset, n_j);
    let margin = CREASE_MARGIN * point.radius;
    if squared >= point.radius * point.radius || offset.dot(n_j) < -margin || offset.dot(n) > margin
    {
        return 0.0;
    }
    for plane in &planes[point.plane_range()] {
        if before(Vec4::from_array(*plane), x, n, point.radius) < -margin {
            return 0.0;
        }
    }
    flat_weight(point, kernel(squared.sqrt() / point.radius))
}

/// Returns the cosine of the normals and the squared distance of \[L08\] Eq. (10). The last value
/// is `true` if the position is within the radius and on the side that the function faces.
#[inline]
pub(super) fn reach(point: &Point, x: Vec3, n: Vec3) -> (f32, f32, bool) {
    let n_j = point.n();
    let cosine = n.dot(n_j);
    let squared = dist_squared(x - point.x(), n_j);
    let inside = (cosine > 0.0) & (squared < point.radius * point.radius);
    (cosine, squared, inside)
}

/// Computes [`weight`] for a position that is inside by [`reach`].
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
        // The support extends 1 / (1 + F_squash) radii along the normal.
        assert_eq!(weight(&p, &[], Vec3::Y * 0.67, Vec3::Y), 0.0);
        // A wall at x = 0.9 that faces the function.
        let planes = [[-1.0, 0.0, 0.0, 0.9]];
        p.planes = 1 << 24;
        assert_eq!(weight(&p, &planes, Vec3::X, Vec3::Y), 0.0);
        assert!(weight(&p, &planes, Vec3::X * 0.89, Vec3::Y) > 0.5);
    }

    #[test]
    fn crease_weight_reaches_surface_in_front_only() {
        let p = Point::new(Vec3::ZERO, Vec3::Y, 1.0);
        // A wall that stands on the floor at x = 0.3 and faces the function.
        let (wall, facing) = (Vec3::new(0.3, 0.05, 0.0), Vec3::NEG_X);
        assert_eq!(weight(&p, &[], wall, facing), 0.0);
        assert!(crease_weight(&p, &[], wall, facing) > 0.5);
        // The back of the wall, below the floor, and out of reach.
        assert_eq!(crease_weight(&p, &[], wall, Vec3::X), 0.0);
        assert_eq!(crease_weight(&p, &[], wall - 0.1 * Vec3::Y, facing), 0.0);
        assert_eq!(crease_weight(&p, &[], 4.0 * wall, facing), 0.0);
        // A clip plane between them, and one on the wall itself.
        let mut clipped = p;
        clipped.planes = 1 << 24;
        let plane = |at: f32| [[-1.0, 0.0, 0.0, at]];
        assert_eq!(crease_weight(&clipped, &plane(0.2), wall, facing), 0.0);
        assert!(crease_weight(&clipped, &plane(0.299), wall, facing) > 0.5);
    }

    /// Door 20 cm thick with its middle at x = 1, in front of a function at the origin.
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
        // A static wall has zero thickness for every normal.
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
