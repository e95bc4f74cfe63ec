//! Structs that the kernels of reflective shadow maps share with their CPU twins, byte for byte: a
//! map and its texels, virtual point lights, a view. `shaders/lib/rsm.wgsl` declares the same
//! structs. `tests/checks/shader_layout.rs` compares the two.
//!
//! All of them use one *space*: the world's axes and meters, with the origin moved to a nearby
//! position ([`space_from_clip`]). Single precision is therefore sufficient for a scene far from
//! the world's origin. All lights and views of a frame must use the same origin.

use super::FrameLight;
use bytemuck::{Pod, Zeroable};
use glam::{DMat4, Mat4, Vec3};

/// Smallest and largest side of a map. A side is a power of two, as the curve through the texels
/// requires.
pub const SIDES: [u32; 2] = [1, 256];

/// Maximum number of virtual point lights of a light.
pub const MAX_VPLS: u32 = 1024;

/// Returns the side of a map for a requested resolution: the largest power of two that is not
/// larger, within [`SIDES`].
#[must_use]
pub fn side(resolution: u32) -> u32 {
    let resolution = resolution.clamp(SIDES[0], SIDES[1]);
    1 << resolution.ilog2()
}

/// Returns the transform from a camera's clip space (reversed depth, y up) to the space whose
/// origin is at `origin` of the world, meters. It is computed in double precision.
#[must_use]
pub fn space_from_clip(world_from_view: &Mat4, clip_from_view: &Mat4, origin: Vec3) -> Mat4 {
    let shift = DMat4::from_translation(-origin.as_dvec3());
    (shift * world_from_view.as_dmat4() * clip_from_view.as_dmat4().inverse()).as_mat4()
}

/// Returns the transform from that space to a bake's local space. `local_from_world` is the inverse
/// of the baked scene's transform.
#[must_use]
pub fn local_from_space(local_from_world: &Mat4, origin: Vec3) -> Mat4 {
    (local_from_world.as_dmat4() * DMat4::from_translation(origin.as_dvec3())).as_mat4()
}

/// Returns a light in that space.
#[must_use]
pub fn light_in_space(world: &FrameLight, origin: Vec3) -> FrameLight {
    let at = Vec3::from_array(world.position).as_dvec3() - origin.as_dvec3();
    FrameLight {
        position: at.as_vec3().to_array(),
        ..*world
    }
}

/// One map of a light, for the entry `texels` of `rsm`. 176 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct RsmParams {
    /// Transform from the map's clip space (reversed depth, y up), column by column.
    pub space_from_clip: [[f32; 4]; 4],
    /// The light. A point light, spot light or patch is at the position that the map is rendered
    /// from.
    pub light: FrameLight,
    /// Vector from the light to the middle of the map. `right` and `up` are the vectors of a step
    /// of one in x and y of clip space. All three share one arbitrary scale.
    pub forward: [f32; 3],
    /// Texels along each edge, a power of two ([`side`]).
    pub side: u32,
    /// Vector of a step in x.
    pub right: [f32; 3],
    /// Index of the map's first texel among those of the light.
    pub first: u32,
    /// Vector of a step in y.
    pub up: [f32; 3],
    /// Cross-section of a texel of a directional light, m².
    pub area: f32,
}

impl RsmParams {
    /// Creates the parameters of the map that was rendered with this matrix ([`space_from_clip`]).
    /// `light` is in the matrix's space ([`light_in_space`]), and `side` is a result of [`side`].
    /// `first` is the number of texels in the light's maps before this one.
    #[must_use]
    pub fn new(space_from_clip: Mat4, light: &FrameLight, side: u32, first: u32) -> Self {
        let m = space_from_clip.as_dmat4();
        let eye = Vec3::from_array(light.position).as_dvec3();
        // The near plane. A step on it is exactly a column of the matrix, which avoids
        // cancellation.
        let near = m * glam::DVec4::new(0.0, 0.0, 1.0, 1.0);
        let w = if near.w == 0.0 { 1.0 } else { near.w };
        let [right, up] = [m.x_axis.truncate() / w, m.y_axis.truncate() / w];
        let forward = near.truncate() / w - eye;
        let along = Vec3::from_array(light.direction).as_dvec3();
        let step = 2.0 / f64::from(side.max(1));
        let length = match light.kind == FrameLight::DIRECTIONAL {
            true => 1.0,
            false => forward.length().max(1e-30),
        };
        let unit = |v: glam::DVec3| (v / length).as_vec3().to_array();
        Self {
            space_from_clip: space_from_clip.to_cols_array_2d(),
            light: *light,
            forward: unit(forward),
            side,
            right: unit(right),
            first,
            up: unit(up),
            area: (right.cross(up).dot(along).abs() * step * step) as f32,
        }
    }
}

/// A lit texel of a map. 48 bytes. All zero for a texel without light.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct RsmTexel {
    /// Position, meters.
    pub position: [f32; 3],
    /// Mean squared distance of the texel's surface from its position, m².
    pub spread: f32,
    /// Unit normal.
    pub normal: [f32; 3],
    /// Padding.
    pub pad0: f32,
    /// Reflected flux, W.
    pub flux: [f32; 3],
    /// Padding.
    pub pad1: f32,
}

/// A baked scene that shadows a light's texels, for the entry `shadow` of `rsm`. 144 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct RsmShadowParams {
    /// Transform to the bake's local space, column by column ([`local_from_space`]).
    pub local_from_space: [[f32; 4]; 4],
    /// The light in the bake's local space ([`FrameLight::to_local`]).
    pub light: FrameLight,
    /// Number of texels.
    pub texels: u32,
    /// Number of nodes of the scene's BVH. 0 means that nothing casts shadows.
    pub nodes: u32,
    /// Largest edge of the box around the bake's geometry, meters.
    pub extent: f32,
    /// Padding.
    pub pad: u32,
}

impl RsmShadowParams {
    /// Creates the parameters for `texels` texels of `light` (in the space). The texels are in the
    /// shadow of a scene of `nodes` BVH nodes and this extent.
    #[must_use]
    pub fn new(
        local_from_space: Mat4,
        light: &FrameLight,
        texels: u32,
        nodes: u32,
        extent: f32,
    ) -> Self {
        Self {
            local_from_space: local_from_space.to_cols_array_2d(),
            light: light.to_local(&local_from_space),
            texels,
            nodes,
            extent,
            pad: 0,
        }
    }
}

/// Parameters of the selection of virtual point lights from a light's texels, for the entry point
/// `select_vpls` of `rsm`. 16 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct RsmSelectParams {
    /// Number of texels.
    pub texels: u32,
    /// Index of the light's first virtual point light.
    pub first: u32,
    /// Number of its virtual point lights.
    pub vpls: u32,
    /// Padding.
    pub pad: u32,
}

/// A virtual point light: the diffuse reflection of a part of a map. 48 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Vpl {
    /// Mean position of the part, meters.
    pub position: [f32; 3],
    /// Squared radius of a disk with the same spread as the part, m².
    pub square: f32,
    /// Mean of the part's unit normals. Its length decreases with their spread.
    pub normal: [f32; 3],
    /// Padding.
    pub pad0: f32,
    /// Reflected flux, W.
    pub flux: [f32; 3],
    /// Padding.
    pub pad1: f32,
}

/// Inputs of the evaluation of virtual point lights in any kernel: `vpl_at` of
/// `shaders/lib/vpl.wgsl`. 80 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct VplParams {
    /// Transform to the local space of the bake that casts their shadows ([`local_from_space`]).
    pub local_from_space: [[f32; 4]; 4],
    /// Number of virtual point lights.
    pub vpls: u32,
    /// Number of nodes of the scene's BVH. 0 means that nothing casts shadows.
    pub nodes: u32,
    /// Largest edge of the box around the bake's geometry, meters.
    pub extent: f32,
    /// Irradiance below which a light gets no shadow ray, W/m². 0 traces every ray.
    pub dim: f32,
}

impl VplParams {
    /// Creates the parameters of `vpls` lights without shadows.
    #[must_use]
    pub fn unshadowed(vpls: u32) -> Self {
        Self {
            vpls,
            ..Self::default()
        }
    }

    /// Creates the parameters of `vpls` lights in the shadow of a baked scene of `nodes` BVH nodes
    /// and this extent.
    #[must_use]
    pub fn shadowed(vpls: u32, local_from_space: Mat4, nodes: u32, extent: f32, dim: f32) -> Self {
        Self {
            local_from_space: local_from_space.to_cols_array_2d(),
            vpls,
            nodes,
            extent,
            dim,
        }
    }
}

/// Parameters of a view, for kernel `vpl`. 96 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct VplViewParams {
    /// Transform from the view's clip space, column by column ([`space_from_clip`]).
    pub space_from_clip: [[f32; 4]; 4],
    /// The viewport in texels: x, y, width, height.
    pub viewport: [f32; 4],
    /// Size of the output in texels.
    pub size: [u32; 2],
    /// Factor on the irradiance before it is stored as half floats.
    pub scale: f32,
    /// Padding.
    pub pad: u32,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rsm_sizes_are_bounded_powers_of_two() {
        let sides = [0, 1, 3, 64, 100, 256, 5000].map(side);
        assert_eq!(sides, [1, 1, 2, 64, 64, 256, 256]);
    }

    #[test]
    fn rsm_camera_far_from_origin_is_exact_in_local_space() {
        let eye = Vec3::new(100_000.0, 50.0, -100_000.0);
        let world_from_view = Mat4::from_translation(eye);
        let clip_from_view = Mat4::perspective_infinite_reverse_rh(1.0, 1.0, 0.1);
        let m = space_from_clip(&world_from_view, &clip_from_view, eye);
        // A pixel in the middle, at a distance of two meters.
        let x = m.project_point3(Vec3::new(0.0, 0.0, 0.05));
        assert!((x - Vec3::new(0.0, 0.0, -2.0)).length() < 1e-6, "{x}");
        let light = FrameLight::point(eye, Vec3::ONE, f32::INFINITY);
        assert_eq!(light_in_space(&light, eye).position, [0.0; 3]);
        let local = local_from_space(&Mat4::from_translation(-eye), eye);
        assert!(local.abs_diff_eq(Mat4::IDENTITY, 1e-9));
    }
}
