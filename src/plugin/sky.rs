//! [`GiSky`]: radiance of the sky of a baked scene, uniform, from a gradient or from a cubemap.
//!
//! The sky lights the scene through the bake and is not drawn: the background (`Skybox`, a clear
//! color) is independent of it. Bevy's own environment light is added to it, which
//! [`check`](super::validation) reports.

use bevy::asset::{Assets, RenderAssetUsages};
use bevy::color::{ColorToComponents, LinearRgba};
use bevy::ecs::prelude::*;
use bevy::image::{Image, TextureFormatPixelInfo};
use bevy::light::EnvironmentMapLight;
use bevy::math::{Quat, Vec3};
use bevy::reflect::prelude::*;
use bevy::render::render_resource::{TextureDataOrder, TextureDimension, TextureFormat};
use meshless_gi::SkyRadiance;

/// Radiance of the sky of a baked scene, in [`GiEnvironment`](super::GiEnvironment).
#[derive(Reflect, Clone, Copy, Debug, Default, PartialEq)]
#[reflect(Default, Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum GiSky {
    /// No light from the sky.
    #[default]
    None,
    /// The same radiance from every direction, cd/m². Negative values count as 0.
    Uniform(LinearRgba),
    /// Second-order spherical harmonics in world axes: L(ω) = c + d·ω + ω·Q ω in cd/m², with Q
    /// symmetric and trace-free. Coefficients: c; d (x, y, z); Q_xx, Q_yy, Q_xy, Q_xz, Q_yz, each
    /// in linear RGB. Values that are not finite disable the sky.
    ///
    /// Bake with `sky: Harmonics` in the recipe. Other bakes use the mean over all directions, with
    /// one warning.
    Harmonics([Vec3; 9]),
}

/// Reason that a cubemap gives no sky.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum GiSkyError {
    /// The image does not have six square layers.
    #[error("{width} × {height} texels in {layers} layers are not a cubemap")]
    NoCubemap {
        /// Texels across.
        width: u32,
        /// Texels down.
        height: u32,
        /// Layers.
        layers: u32,
    },
    /// The texels are only on the GPU. Load the image with [`RenderAssetUsages::MAIN_WORLD`].
    #[error("the image has no texels on the CPU: load it with `RenderAssetUsages::default()`")]
    NoData,
    /// The environment light's `specular_map` is not loaded.
    #[error("the environment map is not loaded")]
    NotLoaded,
    /// The format of the texels cannot be read on the CPU.
    #[error("texels of this format cannot be read: {0}")]
    Format(String),
}

impl GiSky {
    /// Creates a gradient of three colors, cd/m²: at the zenith, at the horizon and at the nadir
    /// ([`SkyRadiance::gradient`]).
    #[must_use]
    pub fn gradient(zenith: LinearRgba, horizon: LinearRgba, ground: LinearRgba) -> Self {
        let [zenith, horizon, ground] = [zenith, horizon, ground].map(|c| c.to_vec3());
        SkyRadiance::gradient(zenith, horizon, ground).into()
    }

    /// Creates the sky of a cubemap in the orientation of `Skybox`. `brightness` is the radiance of
    /// a texel of 1, cd/m².
    ///
    /// # Errors
    /// [`GiSkyError`], for example for compressed texels.
    pub fn from_cubemap(image: &Image, brightness: f32) -> Result<Self, GiSkyError> {
        Self::from_image(image, brightness, Quat::IDENTITY)
    }

    /// Creates the sky of one of Bevy's environment lights from the largest level of its
    /// `specular_map`, with its rotation and intensity. Remove the light or set a black
    /// `diffuse_map`, because its light counts twice otherwise.
    ///
    /// # Errors
    /// [`GiSkyError`], also if the map is not loaded yet.
    pub fn from_environment_map(
        light: &EnvironmentMapLight,
        images: &Assets<Image>,
    ) -> Result<Self, GiSkyError> {
        let map = images.get(&light.specular_map);
        let map = map.ok_or(GiSkyError::NotLoaded)?;
        Self::from_image(map, light.intensity, light.rotation)
    }

    /// Creates the sky of a cubemap with this rotation.
    fn from_image(image: &Image, brightness: f32, rotation: Quat) -> Result<Self, GiSkyError> {
        let size = image.texture_descriptor.size;
        let (n, layers) = (size.width, size.depth_or_array_layers);
        if layers != 6 || n != size.height || n == 0 {
            return Err(GiSkyError::NoCubemap {
                width: n,
                height: size.height,
                layers,
            });
        }
        if image.data.is_none() {
            debug_assert!(!image.asset_usage.contains(RenderAssetUsages::MAIN_WORLD));
            return Err(GiSkyError::NoData);
        }
        let texels = texels(image)?;
        let mut samples = Vec::with_capacity(texels.len());
        for (k, radiance) in (0..).zip(texels) {
            let (x, y, face) = (k % n, k / n % n, k / (n * n));
            let at = |k: u32| (2 * k + 1) as f32 / n as f32 - 1.0;
            let way = texel_direction(face, at(x), at(y));
            // A texel's solid angle falls with the cube of its distance. Every texel counts: a sun
            // may be a few of them.
            let angle = way.length().powi(-3);
            samples.push((rotation * way.normalize(), angle, radiance * brightness));
        }
        Ok(SkyRadiance::of_map(samples).into())
    }

    /// Returns the nearest sky of the same mean that is nowhere negative
    /// ([`SkyRadiance::without_ringing`]). Use it for scenes in which the sky is visible through
    /// openings. Nine coefficients ring around a sun or a low sun's glow and give wrong colors.
    #[must_use]
    pub fn without_ringing(&self) -> Self {
        self.radiance().without_ringing().into()
    }

    /// Returns the radiance as a type of the core.
    #[must_use]
    pub fn radiance(&self) -> SkyRadiance {
        match *self {
            Self::None => SkyRadiance::from(Vec3::ZERO),
            Self::Uniform(color) => SkyRadiance::from(color.to_vec3().max(Vec3::ZERO)),
            Self::Harmonics([mean, terms @ ..]) => SkyRadiance { mean, terms },
        }
    }
}

impl From<SkyRadiance> for GiSky {
    fn from(sky: SkyRadiance) -> Self {
        let mut coefficients = [sky.mean; 9];
        coefficients[1..].copy_from_slice(&sky.terms);
        Self::Harmonics(coefficients)
    }
}

/// Linear colors of a cubemap's largest level, face by face, row by row.
fn texels(image: &Image) -> Result<Vec<Vec3>, GiSkyError> {
    let descriptor = &image.texture_descriptor;
    let format = descriptor.format;
    let wrong = |problem: String| GiSkyError::Format(problem);
    let bytes = format.pixel_size().map_err(|e| wrong(e.to_string()))?;
    let data = image.data.as_deref().ok_or(GiSkyError::NoData)?;
    let n = descriptor.size.width as usize;
    let level = |m: u32| (n >> m).max(1).pow(2) * bytes;
    let face = match image.data_order {
        TextureDataOrder::LayerMajor => (0..descriptor.mip_level_count.clamp(1, 32))
            .map(level)
            .sum(),
        TextureDataOrder::MipMajor => level(0),
    };
    let mut flat = Vec::with_capacity(6 * level(0));
    for k in 0..6 {
        let base = data.get(k * face..k * face + level(0));
        flat.extend_from_slice(base.ok_or_else(|| wrong(format!("{} bytes", data.len())))?);
    }
    if format == TextureFormat::Rgb9e5Ufloat {
        let words = flat.chunks_exact(4).map(|b| [b[0], b[1], b[2], b[3]]);
        return Ok(words
            .map(|b| shared_exponent(u32::from_le_bytes(b)))
            .collect());
    }
    let size = descriptor.size;
    let usage = RenderAssetUsages::MAIN_WORLD;
    let flat = Image::new(size, TextureDimension::D2, flat, format, usage);
    let mut found = Vec::with_capacity(6 * n * n);
    for face in 0..6 {
        for y in 0..size.height {
            for x in 0..size.width {
                let color = flat.get_color_at_3d(x, y, face);
                let color = color.map_err(|e| wrong(e.to_string()))?;
                found.push(LinearRgba::from(color).to_vec3());
            }
        }
    }
    Ok(found)
}

/// Three mantissas of nine bits, red the lowest, and their exponent of five bits above: the format
/// `Rgb9e5Ufloat`, which most environment maps have.
fn shared_exponent(word: u32) -> Vec3 {
    let scale = f32::exp2((word >> 27) as f32 - 24.0);
    Vec3::from_array([0, 9, 18].map(|k| (word >> k & 0x1ff) as f32 * scale))
}

/// Direction from the center of a cube through position (s, t) of a face, both within ±1 and t
/// downwards. Cubemaps are left-handed, the world is right-handed.
fn texel_direction(face: u32, s: f32, t: f32) -> Vec3 {
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
    use bevy::render::render_resource::Extent3d;

    fn cubemap(n: u32, color: impl Fn(Vec3) -> Vec3) -> Image {
        let mut data = Vec::new();
        for face in 0..6 {
            for y in 0..n {
                for x in 0..n {
                    let at = |k: u32| (2 * k + 1) as f32 / n as f32 - 1.0;
                    let c = color(texel_direction(face, at(x), at(y)).normalize());
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

    fn coefficients(sky: GiSky) -> [Vec3; 9] {
        let GiSky::Harmonics(coefficients) = sky else {
            panic!("{sky:?}");
        };
        coefficients
    }

    #[test]
    fn cubemap_sky_round_trips() {
        let sky = GiSky::gradient(
            LinearRgba::rgb(0.2, 0.4, 1.0),
            LinearRgba::rgb(0.8, 0.7, 0.6),
            LinearRgba::rgb(0.1, 0.1, 0.0),
        );
        let mut sky = sky.radiance();
        sky.terms[0] = Vec3::new(0.1, 0.0, 0.05);
        sky.terms[2] = Vec3::new(0.0, 0.2, 0.0);
        let found = GiSky::from_cubemap(&cubemap(32, |w| sky.toward(w)), 3.0);
        let found = coefficients(found.unwrap());
        let right = coefficients(GiSky::from(sky * 3.0));
        for (a, b) in found.iter().zip(right) {
            assert!((*a - b).length() < 0.01, "{a} {b}");
        }
    }

    #[test]
    fn cubemap_with_sun_is_deringed_by_default() {
        let sun = Vec3::new(0.8, 0.6, 0.0);
        let shines = |w: Vec3| Vec3::splat(if w.dot(sun) > 0.95 { 10.0 } else { 0.1 });
        let sky = GiSky::from_cubemap(&cubemap(32, shines), 1.0).unwrap();
        let beside = Vec3::new(-0.6, 0.8, 0.0);
        let min = |sky: &GiSky| sky.radiance().toward(beside).max_element();
        assert!(min(&sky) < -0.1, "{}", min(&sky));
        let without = sky.without_ringing();
        assert!(min(&without) > -1e-4, "{}", min(&without));
        assert_eq!(without.radiance().mean, sky.radiance().mean);
    }

    /// A map of 256 texels a side with smaller levels behind each face, in the format of
    /// environment maps: half a dozen bright texels in a dark sky.
    #[test]
    fn environment_map_with_small_sun_integrates_every_texel() {
        let n = 256u32;
        // 2¹⁰ in red, half of that in green: mantissa 256 and 128, exponent 26 (256 · 2² = 1024).
        let sun = (26u32 << 27) | (128 << 9) | 256;
        let at = [
            (100, 37),
            (101, 37),
            (100, 38),
            (101, 38),
            (102, 39),
            (103, 41),
        ];
        let mut data = Vec::new();
        for face in 0..6 {
            for level in 0..9 {
                let side = n >> level;
                for k in 0..side * side {
                    let lit = face == 2 && level == 0 && at.contains(&(k % n, k / n));
                    // The texels of smaller mip levels must not matter.
                    let word = if lit || level > 0 { sun } else { 0 };
                    data.extend(word.to_le_bytes());
                }
            }
        }
        let size = Extent3d {
            width: n,
            height: n,
            depth_or_array_layers: 6,
        };
        let usage = RenderAssetUsages::default();
        let format = TextureFormat::Rgb9e5Ufloat;
        let mut image = Image::new_fill(size, TextureDimension::D2, &[0; 4], format, usage);
        image.texture_descriptor.mip_level_count = 9;
        image.data = Some(data);
        let mut images = Assets::<Image>::default();
        let turn = Quat::from_rotation_z(-std::f32::consts::FRAC_PI_2);
        let mut light = EnvironmentMapLight {
            specular_map: images.add(image),
            intensity: 3.0,
            rotation: Quat::IDENTITY,
            ..Default::default()
        };
        let (mut mean, mut way) = (Vec3::ZERO, Vec3::ZERO);
        for (x, y) in at {
            let offset = |k: u32| (2 * k + 1) as f32 / n as f32 - 1.0;
            let to = texel_direction(2, offset(x), offset(y));
            let angle = 4.0 / (n * n) as f32 * to.length().powi(-3);
            let share = angle / (4.0 * std::f32::consts::PI);
            mean += 3.0 * share * Vec3::new(1024.0, 512.0, 0.0);
            way += to.normalize() / at.len() as f32;
        }
        let sky = GiSky::from_environment_map(&light, &images).unwrap();
        let [c, x, y, z, ..] = coefficients(sky);
        assert!((c - mean).length() < 1e-3 * mean.length(), "{c} {mean}");
        // The second coefficients of a sun: three times its mean, along its direction.
        let along = Vec3::new(x.x, y.x, z.x) / (3.0 * mean.x);
        assert!((along - way).length() < 0.01, "{along} {way}");
        light.rotation = turn;
        let sky = GiSky::from_environment_map(&light, &images).unwrap();
        let [_, x, y, z, ..] = coefficients(sky);
        let along = Vec3::new(x.x, y.x, z.x) / (3.0 * mean.x);
        assert!((along - turn * way).length() < 0.01, "{along} {way}");
        light.specular_map = Default::default();
        let none = GiSky::from_environment_map(&light, &images);
        assert_eq!(none, Err(GiSkyError::NotLoaded));
    }

    #[test]
    fn invalid_cubemap_returns_named_error() {
        let mut image = cubemap(4, |_| Vec3::ONE);
        image.data = None;
        image.asset_usage = RenderAssetUsages::RENDER_WORLD;
        let no_data = GiSky::from_cubemap(&image, 1.0);
        assert_eq!(no_data, Err(GiSkyError::NoData));
        image.texture_descriptor.size.depth_or_array_layers = 1;
        assert!(matches!(
            GiSky::from_cubemap(&image, 1.0),
            Err(GiSkyError::NoCubemap { layers: 1, .. })
        ));
    }
}
