//! Kernel `volume`: probe irradiance in the layout of Bevy's irradiance volumes, an ambient cube
//! per voxel. It lights surfaces without a G-buffer: forward cameras, multisampled views,
//! transparent surfaces. It runs after `apply`, from the probes' values to a texture.
//!
//! An engine samples such a volume by the normal of a surface and between eight voxels, some of
//! which lie inside the wall. The light for a normal is therefore that of the next voxel along the
//! normal, where the space in front of the surface is. A voxel inside a wall has, for each side,
//! the light in front of that side. Next to a baked wall, on both sides of its surface, a voxel has
//! the wall's own light (`volume_walls`). A voxel with a wall in front of the next one keeps its
//! own light. Its distances to walls (`volume_distance`) prevent light from beyond them
//! (`volume_sample`).
//!
//! The light of each voxel center is summed once, with weights that depend on no light
//! (`volume_weights`), and the sides of neighboring voxels read it. If the axes of the engine are
//! not those of the voxels (a rotated scene), a side reads the voxel whose center is nearest to the
//! position in front of it. The steps to these voxels are the same everywhere. The kernel has one
//! thread per voxel and scatters its light to the sides that read it. The twin gathers per side.

use super::layout::VectorIrradiance;
use super::splat::LARGEST_HALF;
use super::volume_walls::{FACING, SAME};
use super::volume_weights::{VoxelGrid, VoxelWeights};
use bytemuck::{Pod, Zeroable};
use glam::{IVec3, Mat4, UVec3, Vec3};
use std::f32::consts::FRAC_1_PI;

/// Index of the straight step among a side's [`VolumeParams::steps`].
pub const AHEAD: usize = 4;

/// A volume in the world, for `volume`. 928 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct VolumeParams {
    /// Voxels along each edge.
    pub size: [u32; 3],
    /// Multiplies the irradiance: 1/π, for the radiance of a white surface.
    pub scale: f32,
    /// The world's axes as unit vectors of the local space, the fourth floats not used.
    pub axes: [[f32; 4]; 3],
    /// For each side how many voxels along each edge it is to the one ahead, [`AHEAD`], and to the
    /// eight beside that one. Sides: along each axis, and then away from it. The fourth numbers are
    /// not used.
    pub steps: [[[i32; 4]; 9]; 6],
}

impl VolumeParams {
    /// Creates the parameters for `shape` and an engine whose axes are those of the world.
    #[must_use]
    pub fn new(shape: &VoxelGrid, local_from_world: &Mat4) -> Self {
        let axes = [Vec3::X, Vec3::Y, Vec3::Z]
            .map(|v| local_from_world.transform_vector3(v).normalize_or_zero());
        // A voxel further is one along its longest edge. To the nearest voxel, from the middle of
        // one.
        let reach = shape.voxel().max_element();
        let nearest = |step: Vec3| (step * reach / shape.voxel() + 0.5).floor().as_ivec3();
        let mut steps = [[[0; 4]; 9]; 6];
        for (side, steps) in steps.iter_mut().enumerate() {
            let axis = side / 2;
            let n = axes[axis] * [1.0, -1.0][side % 2];
            let (t, b) = (axes[(axis + 1) % 3], axes[(axis + 2) % 3]);
            for (i, step) in steps.iter_mut().enumerate() {
                let (u, v) = ((i % 3) as f32 - 1.0, (i / 3) as f32 - 1.0);
                *step = nearest(n + t * u + b * v).extend(0).to_array();
            }
        }
        Self {
            size: shape.size().to_array(),
            scale: FRAC_1_PI,
            axes: axes.map(|a| a.extend(0.0).to_array()),
            steps,
        }
    }

    /// The voxel that is a step of a side away; none outside of the volume.
    fn step(&self, voxel: UVec3, side: usize, step: usize) -> Option<u32> {
        let [x, y, z, _] = self.steps[side][step];
        let size = UVec3::from(self.size);
        let to = voxel.as_ivec3() + IVec3::new(x, y, z);
        // Below zero is far above.
        let to = to.as_uvec3();
        to.cmplt(size).all().then(|| index(size, to))
    }
}

fn index(size: UVec3, voxel: UVec3) -> u32 {
    voxel.x + size.x * (voxel.y + size.y * voxel.z)
}

/// The light that a volume is made of.
#[derive(Clone, Copy, Debug)]
pub struct VolumeValues<'a> {
    /// Values of the scene's points.
    pub points: &'a [VectorIrradiance],
    /// Values of its probes, [`PROBE_ROWS`](crate::transport::PROBE_ROWS) each.
    pub probes: &'a [VectorIrradiance],
}

/// All texels, row by row and layer by layer, as [`read_volume`](super::volume_sample::read_volume)
/// and [`fog`](super::fog::fog) take them.
#[must_use]
pub fn volume_texels(
    params: &VolumeParams,
    weights: &VoxelWeights,
    values: VolumeValues<'_>,
) -> Vec<[f32; 4]> {
    let all = weights.shape().texels();
    (0..all.element_product())
        .map(|i| UVec3::new(i % all.x, i / all.x % all.y, i / (all.x * all.y)))
        .map(|texel| volume(params, weights, values, texel))
        .collect()
}

/// One texel: RGB as the engine multiplies it with a surface's color, cd/m² where lights are in
/// lumens; the fourth is how far a way is free
/// ([`WallDistances::encode`](super::WallDistances::encode)). The light of the voxel's face that
/// the side faces as most; without one that of the voxel ahead, unless a wall stands before it;
/// else the voxel's own, else the mean of those around the one ahead; black where no probe reaches
/// any of them.
#[must_use]
pub fn volume(
    params: &VolumeParams,
    weights: &VoxelWeights,
    values: VolumeValues<'_>,
    texel: UVec3,
) -> [f32; 4] {
    let size = UVec3::from(params.size);
    // Surfaces that face an axis have the lower half, those that face away from it the upper one;
    // axes lie behind one another.
    let axis = (texel.z / size.z) as usize;
    let away = texel.y >= size.y;
    let voxel = texel % size;
    let side = 2 * axis + usize::from(away);
    let n = Vec3::from_slice(&params.axes[axis][..3]) * if away { -1.0 } else { 1.0 };
    let light = |voxel: u32| Some(weights.light(values.probes, voxel)?.irradiance(n));
    let step = |k: usize| params.step(voxel, side, k).and_then(light);
    let own = index(size, voxel);
    let wall_distances = &weights.wall_distances()[own as usize];
    let [x, y, z, _] = params.steps[side][AHEAD];
    let mine = light(own);
    let e = on_a_wall(weights, values.points, own, n, mine.is_some());
    let e = e.or_else(|| {
        let walled = mine.is_some() && wall_distances.is_blocked([x, y, z]);
        if walled { mine } else { step(AHEAD).or(mine) }
    });
    let e = e.unwrap_or_else(|| {
        let (mut sum, mut count) = (Vec3::ZERO, 0.0f32);
        for e in (0..9).filter_map(step) {
            sum += e;
            count += 1.0;
        }
        sum / count.max(1.0)
    });
    (e * params.scale)
        .min(Vec3::splat(LARGEST_HALF))
        .extend(wall_distances.encode(side))
        .to_array()
}

/// The light of the wall whose face `n` faces most, the first of those: the wall's for its own
/// normal, so that sides at an angle to it together show it as it is. Returns `None` where no face
/// faces as `n` does: within 60 degrees in the air; a voxel in the ground has no light but that of
/// the walls that it has a face of.
fn on_a_wall(
    weights: &VoxelWeights,
    values: &[VectorIrradiance],
    voxel: u32,
    n: Vec3,
    in_air: bool,
) -> Option<Vec3> {
    let wall_samples = weights.wall_samples();
    let mut best = (if in_air { FACING } else { -2.0 }, None);
    for face in wall_samples.samples_of(voxel) {
        let cosine = Vec3::from_array(wall_samples.wall_samples[face].normal).dot(n);
        if cosine > best.0 + SAME {
            best = (cosine, Some(face));
        }
    }
    let mut e = VectorIrradiance::default();
    let face = best.1?;
    for share in wall_samples.weights_of(face) {
        e.add_scaled(share.part, &values[share.point as usize]);
    }
    Some(
        e.dot(wall_samples.wall_samples[face].normal.into())
            .max(Vec3::ZERO),
    )
}
