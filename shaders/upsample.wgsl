// upsample: interpolation between nodes, coarse to fine. Twin:
// crates/meshless_gi/src/frame/upsample.rs. `upsample` fills a level from the next coarser one.
// `resolve` fills pixels from level 1 and lists those that need evaluation. `fill` writes these.

@group(0) @binding(0) var<uniform> screen: SubsplatParams;
@group(0) @binding(1) var<uniform> span: Span;
@group(0) @binding(2) var depths: texture_depth_2d;
@group(0) @binding(3) var gbuffer: texture_2d<u32>;
@group(0) @binding(4) var<storage, read_write> nodes: array<SubsplatNode>;
@group(0) @binding(5) var<storage, read_write> lists: array<u32>;
@group(0) @binding(6) var<storage, read_write> next: array<atomic<u32>>;
@group(0) @binding(7) var output: texture_storage_2d<rgba16float, write>;
@group(0) @binding(8) var<storage, read> counted: array<u32>;

const MIN_NORMAL_COSINE: f32 = 0.5;
const FULL_NORMAL_COSINE: f32 = 0.9;
const CUBIC_MIN_SIMILARITY: f32 = 0.9;
const PIXELS_PER_DIRECT_EVALUATION: u32 = 4u;

// Surface in a pixel, in view space.
struct VisibleSurface {
    x: vec3f,
    n: vec3f,
    reach: f32,
    lit: bool,
}

fn visible_surface(pixel: vec2u) -> VisibleSurface {
    let depth = lit_depth(pixel);
    if depth <= 0.0 {
        return VisibleSurface(vec3f(0.0), vec3f(0.0), 0.0, false);
    }
    let x = view_position(pixel, depth);
    return VisibleSurface(x, screen.view_from_world * pixel_normal(pixel), depth_reach(x.z, depth), true);
}

fn surface_similarity(a: VisibleSurface, b: VisibleSurface) -> f32 {
    let plane = plane_similarity(a.x, a.n, b.x, b.n, a.reach);
    let normal = clamp((dot(a.n, b.n) - MIN_NORMAL_COSINE) / (FULL_NORMAL_COSINE - MIN_NORMAL_COSINE), 0.0, 1.0);
    return plane * normal;
}

// Interpolated value of a level between its nodes.
struct Interpolation {
    light: VectorIrradiance,
    covered: f32,
    weight: f32,
    // `true` if all nodes of surrounding surfaces have a value.
    whole: bool,
}

// Node and its similarity to a point, 0 if the node has no value.
struct Near {
    node: SubsplatNode,
    similarity: f32,
    known: bool,
    // `true` for a node without a value on a surface.
    missing: bool,
}

fn near_node(k: u32, cell: vec2i, here: VisibleSurface) -> Near {
    var out: Near;
    if any(cell < vec2i(0)) || any(vec2u(cell) >= level_grid(k)) {
        return out;
    }
    out.node = nodes[cell_index(k, vec2u(cell))];
    if !node_is(out.node, KNOWN) {
        out.missing = lit_depth(vec2u(cell) << vec2u(k)) > 0.0;
        return out;
    }
    let there = visible_surface(vec2u(cell) << vec2u(k));
    if there.lit {
        out.similarity = surface_similarity(here, there);
        out.known = true;
    }
    return out;
}

fn interpolate_odd_cell(k: u32, cell: vec2u, here: VisibleSurface) -> Interpolation {
    let first = vec2i(cell / 2u);
    let odd = (cell & vec2u(1u)) == vec2u(1u);
    let middle = all(odd);
    // Steps and weights: the center of a cell, or of an edge.
    var steps = array<vec2i, 12>(
        vec2i(0, 0), vec2i(1, 0), vec2i(0, 1), vec2i(1, 1),
        vec2i(-1, 0), vec2i(-1, 1), vec2i(2, 0), vec2i(2, 1),
        vec2i(0, -1), vec2i(1, -1), vec2i(0, 2), vec2i(1, 2),
    );
    let along = vec2i(select(vec2u(0u), vec2u(1u), odd));
    var cubic = VectorIrradiance(vec4f(0.0), vec4f(0.0), vec4f(0.0));
    var sure = true;
    for (var i = 0; i < select(4, 12, middle); i++) {
        var step = along * (i - 1);
        var weight = select(-0.0625, 0.5625, i == 1 || i == 2);
        if middle {
            step = steps[i];
            weight = select(-0.03125, 0.3125, i < 4);
        }
        let near = near_node(k + 1u, first + step, here);
        if !near.known || !node_is(near.node, COVERED) || near.similarity < CUBIC_MIN_SIMILARITY {
            sure = false;
            break;
        }
        add_scaled(&cubic, weight, node_light(near.node));
    }
    if sure {
        return Interpolation(cubic, 1.0, 1.0, true);
    }
    var sum = VectorIrradiance(vec4f(0.0), vec4f(0.0), vec4f(0.0));
    var covered = 0.0;
    var total = 0.0;
    var whole = true;
    let share = select(0.5, 0.25, middle);
    for (var i = 0; i < 4; i++) {
        let step = vec2i(i & 1, i >> 1u);
        if any(step > along) {
            continue;
        }
        let near = near_node(k + 1u, first + step, here);
        if near.known {
            let weight = share * near.similarity;
            total += weight;
            if node_is(near.node, COVERED) {
                covered += weight;
                add_scaled(&sum, weight, node_light(near.node));
            }
        }
        whole &= !near.missing;
    }
    var light = VectorIrradiance(vec4f(0.0), vec4f(0.0), vec4f(0.0));
    if covered > 0.0 {
        add_scaled(&light, 1.0 / covered, sum);
    }
    return Interpolation(light, select(0.0, covered / max(total, 1e-30), total > 0.0), total, whole);
}

fn state_of(found: Interpolation) -> u32 {
    if found.weight <= screen.min_similarity {
        return 0u;
    }
    if found.covered > 0.99 {
        return KNOWN | COVERED;
    }
    return select(0u, KNOWN, found.covered < 0.01 && found.whole);
}

fn unknown() -> SubsplatNode {
    return SubsplatNode(array<u32, 6>(0u, 0u, 0u, 0u, 0u, 0u));
}

fn node_of(k: u32, cell: vec2u) -> SubsplatNode {
    let pixel = cell << vec2u(k);
    let here = visible_surface(pixel);
    if !here.lit {
        return unknown();
    }
    var light: VectorIrradiance;
    var bits = 0u;
    if all((cell & vec2u(1u)) == vec2u(0u)) {
        let same = nodes[cell_index(k + 1u, cell / 2u)];
        light = node_light(same);
        bits = same.words[5];
    } else {
        let found = interpolate_odd_cell(k, cell, here);
        bits = state_of(found);
        if bits == 0u {
            return unknown();
        }
        light = found.light;
    }
    return node_new(light, luminance(node_new(light, 0.0, bits), pixel_normal(pixel)), bits);
}

fn texel_of(pixel: vec2u, here: VisibleSurface, light: VectorIrradiance) -> vec4f {
    let facing = max(dot(here.n, -normalize(here.x)), 0.0);
    let shade = screen.detail * facing + (1.0 - screen.detail);
    let e = shade * max(irradiance_dot(light, pixel_normal(pixel)), vec3f(0.0));
    return vec4f(min(e, vec3f(MAX_HALF)), 1.0);
}

@compute @workgroup_size(8, 8)
fn upsample(@builtin(global_invocation_id) id: vec3u) {
    let k = span.first;
    if any(id.xy >= level_grid(k)) {
        return;
    }
    nodes[cell_index(k, id.xy)] = node_of(k, id.xy);
}

@compute @workgroup_size(8, 8)
fn resolve(@builtin(global_invocation_id) id: vec3u) {
    let pixel = id.xy;
    if any(pixel >= screen.size) {
        return;
    }
    let here = visible_surface(pixel);
    if !here.lit {
        textureStore(output, pixel, vec4f(0.0));
        return;
    }
    var light: VectorIrradiance;
    var bits = 0u;
    var some = false;
    if all((pixel & vec2u(1u)) == vec2u(0u)) {
        let node = nodes[cell_index(1u, pixel / 2u)];
        light = node_light(node);
        bits = node.words[5];
        some = node_is(node, COVERED);
    } else {
        let found = interpolate_odd_cell(0u, pixel, here);
        light = found.light;
        bits = state_of(found);
        some = found.covered > 0.0;
    }
    let hole = (bits & KNOWN) == 0u;
    if hole {
        let slot = atomicAdd(&next[3], 1u);
        if slot < (screen.size.x * screen.size.y + PIXELS_PER_DIRECT_EVALUATION - 1u) / PIXELS_PER_DIRECT_EVALUATION {
            lists[level_start(0u) + slot] = pack_cell(pixel);
            nodes[level_start(0u) + slot] = unknown();
            atomicMax(&next[0], groups_of(slot + 1u));
        }
    }
    var texel = vec4f(0.0);
    if select((bits & COVERED) != 0u, some, hole) {
        texel = texel_of(pixel, here, light);
    }
    textureStore(output, pixel, texel);
}

@compute @workgroup_size(64)
fn fill(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let room = (screen.size.x * screen.size.y + PIXELS_PER_DIRECT_EVALUATION - 1u) / PIXELS_PER_DIRECT_EVALUATION;
    let count = min(counted[3], room);
    for (var i = id.x; i < count; i += groups.x * ITEMS) {
        let pixel = unpack_cell(lists[level_start(0u) + i]);
        let node = nodes[level_start(0u) + i];
        let here = visible_surface(pixel);
        var texel = vec4f(0.0);
        if here.lit && node_is(node, COVERED) {
            texel = texel_of(pixel, here, node_light(node));
        }
        textureStore(output, pixel, texel);
    }
}
