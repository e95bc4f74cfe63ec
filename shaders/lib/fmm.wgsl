// Inputs and expansions of the kernels of the fast multipole method. An expansion has three vec4f
// per term: x, y and z, each in red, green and blue.

struct FmmNode {
    center: vec3f,
    size: f32,
    start: u32,
    end: u32,
    first_child: u32,
    children: u32,
    parent: u32,
    far: u32,
    local: u32,
    multipole: u32,
    near: u32,
    finish: u32,
    sources: u32,
    receivers: u32,
}

struct FmmOperatorPoint {
    position: vec3f,
    share: f32,
    normal: vec3f,
    point: u32,
    sky: vec3f,
    factor: f32,
}

struct FmmTerm {
    down: array<u32, 9>,
    // Exponents of x, y and z, eight bits each.
    exponents: u32,
    degree: u32,
    factorial: f32,
}

struct FmmParams {
    order: u32,
    terms: u32,
    disks: u32,
    nearest: f32,
    sky: u32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

@group(0) @binding(0) var<uniform> params: FmmParams;
// Nodes of a level.
@group(0) @binding(1) var<uniform> span: Span;
@group(0) @binding(2) var<storage, read> nodes: array<FmmNode>;
@group(0) @binding(3) var<storage, read> fmm_points: array<FmmOperatorPoint>;
@group(0) @binding(4) var<storage, read> terms: array<FmmTerm>;
@group(0) @binding(5) var<storage, read> radiosity: array<vec4f>;

// Three components in three colors.
struct Spectrum {
    x: vec3f,
    y: vec3f,
    z: vec3f,
}

fn exponents_of(packed: u32) -> vec3u {
    return vec3u(packed & 255u, (packed >> 8u) & 255u, packed >> 16u);
}

// Number of terms up to a degree.
fn terms_to(degree: u32) -> u32 {
    return (degree + 1u) * (degree + 2u) * (degree + 3u) / 6u;
}

// Index of the term with these exponents.
fn term_at(e: vec3u) -> u32 {
    let m = e.y + e.z;
    let n = e.x + m;
    return n * (n + 1u) * (n + 2u) / 6u + m * (m + 1u) / 2u + e.z;
}

fn power(base: f32, exponent: u32) -> f32 {
    var out = 1.0;
    for (var i = 0u; i < exponent; i += 1u) {
        out *= base;
    }
    return out;
}

// v to the power of these exponents, over their factorials.
fn monomial(v: vec3f, e: vec3u) -> f32 {
    var out = 1.0;
    for (var i = 1u; i <= e.x; i += 1u) {
        out *= v.x / f32(i);
    }
    for (var i = 1u; i <= e.y; i += 1u) {
        out *= v.y / f32(i);
    }
    for (var i = 1u; i <= e.z; i += 1u) {
        out *= v.z / f32(i);
    }
    return out;
}

// A point as a source: minus its surface area over π, times its radiosity and its normal.
fn source_of(point: FmmOperatorPoint, radiosity: vec3f) -> Spectrum {
    let q = -point.share * radiosity;
    return Spectrum(point.normal.x * q, point.normal.y * q, point.normal.z * q);
}

fn nothing() -> Spectrum {
    return Spectrum(vec3f(0.0), vec3f(0.0), vec3f(0.0));
}

fn plus(a: Spectrum, factor: f32, b: Spectrum) -> Spectrum {
    return Spectrum(a.x + factor * b.x, a.y + factor * b.y, a.z + factor * b.z);
}
