// probe: light in free space, for what moves: what functions on surfaces leave of a pixel's or a
// node's light. Twin: crates/meshless_gi/src/frame/probe.rs. `params` has the probes' grid.

@group(0) @binding(0) var<uniform> params: SplatParams;
@group(0) @binding(1) var depths: texture_depth_2d;
@group(0) @binding(2) var gbuffer: texture_2d<u32>;
@group(0) @binding(3) var<storage, read> points: array<Point>;
@group(0) @binding(4) var<storage, read> planes: array<vec4f>;
@group(0) @binding(5) var<storage, read> grid_slots: array<GridSlot>;
@group(0) @binding(6) var<storage, read> grid_entries: array<u32>;
// Three a probe.
@group(0) @binding(7) var<storage, read> values: array<VectorIrradiance>;
@group(0) @binding(8) var output: texture_storage_2d<rgba16float, write>;
@group(0) @binding(9) var earlier: texture_2d<f32>;

@group(0) @binding(10) var<uniform> screen: SubsplatParams;
@group(0) @binding(11) var<uniform> span: Span;
@group(0) @binding(12) var<storage, read_write> nodes: array<SubsplatNode>;
@group(0) @binding(13) var<storage, read> lists: array<u32>;
@group(0) @binding(14) var<storage, read> counted: array<u32>;

// Its twin: crates/meshless_gi/src/basis/probes.rs.
fn weight_in_space(probe: Point, x: vec3f, n: vec3f) -> f32 {
    let r = distance(x, probe.position);
    if r >= probe.radius {
        return 0.0;
    }
    let first = probe.planes & 0x00ffffffu;
    let end = first + (probe.planes >> 24u);
    for (var i = first; i < end; i++) {
        if !is_before(i, x, n, probe.radius) {
            return 0.0;
        }
    }
    return kernel(r / probe.radius);
}

// Distance before a surface at which light is read where no probe reaches the surface, in cells.
const RETRY_OFFSET: f32 = 0.1;

fn probe(x: vec3f, n: vec3f) -> ProbeIrradiance {
    let light = probe_at(x, n);
    if light.reached {
        return light;
    }
    return probe_at(x + (RETRY_OFFSET * params.cell_size) * n, n);
}

fn probe_at(x: vec3f, n: vec3f) -> ProbeIrradiance {
    let nothing = VectorIrradiance(vec4f(0.0), vec4f(0.0), vec4f(0.0));
    var sums = array<VectorIrradiance, 3>(nothing, nothing, nothing);
    var cover = 0.0;
    var all_weights = 0.0;
    let near = grid_near(x, params.cell_size, params.slot_mask);
    for (var at = near.x; at < near.x + near.y; at++) {
        let j = grid_entries[at];
        let w = weight_in_space(points[j], x, n);
        if w > 0.0 {
            cover += w;
            all_weights += w * w;
            for (var k = 0u; k < PROBE_ROWS; k++) {
                let value = values[PROBE_ROWS * j + k];
                sums[k].x += (w * w) * value.x;
                sums[k].y += (w * w) * value.y;
                sums[k].z += (w * w) * value.z;
            }
        }
    }
    if cover <= NO_COVER {
        return ProbeIrradiance(nothing, nothing, nothing, false);
    }
    for (var k = 0u; k < PROBE_ROWS; k++) {
        sums[k].x /= all_weights;
        sums[k].y /= all_weights;
        sums[k].z /= all_weights;
    }
    return ProbeIrradiance(sums[0], sums[1], sums[2], true);
}

// The vector irradiance that gives E(n) at n and changes beside it as E does.
fn around(light: ProbeIrradiance, n: vec3f) -> VectorIrradiance {
    // Half the gradient of n·Q n is Q n.
    let a = light.even;
    let m = light.mixed;
    let gx = light.linear.x + 2.0 * (a.y * n.x + m.x * n.y + m.y * n.z);
    let gy = light.linear.y + 2.0 * (m.x * n.x + a.z * n.y + m.z * n.z);
    let gz = light.linear.z + 2.0 * (m.y * n.x + m.z * n.y - (a.y + a.z) * n.z);
    let e = vec4f(space_irradiance(light, n), 0.0) - (gx * n.x + gy * n.y + gz * n.z);
    return VectorIrradiance(gx + e * n.x, gy + e * n.y, gz + e * n.z);
}

@compute @workgroup_size(8, 8)
fn probe_over(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.size) {
        return;
    }
    var texel = textureLoad(earlier, id.xy, 0);
    let depth = textureLoad(depths, id.xy, 0);
    let surface = textureLoad(gbuffer, id.xy, 0);
    if texel.a < 1.0 && depth > 0.0 && !gbuffer_is_unlit(surface) {
        let at = pixel_position(id.xy, depth, surface);
        let light = probe(at.x, at.n);
        if light.reached {
            let e = space_irradiance(light, at.n) * params.scale;
            texel = vec4f(min(mix(e, texel.rgb, texel.a), vec3f(LARGEST_HALF)), 1.0);
        }
    }
    textureStore(output, id.xy, texel);
}

@compute @workgroup_size(64)
fn probe_nodes(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let k = span.first;
    let count = min(counted[3], span.count);
    for (var i = id.x; i < count; i += groups.x * ITEMS) {
        let item = listed(k, i);
        if item.at == NOWHERE {
            continue;
        }
        let node = nodes[item.at];
        // Functions on surfaces say all, or nothing is there to be lit.
        let missing = node_probe_fraction(node);
        if missing <= 0.0 || !node_is(node, KNOWN) {
            continue;
        }
        let pixel = item.cell << vec2u(k);
        let surface = textureLoad(gbuffer, pixel, 0);
        let there = pixel_position(pixel, textureLoad(depths, pixel, 0), surface);
        let light = probe(there.x, there.n);
        if light.reached {
            let space = to_world(around(light, there.n));
            var sum = VectorIrradiance(vec4f(0.0), vec4f(0.0), vec4f(0.0));
            add_scaled(&sum, 1.0 - missing, node_light(node));
            add_scaled(&sum, missing, space);
            nodes[item.at] = node_new(
                sum,
                node_predicted_luminance(node),
                EVALUATED | KNOWN | COVERED,
            );
        }
    }
}
