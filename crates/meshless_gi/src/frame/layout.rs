//! Structs that the frame's kernels and their CPU twins share, byte for byte: lights, a vector
//! irradiance, the parameters of a frame and of a view. `shaders/lib/layout.wgsl` declares the same
//! structs. `tests/checks/shader_layout.rs` compares the two.

use crate::samples::HashedGrid;
use bytemuck::{Pod, Zeroable};
use glam::{Mat4, Vec3, Vec4};

/// Vector irradiance E⃗ of the three color channels, W/m². 48 bytes.
///
/// Stored axis by axis: `x` holds the x components of the vectors of red, green and blue. The
/// fourth float of each axis is not used, except by [`soft_shadow`](super::soft_shadow), which
/// stores three more numbers there. The irradiance for a normal n is x·n.x + y·n.y + z·n.z, for all
/// channels.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct VectorIrradiance {
    /// x components: red, green, blue, not used.
    pub x: [f32; 4],
    /// y components.
    pub y: [f32; 4],
    /// z components.
    pub z: [f32; 4],
}

impl VectorIrradiance {
    /// Returns E⃗·n per channel, W/m². The result is negative if the light comes from behind.
    #[must_use]
    #[inline]
    pub fn dot(&self, n: Vec3) -> Vec3 {
        (Vec4::from_array(self.x) * n.x
            + Vec4::from_array(self.y) * n.y
            + Vec4::from_array(self.z) * n.z)
            .truncate()
    }

    /// Adds `weight` times `other`.
    #[inline]
    pub fn add_scaled(&mut self, weight: f32, other: &Self) {
        self.x = (Vec4::from_array(self.x) + weight * Vec4::from_array(other.x)).to_array();
        self.y = (Vec4::from_array(self.y) + weight * Vec4::from_array(other.y)).to_array();
        self.z = (Vec4::from_array(self.z) + weight * Vec4::from_array(other.z)).to_array();
    }
}

/// Parameters of all kernels of a solve. 224 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SolveParams {
    /// π times the mean of the sky's radiance over all directions, W/m².
    pub sky: [f32; 3],
    /// Factor of the surfaces' emission.
    pub emission: f32,
    /// Number of points.
    pub points: u32,
    /// Samples per sender of the finest sender level
    /// ([`LightSamples`](crate::asset::LightSamples)).
    pub samples_per_sender: u32,
    /// Number of points that are senders.
    pub senders: u32,
    /// First sender of the finest sender level.
    pub finest_sender: u32,
    /// Number of light slots in use.
    pub slots: u32,
    /// Number of nodes of the BVH. 0 means that nothing casts shadows.
    pub nodes: u32,
    /// Largest edge of the box around the geometry, meters.
    /// [`ray_offset`](super::project::ray_offset) is relative to it.
    pub extent: f32,
    /// Highest tier of the rows that are used. At 0 all rows are unused
    /// ([`Row::tier`](crate::transport::Row::tier)).
    pub tier: u32,
    /// Index of the sky's coefficient, one after the last sender.
    pub sky_sender: u32,
    /// Number of coarsest points with baked bounces.
    pub coarsest_points: u32,
    /// 1 if the coefficients are differences ([`SenderForm`](crate::transport::SenderForm)).
    pub differences: u32,
    /// Spacing of a sender's samples, meters ([`sample_spacing`](super::project::sample_spacing)).
    /// Point lights closer to the samples' plane are moved to this distance.
    pub sample_spacing: f32,
    /// Number of sky terms after the mean: 0 or 8.
    pub sky_terms: u32,
    /// Channel that is applied if only one is ([`Channels`](super::Channels)).
    pub channel: u32,
    /// Padding, not used.
    pub pad: [u32; 2],
    /// Ratios of the three channels to `channel`. The fourth number is not used.
    pub hue: [f32; 4],
    /// π times the sky's terms after the mean ([`SkyRadiance`](crate::scene::SkyRadiance)), RGB,
    /// W/m².
    pub sky_more: [[f32; 4]; 8],
}

/// Range of points (or rows, or list entries) that one dispatch processes. 16 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Span {
    /// First index.
    pub first: u32,
    /// Number of items.
    pub count: u32,
    /// Index of the first link in the bound buffer, subtracted from a row's first link
    /// (`apply` only).
    pub base: u32,
    /// Padding, not used.
    pub pad: u32,
}

/// Parameters of a lookup in a hashed grid, without its arrays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridShape {
    /// Number of slots of the hash table, minus 1.
    pub slot_mask: u32,
    /// Edge of a cell, meters.
    pub cell_size: f32,
}

impl From<&HashedGrid> for GridShape {
    fn from(grid: &HashedGrid) -> Self {
        Self {
            slot_mask: (grid.slots.len() as u32).wrapping_sub(1),
            cell_size: grid.cell_size,
        }
    }
}

/// View of a baked scene, for `splat`. 160 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct SplatParams {
    /// Transform from clip space (Bevy's: reversed depth, y up) to the bake's local space, column
    /// by column.
    pub local_from_clip: [[f32; 4]; 4],
    /// Rotation of a world-space normal into the bake's local space: three columns. The fourth
    /// floats are not used.
    pub local_from_world: [[f32; 4]; 3],
    /// The viewport in texels: x, y, width, height.
    pub viewport: [f32; 4],
    /// Size of the output in texels.
    pub size: [u32; 2],
    /// Number of slots of the display grid's hash table, minus 1.
    pub slot_mask: u32,
    /// Edge of a grid cell, meters of the local space.
    pub cell_size: f32,
    /// Factor of the irradiance before it is stored as half floats. It contains the exposure, so
    /// that daylight fits.
    pub scale: f32,
    /// Cover (sum of weights, dimensionless) from which only basis functions on surfaces count.
    /// Below it, probe irradiance fills the rest. 0 if there are no probes.
    pub seam: f32,
    /// Padding, not used.
    pub pad: [u32; 2],
}

impl SplatParams {
    /// Returns the same view for basis functions in another grid.
    #[must_use]
    pub fn with_grid(&self, grid: GridShape) -> Self {
        Self {
            slot_mask: grid.slot_mask,
            cell_size: grid.cell_size,
            ..*self
        }
    }

    /// Creates the parameters of a view.
    ///
    /// `world_from_clip` is the transform of the camera, `local_from_world` the inverse transform
    /// of the baked scene. `viewport` and `size` are in texels.
    #[must_use]
    pub fn new(
        world_from_clip: Mat4,
        local_from_world: Mat4,
        viewport: [f32; 4],
        size: [u32; 2],
        scale: f32,
        grid: GridShape,
    ) -> Self {
        // Normals are only rotated, because the transform's scale is uniform.
        let column = |c: Vec4| c.truncate().normalize_or_zero().extend(0.0).to_array();
        Self {
            local_from_clip: (local_from_world * world_from_clip).to_cols_array_2d(),
            local_from_world: [
                local_from_world.x_axis,
                local_from_world.y_axis,
                local_from_world.z_axis,
            ]
            .map(column),
            viewport,
            size,
            slot_mask: grid.slot_mask,
            cell_size: grid.cell_size,
            scale,
            seam: 0.0,
            pad: [0; 2],
        }
    }
}

/// Parameters of `composite`. 16 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct CompositeParams {
    /// Remaining exposure (and artistic) factor, on top of the scale that `splat` already applied.
    pub scale: f32,
    /// Blend factor from the surfaces' own colors (0) to white surfaces (1).
    pub white: f32,
    /// Padding, not used.
    pub pad: [f32; 2],
}
