// Evaluation of the subsplats in a level's list: bindings and entry point of `splat`, `probe` and
// `vpl`. Twins: crates/meshless_gi/src/frame/refine.rs and subsplat_view.rs. Needs lib/screen,
// lib/list and `fn evaluate_subsplat(pixel: vec2u, node: SubsplatNode) -> SubsplatNode`, which
// returns `node` if nothing changes.

@group(0) @binding(10) var<uniform> screen: SubsplatParams;
@group(0) @binding(11) var<uniform> span: Span;
@group(0) @binding(12) var<storage, read_write> subsplats: array<SubsplatNode>;
@group(0) @binding(13) var<storage, read> lists: array<u32>;
@group(0) @binding(14) var<storage, read> counted: array<u32>;

struct Listed {
    cell: vec2u,
    // Index of its node, or NO_NODE if the node belongs to the level above.
    at: u32,
}

const NO_NODE: u32 = 0xffffffffu;

// Cell and node of entry `i` of the list of level `k`.
fn listed(k: u32, i: u32) -> Listed {
    let cell = unpack_cell(lists[level_start(k) + i]);
    if k == 0u {
        // Single pixels lie in the order of their list.
        return Listed(cell, level_start(0u) + i);
    }
    // The node of an even cell is that of the level above.
    let above = k < screen.coarsest_level && all((cell & vec2u(1u)) == vec2u(0u));
    return Listed(cell, select(cell_index(k, cell), NO_NODE, above));
}

@compute @workgroup_size(64)
fn evaluate_list(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let k = span.first;
    let count = min(counted[3], span.count);
    for (var i = id.x; i < count; i += groups.x * ITEMS) {
        let item = listed(k, i);
        if item.at != NO_NODE {
            subsplats[item.at] = evaluate_subsplat(item.cell << vec2u(k), subsplats[item.at]);
        }
    }
}
