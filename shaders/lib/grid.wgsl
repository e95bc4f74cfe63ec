// Hashed grid: candidates among the functions that cover a point. Twin:
// crates/meshless_gi/src/samples/grid.rs. Needs lib/pixel_position.

@group(0) @binding(5) var<storage, read> grid_slots: array<GridSlot>;
@group(0) @binding(6) var<storage, read> grid_entries: array<u32>;

const EMPTY_SLOT: u32 = 0xffffffffu;
const CELL_LIMIT: f32 = 1073741824.0;

fn grid_hash(cell: vec3i) -> u32 {
    let c = bitcast<vec3u>(cell);
    var h = c.x * 0x8da6b343u + c.y * 0xd8163841u + c.z * 0xcb1ab31fu;
    h ^= h >> 16u;
    h *= 0x7feb352du;
    h ^= h >> 15u;
    return h;
}

fn grid_cell(p: vec3f, cell_size: f32) -> vec3i {
    return vec3i(clamp(floor(p / cell_size), vec3f(-CELL_LIMIT), vec3f(CELL_LIMIT)));
}

// Range of the list of the cell of `p` in `grid_entries`: first index and end.
fn grid_range(p: vec3f) -> vec2u {
    let slot_mask = params.slot_mask;
    let cell = grid_cell(p, params.cell_size);
    var at = grid_hash(cell) & slot_mask;
    // The table is at most half full, so a free slot ends the search.
    for (var i = 0u; i <= slot_mask; i++) {
        let slot = grid_slots[at];
        if slot.start == EMPTY_SLOT {
            break;
        }
        if all(slot.cell == cell) {
            let first = slot.start + 1u;
            return vec2u(first, first + grid_entries[slot.start]);
        }
        at = (at + 1u) & slot_mask;
    }
    return vec2u(0u);
}
