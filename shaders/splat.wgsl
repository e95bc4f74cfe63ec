// splat: the irradiance of each pixel from the flat display basis. Twin: src/frame/splat.rs. `splat` starts a view's picture; `splat_over` goes on with
// another baked scene where an earlier one left pixels uncovered.

@group(0) @binding(0) var<uniform> params: SplatParams;
@group(0) @binding(1) var depths: texture_depth_2d;
@group(0) @binding(2) var gbuffer: texture_2d<u32>;
@group(0) @binding(3) var<storage, read> points: array<Point>;
@group(0) @binding(4) var<storage, read> planes: array<vec4f>;
@group(0) @binding(5) var<storage, read> grid_slots: array<GridSlot>;
@group(0) @binding(6) var<storage, read> grid_entries: array<u32>;
@group(0) @binding(7) var<storage, read> values: array<VectorIrradiance>;
@group(0) @binding(8) var output: texture_storage_2d<rgba16float, write>;
@group(0) @binding(9) var earlier: texture_2d<f32>;

// A half holds no more; what is brighter must not become infinite.
const LARGEST_HALF: f32 = 65504.0;

// Place and normal of a pixel in the bake's local space.
struct Place {
    x: vec3f,
    n: vec3f,
}

fn place(pixel: vec2u, depth: f32, texel: vec4u) -> Place {
    let uv = (vec2f(pixel) + 0.5 - params.viewport.xy) / params.viewport.zw;
    let h = params.local_from_clip * vec4f(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, depth, 1.0);
    return Place(h.xyz / h.w, params.local_from_world * gbuffer_normal(texel));
}

// Irradiance and, in alpha, 1 where any function covers the place.
fn irradiance_at(x: vec3f, n: vec3f) -> vec4f {
    let near = grid_near(x, params.cell_size, params.slot_mask);
    var numerator = VectorIrradiance(vec4f(0.0), vec4f(0.0), vec4f(0.0));
    var cover = 0.0;
    var denominator = 0.0;
    for (var at = near.x; at < near.x + near.y; at++) {
        let j = grid_entries[at];
        let point = points[j];
        let w = weight(point, x, n);
        if w > 0.0 {
            let v = (w / point.radius) * (w / point.radius);
            cover += w;
            denominator += v;
            add_scaled(&numerator, v, values[j]);
        }
    }
    if cover <= NO_COVER {
        return vec4f(0.0);
    }
    return vec4f(max(irradiance_dot(numerator, n) / denominator, vec3f(0.0)), 1.0);
}

fn splat_pixel(pixel: vec2u) -> vec4f {
    let depth = textureLoad(depths, pixel, 0);
    let texel = textureLoad(gbuffer, pixel, 0);
    // Reversed depth: 0 is infinitely far, where nothing was drawn.
    if depth <= 0.0 || gbuffer_is_unlit(texel) {
        return vec4f(0.0);
    }
    let at = place(pixel, depth, texel);
    let e = irradiance_at(at.x, at.n);
    return vec4f(min(e.rgb * params.scale, vec3f(LARGEST_HALF)), e.a);
}

@compute @workgroup_size(8, 8)
fn splat(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.size) {
        return;
    }
    textureStore(output, id.xy, splat_pixel(id.xy));
}

@compute @workgroup_size(8, 8)
fn splat_over(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.size) {
        return;
    }
    var texel = textureLoad(earlier, id.xy, 0);
    if texel.a == 0.0 {
        texel = splat_pixel(id.xy);
    }
    textureStore(output, id.xy, texel);
}
