// pull: the coefficient of a sender is the mean of the next finer level over its support. Twin:
// crates/meshless_gi/src/frame/pull.rs. One dispatch per level, fine to coarse.

@group(0) @binding(1) var<uniform> span: Span;
@group(0) @binding(2) var<storage, read> starts: array<u32>;
@group(0) @binding(3) var<storage, read> entries: array<WeightEntry>;
@group(0) @binding(4) var<storage, read_write> senders: array<vec4f>;

@compute @workgroup_size(64)
fn pull(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let i = flat_group(group, groups) * 64u + local;
    if i >= span.count {
        return;
    }
    let k = span.first + i;
    let start = starts[k];
    let end = starts[k + 1u];
    if start == end {
        return;
    }
    var sum = vec4f(0.0);
    for (var at = start; at < end; at++) {
        let entry = entries[at];
        sum += entry.weight * senders[entry.index];
    }
    senders[k] = sum;
}
