// compress: radiosity of the senders in the bases of an operator of components, [P14] Eq. (10).
// Twin: crates/meshless_gi/src/frame/compress.rs. One workgroup per column.

@group(0) @binding(2) var<storage, read> columns: array<Column>;
@group(0) @binding(3) var<storage, read> members: array<u32>;
// Two halves per word.
@group(0) @binding(4) var<storage, read> column_values: array<u32>;
@group(0) @binding(5) var<storage, read> senders: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> components: array<vec4f>;

const COLUMN_LANES: u32 = 64u;

var<workgroup> sums: array<vec4f, 64>;

@compute @workgroup_size(64)
fn compress(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let c = flat_group(group, groups);
    let inside = c < arrayLength(&columns);
    let column = columns[min(c, arrayLength(&columns) - 1u)];
    var sum = vec4f(0.0);
    for (var pair = local; 2u * pair < column.count; pair += COLUMN_LANES) {
        let values = unpack2x16float(column_values[column.value + pair]);
        let k = column.member + 2u * pair;
        sum += values.x * senders[members[k]];
        if 2u * pair + 1u < column.count {
            sum += values.y * senders[members[k + 1u]];
        }
    }
    sums[local] = sum;
    for (var width = COLUMN_LANES / 2u; width > 0u; width /= 2u) {
        workgroupBarrier();
        if local < width {
            sums[local] += sums[local + width];
        }
    }
    if inside && local == 0u {
        components[c] = column.scale * sums[0];
    }
}
