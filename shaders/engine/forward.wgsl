// Splatting in a view that is not deferred (src/plugin/forward_display.rs): converts its prepasses
// to a G-buffer and writes the texture that its surfaces read.

struct ForwardParams {
    view_from_clip: mat4x4f,
    // x, y, width, height, texels.
    viewport: vec4f,
    // Factor of the light.
    scale: f32,
    pad_0: f32,
    pad_1: f32,
    pad_2: f32,
}

@group(0) @binding(0) var depths: texture_depth_2d;
@group(0) @binding(1) var normals: texture_2d<f32>;
@group(0) @binding(2) var depths_sampled: texture_depth_multisampled_2d;
@group(0) @binding(3) var normals_sampled: texture_multisampled_2d<f32>;
@group(0) @binding(4) var irradiance: texture_2d<f32>;
@group(0) @binding(5) var<uniform> params: ForwardParams;

const FRAC_1_PI: f32 = 0.318309886;
// A white, rough texel without occlusion, in the format of lib/gbuffer.wgsl.
const COLOR: u32 = 0x80ffffffu;
const OCCLUSION: u32 = 0x00ff0080u;

struct Texel {
    @location(0) gbuffer: vec4u,
    @builtin(frag_depth) depth: f32,
}

// Full-screen triangle.
@vertex
fn whole_screen(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    let corner = vec2f(f32((index << 1u) & 2u), f32(index & 2u));
    return vec4f(corner * 2.0 - 1.0, 0.0, 1.0);
}

fn texel(depth: f32, prepass: vec4f) -> Texel {
    let n = prepass.xyz * 2.0 - 1.0;
    let m = n / (abs(n.x) + abs(n.y) + abs(n.z));
    let folded = (1.0 - abs(m.yx)) * select(vec2f(-1.0), vec2f(1.0), m.xy > vec2f(0.0));
    let bits = vec2u(round(clamp(select(folded, m.xy, m.z >= 0.0) * 0.5 + 0.5, vec2f(0.0), vec2f(1.0)) * 4095.0));
    return Texel(vec4u(COLOR, 0u, OCCLUSION, bits.x | (bits.y << 12u)), depth);
}

@fragment
fn gbuffer_of_one(@builtin(position) position: vec4f) -> Texel {
    let pixel = vec2u(position.xy);
    return texel(textureLoad(depths, pixel, 0), textureLoad(normals, pixel, 0));
}

// Mean depth of a pixel's samples: that of the pixel's center if all samples lie on one flat
// surface. If several surfaces share the pixel, the mean lies on none of them.
@fragment
fn gbuffer_of_samples(@builtin(position) position: vec4f) -> Texel {
    let pixel = vec2u(position.xy);
    let count = textureNumSamples(depths_sampled);
    var sum = 0.0;
    for (var k = 0u; k < count; k++) {
        sum += textureLoad(depths_sampled, pixel, k);
    }
    return texel(sum / f32(count), textureLoad(normals_sampled, pixel, 0));
}

// rgb: exposed light of a white surface. a: negative distance from the eye. Other textures at this
// binding have no negative alpha.
@fragment
fn exposed_light(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let pixel = vec2u(position.xy);
    let depth = textureLoad(depths, pixel, 0);
    let e = textureLoad(irradiance, pixel, 0);
    if depth <= 0.0 || e.a == 0.0 {
        return vec4f(0.0);
    }
    let uv = (position.xy - params.viewport.xy) / params.viewport.zw;
    let h = params.view_from_clip * vec4f(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, depth, 1.0);
    return vec4f(params.scale * FRAC_1_PI * e.rgb, min(h.z / h.w, 0.0));
}
