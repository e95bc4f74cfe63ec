//! A sky that is not the same in all directions: nine colours beside a baked scene, from a gradient or from a cubemap.
//!
//! It lights the level through the bake, and is not drawn: what a camera shows behind the level (`Skybox`, a clear colour) stays its own affair. Bevy's own
//! environment light adds its diffuse part on top of it, which [`check`](super::check) tells.

use crate::scene::SkyRadiance;
use bevy::asset::RenderAssetUsages;
use bevy::color::{ColorToComponents, LinearRgba};
use bevy::ecs::prelude::*;
use bevy::image::Image;
use bevy::math::Vec3;
use bevy::reflect::prelude::*;

/// Light from a sky that varies, in the axes of the world: L(ω) = c + d·ω + ω·Q ω in cd/m², with Q symmetric and without trace. Goes beside
/// [`MeshlessGi`](super::MeshlessGi), may change in any frame, and is added to [`MeshlessGiLighting::sky`](super::MeshlessGiLighting::sky). A bake made
/// without `sky: Harmonics` in its recipe is lit by its mean over all directions, with one warning.
#[derive(Component, Reflect, Clone, Copy, Debug, Default, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
pub struct MeshlessGiSky {
    /// c; d (x, y, z); Q_xx, Q_yy, Q_xy, Q_xz, Q_yz: linear RGB each.
    pub coefficients: [Vec3; 9],
}

/// A cubemap that gives no sky.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshlessGiSkyError {
    /// It has not six square layers.
    #[error("{width} × {height} texels in {layers} layers are no cubemap")]
    NoCubemap {
        /// Texels across.
        width: u32,
        /// Texels down.
        height: u32,
        /// Layers.
        layers: u32,
    },
    /// Its texels are on the GPU alone: load it with [`RenderAssetUsages::MAIN_WORLD`].
    #[error("the image has no texels on the CPU: load it with `RenderAssetUsages::default()`")]
    NoData,
    /// Its texels cannot be read on the CPU.
    #[error("texels of this format cannot be read: {0}")]
    Format(String),
}

impl MeshlessGiSky {
    /// Three colours, cd/m²: straight up, at the horizon and straight down ([`SkyRadiance::gradient`]).
    #[must_use]
    pub fn gradient(zenith: LinearRgba, horizon: LinearRgba, ground: LinearRgba) -> Self {
        let [zenith, horizon, ground] = [zenith, horizon, ground].map(|c| c.to_vec3());
        SkyRadiance::gradient(zenith, horizon, ground).into()
    }

    /// The sky of a cubemap as `Skybox` shows it; `brightness` is what a texel of one stands for, cd/m².
    ///
    /// # Errors
    /// [`MeshlessGiSkyError`]: compressed texels, for instance, are not read.
    pub fn from_cubemap(image: &Image, brightness: f32) -> Result<Self, MeshlessGiSkyError> {
        let size = image.texture_descriptor.size;
        let (n, layers) = (size.width, size.depth_or_array_layers);
        if layers != 6 || n != size.height || n == 0 {
            return Err(MeshlessGiSkyError::NoCubemap {
                width: n,
                height: size.height,
                layers,
            });
        }
        if image.data.is_none() {
            debug_assert!(!image.asset_usage.contains(RenderAssetUsages::MAIN_WORLD));
            return Err(MeshlessGiSkyError::NoData);
        }
        // Nine numbers need no more than this many texels a side.
        let step = (n / 64).max(1);
        let mut samples = Vec::new();
        for face in 0..6 {
            for y in (0..n).step_by(step as usize) {
                for x in (0..n).step_by(step as usize) {
                    let colour = image.get_color_at_3d(x, y, face);
                    let colour = colour.map_err(|e| MeshlessGiSkyError::Format(e.to_string()))?;
                    let at = |k: u32| (2 * k + 1) as f32 / n as f32 - 1.0;
                    let way = towards(face, at(x), at(y));
                    // A texel's solid angle falls with the cube of its distance.
                    let angle = way.length().powi(-3);
                    let radiance = LinearRgba::from(colour).to_vec3() * brightness;
                    samples.push((way.normalize(), angle, radiance));
                }
            }
        }
        Ok(SkyRadiance::of_map(samples).into())
    }

    /// The same in the core's terms.
    #[must_use]
    pub fn radiance(&self) -> SkyRadiance {
        let [mean, terms @ ..] = self.coefficients;
        SkyRadiance { mean, terms }
    }
}

impl From<SkyRadiance> for MeshlessGiSky {
    fn from(sky: SkyRadiance) -> Self {
        let mut coefficients = [sky.mean; 9];
        coefficients[1..].copy_from_slice(&sky.terms);
        Self { coefficients }
    }
}

/// Where the world lies from the middle of a cube through place (s, t) of a face, both within ±1 and t downwards. Cubemaps are left-handed, the world is not.
fn towards(face: u32, s: f32, t: f32) -> Vec3 {
    let way = match face {
        0 => Vec3::new(1.0, -t, -s),
        1 => Vec3::new(-1.0, -t, s),
        2 => Vec3::new(s, 1.0, t),
        3 => Vec3::new(s, -1.0, -t),
        4 => Vec3::new(s, -t, 1.0),
        _ => Vec3::new(-s, -t, -1.0),
    };
    Vec3::new(way.x, way.y, -way.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::render::render_resource::{Extent3d, TextureDimension, TextureFormat};

    fn cubemap(n: u32, colour: impl Fn(Vec3) -> Vec3) -> Image {
        let mut data = Vec::new();
        for face in 0..6 {
            for y in 0..n {
                for x in 0..n {
                    let at = |k: u32| (2 * k + 1) as f32 / n as f32 - 1.0;
                    let c = colour(towards(face, at(x), at(y)).normalize());
                    data.extend([c.x, c.y, c.z, 1.0].iter().flat_map(|v| v.to_le_bytes()));
                }
            }
        }
        Image::new(
            Extent3d {
                width: n,
                height: n,
                depth_or_array_layers: 6,
            },
            TextureDimension::D2,
            data,
            TextureFormat::Rgba32Float,
            RenderAssetUsages::default(),
        )
    }

    #[test]
    fn a_cubemap_gives_its_sky_back() {
        let sky = MeshlessGiSky::gradient(
            LinearRgba::rgb(0.2, 0.4, 1.0),
            LinearRgba::rgb(0.8, 0.7, 0.6),
            LinearRgba::rgb(0.1, 0.1, 0.0),
        );
        let mut sky = sky.radiance();
        sky.terms[0] = Vec3::new(0.1, 0.0, 0.05);
        sky.terms[2] = Vec3::new(0.0, 0.2, 0.0);
        let found = MeshlessGiSky::from_cubemap(&cubemap(32, |w| sky.towards(w)), 3.0);
        let found = found.unwrap().coefficients;
        let right = MeshlessGiSky::from(sky * 3.0).coefficients;
        for (a, b) in found.iter().zip(right) {
            assert!((*a - b).length() < 0.01, "{a} {b}");
        }
    }

    #[test]
    fn what_is_no_cubemap_is_told() {
        let mut image = cubemap(4, |_| Vec3::ONE);
        image.data = None;
        image.asset_usage = RenderAssetUsages::RENDER_WORLD;
        let no_data = MeshlessGiSky::from_cubemap(&image, 1.0);
        assert_eq!(no_data, Err(MeshlessGiSkyError::NoData));
        image.texture_descriptor.size.depth_or_array_layers = 1;
        assert!(matches!(
            MeshlessGiSky::from_cubemap(&image, 1.0),
            Err(MeshlessGiSkyError::NoCubemap { layers: 1, .. })
        ));
    }
}
