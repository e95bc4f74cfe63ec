// Which node an entry of a level's list names. Needs `screen`, `lists`, lib/screen and lib/list.

struct Listed {
    cell: vec2u,
    // Index of its node; NOWHERE where the level above has it.
    at: u32,
}

const NOWHERE: u32 = 0xffffffffu;

fn listed(k: u32, i: u32) -> Listed {
    let cell = unpack_cell(lists[level_start(k) + i]);
    if k == 0u {
        // Single pixels lie in the order of their list.
        return Listed(cell, level_start(0u) + i);
    }
    // The node of an even cell is that of the level above.
    let above = k < screen.coarsest && all((cell & vec2u(1u)) == vec2u(0u));
    return Listed(cell, select(cell_index(k, cell), NOWHERE, above));
}
