// subtract_shadow: radiance of occluded light to subtract at each pixel. Twin:
// crates/meshless_gi/src/frame/subtract_shadow.rs. `next_scene` evaluates pixels that earlier
// scenes left uncovered. Entry points: lib/pixel_pass.

@group(0) @binding(7) var<storage, read> occluded_irradiances: array<VectorIrradiance>;
@group(0) @binding(10) var<uniform> shadow_params: SubtractShadowParams;
@group(0) @binding(11) var<storage, read> lights: array<SoftLight>;
@group(0) @binding(12) var tables: texture_2d_array<f32>;

const FRAC_1_PI: f32 = 0.318309886;
// Fraction of the occluded radiance that is subtracted.
const SUBTRACTED_FRACTION: f32 = 0.998;
// Minimum perceptual roughness, and minimum cosine between the normal and the direction to the eye.
const MIN_ROUGHNESS: f32 = 0.089;
const MIN_NDOTV: f32 = 1e-4;

// Occluded fraction of the light, and `true` if any function covers the point.
struct OccludedFraction {
    share: vec3f,
    covered: bool,
}

fn occluded_fraction(x: vec3f, n: vec3f) -> OccludedFraction {
    let range = grid_range(x);
    var hidden = vec3f(0.0);
    var whole = vec3f(0.0);
    var cover = 0.0;
    for (var at = range.x; at < range.y; at++) {
        let f = basis_function(at, x, n);
        if f.weight > 0.0 {
            let d = occluded_irradiances[f.index];
            cover += f.weight;
            hidden += f.flat_weight * max(irradiance_dot(d, f.normal), vec3f(0.0));
            whole += f.flat_weight * vec3f(d.x.w, d.y.w, d.z.w);
        }
    }
    if cover <= NO_COVER {
        return OccludedFraction(vec3f(0.0), false);
    }
    return OccludedFraction(min(hidden / max(whole, vec3f(TINY)), vec3f(1.0)), true);
}

// Unit direction from x toward the eye, the start of the pixel's ray.
fn eye_from(pixel: vec2u, x: vec3f) -> vec3f {
    let uv = (vec2f(pixel) + 0.5 - params.viewport.xy) / params.viewport.zw;
    let h = params.local_from_clip * vec4f(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, 1.0, 1.0);
    return normalize(h.xyz / h.w - x);
}

fn pow5(v: f32) -> f32 {
    return v * v * v * v * v;
}

// π times the diffuse BRDF of a white surface for a light at `l` (unit).
fn burley(n: vec3f, v: vec3f, l: vec3f, roughness: f32) -> f32 {
    let sum = l + v;
    let size = max(sqrt(dot(sum, sum)), TINY);
    let lh = clamp(dot(l, sum) / size, 0.0, 1.0);
    let r = clamp(roughness, MIN_ROUGHNESS, 1.0);
    let more = 2.0 * r * r * lh * lh - 0.5;
    let nl = clamp(dot(n, l), 0.0, 1.0);
    let nv = clamp(dot(n, v), MIN_NDOTV, 1.0);
    return (1.0 + more * pow5(1.0 - nl)) * (1.0 + more * pow5(1.0 - nv));
}

// Surface of a pixel.
struct Surface {
    n: vec3f,
    // Toward the eye.
    v: vec3f,
    diffuse: vec3f,
    // Perceptual.
    roughness: f32,
}

// Specular lobe: the transform into a cosine, and the reflected fraction.
struct Lobe {
    rows: mat3x3f,
    weight: vec3f,
}

// Table lookup at a position between texels. 0 and 1 are the centers of the first and the last
// texel.
fn table(layer: u32, uv: vec2f) -> vec4f {
    let last = textureDimensions(tables) - 1u;
    let at = clamp(uv, vec2f(0.0), vec2f(1.0)) * vec2f(last);
    let low = vec2u(at);
    let high = min(low + 1u, last);
    let f = at - vec2f(low);
    let a = mix(textureLoad(tables, low, layer, 0), textureLoad(tables, vec2u(high.x, low.y), layer, 0), f.x);
    let b = mix(textureLoad(tables, vec2u(low.x, high.y), layer, 0), textureLoad(tables, high, layer, 0), f.x);
    return mix(a, b, f.y);
}

fn lobe_of(surface: Surface, f0: vec3f) -> Lobe {
    let nv = clamp(dot(surface.n, surface.v), MIN_NDOTV, 1.0);
    let uv = vec2f(surface.roughness, sqrt(1.0 - nv));
    let m = table(0u, uv);
    let f = table(1u, uv);
    let across = surface.v - surface.n * dot(surface.v, surface.n);
    let t = across / max(sqrt(dot(across, across)), TINY);
    let b = cross(t, surface.n);
    let rows = mat3x3f(m.x * t + m.z * surface.n, b, m.y * t + m.w * surface.n);
    return Lobe(rows, f0 * f.x + (1.0 - f0) * f.y);
}

// Fraction of a rectangle's radiance from the mirror direction of the eye.
fn mirrored(lobe: Lobe, light: SoftLight, to: vec3f) -> f32 {
    // Row vectors: the dot products with the rows.
    let c = to * lobe.rows;
    let u = light.u * lobe.rows;
    let v = light.v * lobe.rows;
    return FRAC_1_PI * lambert(array<vec3f, 4>(c - u - v, c + u - v, c + u + v, c - u + v), vec3f(0.0, 0.0, 1.0));
}

// Radiance that the renderer drew without shadows.
fn drawn_at(x: vec3f, surface: Surface, f0: vec3f) -> vec3f {
    var lobe: Lobe;
    if shadow_params.gloss != 0u {
        lobe = lobe_of(surface, f0);
    }
    var sum = vec3f(0.0);
    for (var k = 0u; k < shadow_params.lights; k++) {
        let light = lights[k];
        let to = light.center - x;
        let e = unshadowed(light, x, surface.n, shadow_params.extent);
        if light.kind == SOFT_SPHERE {
            if e > 0.0 {
                sum += (FRAC_1_PI * e * burley(surface.n, surface.v, normalize(to), surface.roughness)) * surface.diffuse * light.color;
            }
            continue;
        }
        sum += FRAC_1_PI * e * surface.diffuse * light.color;
        if shadow_params.gloss != 0u && light.kind == SOFT_RECTANGLE && dot(normal_of(light), to) < 0.0 {
            sum += mirrored(lobe, light, to) * window_of(light, dot(to, to)) * lobe.weight * light.color;
        }
    }
    return sum;
}

fn pixel_texel(pixel: vec2u, before: vec4f) -> vec4f {
    if before.a != 0.0 {
        return before;
    }
    let at = pixel_position(pixel);
    if !at.lit {
        return vec4f(0.0);
    }
    let missing = occluded_fraction(at.x, at.n);
    if !missing.covered {
        return vec4f(0.0);
    }
    if all(missing.share == vec3f(0.0)) {
        return vec4f(vec3f(0.0), 1.0);
    }
    let texel = textureLoad(gbuffer, pixel, 0);
    let surface = Surface(at.n, eye_from(pixel, at.x), gbuffer_diffuse(texel), gbuffer_roughness(texel));
    let drawn = drawn_at(at.x, surface, gbuffer_f0(texel));
    let radiance = SUBTRACTED_FRACTION * params.scale * missing.share * drawn;
    return vec4f(min(radiance, vec3f(MAX_HALF)), 1.0);
}
