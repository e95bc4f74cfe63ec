// vpl: the irradiance of each pixel from virtual point lights. Twin: src/frame/vpl.rs. `vpl` starts a view's picture; `vpl_over` adds to what baked scenes gave.

@group(0) @binding(0) var<uniform> params: VplViewParams;
@group(0) @binding(1) var depths: texture_depth_2d;
@group(0) @binding(2) var gbuffer: texture_2d<u32>;
@group(0) @binding(3) var<uniform> lit: VplParams;
@group(0) @binding(4) var<storage, read> vpls: array<Vpl>;
@group(0) @binding(5) var<storage, read> nodes: array<BvhNode>;
@group(0) @binding(6) var<storage, read> triangles: array<BvhTriangle>;
@group(0) @binding(7) var output: texture_storage_2d<rgba16float, write>;
@group(0) @binding(8) var earlier: texture_2d<f32>;

// A half holds no more; what is brighter must not become infinite.
const LARGEST_HALF: f32 = 65504.0;

fn vpl_pixel(pixel: vec2u, before: vec4f) -> vec4f {
    let depth = textureLoad(depths, pixel, 0);
    let texel = textureLoad(gbuffer, pixel, 0);
    if depth <= 0.0 || gbuffer_is_unlit(texel) {
        return before;
    }
    let uv = (vec2f(pixel) + 0.5 - params.viewport.xy) / params.viewport.zw;
    let h = params.space_from_clip * vec4f(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, depth, 1.0);
    let n = gbuffer_normal(texel);
    let e = max(irradiance_dot(vpl_at(h.xyz / h.w, n), n), vec3f(0.0)) * params.scale;
    if all(e <= vec3f(0.0)) {
        return before;
    }
    return vec4f(min(before.rgb + e, vec3f(LARGEST_HALF)), 1.0);
}

@compute @workgroup_size(8, 8)
fn vpl(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.size) {
        return;
    }
    textureStore(output, id.xy, vpl_pixel(id.xy, vec4f(0.0)));
}

@compute @workgroup_size(8, 8)
fn vpl_over(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.size) {
        return;
    }
    textureStore(output, id.xy, vpl_pixel(id.xy, textureLoad(earlier, id.xy, 0)));
}
