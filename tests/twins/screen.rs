//! Textures of a synthetic picture: every pixel has its own random depth and normal.

use super::synthetic::HashRandom;
use glam::{Mat4, Vec3};
use meshless_gi::internals::frame::gbuffer;
use meshless_gi::internals::frame::splat::MIN_COVERED_FRACTION;

pub const SIZE: [u32; 2] = [67, 41];

/// Texels of the picture on the CPU.
pub struct Screen {
    pub depth: Vec<f32>,
    pub gbuffer: Vec<[u32; 4]>,
    /// Identifier of Bevy's deferred lighting pass, per pixel.
    pub passes: Vec<u8>,
    /// Output of an earlier scene.
    pub earlier: Vec<[half::f16; 4]>,
    /// Picture before the composite.
    pub lit: Vec<[half::f16; 4]>,
}

impl Screen {
    pub fn new() -> Self {
        let mut random = HashRandom::new(9);
        let count = (SIZE[0] * SIZE[1]) as usize;
        let halves = |v: [f32; 4]| v.map(half::f16::from_f32);
        let mut out = Self {
            depth: Vec::new(),
            gbuffer: Vec::new(),
            passes: Vec::new(),
            earlier: Vec::new(),
            lit: Vec::new(),
        };
        for i in 0..count {
            // Distances from 0.5 to 3.5 meters, and some sky.
            let depth = NEAR / (0.5 + 3.0 * random.unit());
            out.depth.push(if i % 13 == 0 { 0.0 } else { depth });
            let flags = if i % 17 == 0 { gbuffer::UNLIT } else { 0 };
            let normal = random.direction();
            out.gbuffer.push(gbuffer::pack(
                random.color(),
                0.5 * random.unit(),
                0.3 + 0.7 * random.unit(),
                normal,
                flags,
            ));
            out.passes.push(u8::from(i % 11 != 0));
            // Covered, an estimate, and none.
            let alpha = [1.0, MIN_COVERED_FRACTION, 0.0][i % 3];
            out.earlier.push(if alpha > 0.0 {
                halves([random.unit(), random.unit(), random.unit(), alpha])
            } else {
                halves([0.0; 4])
            });
            out.lit
                .push(halves([random.unit(), random.unit(), random.unit(), 1.0]));
        }
        out
    }
}

const NEAR: f32 = 0.1;

/// Returns world from clip space of a camera in the middle of the points.
pub fn world_from_clip() -> Mat4 {
    let clip_from_view =
        Mat4::perspective_infinite_reverse_rh(1.2, SIZE[0] as f32 / SIZE[1] as f32, NEAR);
    let view_from_world =
        Mat4::look_at_rh(Vec3::new(4.0, 0.4, 1.6), Vec3::new(1.0, 1.0, 1.0), Vec3::Y);
    (clip_from_view * view_from_world).inverse()
}

/// Returns local from world space of a scene root that is rotated, moved and twice as large.
pub fn local_from_world() -> Mat4 {
    let turn = glam::Quat::from_axis_angle(Vec3::new(0.6, 0.0, 0.8), 0.7);
    Mat4::from_scale_rotation_translation(Vec3::splat(2.0), turn, Vec3::new(2.0, 1.0, 1.0))
        .inverse()
}
