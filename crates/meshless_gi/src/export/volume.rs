//! Bevy irradiance volume for one set of lights. The frame is solved on the CPU, and the kernel
//! [`volume`](crate::frame::volume) fills the voxels.

use super::VolumePlacement;
use super::ktx2;
use crate::asset::{BakedScene, write_file};
use crate::eval::{Bounces, PATCHES, solve};
use crate::frame::splat::MAX_HALF;
use crate::frame::volume::volume_texels;
use crate::frame::{
    FrameLight, FrameSettings, VolumeParams, VolumeValues, VoxelGrid, VoxelWeights,
};
use crate::scene::{Light, sum_sky_lights};
use glam::Mat4;
use half::f16;
use std::io;
use std::path::Path;

/// Scale of the light during the computation, since the kernel clamps texels to the range of half
/// floats. No light of a frame is above 10¹⁸.
const COMPUTE_SCALE: f32 = 1.0 / (1u128 << 64) as f32;

/// Settings of an exported volume.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VolumeExport {
    /// Edge of a voxel, meters in the space of the bake. `None` uses half of the distance between
    /// the bake's probes.
    pub voxel: Option<f32>,
    /// Largest number of voxels, at most 2²⁰. Voxels are enlarged if there would be more. Default:
    /// 65,536. A voxel takes 48 bytes.
    pub max_voxels: u32,
    /// Diffuse reflections. `None` uses the number of the bake's recipe.
    pub bounces: Option<Bounces>,
    /// Radiance for an emissive factor of 1, cd/m². 0 or more. Default: 1.
    pub emission: f32,
}

impl Default for VolumeExport {
    fn default() -> Self {
        Self {
            voxel: None,
            max_voxels: 1 << 16,
            bounces: None,
            emission: 1.0,
        }
    }
}

/// Error of the export of a volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// The bake has no probes.
    #[error(
        "the bake has no probes: bake the scene with `--probes`, or with `probes: ()` in its recipe"
    )]
    NoProbes,
    /// The sky is not uniform, but the bake supports only uniform skies.
    #[error(
        "the bake has a uniform sky: bake the scene with `--sky harmonics` for one that varies"
    )]
    UniformSky,
}

/// Irradiance volume in the layout of Bevy.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct ExportedVolume {
    /// Box and voxels, in the space of the bake.
    pub shape: VoxelGrid,
    /// Factor of the texels, a power of two.
    pub intensity: f32,
    /// Texels, x fastest and z last: the radiance of a white surface in cd/m², divided by
    /// `intensity`. The fourth number encodes distances to walls
    /// ([`WallDistances::encode`](crate::frame::WallDistances::encode)). Bevy does not read it, but
    /// this crate's plugin does.
    pub texels: Vec<[f16; 4]>,
}

impl ExportedVolume {
    /// Computes the volume of a bake under `lights`: their reflected light, and all light of the
    /// sky and of emissive surfaces. W is used as lm, W/sr as cd and W/m² as lx. The result does
    /// not depend on the number of threads.
    ///
    /// # Errors
    /// See [`ExportError`].
    pub fn new(
        scene: &BakedScene,
        lights: &[Light],
        export: &VolumeExport,
    ) -> Result<Self, ExportError> {
        let shape = VoxelGrid::from_scene(scene.data(), export.voxel, export.max_voxels)
            .ok_or(ExportError::NoProbes)?;
        let sky = sum_sky_lights(lights);
        if scene.data().sky.is_none() && !sky.is_uniform() {
            return Err(ExportError::UniformSky);
        }
        let slots = lights.iter().flat_map(|l| FrameLight::expand(l, PATCHES));
        let slots: Vec<FrameLight> = slots.collect();
        let settings = FrameSettings {
            sky,
            emission: export.emission,
            ..FrameSettings::default()
        };
        let bounces = export
            .bounces
            .unwrap_or(Bounces::Count(scene.info().bounces));
        let (frame, _) = solve(scene, &slots, &settings, bounces);
        let mut params = VolumeParams::new(&shape, &Mat4::IDENTITY);
        params.scale *= COMPUTE_SCALE;
        let values = VolumeValues {
            points: frame.vector_irradiance(),
            probes: frame.probes(),
        };
        let texels = volume_texels(
            &params,
            &VoxelWeights::from_scene(shape, scene.data()),
            values,
        );
        let peak = texels
            .iter()
            .flat_map(|t| &t[..3])
            .fold(0.0, |peak: f32, v| peak.max(*v));
        let intensity = intensity(peak / COMPUTE_SCALE);
        let scale = 1.0 / COMPUTE_SCALE / intensity;
        let stored =
            |[r, g, b, way]: [f32; 4]| [r * scale, g * scale, b * scale, way].map(f16::from_f32);
        Ok(Self {
            shape,
            intensity,
            texels: texels.into_iter().map(stored).collect(),
        })
    }

    /// Returns the texture as a KTX 2.0 file: three-dimensional, `Rgba16Float`, one level.
    #[must_use]
    pub fn ktx2(&self) -> Vec<u8> {
        ktx2::write(self.shape.texels().to_array(), &self.texels)
    }

    /// Returns the description of the volume, for a texture and lights of these names.
    #[must_use]
    pub fn placement(&self, texture: &str, lights: &str) -> VolumePlacement {
        VolumePlacement {
            version: VolumePlacement::VERSION,
            texture: texture.into(),
            lights: lights.into(),
            translation: self.shape.center().to_array(),
            rotation: [0.0, 0.0, 0.0, 1.0],
            scale: self.shape.edges().to_array(),
            resolution: self.shape.size().to_array(),
            intensity: self.intensity,
        }
    }

    /// Writes the texture to `path`, and its description to the same path with the extension
    /// `.ron`. Returns the bytes of the texture.
    ///
    /// # Errors
    /// Errors of the operating system.
    pub fn write(&self, path: &Path, lights: &str) -> io::Result<u64> {
        let texture = path.file_name().unwrap_or_default().to_string_lossy();
        let placement = self.placement(&texture, lights).to_ron();
        let placement = placement.map_err(io::Error::other)?;
        let bytes = self.ktx2();
        write_file(path, &bytes)?;
        write_file(&path.with_extension("ron"), placement.as_bytes())?;
        Ok(bytes.len() as u64)
    }
}

/// Computes the power of two by which texels are divided. `peak` is the brightest texel. 1 if half
/// floats represent it well.
fn intensity(peak: f32) -> f32 {
    let mut intensity = 1.0f32;
    while peak / intensity > MAX_HALF {
        intensity *= 2.0;
    }
    while peak > 0.0 && peak / intensity < 1.0 && intensity > f32::MIN_POSITIVE {
        intensity *= 0.5;
    }
    intensity
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn volume_intensity_keeps_brightest_texel_in_f16_range() {
        for peak in [0.0, 1.0, 300.0, MAX_HALF] {
            assert_eq!(intensity(peak), 1.0, "{peak}");
        }
        assert_eq!(intensity(65_505.0), 2.0);
        assert_eq!(intensity(0.75), 0.5);
        for peak in [1e-30f32, 1e-5, 1e6, 1e30, f32::MAX] {
            let stored = peak / intensity(peak);
            assert!((1.0..=MAX_HALF).contains(&stored), "{peak}: {stored}");
        }
    }
}
