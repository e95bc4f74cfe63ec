// soft_shadow: occluded irradiance of lights with soft shadows at points with visibility. Twin:
// crates/meshless_gi/src/frame/soft_shadow.rs. One thread per point.

@group(0) @binding(0) var<uniform> params: SoftShadowParams;
@group(0) @binding(1) var<storage, read> lights: array<SoftLight>;
@group(0) @binding(2) var<storage, read> points: array<Point>;
@group(0) @binding(3) var<storage, read> clusters: array<VisibilityCluster>;
@group(0) @binding(4) var<storage, read> visible: array<VisiblePoint>;
@group(0) @binding(5) var<storage, read> basis: array<u32>;
@group(0) @binding(6) var<storage, read> scales: array<f32>;
@group(0) @binding(7) var<storage, read> coefficients: array<u32>;
@group(0) @binding(8) var<storage, read_write> occluded_irradiances: array<VectorIrradiance>;

const QUARTER_PI: f32 = 0.7853981633974483;
const HALF_PI: f32 = 1.5707963267948966;
const GOLDEN: f32 = 0.618034;
const TURN: f32 = 6.283185307179586;
const MAX_COMPONENTS: u32 = 128u;
// Limit of the angle to the normal: the length of a vector is at most ten times its component along
// the normal.
const MIN_ALONG: f32 = 0.1;
// Depths that differ by at most this much count as equal.
const ROUNDING: f32 = 1e-3;
// Depths are clamped to this multiple of s.
const MAX_RATIO: f32 = 1e9;
// Code of the error of a point that equals the error of its cluster.
const ERROR_ONE: f32 = 32.0;

// The point of this thread: axes, cluster, decoded coefficients.
var<private> axis_x: vec3f;
var<private> axis_y: vec3f;
var<private> axis_z: vec3f;
var<private> first_word: u32;
var<private> words: u32;
// s of e = d² / (d² + s²), meters.
var<private> near: f32;
var<private> decoded: array<f32, 132>;

// Two unit vectors that form a right-handed frame with the unit vector n.
fn tangent(n: vec3f) -> vec3f {
    let s = select(-1.0, 1.0, n.z >= 0.0);
    let a = -1.0 / (s + n.z);
    return vec3f(1.0 + s * n.x * n.x * a, s * n.x * n.y * a, -s * n.x);
}

fn load_visibility(i: u32, n: vec3f) {
    let point = visible[i];
    let cluster = clusters[point.cluster];
    let along = cluster.tangent - n * dot(n, cluster.tangent);
    let square = dot(along, along);
    axis_z = n;
    axis_x = tangent(n);
    if square > 1e-6 {
        axis_x = along / sqrt(square);
    }
    axis_y = cross(n, axis_x);
    first_word = cluster.basis;
    words = (cluster.components + 3u) / 4u + 1u;
    decoded[0] = scales[cluster.scales];
    decoded[1] = scales[cluster.scales + 1u] * f32(point.error) / ERROR_ONE;
    near = cluster.near;
    // The last word of a direction may contain fewer than four coefficients.
    for (var j = cluster.components; j < 4u * (words - 1u); j++) {
        decoded[j + 2u] = 0.0;
    }
    var at = point.first;
    for (var j = 0u; j < cluster.components; j++) {
        var value = 0.0;
        if ((point.mask[j / 32u] >> (j % 32u)) & 1u) != 0u {
            value = scales[cluster.scales + j + 2u] * unpack2x16snorm(coefficients[at / 2u])[at % 2u];
            at += 1u;
        }
        decoded[j + 2u] = value;
    }
}

fn to_local(v: vec3f) -> vec3f {
    return vec3f(dot(axis_x, v), dot(axis_y, v), dot(axis_z, v));
}

// e in the direction of a texel, and its root mean square error.
fn depth(texel: u32) -> vec2f {
    let start = first_word + texel * words;
    let first = unpack2x16snorm(basis[start]);
    var e = decoded[0] * first.x;
    for (var w = 1u; w < words; w++) {
        let four = unpack4x8snorm(basis[start + w]);
        let at = 4u * w - 2u;
        e += decoded[at] * four.x + decoded[at + 1u] * four.y + decoded[at + 2u] * four.z + decoded[at + 3u] * four.w;
    }
    return vec2f(e, decoded[1] * first.y);
}

fn encode(d: f32) -> f32 {
    // Squares do not overflow.
    let q = min(d / near, MAX_RATIO);
    return q * q / (1.0 + q * q);
}

// Direction of a texel, z up.
fn texel_direction(i: u32) -> vec3f {
    let a = f32(2u * (i % params.columns) + 1u) / f32(params.columns) - 1.0;
    let b = f32(2u * (i / params.columns) + 1u) / f32(params.rows) - 1.0;
    var r = 0.0;
    var phi = 0.0;
    if abs(a) > abs(b) {
        r = a;
        phi = QUARTER_PI * (b / a);
    } else if b != 0.0 {
        r = b;
        phi = HALF_PI - QUARTER_PI * (a / b);
    }
    let across = r * sqrt(max(2.0 - r * r, 0.0));
    return vec3f(across * cos(phi), across * sin(phi), 1.0 - r * r);
}

// Texels on both sides along an edge of the map, and the distance to the second.
fn neighbor_texels(v: f32, count: u32) -> vec3f {
    let at = clamp(0.5 * (1.0 + v) * f32(count) - 0.5, 0.0, f32(count - 1u));
    let low = min(u32(at), max(count, 2u) - 2u);
    return vec3f(f32(low), f32(min(low + 1u, count - 1u)), at - f32(low));
}

fn with_sign(v: f32, sign: f32) -> f32 {
    return select(-v, v, sign >= 0.0);
}

struct Cell {
    texels: vec4u,
    weights: vec4f,
}

// The four texels around a direction.
fn lookup(d: vec3f) -> Cell {
    let r = sqrt(clamp(1.0 - d.z, 0.0, 1.0));
    let large = max(abs(d.x), abs(d.y));
    let small = min(abs(d.x), abs(d.y));
    var t = 0.0;
    if large > 0.0 {
        t = small / large;
    }
    let q = t * t;
    // Abramowitz and Stegun 4.4.47.
    let arc = t * (0.999866 + q * (-0.3302995 + q * (0.180141 + q * (-0.085133 + q * 0.0208351))));
    let other = min(r * arc / QUARTER_PI, r);
    var ab = vec2f(other, r);
    if abs(d.x) > abs(d.y) {
        ab = vec2f(r, other);
    }
    let u = neighbor_texels(with_sign(ab.x, d.x), params.columns);
    let v = neighbor_texels(with_sign(ab.y, d.y), params.rows);
    let column = vec2u(u.xy);
    let row = vec2u(v.xy) * params.columns;
    return Cell(
        vec4u(row.x + column.x, row.x + column.y, row.y + column.x, row.y + column.y),
        vec4f((1.0 - u.z) * (1.0 - v.z), u.z * (1.0 - v.z), (1.0 - u.z) * v.z, u.z * v.z),
    );
}

// Position of sample k relative to x.
fn sample_position(light: SoftLight, k: u32, x: vec3f) -> vec3f {
    if light.kind == SOFT_RECTANGLE {
        // Fibonacci lattice.
        let at = f32(k) + 0.5;
        let turn = at * GOLDEN;
        let a = 2.0 * at / f32(light.columns * light.rows) - 1.0;
        let b = 2.0 * (turn - floor(turn)) - 1.0;
        return light.center + light.u * a + light.v * b;
    }
    if light.radius <= 0.0 {
        return light.center;
    }
    let away = x - light.center;
    let distance = sqrt(dot(away, away));
    let count = f32(light.columns * light.rows);
    let radius = min(light.radius, 0.9 * distance) * sqrt((f32(k) + 0.5) / count);
    let turn = f32(k) * GOLDEN;
    let angle = TURN * (turn - floor(turn));
    let to = away / max(distance, TINY);
    let t = tangent(to);
    return light.center + (t * cos(angle) + cross(to, t) * sin(angle)) * radius;
}

// Direction of a sample in xyz, its weight in w. The weight is 0 if no light goes in this
// direction.
fn weigh(light: SoftLight, normal: vec3f, to: vec3f, n: vec3f) -> vec4f {
    let square = dot(to, to);
    if square <= 0.0 {
        return vec4f(0.0);
    }
    let direction = to / sqrt(square);
    var w = dot(n, direction) / square;
    if light.kind == SOFT_RECTANGLE {
        w *= -dot(normal, direction);
    }
    // The twin drops values that are not finite.
    return vec4f(direction, select(0.0, w, w > 0.0 && w < 1e38));
}

fn visibility_toward(direction: vec3f, distance: f32, normal: vec3f) -> f32 {
    let local = to_local(direction);
    let plane = to_local(normal);
    let cell = lookup(local);
    var seen = 0.0;
    for (var k = 0u; k < 4u; k++) {
        let over = dot(texel_direction(cell.texels[k]), plane);
        var far = distance;
        if over < 0.0 {
            far = clamp(distance * dot(local, plane) / over, 0.5 * distance, 2.0 * distance);
        }
        let light = encode(far);
        let least = max(light - encode(far * (1.0 - params.bias)), ROUNDING);
        let found = depth(cell.texels[k]);
        let threshold = light - max(params.before * found.y, least);
        let ramp = max(params.ramp * found.y, least);
        seen += cell.weights[k] * clamp(0.5 + (found.x - threshold) / ramp, 0.0, 1.0);
    }
    return seen;
}

// Occluded part of e, the irradiance without shadows from the light with color one.
fn occluded_irradiance(light: SoftLight, x: vec3f, n: vec3f, e: f32) -> vec3f {
    if e <= 0.0 {
        return vec3f(0.0);
    }
    let normal = normal_of(light);
    let samples = light.columns * light.rows;
    var sum = 0.0;
    var seen = 0.0;
    var hidden = vec3f(0.0);
    for (var k = 0u; k < samples; k++) {
        let to = sample_position(light, k, x) - x;
        let s = weigh(light, normal, to, n);
        if s.w > 0.0 {
            let v = visibility_toward(s.xyz, sqrt(dot(to, to)), normal);
            sum += s.w;
            seen += s.w * v;
            hidden += (s.w * (1.0 - v)) * s.xyz;
        }
    }
    if sum <= 0.0 {
        return vec3f(0.0);
    }
    hidden /= sum;
    let along = dot(hidden, n);
    let across = hidden - n * along;
    let lean = across / max(max(along, MIN_ALONG * sqrt(dot(across, across))), TINY);
    return (n + lean) * ((1.0 - clamp(seen / sum, 0.0, 1.0)) * e);
}

@compute @workgroup_size(64)
fn soft_shadow(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let i = flat_group(group, groups) * 64u + local;
    if i >= params.points {
        return;
    }
    let x = points[i].position;
    let n = points[i].normal;
    load_visibility(i, n);
    var out = VectorIrradiance(vec4f(0.0), vec4f(0.0), vec4f(0.0));
    for (var l = 0u; l < params.lights; l++) {
        let e = unshadowed(lights[l], x, n, params.extent);
        let d = occluded_irradiance(lights[l], x, n, e);
        // Fourth floats: the irradiance without shadows.
        let color = lights[l].color;
        out.x += vec4f(d.x * color, e * color.r);
        out.y += vec4f(d.y * color, e * color.g);
        out.z += vec4f(d.z * color, e * color.b);
    }
    occluded_irradiances[i] = out;
}
