// probe: irradiance from probes for dynamic objects, blended with that of surface functions in a
// pixel or subsplat. Twin: crates/meshless_gi/src/frame/probe.rs. `params` has the probes' grid.

// Three per probe.
@group(0) @binding(7) var<storage, read> values: array<VectorIrradiance>;

// Twin: crates/meshless_gi/src/basis/probes.rs.
fn probe_weight(probe: Point, x: vec3f, n: vec3f) -> f32 {
    let r = distance(x, probe.position);
    if r >= probe.radius {
        return 0.0;
    }
    if !is_inside(probe, x, n, 0.0) {
        return 0.0;
    }
    return kernel(r / probe.radius);
}

// Distance in front of a surface at which probes are read again if none reaches the surface, in
// cells.
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
    let range = grid_range(x);
    for (var at = range.x; at < range.y; at++) {
        let j = grid_entries[at];
        let w = probe_weight(points[j], x, n);
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

// Vector irradiance that equals E(n) at n and has its gradient there.
fn linearize(light: ProbeIrradiance, n: vec3f) -> VectorIrradiance {
    // Half of the gradient of n·Q n is Q n.
    let a = light.even;
    let m = light.mixed;
    let gx = light.linear.x + 2.0 * (a.y * n.x + m.x * n.y + m.y * n.z);
    let gy = light.linear.y + 2.0 * (m.x * n.x + a.z * n.y + m.z * n.z);
    let gz = light.linear.z + 2.0 * (m.y * n.x + m.z * n.y - (a.y + a.z) * n.z);
    let e = vec4f(probe_irradiance(light, n), 0.0) - (gx * n.x + gy * n.y + gz * n.z);
    return VectorIrradiance(gx + e * n.x, gy + e * n.y, gz + e * n.z);
}

@compute @workgroup_size(8, 8)
fn next_scene(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.size) {
        return;
    }
    var texel = textureLoad(earlier, id.xy, 0);
    let at = pixel_position(id.xy);
    if texel.a < 1.0 && at.lit {
        let light = probe(at.x, at.n);
        if light.reached {
            let e = probe_irradiance(light, at.n) * params.scale;
            texel = vec4f(min(mix(e, texel.rgb, texel.a), vec3f(MAX_HALF)), 1.0);
        }
    }
    textureStore(output, id.xy, texel);
}

fn evaluate_subsplat(pixel: vec2u, node: SubsplatNode) -> SubsplatNode {
    let missing = node_probe_fraction(node);
    // Surface functions give all its light, or it has no surface.
    if missing <= 0.0 || !node_is(node, KNOWN) {
        return node;
    }
    let at = pixel_position(pixel);
    let light = probe(at.x, at.n);
    if !light.reached {
        return node;
    }
    var sum = VectorIrradiance(vec4f(0.0), vec4f(0.0), vec4f(0.0));
    add_scaled(&sum, 1.0 - missing, node_light(node));
    add_scaled(&sum, missing, to_world(linearize(light, at.n)));
    return node_new(sum, node_predicted_luminance(node), EVALUATED | KNOWN | COVERED);
}
