// Lists of cells. Twin: crates/meshless_gi/src/frame/refine.rs. A count stores the three numbers of
// an indirect dispatch, the number of items, and the number of cells that were divided for them.

const ITEMS: u32 = 64u;
const MAX_GROUPS: u32 = 65535u;

fn pack_cell(cell: vec2u) -> u32 {
    return cell.x | cell.y << 16u;
}

fn unpack_cell(word: u32) -> vec2u {
    return vec2u(word & 0xffffu, word >> 16u);
}

fn groups_of(count: u32) -> u32 {
    return min((count + ITEMS - 1u) / ITEMS, MAX_GROUPS);
}
