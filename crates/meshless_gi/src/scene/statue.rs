//! Built-in statue: a knot on a pedestal in the Cornell box, without the blocks. It is a closed
//! shape with thin, curved and hidden parts. The demo and the tests sample point clouds from it.

use super::{Material, Quad, TriangleMesh};
use glam::{DVec2, DVec3, Vec3};

const MARBLE: Vec3 = Vec3::new(0.78, 0.76, 0.72);
const STONE: Vec3 = Vec3::new(0.45, 0.44, 0.42);
/// Segments along the knot, around its tube and around the pedestal.
const ALONG: u32 = 480;
const AROUND: u32 = 48;
const TURN: u32 = 96;
/// Meters per unit of the knot's equation, and half the width of its tube in meters.
const SIZE: f64 = 0.16;
const TUBE: f64 = 0.1;
/// Profile of the pedestal: radius and height of each ring in meters, from the floor to the center
/// of its top.
const PROFILE: [[f64; 2]; 8] = [
    [0.34, 0.0],
    [0.34, 0.08],
    [0.28, 0.12],
    [0.25, 0.2],
    [0.25, 0.36],
    [0.3, 0.4],
    [0.3, 0.46],
    [0.0, 0.46],
];

/// Returns the statue alone, standing on y = 0 above the origin. Corners are counter-clockwise seen
/// from outside. The base is open.
#[must_use]
pub fn statue() -> TriangleMesh {
    let (pedestal, knot) = (pedestal(), knot());
    let material_of = [vec![0; pedestal.len()], vec![1; knot.len()]].concat();
    let materials = [STONE, MARBLE].map(Material::diffuse).to_vec();
    TriangleMesh::new([pedestal, knot].concat(), material_of, materials)
}

/// Returns the Cornell box with the [`statue`] instead of its blocks. The floor is at y = 0 with
/// its center at the origin.
#[must_use]
pub fn statue_room() -> TriangleMesh {
    let walls = TriangleMesh::from_quads(&Quad::cornell_box()[..5]);
    TriangleMesh::joined(vec![walls, statue()])
}

/// Returns the cosine and sine of a fraction of a full turn, bitwise identical on every machine.
fn turn_cos_sin(part: f64) -> DVec2 {
    let angle = core::f64::consts::TAU * part;
    DVec2::new(libm::cos(angle), libm::sin(angle))
}

/// Triangulates a surface over a grid of `rows` × `columns` cells. The columns close to a ring. The
/// mesh leaves out triangles without area.
fn grid(rows: u32, columns: u32, at: impl Fn(u32, u32) -> DVec3) -> Vec<[Vec3; 3]> {
    let corner = |i: u32, j: u32| at(i, j % columns).as_vec3();
    let pieces = (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j)));
    pieces
        .flat_map(|(i, j)| {
            let [a, b] = [corner(i, j), corner(i, j + 1)];
            let [c, d] = [corner(i + 1, j + 1), corner(i + 1, j)];
            [[a, c, b], [a, d, c]]
        })
        .filter(super::mesh::has_area)
        .collect()
}

fn pedestal() -> Vec<[Vec3; 3]> {
    grid(PROFILE.len() as u32 - 1, TURN, |i, j| {
        let [radius, height] = PROFILE[i as usize];
        let around = turn_cos_sin(f64::from(j) / f64::from(TURN)) * radius;
        DVec3::new(around.x, height, around.y)
    })
}

/// Returns a trefoil knot with a slightly flat tube that twists nine half turns along the knot.
fn knot() -> Vec<[Vec3; 3]> {
    let middle = |part: f64| {
        let [one, two, three] = [1.0, 2.0, 3.0].map(|k| turn_cos_sin(k * part));
        DVec3::new(one.y + 2.0 * two.y, one.x - 2.0 * two.x, -three.y) * SIZE
    };
    // The lowest point of the knot is three units below its center. The tube sinks into the
    // pedestal by a tenth.
    let foot = DVec3::Y * (PROFILE[7][1] + 3.0 * SIZE + 0.9 * TUBE);
    grid(ALONG, AROUND, |i, j| {
        let part = f64::from(i % ALONG) / f64::from(ALONG);
        let center = middle(part);
        let along = (middle(part + 1e-4) - middle(part - 1e-4)).normalize();
        let out = (center - along * along.dot(center)).normalize();
        let phi = f64::from(j) / f64::from(AROUND);
        let around = turn_cos_sin(phi);
        let radius = TUBE * (1.0 + 0.22 * turn_cos_sin(2.0 * phi + 9.0 * part).x);
        foot + center + (out * around.x + out.cross(along) * around.y) * radius
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Geometry, Ray};

    #[test]
    fn statue_is_closed_faces_outward_and_fits_room() {
        let room = statue_room();
        assert_eq!(room.problems().dropped(), 0);
        let bounds = room.bounds();
        assert!(bounds.min.abs_diff_eq(Vec3::new(-1.0, 0.0, -1.0), 1e-6));
        assert!(bounds.max.abs_diff_eq(Vec3::new(1.0, 2.0, 1.0), 1e-6));
        let mut on_statue = 0;
        for i in 0..40_000u32 {
            // View from the front, over the whole opening.
            let eye = Vec3::new(
                (i % 200) as f32 * 0.0099 - 0.99,
                (i / 200) as f32 * 0.0099 + 0.01,
                1.5,
            );
            let ray = Ray::new(eye, Vec3::NEG_Z);
            let hit = room.cast(&ray).expect("the back wall at least");
            assert!(room.surface(&ray, &hit).front, "{eye}");
            on_statue += u32::from(hit.primitive >= 10);
        }
        assert!((4000..20_000).contains(&on_statue), "{on_statue}");
    }
}
