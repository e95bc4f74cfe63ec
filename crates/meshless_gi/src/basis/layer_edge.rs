//! Edge of the cover above a function: the plane where its layer ends sideways.

use crate::samples::tangents;
use glam::{Vec3, Vec4};

/// Number of bisections. The error of the edge is at most 0.001 of the distance searched.
const BISECTIONS: u32 = 10;
/// Angle to either side at which the direction of the edge is measured, radians.
const ANGLE: f32 = 0.15;

/// Computes the plane (n, d) that contains the normal `n_j` and the edge between the center `x_j`
/// and a position `x` of another layer. The center is on its positive side. `is_inside` returns
/// `true` for a position on the tangent plane in the center's layer. Returns `None` if the search
/// does not find an edge.
pub(super) fn edge_plane(
    x_j: Vec3,
    n_j: Vec3,
    x: Vec3,
    is_inside: &mut impl FnMut(Vec3) -> bool,
) -> Option<Vec4> {
    let (t, b) = tangents(n_j);
    let way = x - x_j;
    let (along_t, along_b) = (way.dot(t), way.dot(b));
    let angle = libm::atan2f(along_b, along_t);
    // Margin, because the edge can be farther away on one side.
    let length = 1.2 * libm::hypotf(along_t, along_b);
    let mut edge = |turn: f32| {
        let toward = t * libm::cosf(angle + turn) + b * libm::sinf(angle + turn);
        let (mut near, mut far) = (0.0, length);
        if is_inside(x_j + toward * far) {
            return None;
        }
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (near + far);
            if is_inside(x_j + toward * middle) {
                near = middle;
            } else {
                far = middle;
            }
        }
        Some(x_j + toward * near)
    };
    let ends = edge(-ANGLE).zip(edge(ANGLE));
    let (position, line) = match ends {
        Some((a, c)) => (0.5 * (a + c), c - a),
        None => (edge(0.0)?, way.cross(n_j)),
    };
    let normal = line.cross(n_j).normalize_or_zero();
    let toward = normal * normal.dot(x_j - position).signum();
    let is_plane = normal != Vec3::ZERO && toward.is_finite();
    is_plane.then(|| toward.extend(-toward.dot(position)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edge_plane_follows_straight_edge() {
        // The layer ends at x + z / 2 = 1.
        let edge = |p: Vec3| p.x + 0.5 * p.z < 1.0;
        let plane = edge_plane(Vec3::ZERO, Vec3::Y, Vec3::new(1.4, 0.0, 0.1), &mut |p| {
            edge(p)
        });
        let plane = plane.expect("an edge");
        let expected = Vec3::new(-1.0, 0.0, -0.5).normalize();
        assert!((plane.truncate() - expected).length() < 0.02, "{plane}");
        assert!(
            plane.w > 0.0 && (plane.w - 1.0 / 1.25f32.sqrt()).abs() < 0.01,
            "{plane}"
        );
    }

    #[test]
    fn edge_plane_without_edge_is_none() {
        assert_eq!(
            edge_plane(Vec3::ZERO, Vec3::Y, Vec3::X, &mut |_| true),
            None
        );
    }
}
