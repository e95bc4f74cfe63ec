// Bevy's deferred G-buffer texel. Twin: crates/meshless_gi/src/frame/gbuffer.rs, which documents
// the bits.

const UNLIT: u32 = 1u;
const GAMMA: f32 = 2.2;

fn gbuffer_normal(texel: vec4u) -> vec3f {
    let packed = vec2f(vec2u(texel.a, texel.a >> 12u) & vec2u(0xfffu)) / 4095.0;
    let v = packed * 2.0 - 1.0;
    let z = 1.0 - abs(v.x) - abs(v.y);
    // The lower half is folded over the diagonals.
    let fold = clamp(-z, 0.0, 1.0);
    return normalize(vec3f(v + select(vec2f(fold), vec2f(-fold), v >= vec2f(0.0)), z));
}

fn gbuffer_is_unlit(texel: vec4u) -> bool {
    return ((texel.a >> 24u) & UNLIT) != 0u;
}

fn unorm8(bits: u32) -> f32 {
    return f32(bits & 0xffu) / 255.0;
}

// Linear.
fn gbuffer_base(texel: vec4u) -> vec3f {
    return pow(vec3f(unorm8(texel.r), unorm8(texel.r >> 8u), unorm8(texel.r >> 16u)), vec3f(GAMMA));
}

// Base color × (1 − metallic), linear.
fn gbuffer_diffuse(texel: vec4u) -> vec3f {
    return gbuffer_base(texel) * (1.0 - gbuffer_metallic(texel));
}

fn gbuffer_metallic(texel: vec4u) -> f32 {
    return unorm8(texel.b >> 8u);
}

// Perceptual.
fn gbuffer_roughness(texel: vec4u) -> f32 {
    return unorm8(texel.r >> 24u);
}

// Specular reflectance straight ahead, linear.
fn gbuffer_f0(texel: vec4u) -> vec3f {
    let reflectance = unorm8(texel.b);
    return mix(vec3f(0.16 * reflectance * reflectance), gbuffer_base(texel), gbuffer_metallic(texel));
}

fn gbuffer_occlusion(texel: vec4u) -> f32 {
    return unorm8(texel.b >> 16u);
}
