// apply: the operator times the senders' coefficients. Twin: crates/meshless_gi/src/frame/apply.rs.
// Sixteen threads share a row, so that they read its links side by side; their sums meet in
// workgroup memory.

@group(0) @binding(1) var<uniform> span: Span;
@group(0) @binding(2) var<storage, read> rows: array<Row>;
// The links of a part of the rows; the first of them is the operator's link `span.base`.
@group(0) @binding(3) var<storage, read> links: array<Link>;
@group(0) @binding(4) var<storage, read> coefficients: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> applied: array<VectorIrradiance>;
// The rows in the order of their links: by tier. The span is a range of it.
@group(0) @binding(6) var<storage, read> order: array<u32>;

const LANES: u32 = 16u;
const ROWS: u32 = 4u;

var<workgroup> sums_x: array<vec3f, 64>;
var<workgroup> sums_y: array<vec3f, 64>;
var<workgroup> sums_z: array<vec3f, 64>;

@compute @workgroup_size(64)
fn apply(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let lane = local % LANES;
    let r = flat_group(group, groups) * ROWS + local / LANES;
    let inside = r < span.count;
    let i = order[span.first + min(r, span.count - 1u)];
    let row = rows[i];
    let start = row.start - span.base;
    var x = vec3f(0.0);
    var y = vec3f(0.0);
    var z = vec3f(0.0);
    for (var at = lane; at < row.count; at += LANES) {
        let link = links[start + at];
        let f = coefficients[link.z_sender >> 16u].xyz;
        let v = vec3f(unpack2x16float(link.xy), unpack2x16float(link.z_sender).x);
        x += v.x * f;
        y += v.y * f;
        z += v.z * f;
    }
    sums_x[local] = x;
    sums_y[local] = y;
    sums_z[local] = z;
    for (var width = LANES / 2u; width > 0u; width /= 2u) {
        workgroupBarrier();
        if lane < width {
            sums_x[local] += sums_x[local + width];
            sums_y[local] += sums_y[local + width];
            sums_z[local] += sums_z[local + width];
        }
    }
    if inside && lane == 0u {
        applied[i] = VectorIrradiance(
            vec4f(row.scale * sums_x[local], 0.0),
            vec4f(row.scale * sums_y[local], 0.0),
            vec4f(row.scale * sums_z[local], 0.0),
        );
    }
}
