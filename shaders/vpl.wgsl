// vpl: irradiance of pixels and subsplats from virtual point lights, added to that of baked scenes.
// Twin: crates/meshless_gi/src/frame/vpl.rs. Entry points: lib/pixel_pass and lib/listed.

@group(0) @binding(8) var output: texture_storage_2d<rgba16float, write>;
@group(0) @binding(9) var earlier: texture_2d<f32>;

// Position of a pixel in the space of the lights.
fn light_space_position(pixel: vec2u, depth: f32) -> vec3f {
    let uv = (vec2f(pixel) + 0.5 - params.viewport.xy) / params.viewport.zw;
    let h = params.space_from_clip * vec4f(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, depth, 1.0);
    return h.xyz / h.w;
}

fn pixel_texel(pixel: vec2u, before: vec4f) -> vec4f {
    let depth = textureLoad(depths, pixel, 0);
    let texel = textureLoad(gbuffer, pixel, 0);
    if depth <= 0.0 || gbuffer_is_unlit(texel) {
        return before;
    }
    let n = gbuffer_normal(texel);
    let e = max(irradiance_dot(vpl_at(light_space_position(pixel, depth), n), n), vec3f(0.0)) * params.scale;
    if all(e <= vec3f(0.0)) {
        return before;
    }
    return vec4f(min(before.rgb + e, vec3f(MAX_HALF)), 1.0);
}

// Light of a node: that of baked scenes, if any were evaluated, plus the lights.
fn evaluate_subsplat(pixel: vec2u, node: SubsplatNode) -> SubsplatNode {
    let depth = lit_depth(pixel);
    if depth <= 0.0 {
        return node;
    }
    var light = VectorIrradiance(vec4f(0.0), vec4f(0.0), vec4f(0.0));
    var state = EVALUATED | KNOWN;
    // Otherwise it stores the prediction.
    if node_is(node, EVALUATED) {
        light = node_light(node);
        state |= node.words[5];
    }
    let e = vpl_at(light_space_position(pixel, depth), pixel_normal(pixel));
    if any(max(max(abs(e.x), abs(e.y)), abs(e.z)).xyz > vec3f(0.0)) {
        add_scaled(&light, params.scale, e);
        state |= COVERED;
    }
    return node_new(light, node_predicted_luminance(node), state);
}
