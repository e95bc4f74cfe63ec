// pyramid: discontinuities of a view, per cell and level. Twin:
// crates/meshless_gi/src/frame/pyramid.rs. `base` computes level 1 from pixels, `reduce` a level
// from the next finer one.

@group(0) @binding(0) var<uniform> screen: SubsplatParams;
@group(0) @binding(1) var<uniform> span: Span;
@group(0) @binding(2) var depths: texture_depth_2d;
@group(0) @binding(3) var gbuffer: texture_2d<u32>;
@group(0) @binding(4) var<storage, read_write> cells: array<CellRange>;

const BACKGROUND_DEPTH: f32 = 1e30;
const MAX_SLOPE: f32 = 1e9;
// `high` of a cell without a normal: `max` leaves other values unchanged.
const EMPTY_HIGH: u32 = 0x00818181u;

fn linear_depth(pixel: vec2u, depth: f32) -> f32 {
    if depth <= 0.0 {
        return BACKGROUND_DEPTH;
    }
    return -view_position(pixel, depth).z;
}

fn beside(pixel: vec2u, by: vec2i) -> vec2u {
    return vec2u(clamp(vec2i(pixel) + by, vec2i(0), vec2i(screen.size) - 1));
}

// Distance of the pixel from the plane through two neighbors, relative to its depth's reach.
fn off_plane(pixel: vec2u, z: f32, d: f32, by: vec2i) -> f32 {
    let a = beside(pixel, -by);
    let b = beside(pixel, by);
    if all(a == pixel) || all(b == pixel) {
        return 0.0;
    }
    return abs(linear_depth(pixel, 0.5 * (lit_depth(a) + lit_depth(b))) - z) / depth_reach(z, d);
}

fn slope(pixel: vec2u, z: f32, by: vec2i) -> f32 {
    let p = beside(pixel, by);
    let other = linear_depth(p, lit_depth(p));
    // The step between a surface and the background has the largest slope.
    return min(abs(other - z) / min(other, z), MAX_SLOPE);
}

fn curvature(pixel: vec2u, by: vec2i) -> f32 {
    let p = beside(pixel, by);
    if lit_depth(p) <= 0.0 {
        return 0.0;
    }
    return sqrt(max(2.0 - 2.0 * dot(pixel_normal(pixel), pixel_normal(p)), 0.0));
}

fn measure(pixel: vec2u) -> CellRange {
    let d = lit_depth(pixel);
    let z = linear_depth(pixel, d);
    var out = CellRange(0.0, 0.0, EMPTY_LOW, EMPTY_HIGH);
    switch screen.depth_test {
        case 0u: {
            if d > 0.0 {
                out.far = max(off_plane(pixel, z, d, vec2i(1, 0)), off_plane(pixel, z, d, vec2i(0, 1)));
            }
        }
        case 1u: {
            out.near = z;
            out.far = z;
        }
        default: {
            out.far = length(vec2f(slope(pixel, z, vec2i(1, 0)), slope(pixel, z, vec2i(0, 1))));
        }
    }
    if d > 0.0 {
        if screen.normal_test == 0u {
            out.low = pack4x8snorm(vec4f(pixel_normal(pixel), 0.0));
            out.high = out.low;
        } else {
            out.low = 0u;
            out.high = bitcast<u32>(max(curvature(pixel, vec2i(1, 0)), curvature(pixel, vec2i(0, 1))));
        }
    }
    return out;
}

fn pack_bytes(v: vec4i) -> u32 {
    let b = vec4u(v) & vec4u(0xffu);
    return b.x | b.y << 8u | b.z << 16u | b.w << 24u;
}

fn measured(cell: CellRange) -> u32 {
    return select(cell.high, 0u, cell.low == EMPTY_LOW);
}

fn join(a: CellRange, b: CellRange) -> CellRange {
    var out = CellRange(min(a.near, b.near), max(a.far, b.far), 0u, 0u);
    if screen.normal_test == 0u {
        out.low = pack_bytes(min(signed_bytes(a.low), signed_bytes(b.low)));
        out.high = pack_bytes(max(signed_bytes(a.high), signed_bytes(b.high)));
    } else {
        out.high = max(measured(a), measured(b));
    }
    return out;
}

@compute @workgroup_size(8, 8)
fn base(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= level_grid(1u)) {
        return;
    }
    let first = 2u * id.xy;
    var out = measure(first);
    for (var i = 1u; i < 4u; i++) {
        let child = first + vec2u(i & 1u, i >> 1u);
        if all(child < screen.size) {
            out = join(out, measure(child));
        }
    }
    cells[cell_index(1u, id.xy)] = out;
}

@compute @workgroup_size(8, 8)
fn reduce(@builtin(global_invocation_id) id: vec3u) {
    let k = span.first;
    if any(id.xy >= level_grid(k)) {
        return;
    }
    let first = 2u * id.xy;
    var out = cells[cell_index(k - 1u, first)];
    for (var i = 1u; i < 4u; i++) {
        let child = first + vec2u(i & 1u, i >> 1u);
        if all(child < level_grid(k - 1u)) {
            out = join(out, cells[cell_index(k - 1u, child)]);
        }
    }
    cells[cell_index(k, id.xy)] = out;
}
