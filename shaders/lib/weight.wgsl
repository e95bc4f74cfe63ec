// The weight function of the basis, [L08] Eqs. (8)-(10). Twin: src/basis/kernel.rs. Needs `planes`.

const F_SQUASH: f32 = 2.0;
const NO_COVER: f32 = 1e-6;

// K(t) = 2t³ − 3t² + 1.
fn kernel(t: f32) -> f32 {
    return select(0.0, (2.0 * t - 3.0) * t * t + 1.0, t < 1.0);
}

// The length of v + F_squash ⟨v, n_j⟩ n_j.
fn dist(v: vec3f, n_j: vec3f) -> f32 {
    return length(v + F_SQUASH * dot(v, n_j) * n_j);
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
    let first = point.planes & 0x00ffffffu;
    let end = first + (point.planes >> 24u);
    for (var i = first; i < end; i++) {
        if dot(planes[i], vec4f(x, 1.0)) < 0.0 {
            return 0.0;
        }
    }
    return kernel(r / point.radius) * cosine * cosine;
}
