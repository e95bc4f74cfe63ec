// splat: the irradiance of each pixel from the flat display basis. Twin:
// crates/meshless_gi/src/frame/splat.rs. `splat` starts a view's picture; `splat_over` goes on with
// another baked scene where an earlier one left pixels uncovered. `nodes` does both for the
// subsplats of a list.

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

@group(0) @binding(10) var<uniform> screen: SubsplatParams;
@group(0) @binding(11) var<uniform> span: Span;
@group(0) @binding(12) var<storage, read_write> nodes: array<SubsplatNode>;
@group(0) @binding(13) var<storage, read> lists: array<u32>;
@group(0) @binding(14) var<storage, read> counted: array<u32>;

// Vector irradiance, the share of the light that it has, and whether any function covers the place.
struct Covered {
    e: VectorIrradiance,
    share: f32,
    covered: bool,
}

// Cosines to a function's normal from where on it counts as a surface's cover, and from where on
// wholly.
const MIN_COVER_COSINE: f32 = 0.7;
const FULL_COVER_COSINE: f32 = 0.9;

// Least share of a pixel that functions reach.
const MIN_SHARE: f32 = 1.0 / 1024.0;

// Part of a function's weight that covers a surface, by the cosine between their normals.
fn cover_of(cosine: f32) -> f32 {
    return clamp((cosine - MIN_COVER_COSINE) / (FULL_COVER_COSINE - MIN_COVER_COSINE), 0.0, 1.0);
}

// All of the light from `seam` on.
fn share_of(cover: f32) -> f32 {
    if cover >= params.seam {
        return 1.0;
    }
    let t = cover / params.seam;
    return t * t * (3.0 - 2.0 * t);
}

fn vector_at(x: vec3f, n: vec3f) -> Covered {
    let near = grid_near(x, params.cell_size, params.slot_mask);
    var numerator = VectorIrradiance(vec4f(0.0), vec4f(0.0), vec4f(0.0));
    var sum = 0.0;
    var cover = 0.0;
    var denominator = 0.0;
    for (var at = near.x; at < near.x + near.y; at++) {
        let j = grid_entries[at];
        let point = points[j];
        let w = weight(point, x, n);
        if w > 0.0 {
            let v = (w / point.radius) * (w / point.radius);
            sum += w;
            cover += w * cover_of(dot(n, point.normal));
            denominator += v;
            add_scaled(&numerator, v, values[j]);
        }
    }
    var e = VectorIrradiance(vec4f(0.0), vec4f(0.0), vec4f(0.0));
    if sum > NO_COVER {
        add_scaled(&e, 1.0 / denominator, numerator);
    }
    return Covered(e, share_of(cover), sum > NO_COVER);
}

// Irradiance and, in alpha, the share of the light that it has: 0 where no function covers the
// place.
fn irradiance_at(x: vec3f, n: vec3f) -> vec4f {
    let found = vector_at(x, n);
    return vec4f(max(irradiance_dot(found.e, n), vec3f(0.0)), select(0.0, max(found.share, MIN_SHARE), found.covered));
}

fn splat_node(pixel: vec2u, node: SubsplatNode) -> SubsplatNode {
    let nothing = VectorIrradiance(vec4f(0.0), vec4f(0.0), vec4f(0.0));
    let depth = textureLoad(depths, pixel, 0);
    let texel = textureLoad(gbuffer, pixel, 0);
    if depth <= 0.0 || gbuffer_is_unlit(texel) {
        return node_new(nothing, node_predicted_luminance(node), EVALUATED);
    }
    let at = pixel_position(pixel, depth, texel);
    let found = vector_at(at.x, at.n);
    if !found.covered {
        return node_new(nothing, node_predicted_luminance(node), EVALUATED | KNOWN);
    }
    return node_new(to_world(found.e), node_predicted_luminance(node), EVALUATED | KNOWN | COVERED | probe_fraction_bits(found.share));
}

fn splat_pixel(pixel: vec2u) -> vec4f {
    let depth = textureLoad(depths, pixel, 0);
    let texel = textureLoad(gbuffer, pixel, 0);
    // Reversed depth: 0 is infinitely far, where nothing was drawn.
    if depth <= 0.0 || gbuffer_is_unlit(texel) {
        return vec4f(0.0);
    }
    let at = pixel_position(pixel, depth, texel);
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

@compute @workgroup_size(64)
fn nodes_of(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let k = span.first;
    let count = min(counted[3], span.count);
    for (var i = id.x; i < count; i += groups.x * ITEMS) {
        let item = listed(k, i);
        if item.at == NOWHERE {
            continue;
        }
        // An earlier scene covers it.
        let node = nodes[item.at];
        if !node_is(node, EVALUATED | COVERED) {
            nodes[item.at] = splat_node(item.cell << vec2u(k), node);
        }
    }
}
