//! Position that light is projected onto, in the layout of the bake, the file and the GPU.

use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3};

/// Surface point and its normal. 16 bytes, the layout of `LightSample` in the shaders.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct LightSample {
    /// Position, meters.
    pub position: [f32; 3],
    /// Unit normal, octahedral encoding as two signed normalized 16-bit numbers (WGSL's
    /// `unpack2x16snorm`). The error is at most 5e-5.
    pub normal: u32,
}

impl LightSample {
    /// Creates a sample from a position in meters and a unit normal.
    #[must_use]
    pub fn new(position: Vec3, normal: Vec3) -> Self {
        let sum = normal.abs().element_sum();
        let mut p = if sum > 0.0 {
            normal.truncate() / sum
        } else {
            Vec2::ZERO
        };
        if normal.z < 0.0 {
            p = fold(p);
        }
        let half = |v: f32| u32::from((v.clamp(-1.0, 1.0) * 32767.0).round() as i16 as u16);
        Self {
            position: position.to_array(),
            normal: half(p.x) | half(p.y) << 16,
        }
    }

    /// Returns the position, meters.
    #[must_use]
    pub fn x(&self) -> Vec3 {
        Vec3::from_array(self.position)
    }

    /// Returns the unit normal.
    #[must_use]
    #[inline]
    pub fn n(&self) -> Vec3 {
        let half = |bits: u32| (f32::from(bits as u16 as i16) / 32767.0).max(-1.0);
        let p = Vec2::new(half(self.normal), half(self.normal >> 16));
        let z = 1.0 - p.x.abs() - p.y.abs();
        let p = if z < 0.0 { fold(p) } else { p };
        p.extend(z).normalize()
    }
}

/// Maps a point to the other side of the octahedron.
fn fold(p: Vec2) -> Vec2 {
    let sign = |v: f32| if v < 0.0 { -1.0 } else { 1.0 };
    Vec2::new((1.0 - p.y.abs()) * sign(p.x), (1.0 - p.x.abs()) * sign(p.y))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::{Random, uniform_sphere};

    #[test]
    fn light_sample_packed_normals_round_trip() {
        let mut random = Random::new(2, 7, 1);
        for k in 0..10_000 {
            let n = match k {
                0 => Vec3::Z,
                1 => Vec3::NEG_Z,
                2 => Vec3::NEG_X,
                _ => uniform_sphere(Vec2::new(random.unit(), random.unit())),
            };
            let back = LightSample::new(Vec3::ONE, n).n();
            assert!((back - n).length() < 1e-4, "{n} {back}");
        }
        for bits in [0, u32::MAX, 0x8000_8000, 0x7fff_7fff] {
            let sample = LightSample {
                position: [0.0; 3],
                normal: bits,
            };
            assert!(sample.n().is_normalized(), "{bits:x}");
        }
    }
}
