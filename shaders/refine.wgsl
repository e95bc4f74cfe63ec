// refine: selection of the cells that are divided. Twin: crates/meshless_gi/src/frame/refine.rs.
// `start` lists the cells of the coarsest level, `refine` the children of divided cells.

@group(0) @binding(0) var<uniform> screen: SubsplatParams;
@group(0) @binding(1) var<uniform> span: Span;
@group(0) @binding(2) var depths: texture_depth_2d;
@group(0) @binding(3) var gbuffer: texture_2d<u32>;
@group(0) @binding(4) var<storage, read> cells: array<CellRange>;
@group(0) @binding(5) var<storage, read> nodes: array<SubsplatNode>;
@group(0) @binding(6) var<storage, read_write> lists: array<u32>;
@group(0) @binding(7) var<storage, read> counted: array<u32>;
@group(0) @binding(8) var<storage, read_write> next: array<atomic<u32>>;

const FLOOR: f32 = 0.1;

fn is_discontinuous(k: u32, at: vec2u) -> bool {
    let cell = cells[cell_index(k, at)];
    var broken = false;
    switch screen.depth_test {
        case 0u: {
            broken = cell.far * f32(1u << k) > screen.depth_threshold;
        }
        case 1u: {
            broken = cell.far - cell.near > screen.depth_threshold * cell.near;
        }
        default: {
            broken = cell.far > screen.depth_threshold;
        }
    }
    if screen.normal_test == 0u {
        let range = vec3f((signed_bytes(cell.high) - signed_bytes(cell.low)).xyz);
        broken = broken || any(range > vec3f(127.0 * screen.normal_threshold));
    } else {
        broken = broken || (bitcast<f32>(cell.high) > screen.normal_threshold && cell.low != EMPTY_LOW);
    }
    return broken;
}

fn exceeds_prediction(k: u32, cell: vec2u) -> bool {
    let node = nodes[cell_index(k, cell)];
    if !node_is(node, EVALUATED | COVERED) {
        return false;
    }
    let found = luminance(node, pixel_normal(cell << vec2u(k)));
    let predicted_luminance = node_predicted_luminance(node);
    return abs(found - predicted_luminance) > screen.radiance_threshold * (0.5 * (found + predicted_luminance) + FLOOR);
}

fn is_divided(k: u32, cell: vec2u) -> bool {
    if k == screen.coarsest_level || is_discontinuous(k, cell) {
        return true;
    }
    let grid = level_grid(k);
    if screen.diagonal != 0u {
        for (var i = 0u; i < 4u; i++) {
            // Negative coordinates are outside of the grid, too.
            let other = cell + 2u * vec2u(i & 1u, i >> 1u) - 1u;
            if all(other < grid) && is_discontinuous(k, other) {
                return true;
            }
        }
    }
    for (var i = 0u; i < 4u; i++) {
        let corner = cell + vec2u(i & 1u, i >> 1u);
        if all(corner < grid) && exceeds_prediction(k, corner) {
            return true;
        }
    }
    return false;
}

@compute @workgroup_size(64)
fn start(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let k = screen.coarsest_level;
    let grid = level_grid(k);
    let count = grid.x * grid.y;
    let i = flat_group(group, groups) * ITEMS + lane;
    if i == 0u {
        atomicStore(&next[0], groups_of(count));
        atomicStore(&next[3], count);
    }
    if i < count {
        lists[level_start(k) + i] = pack_cell(vec2u(i % grid.x, i / grid.x));
    }
}

@compute @workgroup_size(64)
fn refine(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let k = span.first;
    let grid = level_grid(k - 1u);
    let count = counted[3];
    for (var i = id.x; i < count; i += groups.x * ITEMS) {
        let cell = unpack_cell(lists[level_start(k) + i]);
        if !is_divided(k, cell) {
            continue;
        }
        let first = 2u * cell;
        // At the image border some children are outside.
        let inside = min(grid - first, vec2u(2u));
        let children = inside.x * inside.y;
        atomicAdd(&next[4], 1u);
        let slot = atomicAdd(&next[3], children);
        atomicMax(&next[0], groups_of(slot + children));
        for (var c = 0u; c < children; c++) {
            lists[level_start(k - 1u) + slot + c] = pack_cell(first + vec2u(c % inside.x, c / inside.x));
        }
    }
}
