// Unshadowed irradiance of lights with soft shadows. Twin: `unshadowed` in
// crates/meshless_gi/src/frame/soft_shadow/light.rs.

// Smallest normal number: lower limit of divisors.
const TINY: f32 = 1.17549435e-38;

fn normal_of(light: SoftLight) -> vec3f {
    if light.kind != SOFT_RECTANGLE {
        return vec3f(0.0);
    }
    let across = cross(light.u, light.v);
    let square = dot(across, across);
    if square <= 0.0 {
        return vec3f(0.0);
    }
    return across / sqrt(square);
}

fn arc_of(a: vec3f, b: vec3f, n: vec3f) -> f32 {
    let across = cross(a, b);
    let sine = sqrt(dot(across, across));
    if sine <= 0.0 {
        return 0.0;
    }
    return atan2(sine, dot(a, b)) * dot(n, across) / sine;
}

// Half of Lambert's sum over the edges of a quadrilateral, clipped to the horizon of n.
fn lambert(quad: array<vec3f, 4>, n: vec3f) -> f32 {
    var corners = quad;
    var sum = 0.0;
    var first = vec3f(0.0);
    var last = vec3f(0.0);
    var any = false;
    for (var k = 0u; k < 4u; k++) {
        let a = corners[k];
        let b = corners[(k + 1u) % 4u];
        let ha = dot(n, a);
        let hb = dot(n, b);
        if ha >= 0.0 {
            if any {
                sum += arc_of(last, a, n);
            } else {
                first = a;
                any = true;
            }
            last = a;
        }
        if (ha < 0.0) != (hb < 0.0) {
            let p = a + (b - a) * (ha / (ha - hb));
            if any {
                sum += arc_of(last, p, n);
            } else {
                first = p;
                any = true;
            }
            last = p;
        }
    }
    if any {
        sum += arc_of(last, first, n);
    }
    return 0.5 * abs(sum);
}

// Fade factor of a light toward its range.
fn window_of(light: SoftLight, square: f32) -> f32 {
    let factor = square * light.inverse_square_range;
    let fade = clamp(1.0 - factor * factor, 0.0, 1.0);
    return fade * fade;
}

// Irradiance without shadows from a light of color one, in a scene of the size `extent`.
fn unshadowed(light: SoftLight, x: vec3f, n: vec3f, extent: f32) -> f32 {
    let to = light.center - x;
    let square = dot(to, to);
    if light.kind == SOFT_SPHERE {
        if square <= 0.0 {
            return 0.0;
        }
        let cosine = max(dot(n, to / sqrt(square)), 0.0);
        let nearest = clamp(2.5e-5 * extent * extent, TINY, 1e-4);
        return cosine / max(square, nearest) * window_of(light, square);
    }
    if light.kind != SOFT_RECTANGLE || dot(normal_of(light), to) >= 0.0 {
        return 0.0;
    }
    let corners = array<vec3f, 4>(
        to - light.u - light.v,
        to + light.u - light.v,
        to + light.u + light.v,
        to - light.u + light.v,
    );
    return lambert(corners, n) * window_of(light, square);
}
