//! Built-in Cornell box for the demo, the examples and tests. It has colored walls that cause color
//! bleeding and two blocks that cast shadows.

use super::{Material, TriangleMesh};
use glam::{Quat, Vec3};

/// Flat quadrilateral with counter-clockwise corners seen from its front.
#[derive(Clone, Debug, PartialEq)]
pub struct Quad {
    /// Meters.
    pub corners: [Vec3; 4],
    /// Material. Textures are not used.
    pub material: Material,
}

const WHITE: Vec3 = Vec3::new(0.73, 0.71, 0.68);
const RED: Vec3 = Vec3::new(0.61, 0.06, 0.05);
const GREEN: Vec3 = Vec3::new(0.12, 0.42, 0.09);

impl Quad {
    /// Returns a room of 2 m, open toward +Z, red on the left and green on the right. Two blocks
    /// stand on its floor. The floor is at y = 0 with its center at the origin.
    #[must_use]
    pub fn cornell_box() -> Vec<Self> {
        let v = Vec3::new;
        let wall = |color, corners| Self {
            corners,
            material: Material::diffuse(color),
        };
        let corner = |x: f32, y: f32, z: f32| v(x, 1.0 + y, z);
        let mut quads = vec![
            wall(
                WHITE,
                [
                    corner(-1.0, -1.0, -1.0),
                    corner(-1.0, -1.0, 1.0),
                    corner(1.0, -1.0, 1.0),
                    corner(1.0, -1.0, -1.0),
                ],
            ),
            wall(
                WHITE,
                [
                    corner(-1.0, 1.0, -1.0),
                    corner(1.0, 1.0, -1.0),
                    corner(1.0, 1.0, 1.0),
                    corner(-1.0, 1.0, 1.0),
                ],
            ),
            wall(
                WHITE,
                [
                    corner(-1.0, -1.0, -1.0),
                    corner(1.0, -1.0, -1.0),
                    corner(1.0, 1.0, -1.0),
                    corner(-1.0, 1.0, -1.0),
                ],
            ),
            wall(
                RED,
                [
                    corner(-1.0, -1.0, 1.0),
                    corner(-1.0, -1.0, -1.0),
                    corner(-1.0, 1.0, -1.0),
                    corner(-1.0, 1.0, 1.0),
                ],
            ),
            wall(
                GREEN,
                [
                    corner(1.0, -1.0, -1.0),
                    corner(1.0, -1.0, 1.0),
                    corner(1.0, 1.0, 1.0),
                    corner(1.0, 1.0, -1.0),
                ],
            ),
        ];
        quads.extend(block(v(-0.35, 0.0, -0.35), v(0.6, 1.2, 0.6), 0.3));
        quads.extend(block(v(0.35, 0.0, 0.35), v(0.6, 0.6, 0.6), -0.3));
        quads
    }
}

/// Returns a box without underside that stands on `foot`, rotated by `turn` radians about the
/// vertical.
fn block(foot: Vec3, size: Vec3, turn: f32) -> Vec<Quad> {
    let rotation = Quat::from_rotation_y(turn);
    let at = |x: f32, y: f32, z: f32| {
        foot + rotation * (Vec3::new(x, y, z) * size * Vec3::new(0.5, 1.0, 0.5))
    };
    let face = |corners| Quad {
        corners,
        material: Material::diffuse(WHITE),
    };
    let side = |a: [f32; 2], b: [f32; 2]| {
        face([
            at(a[0], 0.0, a[1]),
            at(b[0], 0.0, b[1]),
            at(b[0], 1.0, b[1]),
            at(a[0], 1.0, a[1]),
        ])
    };
    vec![
        side([-1.0, 1.0], [1.0, 1.0]),
        side([1.0, 1.0], [1.0, -1.0]),
        side([1.0, -1.0], [-1.0, -1.0]),
        side([-1.0, -1.0], [-1.0, 1.0]),
        face([
            at(-1.0, 1.0, 1.0),
            at(1.0, 1.0, 1.0),
            at(1.0, 1.0, -1.0),
            at(-1.0, 1.0, -1.0),
        ]),
    ]
}

impl TriangleMesh {
    /// Creates a mesh of quadrilaterals, two triangles each. Each quadrilateral has a material of
    /// its own.
    #[must_use]
    pub fn from_quads(quads: &[Quad]) -> Self {
        let halves = |q: &Quad| {
            let [a, b, c, d] = q.corners;
            [[a, b, c], [a, c, d]]
        };
        Self::new(
            quads.iter().flat_map(halves).collect(),
            (0..2 * quads.len() as u32).map(|i| i / 2).collect(),
            quads.iter().map(|q| q.material.clone()).collect(),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Geometry, Ray};

    #[test]
    fn cornell_box_surfaces_face_inward() {
        let quads = Quad::cornell_box();
        assert_eq!(quads.len(), 15);
        let mesh = TriangleMesh::from_quads(&quads);
        assert_eq!((mesh.len(), mesh.problems().dropped()), (30, 0));
        // Viewpoint in the middle of the room, above the blocks.
        let eye = Vec3::new(0.0, 1.5, 0.6);
        for (i, quad) in quads.iter().enumerate().filter(|(i, _)| *i < 5) {
            let to = quad.corners.iter().sum::<Vec3>() / 4.0 - eye;
            let ray = Ray::new(eye, (to + 0.2 * Vec3::Y).normalize());
            let hit = mesh.cast(&ray).expect("a wall");
            let seen = mesh.surface(&ray, &hit);
            assert!(seen.front, "quad {i}");
        }
        let out = Ray::new(eye, Vec3::Z);
        assert!(mesh.cast(&out).is_none(), "open in front");
        for (x, color) in [(Vec3::NEG_X, RED), (Vec3::X, GREEN)] {
            let ray = Ray::new(eye, x);
            let hit = mesh.cast(&ray).expect("a wall");
            assert_eq!(mesh.surface(&ray, &hit).albedo, color);
        }
    }
}
