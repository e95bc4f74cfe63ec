//! Kernel `volume`: light in free space as Bevy's irradiance volumes hold it, an ambient cube a voxel, for what no G-buffer shows: forward cameras, several samples a pixel,
//! transparent surfaces. From the probes' values, behind `apply`, to a texture.
//!
//! An engine reads such a volume by the normal of a surface and between eight voxels, of which some lie in the wall. So the light for a normal is that one voxel further along the normal, where
//! the free space before such a surface is: a voxel in a wall holds for each side what is before that side. Walls thinner than two voxels have voxels of the next room beside those of this
//! one: what stands closer than a voxel to such a wall, and faces it, is lit from both.

use super::layout::{GridShape, VectorIrradiance};
use super::probe::probe;
use super::splat::LARGEST_HALF;
use crate::asset::Probes;
use bytemuck::{Pod, Zeroable};
use glam::{Mat4, UVec3, Vec3};
use std::f32::consts::FRAC_1_PI;

/// Most voxels along an edge: the texture is twice as high and three times as deep.
pub const MOST_VOXELS: u32 = 512;

/// A volume in a baked scene, for `volume`. 96 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct VolumeParams {
    /// The corner of the volume, metres of the bake's local space.
    pub low: [f32; 3],
    /// Edge of a cell of the probes' grid, metres.
    pub cell_size: f32,
    /// Edges of a voxel, metres.
    pub voxel: [f32; 3],
    /// Slots of the grid's hash table, less one.
    pub slot_mask: u32,
    /// Voxels along each edge.
    pub size: [u32; 3],
    /// Multiplies the irradiance: 1/π, for the radiance of a white surface.
    pub scale: f32,
    /// The world's axes as unit vectors of the local space, the fourth floats not used.
    pub axes: [[f32; 4]; 3],
}

impl VolumeParams {
    /// A volume of `size` voxels from `low` to `high`, metres of the bake's local space, for an engine whose axes are those of the world. None where that is no box or there are no voxels, or more than
    /// [`MOST_VOXELS`] along an edge.
    #[must_use]
    pub fn new(
        [low, high]: [Vec3; 2],
        size: UVec3,
        local_from_world: &Mat4,
        grid: GridShape,
    ) -> Option<Self> {
        let edges = high - low;
        let fits = size.cmpge(UVec3::ONE).all() && size.cmple(UVec3::splat(MOST_VOXELS)).all();
        if !fits || !edges.is_finite() || !edges.cmpgt(Vec3::ZERO).all() {
            return None;
        }
        let axis = |v: Vec3| {
            let turned = local_from_world.transform_vector3(v).normalize_or_zero();
            turned.extend(0.0).to_array()
        };
        Some(Self {
            low: low.to_array(),
            cell_size: grid.cell_size,
            voxel: (edges / size.as_vec3()).to_array(),
            slot_mask: grid.slot_mask,
            size: size.to_array(),
            scale: FRAC_1_PI,
            axes: [Vec3::X, Vec3::Y, Vec3::Z].map(axis),
        })
    }

    /// Texels of the texture along each edge.
    #[must_use]
    pub fn texels(&self) -> UVec3 {
        UVec3::from(self.size) * UVec3::new(1, 2, 3)
    }
}

/// How many voxels a box of these edges, metres, is divided into: cubes of `edge` metres, about, and larger ones where they would be more than `most`, or more than [`MOST_VOXELS`] along an edge.
#[must_use]
pub fn voxels_of(edges: Vec3, edge: f32, most: u32) -> UVec3 {
    let edges = edges.max(Vec3::splat(f32::MIN_POSITIVE));
    let mut edge = edge.max(edges.max_element() / MOST_VOXELS as f32);
    let count = |edge: f32| {
        let along = (edges / edge).ceil().max(Vec3::ONE);
        along.as_uvec3().min(UVec3::splat(MOST_VOXELS))
    };
    let all = |size: UVec3| size.to_array().map(u64::from).iter().product::<u64>();
    // Rounding up adds a voxel along each edge at most: a few steps suffice.
    while all(count(edge)) > u64::from(most.max(1)) && count(edge) != UVec3::ONE {
        edge *= 1.1;
    }
    count(edge)
}

/// What surfaces beside `x` that face `n` receive, W/m²: light a voxel before them, else nearer, else beside.
fn beside(
    params: &VolumeParams,
    probes: &Probes,
    values: &[VectorIrradiance],
    x: Vec3,
    [n, t, b]: [Vec3; 3],
) -> Vec3 {
    let reach = Vec3::from(params.voxel).max_element();
    for before in [1.0, 0.5, 0.0] {
        if let Some(light) = probe(probes, values, x + n * (before * reach)) {
            return light.irradiance(n);
        }
    }
    let (mut sum, mut count) = (Vec3::ZERO, 0.0f32);
    for i in 0..9u8 {
        let (u, v) = (f32::from(i % 3) - 1.0, f32::from(i / 3) - 1.0);
        if let Some(light) = probe(probes, values, x + (n + t * u + b * v) * reach) {
            sum += light.irradiance(n);
            count += 1.0;
        }
    }
    sum / count.max(1.0)
}

/// One texel: RGB as the engine multiplies it with a surface's colour, cd/m² where lamps are in lumens; the fourth is 1. Black where no probe reaches.
#[must_use]
pub fn volume(
    params: &VolumeParams,
    probes: &Probes,
    values: &[VectorIrradiance],
    texel: UVec3,
) -> [f32; 4] {
    let size = UVec3::from(params.size);
    // Surfaces that face an axis have the lower half, those that face away from it the upper one; axes lie behind one another.
    let axis = (texel.z / size.z) as usize;
    let away = texel.y >= size.y;
    let voxel = texel % size;
    let x = Vec3::from(params.low) + Vec3::from(params.voxel) * (voxel.as_vec3() + 0.5);
    let direction = |k: usize| Vec3::from_slice(&params.axes[k % 3][..3]);
    let n = direction(axis) * if away { -1.0 } else { 1.0 };
    let along = [n, direction(axis + 1), direction(axis + 2)];
    let light = beside(params, probes, values, x, along) * params.scale;
    light.min(Vec3::splat(LARGEST_HALF)).extend(1.0).to_array()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn voxels_are_as_asked_and_no_more_than_allowed() {
        let room = Vec3::new(8.0, 3.0, 4.0);
        assert_eq!(voxels_of(room, 0.25, u32::MAX), UVec3::new(32, 12, 16));
        for most in [1, 100, 4096, 65_536] {
            let size = voxels_of(room, 0.01, most);
            assert!(size.element_product() <= most, "{size}");
            assert!(most < 100 || size.element_product() * 3 > most, "{size}");
        }
        // A thread, a plane and a point are boxes of one voxel across.
        let thin = voxels_of(Vec3::new(100.0, 0.0, 1e-30), 0.01, u32::MAX);
        assert_eq!(thin, UVec3::new(MOST_VOXELS, 1, 1));
        assert_eq!(voxels_of(Vec3::ZERO, 1.0, 8), UVec3::ONE);
    }

    #[test]
    fn boxes_that_are_none_are_refused() {
        let grid = GridShape {
            slot_mask: 0,
            cell_size: 1.0,
        };
        let of = |corners, size| VolumeParams::new(corners, size, &Mat4::IDENTITY, grid);
        let room = [Vec3::ZERO, Vec3::ONE];
        assert!(of(room, UVec3::splat(4)).is_some());
        assert!(of(room, UVec3::new(4, 0, 4)).is_none());
        assert!(of(room, UVec3::new(4, MOST_VOXELS + 1, 4)).is_none());
        assert!(of([Vec3::ONE, Vec3::ZERO], UVec3::ONE).is_none());
        assert!(of([Vec3::ZERO, Vec3::splat(f32::NAN)], UVec3::ONE).is_none());
    }
}
