// apply: product of the operator and the senders' coefficients, [L08] Eq. (14). Twin:
// crates/meshless_gi/src/frame/apply.rs. Rows and threads: lib/apply.

@group(0) @binding(4) var<storage, read> coefficients: array<vec4f>;

var<workgroup> sums_x: array<vec3f, 64>;
var<workgroup> sums_y: array<vec3f, 64>;
var<workgroup> sums_z: array<vec3f, 64>;

@compute @workgroup_size(64)
fn apply(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let part = row_part(flat_group(group, groups), local);
    var x = vec3f(0.0);
    var y = vec3f(0.0);
    var z = vec3f(0.0);
    for (var at = part.first; at < part.end; at += LANES) {
        let link = links[at];
        let f = coefficients[link.z_sender >> 16u].xyz;
        let v = link_vector(link);
        x += v.x * f;
        y += v.y * f;
        z += v.z * f;
    }
    sums_x[local] = x;
    sums_y[local] = y;
    sums_z[local] = z;
    for (var width = LANES / 2u; width > 0u; width /= 2u) {
        workgroupBarrier();
        if part.lane < width {
            sums_x[local] += sums_x[local + width];
            sums_y[local] += sums_y[local + width];
            sums_z[local] += sums_z[local + width];
        }
    }
    if part.writes {
        applied[part.row] = VectorIrradiance(
            vec4f(part.scale * sums_x[local], 0.0),
            vec4f(part.scale * sums_y[local], 0.0),
            vec4f(part.scale * sums_z[local], 0.0),
        );
    }
}
