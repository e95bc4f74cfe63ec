//! Diffuse materials and their textures. All light is linear RGB.

use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3, Vec4};

/// Addressing mode of texture coordinates outside [0, 1].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Wrap {
    /// The texture repeats.
    #[default]
    Repeat,
    /// The texture repeats and is mirrored in every second repetition.
    Mirror,
    /// The border texel extends to infinity.
    Clamp,
}

impl Wrap {
    fn texel(self, i: i64, size: u32) -> u32 {
        let n = i64::from(size);
        let wrapped = match self {
            Self::Repeat => i.rem_euclid(n),
            Self::Mirror => {
                let m = i.rem_euclid(2 * n);
                m.min(2 * n - 1 - m)
            }
            Self::Clamp => i.clamp(0, n - 1),
        };
        wrapped as u32
    }
}

/// Image of 8 bits per channel with straight alpha. (0, 0) is the upper left corner of the first
/// texel, as in glTF.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    width: u32,
    height: u32,
    texels: Vec<[u8; 4]>,
    wrap: [Wrap; 2],
}

impl Texture {
    /// Creates a texture of `width` × `height` texels, row by row from the top. `None` if the
    /// number of texels does not match or is zero.
    #[must_use]
    pub fn new(width: u32, height: u32, texels: Vec<[u8; 4]>, wrap: [Wrap; 2]) -> Option<Self> {
        let count = u64::from(width) * u64::from(height);
        (count > 0 && count == texels.len() as u64).then_some(Self {
            width,
            height,
            texels,
            wrap,
        })
    }

    /// Returns the number of texels.
    #[cfg(feature = "gltf")]
    pub(super) fn len(&self) -> u64 {
        self.texels.len() as u64
    }

    fn texel(&self, x: i64, y: i64) -> [u8; 4] {
        let x = self.wrap[0].texel(x, self.width);
        let y = self.wrap[1].texel(y, self.height);
        self.texels[(y * self.width + x) as usize]
    }

    /// Returns the four texels around `uv` and the weights between them for bilinear filtering.
    fn bilinear_texels(&self, uv: Vec2) -> ([[u8; 4]; 4], Vec2) {
        let at = uv * Vec2::new(self.width as f32, self.height as f32) - Vec2::splat(0.5);
        // Coordinates beyond the range of texel indices have no meaningful texel.
        let at = if at.is_finite() {
            at.clamp(Vec2::splat(-1e9), Vec2::splat(1e9))
        } else {
            Vec2::ZERO
        };
        let floor = at.floor();
        let (x, y) = (floor.x as i64, floor.y as i64);
        (
            [
                self.texel(x, y),
                self.texel(x + 1, y),
                self.texel(x, y + 1),
                self.texel(x + 1, y + 1),
            ],
            at - floor,
        )
    }

    fn blend(&self, uv: Vec2, decode: impl Fn([u8; 4]) -> Vec4) -> Vec4 {
        let ([a, b, c, d], f) = self.bilinear_texels(uv);
        let top = decode(a) * (1.0 - f.x) + decode(b) * f.x;
        let bottom = decode(c) * (1.0 - f.x) + decode(d) * f.x;
        top * (1.0 - f.y) + bottom * f.y
    }

    /// Returns the color at `uv`. sRGB is decoded to linear before filtering. Alpha is linear.
    #[must_use]
    pub fn color(&self, uv: Vec2) -> Vec4 {
        let table = srgb_table();
        let linear = |i: u8| table[usize::from(i)];
        self.blend(uv, |t| {
            Vec4::new(
                linear(t[0]),
                linear(t[1]),
                linear(t[2]),
                f32::from(t[3]) / 255.0,
            )
        })
    }

    /// Returns the texel values at `uv` in [0, 1], without decoding.
    #[must_use]
    pub fn data(&self, uv: Vec2) -> Vec4 {
        self.blend(uv, |t| Vec4::from_array(t.map(f32::from)) / 255.0)
    }

    /// Returns alpha at `uv`.
    #[must_use]
    pub fn alpha(&self, uv: Vec2) -> f32 {
        let ([a, b, c, d], f) = self.bilinear_texels(uv);
        let [a, b, c, d] = [a, b, c, d].map(|t| f32::from(t[3]) / 255.0);
        (a * (1.0 - f.x) + b * f.x) * (1.0 - f.y) + (c * (1.0 - f.x) + d * f.x) * f.y
    }

    /// Returns `false` only if no texel in the bounding box of these coordinates has an alpha of
    /// `min_alpha` or more. A box with a very large number of texels returns `true`.
    #[must_use]
    pub fn may_reach_alpha(&self, corners: [Vec2; 3], min_alpha: f32) -> bool {
        const MAX: i64 = 1 << 14;
        let size = Vec2::new(self.width as f32, self.height as f32);
        let corners = corners.map(|uv| uv * size - Vec2::splat(0.5));
        if !corners
            .iter()
            .all(|c| c.is_finite() && c.abs().max_element() < 1e9)
        {
            return true;
        }
        let min = corners[0].min(corners[1]).min(corners[2]).floor();
        let max = corners[0].max(corners[1]).max(corners[2]).floor() + Vec2::ONE;
        let (x0, y0, x1, y1) = (min.x as i64, min.y as i64, max.x as i64, max.y as i64);
        if (x1 - x0 + 1).saturating_mul(y1 - y0 + 1) > MAX {
            return true;
        }
        (y0..=y1).any(|y| (x0..=x1).any(|x| f32::from(self.texel(x, y)[3]) / 255.0 >= min_alpha))
    }

    /// Adds all properties that a bake reads to `hasher`.
    pub fn add_to_hash(&self, hasher: &mut blake3::Hasher) {
        hasher.update(&self.width.to_le_bytes());
        hasher.update(&self.height.to_le_bytes());
        hasher.update(&self.wrap.map(|w| w as u8));
        hasher.update(bytemuck::cast_slice(&self.texels));
    }
}

/// Returns the linear values of sRGB codes (IEC 61966-2-1). The power function gives the same bits
/// on every machine.
pub(super) fn srgb_table() -> &'static [f32; 256] {
    static TABLE: std::sync::OnceLock<[f32; 256]> = std::sync::OnceLock::new();
    TABLE.get_or_init(|| {
        std::array::from_fn(|i| {
            let c = i as f64 / 255.0;
            let linear = if c <= 0.04045 {
                c / 12.92
            } else {
                libm::pow((c + 0.055) / 1.055, 2.4)
            };
            linear as f32
        })
    })
}

/// Diffuse material: glTF's metallic-roughness model without its specular part. Textures are
/// indices into the textures of the mesh. Each uses its own texture coordinates
/// ([`super::TriangleUvs`]).
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Linear RGB in [0, 1], and alpha.
    pub base_color: Vec4,
    /// Texture that multiplies `base_color`: sRGB color, linear alpha.
    pub base_color_texture: Option<u32>,
    /// Metallic fraction of the surface, 0 to 1. Metal has no diffuse reflection.
    pub metallic: f32,
    /// Texture with a blue channel that multiplies `metallic`.
    pub metallic_texture: Option<u32>,
    /// Emitted radiance, W/(m² sr), linear RGB.
    pub emissive: Vec3,
    /// Texture that multiplies `emissive`: sRGB.
    pub emissive_texture: Option<u32>,
    /// `false` if the back reflects and emits nothing. The back still blocks light.
    pub double_sided: bool,
    /// Alpha below which there is no surface. `None` ignores alpha.
    pub alpha_cutoff: Option<f32>,
    /// Name, possibly empty. Not part of the content hash.
    pub name: String,
}

/// Values of a material that can change at run time. Its textures cannot change.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct MaterialFactors {
    /// Linear RGB in [0, 1].
    pub base_color: [f32; 3],
    /// Emitted radiance, W/(m² sr), linear RGB.
    pub emissive: [f32; 3],
}

impl Default for Material {
    fn default() -> Self {
        Self::diffuse(Vec3::splat(0.5))
    }
}

impl Material {
    /// Creates a double-sided surface that reflects `albedo` and emits nothing.
    #[must_use]
    pub fn diffuse(albedo: Vec3) -> Self {
        Self {
            base_color: albedo.extend(1.0),
            base_color_texture: None,
            metallic: 0.0,
            metallic_texture: None,
            emissive: Vec3::ZERO,
            emissive_texture: None,
            double_sided: true,
            alpha_cutoff: None,
            name: String::new(),
        }
    }

    /// Creates a double-sided surface that reflects `albedo` and emits `radiance`, W/(m² sr).
    #[must_use]
    pub fn emissive(albedo: Vec3, radiance: Vec3) -> Self {
        Self {
            emissive: radiance,
            ..Self::diffuse(albedo)
        }
    }

    /// Returns the factors.
    #[must_use]
    pub fn factors(&self) -> MaterialFactors {
        MaterialFactors {
            base_color: self.base_color.truncate().to_array(),
            emissive: self.emissive.to_array(),
        }
    }

    pub(super) fn textures(&self) -> [Option<u32>; 3] {
        [
            self.base_color_texture,
            self.metallic_texture,
            self.emissive_texture,
        ]
    }

    /// Adds all properties that a bake reads to `hasher`.
    pub fn add_to_hash(&self, hasher: &mut blake3::Hasher) {
        for x in self
            .base_color
            .to_array()
            .into_iter()
            .chain([self.metallic])
            .chain(self.emissive.to_array())
        {
            hasher.update(&x.to_le_bytes());
        }
        for texture in self.textures() {
            hasher.update(&texture.map_or(u32::MAX, |t| t).to_le_bytes());
        }
        hasher.update(&[u8::from(self.double_sided)]);
        hasher.update(&self.alpha_cutoff.unwrap_or(f32::NEG_INFINITY).to_le_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checks(wrap: Wrap) -> Texture {
        let texels = vec![
            [0, 0, 0, 255],
            [255, 255, 255, 0],
            [188, 188, 188, 128],
            [0, 255, 0, 255],
        ];
        Texture::new(2, 2, texels, [wrap; 2]).unwrap()
    }

    #[test]
    fn texture_sample_is_exact_at_texel_centers_and_linear() {
        let t = checks(Wrap::Repeat);
        assert_eq!(
            t.color(Vec2::new(0.25, 0.25)),
            Vec4::new(0.0, 0.0, 0.0, 1.0)
        );
        assert_eq!(
            t.color(Vec2::new(0.75, 0.75)),
            Vec4::new(0.0, 1.0, 0.0, 1.0)
        );
        // sRGB 188 is 0.5029 in linear light.
        assert!((t.color(Vec2::new(0.25, 0.75)).x - 0.5029).abs() < 1e-4);
        assert!((t.data(Vec2::new(0.25, 0.75)).x - 188.0 / 255.0).abs() < 1e-6);
        // Half way between black and white in linear light.
        assert!((t.color(Vec2::new(0.5, 0.25)).x - 0.5).abs() < 1e-6);
        assert!((t.alpha(Vec2::new(0.5, 0.25)) - 0.5).abs() < 1e-6);
    }

    #[test]
    fn texture_wrap_modes_repeat_mirror_and_clamp() {
        let left = |wrap: Wrap, u: f32| checks(wrap).color(Vec2::new(u, 0.25)).x;
        assert_eq!(left(Wrap::Repeat, 1.25), 0.0);
        assert_eq!(left(Wrap::Mirror, 1.25), 1.0);
        assert_eq!(left(Wrap::Clamp, 7.0), 1.0);
        assert_eq!(left(Wrap::Repeat, -0.25), 1.0);
        assert_eq!(left(Wrap::Mirror, -0.25), 0.0);
        for wild in [f32::NAN, f32::INFINITY, 1e38] {
            assert!(left(Wrap::Repeat, wild).is_finite());
        }
    }

    #[test]
    fn alpha_mask_detects_fully_transparent_triangles() {
        let mut texels = vec![[0u8; 4]; 64];
        texels[9][3] = 255;
        let t = Texture::new(8, 8, texels, [Wrap::Repeat; 2]).unwrap();
        let at = |x: f32, y: f32| Vec2::new(x, y);
        assert!(t.may_reach_alpha([at(0.1, 0.1), at(0.2, 0.1), at(0.1, 0.2)], 0.5));
        assert!(!t.may_reach_alpha([at(0.5, 0.5), at(0.8, 0.5), at(0.5, 0.8)], 0.5));
        assert!(
            t.may_reach_alpha([at(1.5, 0.5), at(2.2, 0.1), at(1.5, 1.2)], 0.5),
            "wraps around"
        );
    }
}
