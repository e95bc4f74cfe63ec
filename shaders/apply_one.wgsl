// apply_one: product of the operator and one channel of the senders' coefficients. The other
// channels are proportional to it. Twin: crates/meshless_gi/src/frame/apply_one.rs. Rows and
// threads: lib/apply.

@group(0) @binding(0) var<uniform> params: SolveParams;
// Four numbers per coefficient. Only one of them is read.
@group(0) @binding(4) var<storage, read> coefficients: array<f32>;

var<workgroup> sums: array<vec3f, 64>;

@compute @workgroup_size(64)
fn apply_one(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let part = row_part(flat_group(group, groups), local);
    let channel = params.channel;
    var sum = vec3f(0.0);
    for (var at = part.first; at < part.end; at += LANES) {
        let link = links[at];
        sum += link_vector(link) * coefficients[(link.z_sender >> 16u) * 4u + channel];
    }
    sums[local] = sum;
    for (var width = LANES / 2u; width > 0u; width /= 2u) {
        workgroupBarrier();
        if part.lane < width {
            sums[local] += sums[local + width];
        }
    }
    if part.writes {
        let e = part.scale * sums[local];
        let hue = vec4f(params.hue.xyz, 0.0);
        applied[part.row] = VectorIrradiance(e.x * hue, e.y * hue, e.z * hue);
    }
}
