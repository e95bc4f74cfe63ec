// Rows of the operator, shared by `apply` and `apply_one`. Sixteen threads of a workgroup share a
// row, so that neighboring threads read neighboring links. Their sums are added in workgroup
// memory.

@group(0) @binding(1) var<uniform> span: Span;
@group(0) @binding(2) var<storage, read> rows: array<Row>;
// Links of a part of the rows. The first of them is the operator's link `span.base`.
@group(0) @binding(3) var<storage, read> links: array<Link>;
@group(0) @binding(5) var<storage, read_write> applied: array<VectorIrradiance>;
// Rows in the order of their links, by tier. The span is a range of it.
@group(0) @binding(6) var<storage, read> order: array<u32>;

const LANES: u32 = 16u;
const ROWS: u32 = 4u;

// Part of a row that one thread sums.
struct RowPart {
    // Index of the row.
    row: u32,
    // First link of the thread and end of the row's links. The thread takes every LANES-th link.
    first: u32,
    end: u32,
    scale: f32,
    lane: u32,
    // `true` for the thread that writes the row's sum.
    writes: bool,
}

// Part of thread `local` of a workgroup. Threads beyond the span repeat its last row.
fn row_part(group: u32, local: u32) -> RowPart {
    let lane = local % LANES;
    let r = group * ROWS + local / LANES;
    let i = order[span.first + min(r, span.count - 1u)];
    let start = rows[i].start - span.base;
    return RowPart(i, start + lane, start + rows[i].count, rows[i].scale, lane, r < span.count && lane == 0u);
}

// Vector of a link.
fn link_vector(link: Link) -> vec3f {
    return vec3f(unpack2x16float(link.xy), unpack2x16float(link.z_sender).x);
}
