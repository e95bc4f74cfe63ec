//! Kernel `volume`: probe irradiance in the layout of Bevy's irradiance volumes, an ambient cube
//! per voxel. It lights surfaces without a G-buffer: forward cameras, multisampled views,
//! transparent surfaces. It runs after `apply`, from the probes' values to a texture.
//!
//! An engine samples such a volume by the normal of a surface and between eight voxels, some of
//! which lie inside the wall. The light for a normal is therefore that of the next voxel along the
//! normal, in the space in front of the surface. A voxel inside a wall has, for each side, the
//! light in front of that side. Next to a baked wall, on both sides of its surface, a voxel has the
//! wall's own light (`volume_walls`). A voxel with a wall in front of the next one keeps its own
//! light. Its distances to walls (`volume_distance`) prevent light from beyond them
//! (`volume_sample`).
//!
//! The light of each voxel center is summed once, with weights that depend on no light
//! (`volume_weights`), and the sides of neighboring voxels read it. The engine's axes can differ
//! from those of the voxels (a rotated scene). A side then reads the voxel with the center nearest
//! to the position in front of it. The steps to these voxels are the same for all voxels. The
//! kernel has one thread per voxel and scatters its light to the sides that read it. The twin
//! gathers per side.

use super::layout::VectorIrradiance;
use super::splat::MAX_HALF;
use super::volume_walls::{COSINE_TOLERANCE, MIN_FACING_COSINE};
use super::volume_weights::{VoxelGrid, VoxelWeights};
use bytemuck::{Pod, Zeroable};
use glam::{IVec3, Mat4, UVec3, Vec3};
use std::f32::consts::FRAC_1_PI;

/// Index of the straight step among a side's [`VolumeParams::steps`].
pub const STRAIGHT_STEP: usize = 4;

/// A volume in the world, for `volume`. 928 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct VolumeParams {
    /// Voxels along each edge.
    pub size: [u32; 3],
    /// Factor on the irradiance: 1/π, for the radiance of a white surface.
    pub scale: f32,
    /// World axes as unit vectors of the local space, the fourth floats not used.
    pub axes: [[f32; 4]; 3],
    /// Steps of each side in voxels along each edge: to the voxel ahead, [`STRAIGHT_STEP`], and to
    /// its eight neighbors. Sides: along each axis, and then against it. The fourth numbers are not
    /// used.
    pub steps: [[[i32; 4]; 9]; 6],
}

impl VolumeParams {
    /// Creates the parameters for `shape` and an engine that uses the world's axes.
    #[must_use]
    pub fn new(shape: &VoxelGrid, local_from_world: &Mat4) -> Self {
        let axes = [Vec3::X, Vec3::Y, Vec3::Z]
            .map(|v| local_from_world.transform_vector3(v).normalize_or_zero());
        // The length of a step is the longest edge of a voxel. It ends at the nearest voxel,
        // measured from a voxel center.
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

    /// Returns the voxel at a step of a side. Returns `None` outside of the volume.
    fn step(&self, voxel: UVec3, side: usize, step: usize) -> Option<u32> {
        let [x, y, z, _] = self.steps[side][step];
        let size = UVec3::from(self.size);
        let to = voxel.as_ivec3() + IVec3::new(x, y, z);
        // Negative values become large, outside of the volume.
        let to = to.as_uvec3();
        to.cmplt(size).all().then(|| index(size, to))
    }
}

fn index(size: UVec3, voxel: UVec3) -> u32 {
    voxel.x + size.x * (voxel.y + size.y * voxel.z)
}

/// Light that a volume is computed from.
#[derive(Clone, Copy, Debug)]
pub struct VolumeValues<'a> {
    /// Values of the scene's points.
    pub points: &'a [VectorIrradiance],
    /// Values of its probes, [`PROBE_ROWS`](crate::transport::PROBE_ROWS) each.
    pub probes: &'a [VectorIrradiance],
}

/// Returns all texels, row by row and layer by layer, in the layout of
/// [`read_volume`](super::volume_sample::read_volume) and [`fog`](super::fog::fog).
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

/// Returns one texel. RGB is the factor on a surface's color in the engine, cd/m² if lights are in
/// lumens. The fourth number is the distance to a wall
/// ([`WallDistances::encode`](super::WallDistances::encode)). RGB is the first of these that
/// exists:
///
/// - The light of the voxel's wall sample with the normal most similar to the side's.
/// - The light of the voxel ahead, unless a wall is in front of it and the voxel has its own light.
/// - The voxel's own light.
/// - The mean of the voxels around the one ahead.
/// - Black, if no probe reaches any of them.
#[must_use]
pub fn volume(
    params: &VolumeParams,
    weights: &VoxelWeights,
    values: VolumeValues<'_>,
    texel: UVec3,
) -> [f32; 4] {
    let size = UVec3::from(params.size);
    // The lower half holds surfaces that face along an axis, the upper half those that face against
    // it. The axes follow each other in z.
    let axis = (texel.z / size.z) as usize;
    let away = texel.y >= size.y;
    let voxel = texel % size;
    let side = 2 * axis + usize::from(away);
    let n = Vec3::from_slice(&params.axes[axis][..3]) * if away { -1.0 } else { 1.0 };
    let light = |voxel: u32| Some(weights.light(values.probes, voxel)?.irradiance(n));
    let step = |k: usize| params.step(voxel, side, k).and_then(light);
    let own = index(size, voxel);
    let wall_distances = &weights.wall_distances()[own as usize];
    let [x, y, z, _] = params.steps[side][STRAIGHT_STEP];
    let mine = light(own);
    let e = wall_irradiance(weights, values.points, own, n, mine.is_some());
    let e = e.or_else(|| {
        let walled = mine.is_some() && wall_distances.is_blocked([x, y, z]);
        if walled {
            mine
        } else {
            step(STRAIGHT_STEP).or(mine)
        }
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
        .min(Vec3::splat(MAX_HALF))
        .extend(wall_distances.encode(side))
        .to_array()
}

/// Returns the light of the wall sample with the normal most similar to `n`, or the first of
/// several. It is the irradiance for the wall's own normal, so that oblique sides together
/// reproduce it. A voxel in the air uses samples within 60 degrees. A voxel in the ground uses any
/// of its samples, because it has no other light. Returns `None` if no sample qualifies.
fn wall_irradiance(
    weights: &VoxelWeights,
    values: &[VectorIrradiance],
    voxel: u32,
    n: Vec3,
    in_air: bool,
) -> Option<Vec3> {
    let wall_samples = weights.wall_samples();
    let mut best = (if in_air { MIN_FACING_COSINE } else { -2.0 }, None);
    for face in wall_samples.samples_of(voxel) {
        let cosine = Vec3::from_array(wall_samples.wall_samples[face].normal).dot(n);
        if cosine > best.0 + COSINE_TOLERANCE {
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
