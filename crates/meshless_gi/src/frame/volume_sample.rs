//! Lookup in a volume that kernel `volume` wrote, the twin of the module that replaces Bevy's
//! (`shaders/engine/irradiance_volume.wgsl`). It runs at each pixel that is drawn forward. Kernel
//! [`fog`](super::fog) uses it too.
//!
//! The lookup interpolates eight voxels like a sampler. It leaves out voxels with a wall nearer
//! than the position (`volume_distance`). So neither a thin wall nor a floor between two storeys
//! leaks light, and a dark neighboring room does not darken a position.

use glam::{UVec3, Vec3};

/// Threshold below which a voxel has no walls near it.
pub const NO_WALL_THRESHOLD: f32 = -1.999;
/// Offset that [`WallDistances::encode`](super::WallDistances::encode) adds to a distance.
pub const DISTANCE_OFFSET: f32 = 0.25;
/// Distance beyond a wall, voxels, up to which a point is lit as if it were in front of it.
pub const WALL_FADE_START: f32 = 0.01;
/// Distance beyond a wall, voxels, from which a point gets no light from in front of it.
pub const WALL_FADE_END: f32 = 0.03;
/// Sum of the weights of the eight voxels below which the wall test is ignored.
pub const MIN: f32 = 1e-3;

/// Returns the irradiance at a point for a surface that faces `n`, a unit vector of the world, in
/// the texels' unit. `size` is the number of voxels along each edge. `position` is in voxels from
/// the volume's corner. `texels` are those of [`volume`](super::volume::volume), x first and z
/// last.
#[must_use]
pub fn read_volume(size: [u32; 3], texels: &[[f32; 4]], position: Vec3, n: Vec3) -> Vec3 {
    let voxels = UVec3::from(size);
    read_voxels(size, texels, position, |voxel| {
        (0..3)
            .map(|axis| {
                let side = 2 * axis + usize::from(n[axis] < 0.0);
                let texel = texels[index(voxels, voxel, side)];
                n[axis] * n[axis] * Vec3::from_slice(&texel[..3])
            })
            .sum()
    })
}

/// Returns the index of the texel of a voxel's side.
fn index(size: UVec3, voxel: UVec3, side: usize) -> usize {
    let t = voxel + size * UVec3::new(0, (side % 2) as u32, (side / 2) as u32);
    (t.x + size.x * (t.y + 2 * size.y * t.z)) as usize
}

/// Interpolates a value `light` of each voxel in the same way. `texels` hold the distances to
/// walls.
#[must_use]
pub fn read_voxels(
    size: [u32; 3],
    texels: &[[f32; 4]],
    position: Vec3,
    light: impl Fn(UVec3) -> Vec3,
) -> Vec3 {
    let size = UVec3::from(size);
    let edges = size.as_vec3();
    let position = position.clamp(Vec3::splat(0.5), edges - 0.5);
    let first = (position - 0.5).as_uvec3();
    let (mut whole, mut some) = ((Vec3::ZERO, 0.0), (Vec3::ZERO, 0.0));
    for k in 0..8u32 {
        let step = UVec3::new(k & 1, k >> 1 & 1, k >> 2);
        let voxel = (first + step).min(size - 1);
        let from = position - (voxel.as_vec3() + 0.5);
        let weight = (1.0 - from.abs()).max(Vec3::ZERO).element_product();
        let light = light(voxel);
        whole = (whole.0 + weight * light, whole.1 + weight);
        let seen: f32 = (0..3)
            .map(|axis| {
                let side = 2 * axis + usize::from(from[axis] < 0.0);
                let way = texels[index(size, voxel, side)][3];
                let beyond = from[axis].abs() + way + DISTANCE_OFFSET;
                // Volumes of the engine have no negative values.
                match way > NO_WALL_THRESHOLD && way < 0.0 {
                    true => {
                        1.0 - smooth_step(
                            (beyond - WALL_FADE_START) / (WALL_FADE_END - WALL_FADE_START),
                        )
                    }
                    false => 1.0,
                }
            })
            .product();
        some = (some.0 + weight * seen * light, some.1 + weight * seen);
    }
    match some.1 > MIN {
        true => some.0 / some.1,
        false => whole.0 / whole.1,
    }
}

fn smooth_step(t: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
