//! Structs that the frame's kernels and their CPU twins share, byte for byte: lights, a vector
//! irradiance, the parameters of a frame and of a view. `shaders/lib/layout.wgsl` declares the
//! same; `tests/checks/shader_layout.rs` compares the two.

use crate::samples::HashedGrid;
use bytemuck::{Pod, Zeroable};
use glam::{Mat4, Vec3, Vec4};

/// The vector irradiance E⃗ of the three color channels, W/m². 48 bytes.
///
/// Stored axis by axis: `x` holds the x components of the vectors of red, green and blue, the
/// fourth float of each is not used (but by [`soft_shadow`](super::soft_shadow), for what three
/// more numbers say). The irradiance for a normal n is then x·n.x + y·n.y + z·n.z, all channels at
/// once.
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
    /// E⃗·n per channel, W/m²; negative where light comes from behind.
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
    /// π times the sky's radiance, the mean over all directions, W/m².
    pub sky: [f32; 3],
    /// Multiplies the surfaces' emission.
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
    /// Nodes of the BVH; 0 means that nothing casts shadows.
    pub nodes: u32,
    /// Largest edge of the box around the geometry, meters: what
    /// [`ray_offset`](super::project::ray_offset) is relative to.
    pub extent: f32,
    /// Rows of higher tiers are not used, and none where it is 0
    /// ([`Row::tier`](crate::transport::Row::tier)).
    pub tier: u32,
    /// Index of the sky's coefficient, one after the last sender.
    pub sky_sender: u32,
    /// Number of coarsest points with baked bounces.
    pub coarsest_points: u32,
    /// 1 where the coefficients are differences ([`SenderForm`](crate::transport::SenderForm)).
    pub differences: u32,
    /// Spacing of a sender's samples, meters ([`sample_spacing`](super::project::sample_spacing)).
    /// Point lights nearer to their plane are moved to this distance.
    pub sample_spacing: f32,
    /// Number of terms of the sky after its mean: none or all eight.
    pub sky_terms: u32,
    /// The channel that is applied where one is ([`Channels`](super::Channels)).
    pub channel: u32,
    /// Not used.
    pub pad: [u32; 2],
    /// The three channels beside it; the fourth number is not used.
    pub hue: [f32; 4],
    /// π times those terms ([`SkyRadiance`](crate::scene::SkyRadiance)), RGB, W/m².
    pub sky_more: [[f32; 4]; 8],
}

/// The points (or rows, or list entries) that one dispatch works on. 16 bytes.
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
    /// Not used.
    pub pad: u32,
}

/// Parameters of a lookup in a hashed grid, without its arrays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridShape {
    /// Slots of the hash table, less one.
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

/// A view of a baked scene, for `splat`. 160 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct SplatParams {
    /// From clip space (Bevy's: reversed depth, y up) to the bake's local space, column by column.
    pub local_from_clip: [[f32; 4]; 4],
    /// Turns a world-space normal into the bake's local space: three columns, the fourth floats not
    /// used.
    pub local_from_world: [[f32; 4]; 3],
    /// The viewport in texels: x, y, width, height.
    pub viewport: [f32; 4],
    /// Size of the output in texels.
    pub size: [u32; 2],
    /// Slots of the display grid's hash table, less one.
    pub slot_mask: u32,
    /// Edge of a grid cell, meters of the local space.
    pub cell_size: f32,
    /// Multiplies the irradiance before it is stored as halves (the exposure, so that daylight
    /// fits).
    pub scale: f32,
    /// Cover, the sum of weights (dimensionless), from which functions on surfaces count alone;
    /// with less, probe irradiance has the rest. 0 where there is none.
    pub seam: f32,
    /// Not used.
    pub pad: [u32; 2],
}

impl SplatParams {
    /// The same view, of functions in another grid.
    #[must_use]
    pub fn with_grid(&self, grid: GridShape) -> Self {
        Self {
            slot_mask: grid.slot_mask,
            cell_size: grid.cell_size,
            ..*self
        }
    }

    /// Parameters for a view.
    ///
    /// `world_from_clip` and `local_from_world` are the camera's and the baked scene's (inverse)
    /// transforms, `viewport` and `size` in texels.
    #[must_use]
    pub fn new(
        world_from_clip: Mat4,
        local_from_world: Mat4,
        viewport: [f32; 4],
        size: [u32; 2],
        scale: f32,
        grid: GridShape,
    ) -> Self {
        // A normal is turned, never scaled: the transform's scale is uniform.
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
    /// Exposure (and taste) still to multiply with, over the scale that `splat` already applied.
    pub scale: f32,
    /// 1 shows the irradiance as a white surface would, 0 the surfaces' own colors.
    pub white: f32,
    /// Not used.
    pub pad: [f32; 2],
}
