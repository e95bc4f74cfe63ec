// occlude: links that cross occluders, for the current transmittances. Twin:
// crates/meshless_gi/src/frame/occlude.rs. One thread per term. The thread of the first term of a
// link sums all of them.

@group(0) @binding(1) var<uniform> span: Span;
@group(0) @binding(2) var<storage, read> terms: array<PackedLinkTerm>;
// Transmittance of each set of occluders.
@group(0) @binding(3) var<storage, read> transmittances: array<f32>;
// The first of them is the operator's link `span.base`.
@group(0) @binding(4) var<storage, read_write> links: array<Link>;

@compute @workgroup_size(64)
fn occlude(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let i = flat_group(group, groups) * 64u + local;
    if i >= span.count {
        return;
    }
    let link = terms[i].link;
    if i > 0u && terms[i - 1u].link == link {
        return;
    }
    var sum = vec3f(0.0);
    for (var at = i; at < span.count && terms[at].link == link; at++) {
        let term = terms[at];
        let v = vec3f(unpack2x16float(term.xy), unpack2x16float(term.z_set).x);
        sum += transmittances[term.z_set >> 16u] * v;
    }
    let sender = links[link - span.base].z_sender & 0xffff0000u;
    let z = pack2x16float(vec2f(sum.z, 0.0)) & 0xffffu;
    links[link - span.base] = Link(pack2x16float(sum.xy), z | sender);
}
