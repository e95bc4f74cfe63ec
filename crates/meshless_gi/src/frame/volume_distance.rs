//! Distance from each voxel center to the nearest wall along +x, -x, +y, -y, +z and -z, up to one
//! voxel. Computed with the weights of a volume (`volume_weights`), stored by kernel `volume` and
//! read in lookups (`volume_sample`). A voxel behind a wall therefore lights nothing in front of
//! it.
//!
//! No wall of the room above extends down to the center of a voxel in the ground. A voxel behind a
//! surface therefore also traces rays along that surface, from just in front of it. Walls on the
//! ground then limit the distances below it too.

use super::volume_walls::MIN_FACING_COSINE;
use super::volume_weights::VoxelGrid;
use crate::scene::{Bvh, Ray};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// Distance of a direction without a wall up to the next voxel's center.
pub const UNOBSTRUCTED: u8 = 255;
/// Number of steps of a distance: the value of a wall at the next voxel's center.
pub const DISTANCE_STEPS: f32 = 254.0;
/// Distance of rays along a surface in front of it, voxels.
const LIFT: f32 = 0.05;
/// Distance behind a voxel center at which rays start, voxels. A wall through the center thus
/// limits both sides.
const BEHIND: f32 = 1e-3;

/// Distances from one voxel center to walls. 8 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct WallDistances {
    /// Distance to a wall in 254ths of a voxel, or [`UNOBSTRUCTED`]. Along each axis, and then
    /// against it.
    pub sides: [u8; 6],
    /// 0 for a center between the two sides of a wall, which lights nothing. Else [`UNOBSTRUCTED`].
    lights: u8,
    /// [`UNOBSTRUCTED`].
    rest: u8,
}

impl Default for WallDistances {
    fn default() -> Self {
        Self {
            sides: [UNOBSTRUCTED; 6],
            lights: UNOBSTRUCTED,
            rest: UNOBSTRUCTED,
        }
    }
}

impl WallDistances {
    /// Traces the distances of a voxel with center `x`, meters. `behind` lists the surfaces in
    /// front of it: depth of the center below the surface, meters, and normal.
    pub(super) fn find(
        shape: &VoxelGrid,
        bvh: &Bvh,
        x: Vec3,
        behind: impl Iterator<Item = (f32, Vec3)> + Clone,
    ) -> Self {
        let mut wall_distances = Self::default();
        let voxel = shape.voxel();
        wall_distances.bound(bvh, x, x, voxel, |_| true);
        for (depth, n) in behind.clone() {
            if behind
                .clone()
                .any(|(_, other)| other.dot(n) < -MIN_FACING_COSINE)
            {
                wall_distances.lights = 0;
            }
            let from = x + n * (depth + LIFT * voxel.min_element());
            wall_distances.bound(bvh, from, x, voxel, |axis| n[axis].abs() < 0.5);
        }
        wall_distances
    }

    /// Limits the distances from `x` to the ends of the rays from `from`.
    fn bound(
        &mut self,
        bvh: &Bvh,
        from: Vec3,
        x: Vec3,
        voxel: Vec3,
        along: impl Fn(usize) -> bool,
    ) {
        for (side, way) in self.sides.iter_mut().enumerate() {
            let axis = side / 2;
            if !along(axis) {
                continue;
            }
            let direction = Vec3::AXES[axis] * [1.0, -1.0][side % 2];
            let edge = voxel[axis];
            // `from` can be displaced from `x` along the ray.
            let start = (from - x).dot(direction) - BEHIND * edge;
            let ray = Ray::segment(from - direction * (BEHIND * edge), direction, edge - start);
            let free = bvh.distance(&ray);
            if free < ray.max_t {
                let end = (start + free) / edge;
                *way = (*way).min((end.clamp(0.0, 1.0) * DISTANCE_STEPS).round() as u8);
            }
        }
    }

    /// Returns `true` if a wall lies between this voxel and the one that is `step` voxels along
    /// each edge away.
    #[must_use]
    pub fn is_blocked(&self, step: [i32; 3]) -> bool {
        let ends = |axis: usize| match step[axis] {
            0 => false,
            s => self.sides[2 * axis + usize::from(s < 0)] != UNOBSTRUCTED,
        };
        (0..3).any(ends)
    }

    /// Returns the value that kernel `volume` stores for a side. It is -2 if all distances of the
    /// voxel are unobstructed. Else it is minus a quarter minus the distance of that side, voxels.
    /// The sign distinguishes it from an engine's own volumes. The distance of an unobstructed side
    /// counts as a little more than 1. A center that lights nothing has -0.125.
    #[must_use]
    pub fn encode(&self, side: usize) -> f32 {
        match self.lights {
            0 => -0.125,
            _ if *self == Self::default() => -2.0,
            _ => -(0.25 + f32::from(self.sides[side]) / DISTANCE_STEPS),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::UVec3;

    /// Returns an infinitely thin wall at x = 0.3 that stands on the ground at y = 0.
    fn wall_on_ground() -> Bvh {
        let quad = |a: Vec3, b: Vec3, c: Vec3| [[a, b, c], [a + c - b, a, c]];
        let wall = quad(
            Vec3::new(0.3, 0.0, -9.0),
            Vec3::new(0.3, 9.0, -9.0),
            Vec3::new(0.3, 9.0, 9.0),
        );
        let ground = quad(
            Vec3::new(-9.0, 0.0, -9.0),
            Vec3::new(9.0, 0.0, -9.0),
            Vec3::new(9.0, 0.0, 9.0),
        );
        Bvh::build(&[wall, ground].concat()).0
    }

    #[test]
    fn wall_distances_end_at_walls_below_ground_too() {
        let shape = VoxelGrid::new([Vec3::splat(-4.0), Vec3::splat(4.0)], UVec3::splat(8));
        let shape = shape.expect("a box");
        let bvh = wall_on_ground();
        let find = |x: Vec3| WallDistances::find(&shape, &bvh, x, [].into_iter());
        let at = |x: f32, y: f32| find(Vec3::new(x, y, 0.1)).sides;
        assert_eq!(at(-2.0, 2.0), [UNOBSTRUCTED; 6]);
        assert_eq!(
            at(-0.2, 2.0),
            [
                127,
                UNOBSTRUCTED,
                UNOBSTRUCTED,
                UNOBSTRUCTED,
                UNOBSTRUCTED,
                UNOBSTRUCTED
            ]
        );
        assert_eq!(
            at(0.8, 0.5),
            [
                UNOBSTRUCTED,
                127,
                UNOBSTRUCTED,
                127,
                UNOBSTRUCTED,
                UNOBSTRUCTED
            ]
        );
        // Inside the wall both sides have distance 0.
        assert_eq!(
            at(0.3, 2.0),
            [0, 0, UNOBSTRUCTED, UNOBSTRUCTED, UNOBSTRUCTED, UNOBSTRUCTED]
        );
        // Below the ground, the wall above limits the distance.
        let below = Vec3::new(-0.2, -0.5, 0.1);
        assert_eq!(
            find(below).sides,
            [
                UNOBSTRUCTED,
                UNOBSTRUCTED,
                127,
                UNOBSTRUCTED,
                UNOBSTRUCTED,
                UNOBSTRUCTED
            ]
        );
        let wall_distances = WallDistances::find(&shape, &bvh, below, [(0.5, Vec3::Y)].into_iter());
        assert_eq!(
            wall_distances.sides,
            [
                127,
                UNOBSTRUCTED,
                127,
                UNOBSTRUCTED,
                UNOBSTRUCTED,
                UNOBSTRUCTED
            ]
        );
        assert!(wall_distances.is_blocked([1, 0, 0]) && wall_distances.is_blocked([0, 1, 0]));
        assert!(
            !wall_distances.is_blocked([-1, -1, 1])
                && !WallDistances::default().is_blocked([1, 1, 1])
        );
        assert_eq!(wall_distances.encode(0), -0.75);
        assert!(wall_distances.encode(1) < -1.25 && wall_distances.encode(1) > -1.5);
        assert_eq!(WallDistances::default().encode(3), -2.0);
        // Between the sides of a wall.
        let within = [(0.01, Vec3::X), (0.02, Vec3::NEG_X)].into_iter();
        let wall_distances = WallDistances::find(&shape, &bvh, Vec3::new(0.3, 2.0, 0.1), within);
        assert_eq!(
            [0, 1, 5].map(|side| wall_distances.encode(side)),
            [-0.125; 3]
        );
    }
}
