//! Rooms of points: the Cornell box, and a ball in it, scattered evenly.

use bevy_meshless_gi::accuracy::direct_irradiance;
use bevy_meshless_gi::samples::Random;
use bevy_meshless_gi::scene::{Geometry, Light, Quad, cornell_box};
use bevy_meshless_gi::transport::fmm::FmmPoint;
use glam::{Mat3, Vec3};

/// Points and what they are made of.
pub struct Room {
    /// Points.
    pub points: Vec<FmmPoint>,
    /// Their albedos.
    pub albedo: Vec<Vec3>,
}

/// A jittered grid over a parallelogram, about `count` points that share its surface evenly.
fn scatter(quad: &Quad, count: f32, random: &mut Random, out: &mut Room) {
    let [a, b, _, d] = quad.corners;
    let (u, v) = (b - a, d - a);
    let normal = u.cross(v);
    let area = normal.length();
    let rows = (count * v.length() / u.length()).sqrt().round().max(1.0) as usize;
    let columns = (count / rows as f32).round().max(1.0) as usize;
    for row in 0..rows {
        for column in 0..columns {
            let s = (column as f32 + random.unit()) / columns as f32;
            let t = (row as f32 + random.unit()) / rows as f32;
            out.points.push(FmmPoint {
                position: a + s * u + t * v,
                normal: normal / area,
                weight: area / (rows * columns) as f32,
                receives: true,
            });
            out.albedo.push(quad.material.base_color.truncate());
        }
    }
}

/// The Cornell box as about `count` points.
pub fn cornell(count: usize) -> Room {
    let mut room = Room {
        points: Vec::new(),
        albedo: Vec::new(),
    };
    let mut random = Random::new(1, 0x726f_6f6d, count as u64);
    let quads = cornell_box();
    let area = |q: &Quad| {
        let [a, b, _, d] = q.corners;
        (b - a).cross(d - a).length()
    };
    let whole: f32 = quads.iter().map(area).sum();
    for quad in &quads {
        scatter(
            quad,
            count as f32 * area(quad) / whole,
            &mut random,
            &mut room,
        );
    }
    room
}

/// The Cornell box with a ball above the lower block, a seventh of the points, all turned by half a radian: nothing lies along an axis.
pub fn with_ball(count: usize) -> Room {
    let mut room = cornell(count * 6 / 7);
    let mut random = Random::new(2, 0x6261_6c6c, count as u64);
    let (center, radius) = (Vec3::new(0.35, 1.0, 0.35), 0.3);
    let more = (count / 7).max(1);
    for i in 0..more {
        // Equal areas: heights evenly, longitudes by the golden angle.
        let z = 1.0 - 2.0 * (i as f32 + random.unit()) / more as f32;
        let phi = i as f32 * 2.399_963;
        let s = (1.0 - z * z).max(0.0).sqrt();
        let normal = Vec3::new(s * phi.cos(), s * phi.sin(), z);
        room.points.push(FmmPoint {
            position: center + radius * normal,
            normal,
            weight: 4.0 * std::f32::consts::PI * radius * radius / more as f32,
            receives: true,
        });
        room.albedo.push(Vec3::new(0.3, 0.5, 0.8));
    }
    let turn = Mat3::from_axis_angle(Vec3::new(1.0, 2.0, 3.0).normalize(), 0.5);
    for p in &mut room.points {
        (p.position, p.normal) = (turn * p.position, turn * p.normal);
    }
    room
}

/// Radiosities that vary from point to point, W/m².
pub fn glow(room: &Room) -> Vec<Vec3> {
    let of = |p: &FmmPoint| {
        let wave = |k: f32, c: f32| 1.0 + (k * p.position.dot(Vec3::new(1.0, 0.7, c))).sin();
        Vec3::new(wave(1.0, 0.3), wave(2.0, -0.5), wave(3.0, 0.9))
    };
    room.points.iter().map(of).collect()
}

/// What a lamp makes the points reflect at once, W/m².
pub fn lit(room: &Room, geometry: &dyn Geometry, lamp: &Light) -> Vec<Vec3> {
    let mut random = Random::new(3, 0, 0);
    let pairs = room.points.iter().zip(&room.albedo);
    let reflected = |(p, albedo): (&FmmPoint, &Vec3)| {
        let start = p.position + p.normal * geometry.lift(p.position);
        *albedo * direct_irradiance(geometry, lamp, start, p.normal, &mut random)
    };
    pairs.map(reflected).collect()
}
