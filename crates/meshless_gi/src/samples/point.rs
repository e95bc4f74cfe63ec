//! Surface point p = (x, n), in the layout of every stage and the GPU.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// Surface point with the radius of its basis function. 32 bytes, the layout of `Point` in the
/// shaders.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Point {
    /// Position, meters.
    pub position: [f32; 3],
    /// Radius r of the support of its basis function, meters (\[L08\] Eq. (9)).
    pub radius: f32,
    /// Unit normal.
    pub normal: [f32; 3],
    /// Clip planes of its basis function: first index in the low 24 bits, count in the high 8.
    pub planes: u32,
}

impl Point {
    /// Creates a point without clip planes.
    #[must_use]
    pub fn new(position: Vec3, normal: Vec3, radius: f32) -> Self {
        Self {
            position: position.to_array(),
            radius,
            normal: normal.to_array(),
            planes: 0,
        }
    }

    /// Returns the position, meters.
    #[must_use]
    pub fn x(&self) -> Vec3 {
        Vec3::from_array(self.position)
    }

    /// Returns the unit normal.
    #[must_use]
    pub fn n(&self) -> Vec3 {
        Vec3::from_array(self.normal)
    }

    /// Returns the range of its clip planes in the array of planes.
    #[must_use]
    pub fn plane_range(&self) -> std::ops::Range<usize> {
        let first = (self.planes & 0x00ff_ffff) as usize;
        first..first + (self.planes >> 24) as usize
    }
}
