//! Materials, textures and images of a glTF file.

use super::super::{Material, SceneError, Texture, Wrap};
use super::accessor::Buffers;
use super::{Resolver, container};
use ::gltf::json::texture::{Info, WrappingMode};
use ::gltf::json::validation::Checked;
use ::gltf::json::{self, material::AlphaMode};
use glam::{Vec2, Vec3, Vec4};
use image::{DynamicImage, ImageDecoder};
use std::io::Cursor;

/// Largest width and height of an image, texels.
const MAX_IMAGE_EDGE: u32 = 16_384;
/// Largest decoded image, bytes.
const MAX_IMAGE: u64 = 1 << 30;
/// Largest memory for the metadata of an image, such as color profiles, bytes.
const MAX_METADATA: u64 = 1 << 26;
/// Largest number of pixels per byte of a file. DEFLATE (RFC 1951) expands one byte to at most 1032
/// bytes, and a decompressed byte of a PNG has at most 8 pixels. JPEG has fewer pixels per byte: a
/// block of 64 takes at least one bit.
const MAX_PIXELS_PER_BYTE: u64 = 8 * 1032;

/// Texture coordinate set of a texture, and its transform (KHR_texture_transform).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct TexturePlacement {
    /// Number of the coordinate set. `None` if the material has no such texture.
    pub(super) set: Option<u32>,
    offset: Vec2,
    rotation: f32,
    scale: Vec2,
}

impl TexturePlacement {
    fn from_info(info: Option<&Info>) -> Self {
        let Some(info) = info else {
            return Self::default();
        };
        let transform = info
            .extensions
            .as_ref()
            .and_then(|e| e.texture_transform.as_ref());
        Self {
            set: Some(
                transform
                    .and_then(|t| t.tex_coord)
                    .unwrap_or(info.tex_coord),
            ),
            offset: transform.map_or(Vec2::ZERO, |t| Vec2::from_array(t.offset.0)),
            rotation: transform.map_or(0.0, |t| t.rotation.0),
            scale: transform.map_or(Vec2::ONE, |t| Vec2::from_array(t.scale.0)),
        }
    }

    /// Transforms a texture coordinate of the mesh: scale, rotation, translation.
    pub(super) fn apply(&self, uv: Vec2) -> Vec2 {
        let (s, c) = (libm::sinf(self.rotation), libm::cosf(self.rotation));
        let p = uv * self.scale;
        Vec2::new(c * p.x + s * p.y, c * p.y - s * p.x) + self.offset
    }
}

/// Material with the placements of its base color, metallic and emissive texture.
pub(super) struct PlacedMaterial {
    pub(super) material: Material,
    pub(super) placements: [TexturePlacement; 3],
}

/// Returns the material of a primitive without a material: white and not metallic, as viewers
/// display it. The format's default is fully metallic, which has no diffuse reflection.
pub(super) fn plain() -> PlacedMaterial {
    PlacedMaterial {
        material: Material {
            double_sided: false,
            ..Material::diffuse(Vec3::ONE)
        },
        placements: [TexturePlacement::default(); 3],
    }
}

pub(super) fn material(m: &json::Material, textures: usize) -> Result<PlacedMaterial, String> {
    let index = |info: &Option<Info>| match info.as_ref().map(|i| i.index.value()) {
        Some(i) if i >= textures => Err(format!("texture {i} is not there")),
        other => Ok(other.map(|i| i as u32)),
    };
    let extensions = m.extensions.as_ref();
    let glossy = extensions.and_then(|e| e.pbr_specular_glossiness.as_ref());
    let pbr = &m.pbr_metallic_roughness;
    let strength = extensions
        .and_then(|e| e.emissive_strength.as_ref())
        .map_or(1.0, |e| e.emissive_strength.0);
    let (base, base_info, metallic, metallic_info) = match glossy {
        // The light that is not reflected specularly remains for diffuse reflection.
        Some(g) => {
            let [r, gr, b] = g.specular_factor.0;
            let textured = g.specular_glossiness_texture.is_some();
            let mirrored = if textured { 0.0 } else { r.max(gr).max(b) };
            (g.diffuse_factor.0, &g.diffuse_texture, mirrored, &None)
        }
        None => (
            pbr.base_color_factor.0,
            &pbr.base_color_texture,
            pbr.metallic_factor.0,
            &pbr.metallic_roughness_texture,
        ),
    };
    let Checked::Valid(mode) = m.alpha_mode else {
        return Err("its alpha mode is not known".into());
    };
    Ok(PlacedMaterial {
        material: Material {
            base_color: Vec4::from_array(base),
            base_color_texture: index(base_info)?,
            metallic,
            metallic_texture: index(metallic_info)?,
            emissive: Vec3::from_array(m.emissive_factor.0) * strength,
            emissive_texture: index(&m.emissive_texture)?,
            double_sided: m.double_sided,
            alpha_cutoff: match mode {
                AlphaMode::Opaque => None,
                AlphaMode::Mask => Some(m.alpha_cutoff.map_or(0.5, |c| c.0)),
                // Transparency is binary: alpha of at least 0.5 is opaque.
                AlphaMode::Blend => Some(0.5),
            },
            name: m.name.clone().unwrap_or_default(),
        },
        placements: [
            TexturePlacement::from_info(base_info.as_ref()),
            TexturePlacement::from_info(metallic_info.as_ref()),
            TexturePlacement::from_info(m.emissive_texture.as_ref()),
        ],
    })
}

/// Decodes the texture with index `i`, which may have at most `left` texels.
pub(super) fn texture(
    file: &str,
    buffers: &Buffers<'_>,
    i: usize,
    left: u64,
    resolve: &mut Resolver<'_>,
) -> Result<Texture, SceneError> {
    let root = buffers.root;
    let texture = &root.textures[i];
    let image_index = texture.source.value();
    let wrong = |reason: String| SceneError::Image {
        file: file.into(),
        image: image_index,
        reason,
    };
    let image = root
        .images
        .get(image_index)
        .ok_or_else(|| wrong("it is not there".into()))?;
    let owned;
    let bytes: &[u8] = match (&image.buffer_view, &image.uri) {
        (Some(view), _) => buffers.view(*view).map_err(wrong)?,
        (None, Some(uri)) => {
            owned = match container::data_uri(uri) {
                Some(bytes) => bytes.map_err(wrong)?,
                None => resolve(&container::file_name(uri))?,
            };
            &owned
        }
        (None, None) => return Err(wrong("it has neither a buffer view nor a URI".into())),
    };
    let wrap = match texture.sampler {
        None => [Wrap::Repeat; 2],
        Some(s) => {
            let sampler = root
                .samplers
                .get(s.value())
                .ok_or_else(|| wrong(format!("sampler {} is not there", s.value())))?;
            [sampler.wrap_s, sampler.wrap_t].map(|w| match w {
                Checked::Valid(WrappingMode::ClampToEdge) => Wrap::Clamp,
                Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::Mirror,
                _ => Wrap::Repeat,
            })
        }
    };
    let (width, height, texels) = decode(bytes, left).map_err(wrong)?;
    Texture::new(width, height, texels, wrap).ok_or_else(|| wrong("it has no texel".into()))
}

/// Decodes an image of at most `left` texels. No memory is allocated for pixels that the bytes
/// cannot contain.
fn decode(bytes: &[u8], left: u64) -> Result<(u32, u32, Vec<[u8; 4]>), String> {
    let mut reader = image::ImageReader::new(Cursor::new(bytes))
        .with_guessed_format()
        .map_err(|e| e.to_string())?;
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(MAX_IMAGE_EDGE);
    limits.max_image_height = Some(MAX_IMAGE_EDGE);
    limits.max_alloc = Some(MAX_METADATA);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|e| e.to_string())?;
    let (width, height) = decoder.dimensions();
    let pixels = u64::from(width) * u64::from(height);
    let held = MAX_PIXELS_PER_BYTE.saturating_mul(bytes.len() as u64);
    if pixels > held.min(left) || decoder.total_bytes() > MAX_IMAGE {
        let size = bytes.len();
        return Err(match pixels > held {
            true => format!("{width} x {height} pixels do not fit in {size} bytes"),
            false => format!("{width} x {height} pixels exceed the remaining limit of {left}"),
        });
    }
    let image = DynamicImage::from_decoder(decoder).map_err(|e| e.to_string())?;
    let texels = image.into_rgba8().into_raw();
    let texels = texels.chunks_exact(4).map(|t| [t[0], t[1], t[2], t[3]]);
    Ok((width, height, texels.collect()))
}
