//! A room full of small things: boxes at all angles, balls, poles, a shelf with books, a table.

use super::Level;
use bevy_meshless_gi::samples::Random;
use bevy_meshless_gi::scene::{Light, Material, TriangleMesh};
use glam::{Mat3, Quat, Vec3};
use std::f32::consts::{PI, TAU};

/// Inner size of the room, metres; a corner of its floor is the origin.
const ROOM: Vec3 = Vec3::new(6.0, 3.0, 5.0);

#[derive(Default)]
struct Builder {
    triangles: Vec<[Vec3; 3]>,
    material_of: Vec<u32>,
    materials: Vec<Material>,
}

impl Builder {
    fn material(&mut self, albedo: Vec3) {
        self.materials.push(Material::diffuse(albedo));
    }

    fn triangle(&mut self, corners: [Vec3; 3]) {
        self.triangles.push(corners);
        self.material_of.push(self.materials.len() as u32 - 1);
    }

    fn quad(&mut self, origin: Vec3, u: Vec3, v: Vec3) {
        self.triangle([origin, origin + u, origin + u + v]);
        self.triangle([origin, origin + u + v, origin + v]);
    }

    /// A box around `center`, its edges turned; `inwards` shows its inner sides.
    fn block(&mut self, center: Vec3, size: Vec3, turn: Quat, inwards: bool) {
        let axes = Mat3::from_quat(turn);
        let half = [0, 1, 2].map(|i| 0.5 * size[i] * axes.col(i));
        for i in 0..3 {
            let (u, v) = (half[(i + 1) % 3], half[(i + 2) % 3]);
            for side in [-1.0, 1.0] {
                let (u, v) = if (side > 0.0) == inwards {
                    (v, u)
                } else {
                    (u, v)
                };
                self.quad(center + side * half[i] - u - v, 2.0 * u, 2.0 * v);
            }
        }
    }

    /// A ball of `n` by 2 `n` patches.
    fn ball(&mut self, center: Vec3, radius: f32, n: u32) {
        let at = |i: u32, j: u32| {
            let (polar, around) = (PI * i as f32 / n as f32, PI * j as f32 / n as f32);
            let ring = polar.sin();
            center + radius * Vec3::new(ring * around.cos(), polar.cos(), -ring * around.sin())
        };
        for i in 0..n {
            for j in 0..2 * n {
                let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                if i + 1 < n {
                    self.triangle([a, b, c]);
                }
                if i > 0 {
                    self.triangle([a, c, d]);
                }
            }
        }
    }
}

/// The room, with a spot lamp that lights a part of its floor.
pub fn clutter() -> Level {
    let mut random = Random::new(0x636c, 7, 0);
    let mut out = Builder::default();
    let upright = Quat::IDENTITY;
    out.material(Vec3::new(0.75, 0.72, 0.68));
    out.block(0.5 * ROOM, ROOM, upright, true);
    // A table on four legs, and things on it.
    out.material(Vec3::new(0.55, 0.35, 0.2));
    out.block(
        Vec3::new(2.0, 0.75, 2.0),
        Vec3::new(1.6, 0.05, 0.9),
        upright,
        false,
    );
    for (x, z) in [(1.25, 1.6), (2.75, 1.6), (1.25, 2.4), (2.75, 2.4)] {
        out.block(
            Vec3::new(x, 0.36, z),
            Vec3::new(0.06, 0.73, 0.06),
            upright,
            false,
        );
    }
    // A shelf along the far wall, with books.
    out.material(Vec3::new(0.4, 0.42, 0.45));
    for row in 0..4 {
        let y = 0.4 + 0.5 * row as f32;
        out.block(
            Vec3::new(3.0, y, 0.2),
            Vec3::new(3.0, 0.03, 0.3),
            upright,
            false,
        );
    }
    for row in 0..4 {
        let mut x = 1.6;
        while x < 4.4 {
            out.material(colour(&mut random));
            let (thick, high) = (0.03 + 0.05 * random.unit(), 0.22 + 0.16 * random.unit());
            let center = Vec3::new(x, 0.42 + 0.5 * row as f32 + 0.5 * high, 0.2);
            let lean = Quat::from_rotation_z(0.12 * (random.unit() - 0.5));
            out.block(center, Vec3::new(thick, high, 0.2), lean, false);
            x += thick + 0.02 + if random.unit() < 0.15 { 0.2 } else { 0.0 };
        }
    }
    // Boxes and balls on the floor and on the table.
    for i in 0..48 {
        out.material(colour(&mut random));
        let size = 0.1 + 0.3 * random.unit() * random.unit();
        let (x, z) = (0.4 + 5.2 * random.unit(), 0.7 + 3.9 * random.unit());
        let on_table = (1.3..2.7).contains(&x) && (1.65..2.35).contains(&z);
        let ground = if on_table { 0.78 } else { 0.0 };
        if i % 3 == 0 {
            out.ball(Vec3::new(x, ground + 0.5 * size, z), 0.5 * size, 8);
        } else {
            let turn = Quat::from_rotation_y(TAU * random.unit());
            let extent = size * Vec3::new(1.0, 0.5 + random.unit(), 0.6);
            out.block(
                Vec3::new(x, ground + 0.5 * extent.y, z),
                extent,
                turn,
                false,
            );
        }
    }
    // Poles, thin and slanted.
    for _ in 0..8 {
        out.material(colour(&mut random));
        let foot = Vec3::new(0.5 + 5.0 * random.unit(), 1.0, 1.0 + 3.5 * random.unit());
        let lean = Quat::from_rotation_x(0.4 * (random.unit() - 0.5))
            * Quat::from_rotation_z(0.4 * (random.unit() - 0.5));
        out.block(foot, Vec3::new(0.03, 2.0, 0.03), lean, false);
    }
    let v = Vec3::new;
    Level {
        name: "clutter".into(),
        mesh: TriangleMesh::new(out.triangles, out.material_of, out.materials),
        lights: vec![Light::Spot {
            position: v(4.2, 2.9, 3.4),
            direction: v(-0.25, -0.95, -0.2).normalize(),
            intensity: v(60.0, 56.0, 50.0),
            inner: 0.5,
            outer: 0.9,
            range: f32::INFINITY,
        }],
        views: [
            (v(5.7, 1.7, 4.6), v(1.6, 0.6, 1.2)),
            (v(0.5, 1.2, 4.4), v(3.4, 0.9, 0.6)),
            (v(3.2, 1.4, 3.0), v(1.8, 0.8, 1.6)),
        ],
    }
}

fn colour(random: &mut Random) -> Vec3 {
    Vec3::new(random.unit(), random.unit(), random.unit()) * 0.7 + 0.1
}
