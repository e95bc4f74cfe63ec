// Specular part of Bevy's standard material, for lights that are disks. Twin:
// crates/meshless_gi/src/frame/brdf.rs. Needs lib/vpl for π.

const MIN_ROUGHNESS: f32 = 0.089;
const MIN_NDOTV: f32 = 1e-4;
const MULTISCATTER_LOSS: f32 = 1.25;
const MULTISCATTER_ROLLOFF: f32 = 1.1;

// Surface that reflects a light.
struct ShadingPoint {
    n: vec3f,
    v: vec3f,
    roughness: f32,
}

fn alpha_square(roughness: f32) -> f32 {
    let r = clamp(roughness, MIN_ROUGHNESS, 1.0);
    return r * r * r * r;
}

fn f90(f0: vec3f) -> f32 {
    return min(50.0 * 0.33 * (f0.r + f0.g + f0.b), 1.0);
}

// D V (1 − p) and D V p for light from `l` that is spread over a disk. `spread` is the squared sine
// of half its angle.
fn specular_terms(facet: ShadingPoint, l: vec3f, spread: f32) -> vec2f {
    let sum = l + facet.v;
    let len = length(sum);
    if len <= 1e-6 {
        return vec2f(0.0);
    }
    let h = sum / len;
    let a2 = min(alpha_square(facet.roughness) + 0.25 * spread, 1.0);
    let nl = max(dot(facet.n, l), 0.0);
    let nv = max(dot(facet.n, facet.v), MIN_NDOTV);
    let nh = dot(facet.n, h);
    if nh <= 0.0 {
        return vec2f(0.0);
    }
    let sine = cross(facet.n, h);
    let wide = dot(sine, sine) + a2 * nh * nh;
    let d = a2 / (PI * wide * wide);
    let masked = nl * sqrt(nv * nv * (1.0 - a2) + a2) + nv * sqrt(nl * nl * (1.0 - a2) + a2);
    let q = 1.0 - clamp(dot(l, h), 0.0, 1.0);
    let p = q * q * q * q * q;
    let dv = d * 0.5 / masked;
    return vec2f(dv * (1.0 - p), dv * p);
}

// Factor of multiple reflections between facets.
fn multiscatter_compensation(roughness: f32, f0: vec3f) -> vec3f {
    let r2 = roughness * roughness;
    let r4 = r2 * r2;
    let lost = MULTISCATTER_LOSS * r4 / (1.0 + MULTISCATTER_ROLLOFF * r4 * r4);
    return 1.0 + f0 * (lost / (1.0 - lost));
}
