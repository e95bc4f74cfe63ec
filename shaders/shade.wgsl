// shade: the radiance that lamps with soft shadows were drawn with at each pixel, and that does not get there. Twin: src/frame/shade.rs. `shade` starts a view;
// `shade_over` goes on with another baked scene where an earlier one left pixels uncovered.

@group(0) @binding(0) var<uniform> params: SplatParams;
@group(0) @binding(1) var depths: texture_depth_2d;
@group(0) @binding(2) var gbuffer: texture_2d<u32>;
@group(0) @binding(3) var<storage, read> points: array<Point>;
@group(0) @binding(4) var<storage, read> planes: array<vec4f>;
@group(0) @binding(5) var<storage, read> grid_slots: array<GridSlot>;
@group(0) @binding(6) var<storage, read> grid_entries: array<u32>;
@group(0) @binding(7) var<storage, read> deficits: array<VectorIrradiance>;
@group(0) @binding(8) var output: texture_storage_2d<rgba16float, write>;
@group(0) @binding(9) var earlier: texture_2d<f32>;
@group(0) @binding(10) var<uniform> wanted: ShadeParams;
@group(0) @binding(11) var<storage, read> lights: array<SoftLight>;

const FRAC_1_PI: f32 = 0.318309886;
// Part of what is missing that is taken away.
const TAKEN: f32 = 0.998;
// Least perceptual roughness, and least cosine between the normal and the direction to the eye.
const SMOOTHEST: f32 = 0.089;
const SLANTED: f32 = 1e-4;

// What of the light is missing, and whether any function covers the place.
struct Missing {
    share: vec3f,
    covered: bool,
}

fn missing_at(x: vec3f, n: vec3f) -> Missing {
    let near = grid_near(x, params.cell_size, params.slot_mask);
    var hidden = vec3f(0.0);
    var whole = vec3f(0.0);
    var cover = 0.0;
    for (var at = near.x; at < near.x + near.y; at++) {
        let j = grid_entries[at];
        let point = points[j];
        let w = weight(point, x, n);
        if w > 0.0 {
            let v = (w / point.radius) * (w / point.radius);
            let d = deficits[j];
            cover += w;
            hidden += v * max(irradiance_dot(d, point.normal), vec3f(0.0));
            whole += v * vec3f(d.x.w, d.y.w, d.z.w);
        }
    }
    if cover <= NO_COVER {
        return Missing(vec3f(0.0), false);
    }
    return Missing(min(hidden / max(whole, vec3f(TINY)), vec3f(1.0)), true);
}

// Unit, from x toward the eye: to where the pixel's ray begins.
fn eye_from(pixel: vec2u, x: vec3f) -> vec3f {
    let uv = (vec2f(pixel) + 0.5 - params.viewport.xy) / params.viewport.zw;
    let h = params.local_from_clip * vec4f(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, 1.0, 1.0);
    return normalize(h.xyz / h.w - x);
}

fn fifth(v: f32) -> f32 {
    return v * v * v * v * v;
}

// Over π, the diffuse BRDF of a white surface for a lamp at `l` (unit).
fn burley(n: vec3f, v: vec3f, l: vec3f, roughness: f32) -> f32 {
    let sum = l + v;
    let size = max(sqrt(dot(sum, sum)), TINY);
    let lh = clamp(dot(l, sum) / size, 0.0, 1.0);
    let r = clamp(roughness, SMOOTHEST, 1.0);
    let more = 2.0 * r * r * lh * lh - 0.5;
    let nl = clamp(dot(n, l), 0.0, 1.0);
    let nv = clamp(dot(n, v), SLANTED, 1.0);
    return (1.0 + more * fifth(1.0 - nl)) * (1.0 + more * fifth(1.0 - nv));
}

// Irradiance that the lamps were drawn with, times what its BRDF has over a white Lambert surface's.
fn drawn_at(x: vec3f, n: vec3f, v: vec3f, roughness: f32) -> vec3f {
    var sum = vec3f(0.0);
    for (var k = 0u; k < wanted.lights; k++) {
        let light = lights[k];
        var e = unshadowed(light, x, n, wanted.extent);
        if e <= 0.0 {
            continue;
        }
        if light.kind == SOFT_SPHERE {
            e *= burley(n, v, normalize(light.center - x), roughness);
        }
        sum += e * light.color;
    }
    return sum;
}

fn shade_pixel(pixel: vec2u) -> vec4f {
    let depth = textureLoad(depths, pixel, 0);
    let texel = textureLoad(gbuffer, pixel, 0);
    // Reversed depth: 0 is infinitely far, where nothing was drawn.
    if depth <= 0.0 || gbuffer_is_unlit(texel) {
        return vec4f(0.0);
    }
    let at = place(pixel, depth, texel);
    let missing = missing_at(at.x, at.n);
    if !missing.covered {
        return vec4f(0.0);
    }
    if all(missing.share == vec3f(0.0)) {
        return vec4f(vec3f(0.0), 1.0);
    }
    let drawn = drawn_at(at.x, at.n, eye_from(pixel, at.x), gbuffer_roughness(texel));
    let radiance = TAKEN * FRAC_1_PI * params.scale * missing.share * gbuffer_diffuse(texel) * drawn;
    return vec4f(min(radiance, vec3f(LARGEST_HALF)), 1.0);
}

@compute @workgroup_size(8, 8)
fn shade(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.size) {
        return;
    }
    textureStore(output, id.xy, shade_pixel(id.xy));
}

@compute @workgroup_size(8, 8)
fn shade_over(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.size) {
        return;
    }
    var texel = textureLoad(earlier, id.xy, 0);
    if texel.a == 0.0 {
        texel = shade_pixel(id.xy);
    }
    textureStore(output, id.xy, texel);
}
