//! A `StandardMaterial` as a material of the bake.

use super::texture::Encoding;
use bevy::asset::Handle;
use bevy::color::LinearRgba;
use bevy::image::Image;
use bevy::material::AlphaMode;
use bevy::math::{Affine2, Vec3, Vec4};
use bevy::mesh::UvChannel;
use bevy::pbr::StandardMaterial;
use bevy::render::render_resource::Face;
use meshless_gi::Material;

/// A material with its textures: base color, metallic, emissive.
#[derive(Clone, Debug)]
pub(super) struct SurfaceMaterial {
    /// Factors of the material. Its texture indices are not set.
    pub(super) material: Material,
    pub(super) textures: [Option<SurfaceTexture>; 3],
    /// Transform from the mesh's texture coordinates to those of the textures.
    pub(super) uv_transform: Affine2,
}

/// A texture of a material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SurfaceTexture {
    /// Index of the collected image.
    pub(super) image: usize,
    /// Number of the texture coordinates, 0 or 1.
    pub(super) channel: usize,
}

/// Names of a material's textures, in their order.
pub(super) const TEXTURES: [&str; 3] = ["base color", "metallic", "emissive"];

/// Encodings of a material's textures, in their order.
pub(super) const ENCODINGS: [Encoding; 3] = [Encoding::Color, Encoding::Data, Encoding::Color];

/// Returns the images of a material's textures, in their order. Textures with a factor of zero are
/// left out.
pub(super) fn images_of(material: &StandardMaterial) -> [Option<&Handle<Image>>; 3] {
    let metallic = material.metallic != 0.0;
    let emissive = emissive(material) != Vec3::ZERO;
    [
        material.base_color_texture.as_ref(),
        (material.metallic_roughness_texture.as_ref()).filter(|_| metallic),
        material.emissive_texture.as_ref().filter(|_| emissive),
    ]
}

/// Texture coordinates of a material's textures, in their order.
pub(super) fn channels_of(material: &StandardMaterial) -> [usize; 3] {
    [
        &material.base_color_channel,
        &material.metallic_roughness_channel,
        &material.emissive_channel,
    ]
    .map(|channel| match channel {
        UvChannel::Uv0 => 0,
        UvChannel::Uv1 => 1,
    })
}

/// Returns `true` if both sides of a surface reflect and emit. A material without back-face culling
/// belongs to a mirrored mesh (bevy_gltf makes such copies), or is double-sided.
pub(super) fn is_double_sided(material: &StandardMaterial, mirrored: bool) -> bool {
    material.double_sided
        || match material.cull_mode {
            None => true,
            Some(Face::Front) => !mirrored,
            Some(Face::Back) => false,
        }
}

/// The factors of a material.
pub(super) fn factors(material: &StandardMaterial, double_sided: bool) -> Material {
    let color = LinearRgba::from(material.base_color);
    Material {
        base_color: Vec4::new(color.red, color.green, color.blue, color.alpha),
        metallic: material.metallic,
        emissive: emissive(material),
        double_sided,
        alpha_cutoff: match material.alpha_mode {
            AlphaMode::Opaque => None,
            AlphaMode::Mask(cutoff) => Some(cutoff),
            // Light passes or does not: a surface that is more opaque than not is opaque.
            _ => Some(0.5),
        },
        ..Material::default()
    }
}

/// The surface of a mesh whose material is not a `StandardMaterial`, or missing.
pub(super) fn neutral() -> SurfaceMaterial {
    SurfaceMaterial {
        material: Material::diffuse(Vec3::splat(0.5)),
        textures: [None; 3],
        uv_transform: Affine2::IDENTITY,
    }
}

fn emissive(material: &StandardMaterial) -> Vec3 {
    let LinearRgba {
        red, green, blue, ..
    } = material.emissive;
    Vec3::new(red, green, blue)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::color::Color;

    #[test]
    fn factors_and_sides_follow_the_standard_material() {
        let mut material = StandardMaterial {
            base_color: Color::linear_rgba(0.1, 0.2, 0.3, 0.4),
            emissive: LinearRgba::rgb(1.0, 2.0, 3.0),
            metallic: 0.25,
            alpha_mode: AlphaMode::Mask(0.7),
            ..StandardMaterial::default()
        };
        let own = factors(&material, false);
        assert_eq!(own.base_color, Vec4::new(0.1, 0.2, 0.3, 0.4));
        assert_eq!(own.emissive, Vec3::new(1.0, 2.0, 3.0));
        assert_eq!((own.metallic, own.alpha_cutoff), (0.25, Some(0.7)));
        for (cull_mode, mirrored, double_sided) in [
            (Some(Face::Back), false, false),
            (Some(Face::Back), true, false),
            (Some(Face::Front), true, false),
            (Some(Face::Front), false, true),
            (None, false, true),
        ] {
            material.cull_mode = cull_mode;
            assert_eq!(is_double_sided(&material, mirrored), double_sided);
        }
        material.cull_mode = Some(Face::Back);
        material.double_sided = true;
        assert!(is_double_sided(&material, false));
    }

    #[test]
    fn textures_without_effect_are_not_read() {
        let handle = Some(Handle::default());
        let mut material = StandardMaterial {
            base_color_texture: handle.clone(),
            metallic_roughness_texture: handle.clone(),
            emissive_texture: handle,
            ..StandardMaterial::default()
        };
        let read = |m: &StandardMaterial| images_of(m).map(|image| image.is_some());
        assert_eq!(read(&material), [true, false, false]);
        material.metallic = 1.0;
        material.emissive = LinearRgba::WHITE;
        assert_eq!(read(&material), [true; 3]);
    }
}
