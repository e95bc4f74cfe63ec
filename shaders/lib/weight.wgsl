// Weight function of the basis, [L08] Eqs. (8)-(10). Twin: crates/meshless_gi/src/basis/weight.rs.
// Needs lib/grid.

@group(0) @binding(3) var<storage, read> points: array<Point>;
@group(0) @binding(4) var<storage, read> planes: array<vec4f>;

const F_SQUASH: f32 = 2.0;
const NO_COVER: f32 = 1e-6;

// K(t) = 2t³ − 3t² + 1.
fn kernel(t: f32) -> f32 {
    return select(0.0, (2.0 * t - 3.0) * t * t + 1.0, t < 1.0);
}

// Length of v + F_squash ⟨v, n_j⟩ n_j.
fn dist(v: vec3f, n_j: vec3f) -> f32 {
    return length(v + F_SQUASH * dot(v, n_j) * n_j);
}

// Minimum squared length of the normal of a clip plane with a lean.
const LEAN_FROM: f32 = 1.001;

// At least zero if x is on the function's side of clip plane `i`. The plane of an occluder moves
// with the normal.
fn before(i: u32, x: vec3f, n: vec3f, radius: f32) -> f32 {
    let plane = planes[i];
    let lean = max(dot(plane.xyz, plane.xyz) - LEAN_FROM, 0.0) * radius;
    return dot(plane, vec4f(x, 1.0)) + lean * dot(plane.xyz, n);
}

// `true` if x is at most `margin` behind each of the function's clip planes.
fn is_inside(point: Point, x: vec3f, n: vec3f, margin: f32) -> bool {
    let first = point.planes & 0x00ffffffu;
    let end = first + (point.planes >> 24u);
    for (var i = first; i < end; i++) {
        if before(i, x, n, point.radius) < -margin {
            return false;
        }
    }
    return true;
}

fn weight(point: Point, x: vec3f, n: vec3f) -> f32 {
    let cosine = dot(n, point.normal);
    if cosine <= 0.0 {
        return 0.0;
    }
    let r = dist(x - point.position, point.normal);
    if r >= point.radius {
        return 0.0;
    }
    if !is_inside(point, x, n, 0.0) {
        return 0.0;
    }
    return kernel(r / point.radius) * cosine * cosine;
}

const CREASE_MARGIN: f32 = 0.02;

// Weight for a surface of another orientation that meets the function's surface in a crease.
fn crease_weight(point: Point, x: vec3f, n: vec3f) -> f32 {
    let offset = x - point.position;
    let margin = CREASE_MARGIN * point.radius;
    let r = dist(offset, point.normal);
    if r >= point.radius || dot(offset, point.normal) < -margin || dot(offset, n) > margin {
        return 0.0;
    }
    if !is_inside(point, x, n, margin) {
        return 0.0;
    }
    let w = kernel(r / point.radius) / point.radius;
    return w * w;
}

// Function of the flat basis at a surface point.
struct BasisFunction {
    // Index of its point.
    index: u32,
    normal: vec3f,
    // [L08] Eq. (8). 0 outside of the function's support.
    weight: f32,
    // Weight over the squared radius: narrow functions count more.
    flat_weight: f32,
}

// Function of entry `at` of the grid, at (x, n).
fn basis_function(at: u32, x: vec3f, n: vec3f) -> BasisFunction {
    let j = grid_entries[at];
    let point = points[j];
    let w = weight(point, x, n);
    return BasisFunction(j, point.normal, w, (w / point.radius) * (w / point.radius));
}
