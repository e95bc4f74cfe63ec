// Irradiance from virtual point lights, [N09] Eq. (2). Twin: crates/meshless_gi/src/frame/vpl.rs,
// which documents the differences. Needs lib/bvh and lib/shadow. Positions and normals are in the
// space of the lights: the world's axes, an origin near the view.

@group(0) @binding(0) var<uniform> params: VplViewParams;
@group(0) @binding(1) var depths: texture_depth_2d;
@group(0) @binding(2) var gbuffer: texture_2d<u32>;
@group(0) @binding(3) var<uniform> lit: VplParams;
@group(0) @binding(4) var<storage, read> vpls: array<Vpl>;
@group(0) @binding(5) var<storage, read> nodes: array<BvhNode>;
@group(0) @binding(6) var<storage, read> triangles: array<BvhTriangle>;

const FRAC_1_PI: f32 = 0.318309886;
const PI: f32 = 3.14159265;
const RAY_OFFSET_SCALE: f32 = 4.0;
const NEAR_FROM: f32 = 9.0;
const NEAR_TO: f32 = 16.0;
const FLAT_FROM: f32 = 0.8;
const FLAT_TO: f32 = 0.9;
const FADE: f32 = 0.1;
const MIN_EDGE_LENGTH: f32 = 1e-7;
const TINY: f32 = 1.17549435e-38;

fn bvh_nodes() -> u32 {
    return lit.nodes;
}

// Mean of max(0, v·N) over unit normals N with mean `normal`.
fn mean_clamped_cosine(normal: vec3f, v: vec3f) -> f32 {
    let cosine = dot(v, normal);
    let s = clamp(1.0 - dot(normal, normal), 0.0, 1.0);
    let w = sqrt(s * (1.5 - 0.5 * s));
    if cosine >= w {
        return cosine;
    }
    if cosine <= -w {
        return 0.0;
    }
    let above = cosine + w;
    return above * above / (4.0 * w);
}

// Orthonormal tangents of `n`: the first, the second.
fn first_tangent(n: vec3f) -> vec3f {
    let s = select(-1.0, 1.0, n.z >= 0.0);
    let a = -1.0 / (s + n.z);
    return vec3f(1.0 + s * n.x * n.x * a, s * n.x * n.y * a, -s * n.x);
}

fn second_tangent(n: vec3f) -> vec3f {
    let s = select(-1.0, 1.0, n.z >= 0.0);
    let a = -1.0 / (s + n.z);
    return vec3f(n.x * n.y * a, s + n.y * n.y * a, -n.y);
}

fn vpl_edge(u: vec3f, v: vec3f) -> vec3f {
    let across = cross(u, v);
    let sine = length(across);
    return across * (atan2(sine, dot(u, v)) / max(sine, MIN_EDGE_LENGTH));
}

// Form factor over area of a square that has the area of a disk of squared radius `disk`.
fn vpl_near(toward: vec3f, normal: vec3f, disk: f32, n: vec3f) -> vec3f {
    if dot(normal, toward) >= 0.0 {
        return vec3f(0.0);
    }
    let t = first_tangent(normal);
    let b = second_tangent(normal);
    let half = 0.5 * sqrt(PI * disk);
    let top = dot(n, toward) + half * (abs(dot(n, t)) + abs(dot(n, b)));
    if top <= 0.0 {
        return vec3f(0.0);
    }
    let p = normalize(toward + half * (t + b));
    let q = normalize(toward + half * (b - t));
    let r = normalize(toward - half * (t + b));
    let s = normalize(toward + half * (t - b));
    let sum = vpl_edge(p, q) + vpl_edge(q, r) + vpl_edge(r, s) + vpl_edge(s, p);
    let factor = sum * (0.5 * FRAC_1_PI * select(1.0, -1.0, dot(sum, toward) < 0.0));
    let whole = length(factor);
    if whole <= MIN_EDGE_LENGTH {
        return vec3f(0.0);
    }
    let to = factor / whole;
    let wide = sqrt(whole);
    let cosine = dot(n, to);
    var clipped = cosine;
    if cosine <= -wide {
        clipped = 0.0;
    } else if cosine < wide {
        clipped = (cosine + wide) * (cosine + wide) / (4.0 * wide);
    }
    let fade = min(top / max(FADE * half * dot(n, normal), MIN_EDGE_LENGTH * half), 1.0);
    return (to + n * (clipped - cosine)) * (fade * whole * FRAC_1_PI / disk);
}

// Vector irradiance over flux of light `i` at `x` on surfaces with normal `n`, unshadowed.
fn vpl_share(i: u32, x: vec3f, n: vec3f) -> vec3f {
    let toward = vpls[i].position - x;
    let square = dot(toward, toward);
    if all(vpls[i].flux <= vec3f(0.0)) || square <= 0.0 {
        return vec3f(0.0);
    }
    let normal = vpls[i].normal;
    let disk = vpls[i].square;
    let flat_share = smoothstep(FLAT_FROM, FLAT_TO, dot(normal, normal));
    var out = vec3f(0.0);
    var beside = 1.0;
    if flat_share > 0.0 && square < NEAR_TO * disk {
        beside = 1.0 - flat_share * (1.0 - smoothstep(NEAR_FROM, NEAR_TO, square / disk));
        out = (1.0 - beside) * vpl_near(toward, normalize(normal), disk, n);
    }
    let to = toward / sqrt(square);
    if dot(n, to) > 0.0 {
        out += to * (beside * FRAC_1_PI * mean_clamped_cosine(normal, -to) / (square + disk));
    }
    return out;
}

// Start of shadow rays from a surface (local).
fn vpl_start(x: vec3f, n: vec3f) -> vec3f {
    let at = (lit.local_from_space * vec4f(x, 1.0)).xyz;
    let turned = (lit.local_from_space * vec4f(n, 0.0)).xyz;
    return at + turned / max(length(turned), TINY) * (RAY_OFFSET_SCALE * ray_offset(at, lit.extent));
}

// Transmittance of the baked scene from light `i` to the surface of the ray that starts at `start`
// (local).
fn vpl_transmittance(i: u32, start: vec3f) -> f32 {
    let end = (lit.local_from_space * vec4f(vpls[i].position, 1.0)).xyz;
    let ray = end - start;
    let distance = length(ray);
    let max_t = distance - ray_offset(end, lit.extent);
    if max_t <= 0.0 {
        return 1.0;
    }
    return transmittance_along(start, ray / distance, max_t);
}

// Vector irradiance at (x, n) of the lights above the surface's horizon.
fn vpl_at(x: vec3f, n: vec3f) -> VectorIrradiance {
    var sum = VectorIrradiance(vec4f(0.0), vec4f(0.0), vec4f(0.0));
    let start = vpl_start(x, n);
    for (var i = 0u; i < lit.vpls; i++) {
        let g = vpl_share(i, x, n);
        let arrives = dot(n, g);
        if arrives <= 0.0 {
            continue;
        }
        var e = vpls[i].flux;
        let most = max(e.x, max(e.y, e.z)) * arrives;
        if lit.nodes > 0u && most >= lit.dim {
            let reached = vpl_transmittance(i, start);
            if reached <= 0.0 {
                continue;
            }
            e *= reached;
        }
        sum.x += vec4f(e * g.x, 0.0);
        sum.y += vec4f(e * g.y, 0.0);
        sum.z += vec4f(e * g.z, 0.0);
    }
    return sum;
}
