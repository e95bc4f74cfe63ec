// push: averages to differences, [L08] Eq. (7). Twin: crates/meshless_gi/src/frame/push.rs. One
// dispatch per level, coarse to fine.

@group(0) @binding(0) var<uniform> params: SolveParams;
@group(0) @binding(1) var<uniform> span: Span;
@group(0) @binding(2) var<storage, read> starts: array<u32>;
@group(0) @binding(3) var<storage, read> entries: array<WeightEntry>;
@group(0) @binding(4) var<storage, read> senders: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> differences: array<vec4f>;

@compute @workgroup_size(64)
fn push(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let i = flat_group(group, groups) * 64u + local;
    // The sky is not a function of a level.
    if i == 0u {
        differences[params.sky_sender] = senders[params.sky_sender];
    }
    if i >= span.count {
        return;
    }
    let j = span.first + i;
    var alpha = senders[j];
    let end = starts[j + 1u];
    for (var at = starts[j]; at < end; at++) {
        let entry = entries[at];
        alpha -= entry.weight * differences[entry.index];
    }
    differences[j] = alpha;
}
