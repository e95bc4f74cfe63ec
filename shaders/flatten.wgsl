// flatten: values of all points on one level. Twin: crates/meshless_gi/src/frame/flatten.rs.
// `averages` has one dispatch per level, coarse to fine. `differences` has one dispatch.

@group(0) @binding(0) var<uniform> params: SolveParams;
@group(0) @binding(1) var<uniform> span: Span;
@group(0) @binding(2) var<storage, read> rows: array<Row>;
@group(0) @binding(3) var<storage, read> starts: array<u32>;
@group(0) @binding(4) var<storage, read> entries: array<WeightEntry>;
@group(0) @binding(5) var<storage, read> applied: array<VectorIrradiance>;
@group(0) @binding(6) var<storage, read_write> values: array<VectorIrradiance>;

@compute @workgroup_size(64)
fn averages(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let r = flat_group(group, groups) * 64u + local;
    if r >= span.count {
        return;
    }
    let i = span.first + r;
    let tier = rows[i].tier;
    if tier != 0u && tier <= params.tier {
        return;
    }
    var sum = VectorIrradiance(vec4f(0.0), vec4f(0.0), vec4f(0.0));
    let end = starts[i + 1u];
    for (var at = starts[i]; at < end; at++) {
        let entry = entries[at];
        add_scaled(&sum, entry.weight, values[entry.index]);
    }
    values[i] = sum;
}

@compute @workgroup_size(64)
fn differences(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let r = flat_group(group, groups) * 64u + local;
    if r >= span.count {
        return;
    }
    let i = span.first + r;
    var sum = applied[i];
    let end = starts[i + 1u];
    for (var at = starts[i]; at < end; at++) {
        let entry = entries[at];
        add_scaled(&sum, entry.weight, applied[entry.index]);
    }
    values[i] = sum;
}
