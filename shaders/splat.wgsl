// splat: irradiance of pixels and subsplats from the flat basis, [L08] §4.1. Twin:
// crates/meshless_gi/src/frame/splat.rs. `next_scene` evaluates pixels that earlier scenes left
// uncovered. Entry points: lib/pixel_pass and lib/listed.

@group(0) @binding(7) var<storage, read> values: array<VectorIrradiance>;

// Vector irradiance, its fraction of the light (the rest comes from probes), and `true` if there is
// light: functions that cover the point, or an estimate with fraction 0.
struct Covered {
    e: VectorIrradiance,
    surface_fraction: f32,
    covered: bool,
}

// Cosines to a function's normal from which on it covers a surface partly and fully.
const MIN_COVER_COSINE: f32 = 0.7;
const FULL_COVER_COSINE: f32 = 0.9;

// Minimum fraction of a pixel that functions cover.
const MIN_COVERED_FRACTION: f32 = 1.0 / 1024.0;

// Fraction of a function's weight that covers a surface, by the cosine between their normals.
fn cover_of(cosine: f32) -> f32 {
    return clamp((cosine - MIN_COVER_COSINE) / (FULL_COVER_COSINE - MIN_COVER_COSINE), 0.0, 1.0);
}

// Fraction of the light, 0 without cover and 1 from `seam` on.
fn surface_fraction(cover: f32) -> f32 {
    if cover <= 0.0 {
        return 0.0;
    }
    if cover >= params.seam {
        return 1.0;
    }
    let t = cover / params.seam;
    return t * t * (3.0 - 2.0 * t);
}

fn vector_at(x: vec3f, n: vec3f) -> Covered {
    let range = grid_range(x);
    var numerator = VectorIrradiance(vec4f(0.0), vec4f(0.0), vec4f(0.0));
    var sum = 0.0;
    var cover = 0.0;
    var denominator = 0.0;
    for (var at = range.x; at < range.y; at++) {
        let f = basis_function(at, x, n);
        if f.weight > 0.0 {
            sum += f.weight;
            cover += f.weight * cover_of(dot(n, f.normal));
            denominator += f.flat_weight;
            add_scaled(&numerator, f.flat_weight, values[f.index]);
        }
    }
    if sum <= NO_COVER {
        return crease_vector(range, x, n);
    }
    var e = VectorIrradiance(vec4f(0.0), vec4f(0.0), vec4f(0.0));
    add_scaled(&e, 1.0 / denominator, numerator);
    return Covered(e, surface_fraction(cover), true);
}

// Estimate from functions of other orientation that the surface meets in a crease.
fn crease_vector(range: vec2u, x: vec3f, n: vec3f) -> Covered {
    var e = vec3f(0.0);
    var sum = 0.0;
    for (var at = range.x; at < range.y; at++) {
        let j = grid_entries[at];
        let point = points[j];
        let w = crease_weight(point, x, n);
        if w > 0.0 {
            e += w * tilted_irradiance(values[j], point.normal, n);
            sum += w;
        }
    }
    if sum <= NO_COVER {
        return Covered(VectorIrradiance(vec4f(0.0), vec4f(0.0), vec4f(0.0)), 0.0, false);
    }
    let light = vec4f(e / sum, 0.0);
    return Covered(VectorIrradiance(light * n.x, light * n.y, light * n.z), 0.0, true);
}

fn tilted_irradiance(e: VectorIrradiance, n_j: vec3f, n: vec3f) -> vec3f {
    let cosine = clamp(dot(n, n_j), -1.0, 1.0);
    let linear = (1.0 - cosine) * max(irradiance_dot(e, n_j), vec3f(0.0)) + irradiance_dot(e, n);
    return max(0.5 * (1.0 + cosine) * linear, vec3f(0.0));
}

// Irradiance. Alpha is its fraction of the light: 0 without light.
fn irradiance_at(x: vec3f, n: vec3f) -> vec4f {
    let found = vector_at(x, n);
    return vec4f(max(irradiance_dot(found.e, n), vec3f(0.0)), select(0.0, max(found.surface_fraction, MIN_COVERED_FRACTION), found.covered));
}

fn evaluate_subsplat(pixel: vec2u, node: SubsplatNode) -> SubsplatNode {
    let has_light = node_is(node, EVALUATED | COVERED);
    // An earlier scene covers it.
    if has_light && node_probe_fraction(node) < 1.0 {
        return node;
    }
    let nothing = VectorIrradiance(vec4f(0.0), vec4f(0.0), vec4f(0.0));
    let at = pixel_position(pixel);
    if !at.lit {
        return node_new(nothing, node_predicted_luminance(node), EVALUATED);
    }
    let found = vector_at(at.x, at.n);
    if has_light && found.surface_fraction <= 0.0 {
        return node;
    }
    if !found.covered {
        return node_new(nothing, node_predicted_luminance(node), EVALUATED | KNOWN);
    }
    let state = EVALUATED | KNOWN | COVERED | probe_fraction_bits(found.surface_fraction);
    return node_new(to_world(found.e), node_predicted_luminance(node), state);
}

fn pixel_texel(pixel: vec2u, before: vec4f) -> vec4f {
    // An earlier scene covers it. Its estimate is replaced if this scene covers it.
    if before.a > MIN_COVERED_FRACTION {
        return before;
    }
    let at = pixel_position(pixel);
    if !at.lit {
        return before;
    }
    let e = irradiance_at(at.x, at.n);
    if before.a > 0.0 && e.a <= MIN_COVERED_FRACTION {
        return before;
    }
    return vec4f(min(e.rgb * params.scale, vec3f(MAX_HALF)), e.a);
}
