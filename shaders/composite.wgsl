// composite: radiance that is added to or subtracted from a pixel. Draws one triangle with
// blending. Twin: crates/meshless_gi/src/frame/composite.rs.

@group(0) @binding(0) var<uniform> params: CompositeParams;
@group(0) @binding(1) var irradiance: texture_2d<f32>;
@group(0) @binding(2) var gbuffer: texture_2d<u32>;
@group(0) @binding(3) var lighting_passes: texture_2d<u32>;

const FRAC_1_PI: f32 = 0.318309886;

// Full-screen triangle.
@vertex
fn whole_screen(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    let corner = vec2f(f32((index << 1u) & 2u), f32(index & 2u));
    return vec4f(corner * 2.0 - 1.0, 0.0, 1.0);
}

// Texel of `irradiance`, or zero for sky and pixels that are not deferred (lighting pass 0).
fn light_of(pixel: vec2u) -> vec4f {
    if textureLoad(lighting_passes, pixel, 0).r == 0u {
        return vec4f(0.0);
    }
    return textureLoad(irradiance, pixel, 0);
}

// Specular radiance needs no albedo: `irradiance` is the output of `vpl_specular`.
@fragment
fn composite_specular(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let pixel = vec2u(position.xy);
    let radiance = light_of(pixel);
    let texel = textureLoad(gbuffer, pixel, 0);
    if radiance.a == 0.0 || gbuffer_is_unlit(texel) {
        return vec4f(0.0);
    }
    return vec4f(params.scale * gbuffer_occlusion(texel) * radiance.rgb, 0.0);
}

// Subtractive blending: `irradiance` is the output of `subtract_shadow`, the radiance of occluded
// light. Ambient occlusion is not applied, as in the light that it is subtracted from.
@fragment
fn composite_shadow(@builtin(position) position: vec4f) -> @location(0) vec4f {
    return vec4f(light_of(vec2u(position.xy)).rgb, 0.0);
}

@fragment
fn composite(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let pixel = vec2u(position.xy);
    let e = light_of(pixel);
    let texel = textureLoad(gbuffer, pixel, 0);
    if e.a == 0.0 || gbuffer_is_unlit(texel) {
        return vec4f(0.0);
    }
    let color = mix(gbuffer_occlusion(texel) * gbuffer_diffuse(texel), vec3f(1.0), params.white);
    return vec4f(params.scale * FRAC_1_PI * color * e.rgb, 0.0);
}
