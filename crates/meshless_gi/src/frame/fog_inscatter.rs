//! Kernel `fog_inscatter`: radiance that fog at the center of each voxel scatters to the eye from
//! the probe irradiance of a scene. The kernel reads the volume that kernel
//! [`volume`](super::volume) wrote. It writes one texel per voxel, once per view. The rays of
//! kernel [`fog`](super::fog) read the texels many times.
//!
//! J is the integral of incident radiance times the phase function of Henyey and Greenstein
//! \[HG41\]. The Legendre terms of that function are powers of its asymmetry g. The kernel uses the
//! first two terms, and the part of the third that six irradiances determine: J = φ / 4π + 3 g F ·
//! d / 4π + g² Σ Qᵢᵢ dᵢ². In this formula:
//!
//! - d is the direction of the ray from the eye.
//! - F = ∫ L ω, with ω the direction to the light.
//! - φ = ∫ L is the fluence.
//! - Q is the light's part of order two, as a matrix without trace.
//!
//! F along an axis is the difference of the irradiances that face along it and away from it. Their
//! sum is Sᵢ = φ / 2 + π Qᵢᵢ / 2. The reason is that the integral of |ω · i| is 2π and that of its
//! product with ω · Qω is π Qᵢᵢ / 2. The sum contains no term of order one or three. Therefore φ is
//! ⅔ of the sum of all six. The part between the axes and all later terms are omitted. They are
//! small for light from all directions. A negative sum is clamped to zero.
//!
//! The sides of a volume's voxel store the light of the next voxel along them. The light of a voxel
//! is therefore stored in the voxels behind it, if no wall is between. Next to a wall, a voxel's
//! own sides are read, which store the light of the wall.

use super::fog::FogView;
use super::splat::MAX_HALF;
use super::volume::{STRAIGHT_STEP, VolumeParams};
use super::volume_weights::VoxelGrid;
use bytemuck::{Pod, Zeroable};
use glam::{IVec3, Mat4, UVec3, Vec3, Vec4};

/// Smallest distance between two positions. The direction to the eye is undefined at the eye.
pub const MIN_EYE_DISTANCE: f32 = 1e-12;

/// Upper limit of the encoded distance of a direction that is free up to the next voxel
/// ([`WallDistances::encode`](super::WallDistances::encode)).
pub const UNOBSTRUCTED_THRESHOLD: f32 = -1.252;

/// Volume of a scene in one view through fog, for `fog_inscatter`. 192 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct FogInscatterParams {
    /// Transform from voxels, measured from the corner of the scene's volume, to the world.
    pub world_from_voxels: [[f32; 4]; 4],
    /// Eye in the world: a position if the fourth number is above zero. If it is zero, the
    /// direction opposite to all rays.
    pub eye: [f32; 4],
    /// Step of each side, in voxels along each edge, to the voxel that provides its light
    /// ([`VolumeParams::steps`]). The fourth numbers are not used.
    pub steps: [[i32; 4]; 6],
    /// Voxels along each edge.
    pub size: [u32; 3],
    /// Asymmetry g of the phase function, -1 to 1.
    pub asymmetry: f32,
}

impl FogInscatterParams {
    /// Creates the parameters of a scene with a volume of `shape`.
    #[must_use]
    pub fn new(view: &FogView, asymmetry: f32, shape: &VoxelGrid, world_from_local: &Mat4) -> Self {
        let volume = VolumeParams::new(shape, &world_from_local.inverse());
        let world_from_voxels = *world_from_local
            * Mat4::from_translation(shape.origin())
            * Mat4::from_scale(shape.voxel());
        // All rays of a projection meet at the point with only a depth coordinate in clip space.
        let eye = view.world_from_view * (view.view_from_clip * Vec4::Z);
        Self {
            world_from_voxels: world_from_voxels.to_cols_array_2d(),
            eye: eye.to_array(),
            steps: volume.steps.map(|of| of[STRAIGHT_STEP]),
            size: shape.size().to_array(),
            asymmetry: asymmetry.clamp(-1.0, 1.0),
        }
    }
}

/// Returns one texel. RGB is in the unit that [`Fog::color`](super::Fog::color) multiplies, cd/m²
/// if lights are in lumens. The fourth number is that of the voxel's own texels. It is below
/// [`NO_WALL_THRESHOLD`](super::volume_sample::NO_WALL_THRESHOLD) if no wall is near. `texels` is
/// the output of [`volume`](super::volume::volume).
#[must_use]
pub fn fog_inscatter(params: &FogInscatterParams, texels: &[[f32; 4]], voxel: UVec3) -> [f32; 4] {
    let size = UVec3::from(params.size);
    let world_from_voxels = Mat4::from_cols_array_2d(&params.world_from_voxels);
    let middle = world_from_voxels.transform_point3(voxel.as_vec3() + 0.5);
    let eye = Vec4::from(params.eye);
    let toward = middle * eye.w - eye.truncate();
    let weights = sides(
        params.asymmetry,
        toward / toward.length().max(MIN_EYE_DISTANCE),
    );
    let texel = |voxel: UVec3, side: usize| {
        let t = voxel + size * UVec3::new(0, (side % 2) as u32, (side / 2) as u32);
        Vec4::from(texels[(t.x + size.x * (t.y + 2 * size.y * t.z)) as usize])
    };
    let free = |way: IVec3| {
        let along = |k: usize| texel(voxel, 2 * k + usize::from(way[k] < 0)).w;
        (0..3).all(|k| way[k] == 0 || along(k) < UNOBSTRUCTED_THRESHOLD)
    };
    let own = |side: usize| {
        let [x, y, z, _] = params.steps[side];
        let behind = voxel.as_ivec3() - IVec3::new(x, y, z);
        // Negative coordinates become large numbers.
        let inside = behind.as_uvec3().cmplt(size).all();
        match inside && free(-IVec3::new(x, y, z)) {
            true => texel(behind.as_uvec3(), side).truncate(),
            false => texel(voxel, side).truncate(),
        }
    };
    let light: Vec3 = (0..6).map(|k| weights[k] * own(k)).sum();
    light
        .clamp(Vec3::ZERO, Vec3::splat(MAX_HALF))
        .extend(texel(voxel, 0).w)
        .to_array()
}

/// Returns the weights of the irradiances of a voxel's six sides in the light that is scattered to
/// the eye. `d` is the direction of the ray from the eye. The weights are the first terms of the
/// phase function. Light from the direction of the ray keeps its direction.
#[must_use]
pub fn sides(asymmetry: f32, d: Vec3) -> [f32; 6] {
    // Texels are E / π, so φ / 4π = ⅔ π Σ / 4π and 3 F / 4π = ¾ of the difference. Q along an axis
    // is twice the excess of its sum over the mean of the sums.
    std::array::from_fn(|side| {
        let along = 0.75 * asymmetry * d[side / 2];
        let second = 2.0 * asymmetry * asymmetry * (d[side / 2] * d[side / 2] - 1.0 / 3.0);
        1.0 / 6.0 + second + if side % 2 == 0 { along } else { -along }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::{lattice, uniform_sphere};
    use glam::Vec2;
    use std::f32::consts::{FRAC_1_PI, PI};

    /// Six irradiances determine the first two terms exactly, and the part of the third along the
    /// axes. This holds for light with any terms up to the fourth.
    #[test]
    fn scattered_light_matches_first_phase_function_terms() {
        let all = 20_000;
        let directions: Vec<Vec3> = (0..all)
            .map(|k| uniform_sphere(lattice(k, all, Vec2::ZERO)))
            .collect();
        let light = |w: Vec3| {
            2.0 + w.x - 0.7 * w.y + 0.9 * w.x * w.z + 0.5 * w.z * w.z - 0.8 * w.x * w.y * w.z
        };
        let mean = |of: &dyn Fn(Vec3) -> f32| {
            4.0 * PI * directions.iter().map(|w| of(*w)).sum::<f32>() / all as f32
        };
        let texels: Vec<f32> = (0..6)
            .map(|side| {
                let n = Vec3::AXES[side / 2] * [1.0, -1.0][side % 2];
                FRAC_1_PI * mean(&|w| light(w) * w.dot(n).max(0.0))
            })
            .collect();
        for (asymmetry, d) in [
            (0.0, Vec3::X),
            (0.5, Vec3::X),
            (0.5, Vec3::new(-0.6, 0.8, 0.0)),
            (-0.3, Vec3::Y),
            (0.8, Vec3::new(0.0, 0.6, -0.8)),
        ] {
            let found: f32 = sides(asymmetry, d)
                .iter()
                .zip(&texels)
                .map(|(w, t)| w * t)
                .sum();
            let first = mean(&|w| light(w) * (1.0 + 3.0 * asymmetry * w.dot(d))) / (4.0 * PI);
            let right = first + asymmetry * asymmetry * 0.5 * (d.z * d.z - 1.0 / 3.0);
            assert!(
                (found - right).abs() < 2e-3 * right.abs(),
                "{found} {right}"
            );
        }
    }

    #[test]
    fn fog_rays_start_at_eye_or_are_parallel() {
        let shape = VoxelGrid::new([Vec3::ZERO, Vec3::splat(2.0)], UVec3::splat(2)).unwrap();
        // All light comes from +x.
        let mut texels = vec![[0.0; 4]; 6 * 8];
        for z in 0..2 {
            for y in 0..2 {
                for x in 0..2 {
                    texels[x + 2 * (y + 4 * z)] = [1.0, 1.0, 1.0, -2.0];
                }
            }
        }
        let light = |view_from_clip: Mat4, eye: Vec3, at: Vec3| {
            let view = FogView {
                view_from_clip,
                world_from_view: Mat4::look_at_rh(eye, at, Vec3::Y).inverse(),
                viewport: [0.0, 0.0, 1.0, 1.0],
                exposure: 1.0,
                steps: 1,
            };
            let params = FogInscatterParams::new(&view, 0.4, &shape, &Mat4::IDENTITY);
            fog_inscatter(&params, &texels, UVec3::ZERO)
        };
        let right = |d: Vec3| sides(0.4, d.normalize())[0].max(0.0);
        let position = Vec3::splat(0.5);
        let endless = Mat4::perspective_infinite_reverse_rh(0.5, 1.0, 0.1).inverse();
        let ends = Mat4::perspective_rh(0.5, 1.0, 100.0, 0.1).inverse();
        let alike = Mat4::orthographic_rh(-1.0, 1.0, -1.0, 1.0, 50.0, 0.1).inverse();
        for eye in [Vec3::new(-3.0, 2.0, 1.0), Vec3::new(5.0, 1.0, -2.0)] {
            let at = Vec3::new(0.5, 0.0, 0.5);
            for (projection, d) in [
                (endless, position - eye),
                (ends, position - eye),
                (alike, at - eye),
            ] {
                let found = light(projection, eye, at);
                assert!((found[0] - right(d)).abs() < 1e-4, "{found:?} {}", right(d));
                assert_eq!(found[3], -2.0);
            }
        }
        // The eye is at the center of the voxel, so any direction is valid.
        assert!(light(endless, position, Vec3::ZERO)[0].is_finite());
    }
}
