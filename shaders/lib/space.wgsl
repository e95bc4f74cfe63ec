// Light at places in free space, of shaders that bind `params` with the probes' grid, and `points`, `planes`, `grid_slots`, `grid_entries` and `values` of the probes.
// Twins: src/frame/probe.rs; the weight's: src/basis/probes.rs.

const PROBE_ROWS: u32 = 3u;

// E(n) = c + d·n + n·Q n: d; (c, Q_xx, Q_yy); (Q_xy, Q_xz, Q_yz).
struct SpaceLight {
    linear: VectorIrradiance,
    even: VectorIrradiance,
    mixed: VectorIrradiance,
    reached: bool,
}

fn weight_in_space(probe: Point, x: vec3f) -> f32 {
    let r = distance(x, probe.position);
    if r >= probe.radius {
        return 0.0;
    }
    let first = probe.planes & 0x00ffffffu;
    let end = first + (probe.planes >> 24u);
    for (var i = first; i < end; i++) {
        if dot(planes[i], vec4f(x, 1.0)) < 0.0 {
            return 0.0;
        }
    }
    return kernel(r / probe.radius);
}

fn probe(x: vec3f) -> SpaceLight {
    let nothing = VectorIrradiance(vec4f(0.0), vec4f(0.0), vec4f(0.0));
    var sums = array<VectorIrradiance, 3>(nothing, nothing, nothing);
    var cover = 0.0;
    var all_weights = 0.0;
    let near = grid_near(x, params.cell_size, params.slot_mask);
    for (var at = near.x; at < near.x + near.y; at++) {
        let j = grid_entries[at];
        let w = weight_in_space(points[j], x);
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
        return SpaceLight(nothing, nothing, nothing, false);
    }
    for (var k = 0u; k < PROBE_ROWS; k++) {
        sums[k].x /= all_weights;
        sums[k].y /= all_weights;
        sums[k].z /= all_weights;
    }
    return SpaceLight(sums[0], sums[1], sums[2], true);
}

// E(n), not below zero.
fn space_irradiance(light: SpaceLight, n: vec3f) -> vec3f {
    let square = n * n;
    let e = light.even.x
        + light.even.y * (square.x - square.z)
        + light.even.z * (square.y - square.z)
        + 2.0 * (light.mixed.x * (n.x * n.y) + light.mixed.y * (n.x * n.z) + light.mixed.z * (n.y * n.z));
    return max(e.xyz + irradiance_dot(light.linear, n), vec3f(0.0));
}
