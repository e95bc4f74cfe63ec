//! Kernel `composite`: radiance that a pixel's indirect irradiance adds to the picture, exposure ·
//! ρ E/π · occlusion. Further entry points add specular radiance and subtract soft shadows. All
//! results are blended additively (shadows by subtraction) over the lit picture, before
//! transparency and tonemapping.

use super::gbuffer;
use super::layout::CompositeParams;
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// Returns the radiance that the shader adds at a pixel. `irradiance` is the texel of `splat`.
/// `pass` is Bevy's deferred lighting pass, 0 for sky and pixels that are not deferred.
#[must_use]
pub fn composite_pixel(
    params: &CompositeParams,
    irradiance: [f32; 4],
    texel: [u32; 4],
    pass: u32,
) -> [f32; 3] {
    if pass == 0 || irradiance[3] == 0.0 || gbuffer::is_unlit(texel) {
        return [0.0; 3];
    }
    let e = Vec3::new(irradiance[0], irradiance[1], irradiance[2]);
    let color = (gbuffer::occlusion(texel) * gbuffer::diffuse(texel)).lerp(Vec3::ONE, params.white);
    (params.scale * FRAC_1_PI * color * e).to_array()
}

/// Returns the radiance that the entry point `composite_specular` adds at a pixel. `radiance` is
/// the texel of `vpl_specular_pixels`.
#[must_use]
pub fn composite_specular_pixel(
    params: &CompositeParams,
    radiance: [f32; 4],
    texel: [u32; 4],
    pass: u32,
) -> [f32; 3] {
    if pass == 0 || radiance[3] == 0.0 || gbuffer::is_unlit(texel) {
        return [0.0; 3];
    }
    let l = Vec3::new(radiance[0], radiance[1], radiance[2]);
    (params.scale * gbuffer::occlusion(texel) * l).to_array()
}

/// Returns the radiance that the entry point `composite_shadow` subtracts from a pixel. `radiance`
/// is the texel of `subtract_shadow`.
#[must_use]
pub fn composite_shadow_pixel(radiance: [f32; 4], pass: u32) -> [f32; 3] {
    let [r, g, b, _] = radiance;
    if pass == 0 { [0.0; 3] } else { [r, g, b] }
}
