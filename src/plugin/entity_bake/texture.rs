//! A Bevy image as a texture of the bake.

use bevy::color::{ColorToComponents, ColorToPacked, LinearRgba, Srgba};
use bevy::image::{Image, ImageAddressMode, ImageSampler, TextureFormatPixelInfo};
use bevy::render::render_resource::{TextureDimension, TextureFormat};
use meshless_gi::{Texture, Wrap};

/// Encoding of a texture's texels in the bake.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Encoding {
    /// sRGB.
    Color,
    /// Linear numbers.
    Data,
}

/// Returns the reason why an image can't be read, and the remedy. `None` if it can.
pub(super) fn unreadable(image: &Image) -> Option<String> {
    let format = image.texture_descriptor.format;
    if image.is_compressed() {
        return Some(format!(
            "format {format:?} is compressed; use an uncompressed image (PNG, JPEG)"
        ));
    }
    if image.data.is_none() {
        return Some(
            "it is in the render world alone; give it `RenderAssetUsages::MAIN_WORLD` \
             (glTF: `GltfLoaderSettings::load_materials`)"
                .into(),
        );
    }
    if image.texture_descriptor.dimension != TextureDimension::D2 {
        return Some("it is not two-dimensional".into());
    }
    let (width, height) = (image.width(), image.height());
    if width == 0 || height == 0 {
        return Some("it has no texels".into());
    }
    let texel = format.pixel_size().unwrap_or(0) as u64;
    let needed = texel * u64::from(width) * u64::from(height);
    let bytes = image.data.as_ref().map_or(0, Vec::len) as u64;
    if texel == 0 || bytes < needed {
        return Some(format!(
            "{width} x {height} texels of format {format:?} do not fit into its {bytes} bytes"
        ));
    }
    let unsupported = image.get_color_at(0, 0).err()?;
    Some(format!("{unsupported}; `Rgba8UnormSrgb` is supported"))
}

/// The image as a texture. `None` if it is [`unreadable`]. Values above 1 are clamped.
pub(super) fn texture(image: &Image, encoding: Encoding) -> Option<Texture> {
    let (width, height) = (image.width(), image.height());
    let own = match image.texture_descriptor.format {
        TextureFormat::Rgba8UnormSrgb => Some(Encoding::Color),
        TextureFormat::Rgba8Unorm => Some(Encoding::Data),
        _ => None,
    };
    let texels = if own == Some(encoding) {
        // The first level of detail comes first.
        let count = width as usize * height as usize;
        let bytes = image.data.as_ref()?.get(..4 * count)?;
        let texel = |t: &[u8]| [t[0], t[1], t[2], t[3]];
        bytes.chunks_exact(4).map(texel).collect()
    } else {
        let gray = is_single_channel(image.texture_descriptor.format);
        let at = |(x, y): (u32, u32)| {
            let mut color = LinearRgba::from(image.get_color_at(x, y).ok()?);
            if gray {
                // Bevy's shaders read one channel as red.
                (color.green, color.blue) = (0.0, 0.0);
            }
            Some(encode(color, encoding))
        };
        let all = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        all.map(at).collect::<Option<Vec<_>>>()?
    };
    Texture::new(width, height, texels, wraps(&image.sampler))
}

fn encode(color: LinearRgba, encoding: Encoding) -> [u8; 4] {
    match encoding {
        Encoding::Color => Srgba::from(color).to_u8_array(),
        Encoding::Data => {
            let byte = |v: f32| (255.0 * v.clamp(0.0, 1.0) + 0.5) as u8;
            color.to_f32_array().map(byte)
        }
    }
}

fn is_single_channel(format: TextureFormat) -> bool {
    matches!(
        format,
        TextureFormat::R8Unorm
            | TextureFormat::R16Unorm
            | TextureFormat::R16Float
            | TextureFormat::R32Float
    )
}

/// Texture coordinates outside of [0, 1]. `ImageSampler::Default` is Bevy's own default, which
/// clamps.
fn wraps(sampler: &ImageSampler) -> [Wrap; 2] {
    match sampler {
        ImageSampler::Default => [Wrap::Clamp; 2],
        ImageSampler::Descriptor(d) => {
            [d.address_mode_u, d.address_mode_v].map(|mode| match mode {
                ImageAddressMode::ClampToEdge | ImageAddressMode::ClampToBorder => Wrap::Clamp,
                ImageAddressMode::Repeat => Wrap::Repeat,
                ImageAddressMode::MirrorRepeat => Wrap::Mirror,
            })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::asset::RenderAssetUsages;
    use bevy::math::Vec2;
    use bevy::render::render_resource::Extent3d;

    fn image(format: TextureFormat, data: Vec<u8>) -> Image {
        let size = Extent3d {
            width: 2,
            height: 1,
            depth_or_array_layers: 1,
        };
        let usages = RenderAssetUsages::default();
        Image::new(size, TextureDimension::D2, data, format, usages)
    }

    #[test]
    fn color_and_data_are_encoded_as_they_are_sampled() {
        let bytes = vec![188, 0, 255, 128, 10, 20, 30, 40];
        let left = Vec2::new(0.25, 0.5);
        let srgb = image(TextureFormat::Rgba8UnormSrgb, bytes.clone());
        let linear = image(TextureFormat::Rgba8Unorm, bytes);
        let near = |a: f32, b: f32| assert!((a - b).abs() < 0.004, "{a} {b}");
        // sRGB 188 is 0.5029 in linear light.
        let color = texture(&srgb, Encoding::Color).unwrap().color(left);
        near(color.x, 0.5029);
        near(color.w, 128.0 / 255.0);
        let color = texture(&linear, Encoding::Color).unwrap().color(left);
        near(color.x, 188.0 / 255.0);
        near(texture(&srgb, Encoding::Data).unwrap().data(left).x, 0.5029);
        near(
            texture(&linear, Encoding::Data).unwrap().data(left).x,
            188.0 / 255.0,
        );
    }

    #[test]
    fn single_channels_are_red_and_floats_are_clamped() {
        let red = image(TextureFormat::R8Unorm, vec![255, 0]);
        let texel = |image: &Image| {
            let texture = texture(image, Encoding::Data).unwrap();
            texture.data(Vec2::new(0.25, 0.5)).to_array()
        };
        assert_eq!(texel(&red), [1.0, 0.0, 0.0, 1.0]);
        let floats = [7.0f32, 0.5, -1.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let bytes = floats.iter().flat_map(|f| f.to_le_bytes()).collect();
        let [r, g, b, a] = texel(&image(TextureFormat::Rgba32Float, bytes));
        assert_eq!([r, b, a], [1.0, 0.0, 1.0]);
        assert!((g - 0.5).abs() < 0.003);
    }

    #[test]
    fn compressed_and_extracted_images_are_unreadable() {
        let mut extracted = image(TextureFormat::Rgba8UnormSrgb, vec![0; 8]);
        assert_eq!(unreadable(&extracted), None);
        extracted.data = None;
        assert!(unreadable(&extracted).unwrap().contains("MAIN_WORLD"));
        let mut compressed = image(TextureFormat::Rgba8UnormSrgb, vec![0; 8]);
        compressed.texture_descriptor.format = TextureFormat::Bc1RgbaUnormSrgb;
        assert!(unreadable(&compressed).unwrap().contains("compressed"));
        let mut short = image(TextureFormat::Rgba8UnormSrgb, vec![0; 8]);
        short.data = Some(vec![0; 3]);
        assert!(unreadable(&short).is_some());
    }
}
