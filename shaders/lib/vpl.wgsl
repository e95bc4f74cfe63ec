// Irradiance from virtual point lights, [N09] Eq. (2). Twin: src/frame/vpl.rs, which says how this differs. Needs `vpls`, `lit` (a VplParams), `nodes`,
// `triangles`, and lib/bvh and lib/shadow. Places and normals in the space of the lights: the world's axes, the origin near by.

const FRAC_1_PI: f32 = 0.318309886;
const LIFTS: f32 = 4.0;
const TINY: f32 = 1.17549435e-38;

fn bvh_nodes() -> u32 {
    return lit.nodes;
}

// The mean of max(0, v·N) over unit normals N whose mean is `normal`.
fn facing(normal: vec3f, v: vec3f) -> f32 {
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

// What light `i` gives at `x` to surfaces that face `n`, unshadowed: the irradiance on a surface that faces it, in `e`, and the direction towards it.
struct VplShare {
    e: vec3f,
    to: vec3f,
}

fn vpl_share(i: u32, x: vec3f, n: vec3f) -> VplShare {
    let dark = VplShare(vec3f(0.0), vec3f(0.0));
    let flux = vpls[i].flux;
    let toward = vpls[i].position - x;
    let square = dot(toward, toward);
    if all(flux <= vec3f(0.0)) || square <= 0.0 {
        return dark;
    }
    let to = toward / sqrt(square);
    if dot(n, to) <= 0.0 {
        return dark;
    }
    let cosine = facing(vpls[i].normal, -to);
    return VplShare(flux * (FRAC_1_PI * cosine / (square + vpls[i].square)), to);
}

// True where the baked scene keeps light `i` from the place that a ray leaves at `start` (local).
fn vpl_hidden(i: u32, start: vec3f) -> bool {
    let end = (lit.local_from_space * vec4f(vpls[i].position, 1.0)).xyz;
    let ray = end - start;
    let distance = length(ray);
    let max_t = distance - lift(end, lit.extent);
    return max_t > 0.0 && occluded(start, ray / distance, max_t);
}

// The vector irradiance at (x, n) of the lights above the surface's horizon.
fn vpl_at(x: vec3f, n: vec3f) -> VectorIrradiance {
    var sum = VectorIrradiance(vec4f(0.0), vec4f(0.0), vec4f(0.0));
    let at = (lit.local_from_space * vec4f(x, 1.0)).xyz;
    let turned = (lit.local_from_space * vec4f(n, 0.0)).xyz;
    let start = at + turned / max(length(turned), TINY) * (LIFTS * lift(at, lit.extent));
    for (var i = 0u; i < lit.vpls; i++) {
        let share = vpl_share(i, x, n);
        let e = share.e;
        let most = max(e.x, max(e.y, e.z));
        if most <= 0.0 {
            continue;
        }
        if lit.nodes > 0u && most * dot(n, share.to) >= lit.dim && vpl_hidden(i, start) {
            continue;
        }
        sum.x += vec4f(e * share.to.x, 0.0);
        sum.y += vec4f(e * share.to.y, 0.0);
        sum.z += vec4f(e * share.to.z, 0.0);
    }
    return sum;
}
