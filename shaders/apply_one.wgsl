// apply_one: the operator times one channel of the senders' coefficients, where the others follow
// from it. Twin: crates/meshless_gi/src/frame/apply_one.rs. Threads share rows as in `apply`.

@group(0) @binding(0) var<uniform> params: SolveParams;
@group(0) @binding(1) var<uniform> span: Span;
@group(0) @binding(2) var<storage, read> rows: array<Row>;
// The links of a part of the rows; the first of them is the operator's link `span.base`.
@group(0) @binding(3) var<storage, read> links: array<Link>;
// Four numbers a coefficient, of which one is read.
@group(0) @binding(4) var<storage, read> coefficients: array<f32>;
@group(0) @binding(5) var<storage, read_write> applied: array<VectorIrradiance>;
// The rows in the order of their links: by tier. The span is a range of it.
@group(0) @binding(6) var<storage, read> order: array<u32>;

const LANES: u32 = 16u;
const ROWS: u32 = 4u;

var<workgroup> sums: array<vec3f, 64>;

@compute @workgroup_size(64)
fn apply_one(
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
    let channel = params.channel;
    var sum = vec3f(0.0);
    for (var at = lane; at < row.count; at += LANES) {
        let link = links[start + at];
        let v = vec3f(unpack2x16float(link.xy), unpack2x16float(link.z_sender).x);
        sum += v * coefficients[(link.z_sender >> 16u) * 4u + channel];
    }
    sums[local] = sum;
    for (var width = LANES / 2u; width > 0u; width /= 2u) {
        workgroupBarrier();
        if lane < width {
            sums[local] += sums[local + width];
        }
    }
    if inside && lane == 0u {
        let e = row.scale * sums[local];
        let hue = vec4f(params.hue.xyz, 0.0);
        applied[i] = VectorIrradiance(e.x * hue, e.y * hue, e.z * hue);
    }
}
