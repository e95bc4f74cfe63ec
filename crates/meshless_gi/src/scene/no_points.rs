//! Ray offsets of point clouds in builds without point clouds. The type has no values.

use glam::Vec3;

/// Ray offsets of the cells of a point cloud.
#[derive(Clone, Debug)]
pub(super) enum RayOffsets {}

impl RayOffsets {
    /// Returns the ray offset at a position, meters.
    pub(super) fn at(&self, _: Vec3) -> f32 {
        match *self {}
    }
}
