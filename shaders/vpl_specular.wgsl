// vpl_specular: specular reflection of virtual point lights, refined for each light separately.
// Twin: crates/meshless_gi/src/frame/vpl_specular.rs. `vpl_specular` fills the nodes of a level
// from the next coarser one, `vpl_specular_pixels` evaluates every pixel.

@group(0) @binding(7) var output: texture_storage_2d<rgba16float, write>;
@group(0) @binding(8) var<uniform> screen: SubsplatParams;
@group(0) @binding(9) var<uniform> span: Span;
@group(0) @binding(10) var<uniform> specular_params: SpecularParams;
@group(0) @binding(11) var<storage, read_write> specular_nodes: array<SpecularNode>;
// Refine masks of the nodes of the levels from 2, one bit per group of lights.
@group(0) @binding(12) var<storage, read_write> refine_masks: array<vec4u>;

const LIGHT_GROUPS: u32 = 128u;
const ROUGHNESS_FADE: f32 = 0.1;
const NORMAL_COSINE_FROM: f32 = 0.85;
const NORMAL_COSINE_TO: f32 = 0.97;
const VIEW_COSINE_TOLERANCE: f32 = 0.15;
const ROUGHNESS_TOLERANCE: f32 = 0.1;
const FLOOR: f32 = 0.1;
const MIN: f32 = 1e-15;

// Radiance over f₀ and over f₉₀.
struct SpecularRadiance {
    f0: vec3f,
    f90: vec3f,
}

// Surface point that receives light, in the space of the lights.
struct Receiver {
    x: vec3f,
    facet: ShadingPoint,
    start: vec3f,
}

// Glossy pixel: its surface in view space, and the strength of its specular reflection.
struct Glossy {
    x: vec3f,
    n: vec3f,
    depth: f32,
    texel: vec4u,
    specular_fraction: f32,
}

// Node next to a point.
struct NeighborNode {
    weight: f32,
    at: Receiver,
}

// Prediction of the surrounding nodes.
struct Prediction {
    light: SpecularRadiance,
    around: array<NeighborNode, 4>,
    known: bool,
}

fn specular_color(light: SpecularRadiance, f0: vec3f) -> vec3f {
    return f0 * light.f0 + f90(f0) * light.f90;
}

fn bright(light: SpecularRadiance, f0: vec3f) -> f32 {
    return dot(vec3f(RED, GREEN, BLUE), specular_color(light, f0));
}

fn pack_radiance(light: SpecularRadiance) -> SpecularNode {
    let a = clamp(light.f0, vec3f(0.0), vec3f(MAX_HALF));
    let b = clamp(light.f90, vec3f(0.0), vec3f(MAX_HALF));
    return SpecularNode(array<u32, 4>(
        pack2x16float(a.xy), pack2x16float(vec2f(a.z, b.x)), pack2x16float(b.yz), 1u,
    ));
}

fn unpack_radiance(node: SpecularNode) -> SpecularRadiance {
    let a = unpack2x16float(node.words[0]);
    let b = unpack2x16float(node.words[1]);
    let c = unpack2x16float(node.words[2]);
    return SpecularRadiance(vec3f(a, b.x), vec3f(b.y, c));
}

fn glossy(pixel: vec2u) -> Glossy {
    var out: Glossy;
    out.depth = lit_depth(pixel);
    if out.depth <= 0.0 {
        return out;
    }
    out.texel = textureLoad(gbuffer, pixel, 0);
    let smooth_share = clamp((specular_params.max_roughness - gbuffer_roughness(out.texel)) / ROUGHNESS_FADE, 0.0, 1.0);
    out.specular_fraction = max(gbuffer_metallic(out.texel), smooth_share);
    out.x = view_position(pixel, out.depth);
    out.n = screen.view_from_world * gbuffer_normal(out.texel);
    return out;
}

fn slant(there: Glossy) -> f32 {
    return abs(dot(there.n, -normalize(there.x)));
}

fn surface_similarity(a: Glossy, b: Glossy) -> f32 {
    let plane = plane_similarity(a.x, a.n, b.x, b.n, depth_reach(a.x.z, a.depth));
    let normal = clamp((dot(a.n, b.n) - NORMAL_COSINE_FROM) / (NORMAL_COSINE_TO - NORMAL_COSINE_FROM), 0.0, 1.0);
    let apart = abs(gbuffer_roughness(a.texel) - gbuffer_roughness(b.texel));
    let rough = clamp(2.0 - 2.0 * apart / ROUGHNESS_TOLERANCE, 0.0, 1.0);
    let u = slant(a);
    let v = slant(b);
    let slants = clamp(2.0 - 2.0 * abs(u - v) / max(VIEW_COSINE_TOLERANCE * (u + v), TINY), 0.0, 1.0);
    return plane * normal * rough * slants;
}

fn receiver(pixel: vec2u, here: Glossy) -> Receiver {
    let uv = (vec2f(pixel) + 0.5 - params.viewport.xy) / params.viewport.zw;
    let ndc = vec2f(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0);
    let h = params.space_from_clip * vec4f(ndc, here.depth, 1.0);
    // Line of the pixel's positions at all depths. The far end may be infinite.
    let far = params.space_from_clip * vec4f(ndc, 0.0, 1.0);
    let near = far + params.space_from_clip[2];
    let v = normalize(near.xyz * far.w - far.xyz * near.w);
    let x = h.xyz / h.w;
    let n = gbuffer_normal(here.texel);
    return Receiver(x, ShadingPoint(n, v, gbuffer_roughness(here.texel)), vpl_start(x, n));
}

// Specular terms of light `i` toward the eye, over its flux.
fn specular_of_light(i: u32, at: Receiver) -> vec2f {
    let g = vpl_share(i, at.x, at.facet.n);
    let arrives = dot(at.facet.n, g);
    // Smaller values have no direction in single precision.
    if !(arrives > MIN) {
        return vec2f(0.0);
    }
    let toward = vpls[i].position - at.x;
    let spread = vpls[i].square / (dot(toward, toward) + vpls[i].square);
    let found = specular_terms(at.facet, normalize(g), spread);
    if found.x + found.y <= 0.0 {
        return vec2f(0.0);
    }
    let e = vpls[i].flux;
    // A reflection may be brighter than a white matte surface.
    let most = max(e.x, max(e.y, e.z)) * arrives * max(PI * (found.x + found.y), 1.0);
    if lit.nodes > 0u && most >= lit.dim {
        return arrives * vpl_transmittance(i, at.start) * found;
    }
    return arrives * found;
}

fn add_light(sum: ptr<function, SpecularRadiance>, i: u32, found: vec2f) {
    let flux = params.scale * vpls[i].flux;
    (*sum).f0 += found.x * flux;
    (*sum).f90 += found.y * flux;
}

// All lights at a pixel.
fn evaluate_all_lights(pixel: vec2u, here: Glossy) -> SpecularRadiance {
    let at = receiver(pixel, here);
    var sum = SpecularRadiance(vec3f(0.0), vec3f(0.0));
    for (var i = 0u; i < lit.vpls; i++) {
        add_light(&sum, i, specular_of_light(i, at));
    }
    return sum;
}

// Prediction of the nodes of level `k` + 1 at a cell of level `k`. At least one coordinate is odd.
fn predict(k: u32, cell: vec2u, here: Glossy) -> Prediction {
    let grid = level_grid(k + 1u);
    let odd = cell & vec2u(1u);
    var out: Prediction;
    var total = 0.0;
    let share = select(0.5, 0.25, all(odd == vec2u(1u)));
    for (var c = 0u; c < 4u; c++) {
        let step = vec2u(c & 1u, c >> 1u);
        let at = cell / 2u + step;
        if any(step > odd) || any(at >= grid) {
            continue;
        }
        let node = specular_nodes[cell_index(k + 1u, at)];
        if node.words[3] == 0u {
            continue;
        }
        let pixel = at << vec2u(k + 1u);
        let there = glossy(pixel);
        if there.specular_fraction <= 0.0 {
            continue;
        }
        let weight = share * surface_similarity(here, there);
        if weight > 0.0 {
            total += weight;
            out.around[c].weight = weight;
            out.around[c].at = receiver(pixel, there);
            let light = unpack_radiance(node);
            out.light.f0 += weight * light.f0;
            out.light.f90 += weight * light.f90;
        }
    }
    out.known = total > screen.min_similarity;
    let scale = select(0.0, 1.0 / max(total, TINY), out.known);
    out.light.f0 *= scale;
    out.light.f90 *= scale;
    for (var c = 0u; c < 4u; c++) {
        out.around[c].weight *= scale;
    }
    return out;
}

fn refine_mask_index(k: u32, cell: vec2u) -> u32 {
    return cell_index(k, cell) - level_start(2u);
}

// Union of the refine masks of level `k` + 1 around a cell of level `k`.
fn combined_refine_masks(k: u32, cell: vec2u) -> vec4u {
    if k + 1u == screen.coarsest_level {
        return vec4u(0xffffffffu);
    }
    let grid = vec2i(level_grid(k + 1u));
    let middle = vec2i(cell / 2u);
    // On an edge, the cells on both sides.
    let first = middle - 1 + vec2i(cell & vec2u(1u));
    var out = vec4u(0u);
    for (var y = first.y; y <= middle.y + 1; y++) {
        for (var x = first.x; x <= middle.x + 1; x++) {
            if x >= 0 && y >= 0 && x < grid.x && y < grid.y {
                out |= refine_masks[refine_mask_index(k + 1u, vec2u(vec2i(x, y)))];
            }
        }
    }
    return out;
}

fn keep(k: u32, cell: vec2u, node: SpecularNode, bits: vec4u) {
    specular_nodes[cell_index(k, cell)] = node;
    if k > 1u {
        refine_masks[refine_mask_index(k, cell)] = bits;
    }
}

@compute @workgroup_size(8, 8)
fn vpl_specular(@builtin(global_invocation_id) id: vec3u) {
    let k = span.first;
    let cell = id.xy;
    if any(cell >= level_grid(k)) {
        return;
    }
    let nothing = SpecularNode(array<u32, 4>(0u, 0u, 0u, 0u));
    let pixel = cell << vec2u(k);
    let here = glossy(pixel);
    if here.specular_fraction <= 0.0 {
        keep(k, cell, nothing, vec4u(0u));
        return;
    }
    if k == screen.coarsest_level {
        keep(k, cell, pack_radiance(evaluate_all_lights(pixel, here)), vec4u(0u));
        return;
    }
    if all((cell & vec2u(1u)) == vec2u(0u)) {
        keep(k, cell, specular_nodes[cell_index(k + 1u, cell / 2u)], vec4u(0u));
        return;
    }
    let before = predict(k, cell, here);
    var wants = combined_refine_masks(k, cell);
    let finer = k >= screen.finest_level;
    if before.known && (all(wants == vec4u(0u)) || !finer) {
        keep(k, cell, pack_radiance(before.light), vec4u(0u));
        return;
    }
    if !before.known && !finer {
        keep(k, cell, nothing, vec4u(0u));
        return;
    }
    let f0 = gbuffer_f0(here.texel);
    let earlier = bright(before.light, f0);
    let most = screen.radiance_threshold * (earlier + FLOOR * FRAC_1_PI);
    if before.known && specular_params.together == 1u {
        let node = pack_radiance(evaluate_all_lights(pixel, here));
        let off = abs(bright(unpack_radiance(node), f0) - earlier);
        keep(k, cell, node, vec4u(select(0u, 0xffffffffu, off > most)));
        return;
    }
    if !before.known {
        wants = vec4u(0xffffffffu);
    }
    let at = receiver(pixel, here);
    let group = max((lit.vpls + LIGHT_GROUPS - 1u) / LIGHT_GROUPS, 1u);
    var light = before.light;
    var bits = vec4u(0u);
    for (var g = 0u; g * group < lit.vpls; g++) {
        if ((wants[g / 32u] >> (g % 32u)) & 1u) == 0u {
            continue;
        }
        var change = SpecularRadiance(vec3f(0.0), vec3f(0.0));
        for (var i = g * group; i < min((g + 1u) * group, lit.vpls); i++) {
            var found = specular_of_light(i, at);
            for (var c = 0u; c < 4u; c++) {
                let weight = before.around[c].weight;
                if weight > 0.0 {
                    found -= weight * specular_of_light(i, before.around[c].at);
                }
            }
            add_light(&change, i, found);
        }
        light.f0 += change.f0;
        light.f90 += change.f90;
        if abs(bright(change, f0)) > most {
            bits[g / 32u] |= 1u << (g % 32u);
        }
    }
    keep(k, cell, pack_radiance(light), bits);
}

@compute @workgroup_size(8, 8)
fn vpl_specular_pixels(@builtin(global_invocation_id) id: vec3u) {
    let pixel = id.xy;
    if any(pixel >= screen.size) {
        return;
    }
    let here = glossy(pixel);
    if here.specular_fraction <= 0.0 {
        textureStore(output, pixel, vec4f(0.0));
        return;
    }
    var light: SpecularRadiance;
    var known = false;
    if all((pixel & vec2u(1u)) == vec2u(0u)) {
        let node = specular_nodes[cell_index(1u, pixel / 2u)];
        light = unpack_radiance(node);
        known = node.words[3] == 1u;
    } else {
        let before = predict(0u, pixel, here);
        light = before.light;
        known = before.known;
    }
    if !known {
        light = unpack_radiance(pack_radiance(evaluate_all_lights(pixel, here)));
    }
    let f0 = gbuffer_f0(here.texel);
    let color = here.specular_fraction * multiscatter_compensation(gbuffer_roughness(here.texel), f0) * specular_color(light, f0);
    textureStore(output, pixel, vec4f(min(color, vec3f(MAX_HALF)), 1.0));
}
