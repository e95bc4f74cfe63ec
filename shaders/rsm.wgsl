// rsm: reflective shadow map to virtual point lights. Twin: crates/meshless_gi/src/frame/rsm.rs.

@group(0) @binding(0) var<uniform> params: RsmParams;
@group(0) @binding(1) var depths: texture_depth_2d;
@group(0) @binding(2) var gbuffer: texture_2d<u32>;
// Texels of all maps of a light, each map in the order of its curve.
@group(0) @binding(3) var<storage, read_write> lit_texels: array<RsmTexel>;
@group(0) @binding(4) var<uniform> shade: RsmShadowParams;
@group(0) @binding(5) var<storage, read> nodes: array<BvhNode>;
@group(0) @binding(6) var<storage, read> triangles: array<BvhTriangle>;
@group(0) @binding(7) var<uniform> choice: RsmSelectParams;
// Virtual point lights of all lights.
@group(0) @binding(8) var<storage, read_write> vpls: array<Vpl>;

// Threads of `select_vpls`.
const CHUNKS: u32 = 256u;
const MAX_DISTANCE: f32 = 1e8;
const MIN_COSINE: f32 = 0.1;
const MIN_DISTANCE_SQUARED: f32 = 1e-4;
const TINY: f32 = 1.17549435e-38;
// Squared radius of a uniform disk over its mean squared distance from the center.
const DISK: f32 = 2.0;

fn bvh_nodes() -> u32 {
    return shade.nodes;
}

// Index of a texel along the Hilbert curve through the map.
fn hilbert_index(side: u32, column: u32, row: u32) -> u32 {
    var x = column;
    var y = row;
    var at = 0u;
    for (var s = side / 2u; s > 0u; s /= 2u) {
        let rx = select(0u, 1u, (x & s) != 0u);
        let ry = select(0u, 1u, (y & s) != 0u);
        at += s * s * ((3u * rx) ^ ry);
        if ry == 0u {
            if rx == 1u {
                x = (side - 1u) - x;
                y = (side - 1u) - y;
            }
            let t = x;
            x = y;
            y = t;
        }
    }
    return at;
}

// atan2(volume, below) of a triangle with two corners in b and c.
fn half_angle(volume: f32, a: vec3f, b: vec3f, c: vec3f) -> f32 {
    let la = length(a);
    let lb = length(b);
    let lc = length(c);
    return atan2(volume, la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb);
}

fn solid_angle(a: vec3f, e: vec3f, f: vec3f) -> f32 {
    let volume = abs(dot(a, cross(e, f)));
    return 2.0 * (half_angle(volume, a, a + e, a + e + f) + half_angle(volume, a, a + e + f, a + f));
}

fn texel_angle(pixel: vec2u) -> f32 {
    let step = 2.0 / f32(params.side);
    let at = vec2f(pixel) * step;
    let corner = params.forward + params.right * (at.x - 1.0) + params.up * (1.0 - at.y);
    return solid_angle(corner, params.right * step, params.up * -step);
}

fn largest(v: vec3f) -> f32 {
    return max(v.x, max(v.y, v.z));
}

fn texel_at(pixel: vec2u, depth: f32, bits: vec4u) -> RsmTexel {
    let light = params.light;
    let dark = RsmTexel(vec3f(0.0), 0.0, vec3f(0.0), 0.0, vec3f(0.0), 0.0);
    if depth <= 0.0 || gbuffer_is_unlit(bits) || light.kind == LIGHT_NONE {
        return dark;
    }
    let uv = (vec2f(pixel) + 0.5) / f32(params.side);
    let h = params.space_from_clip * vec4f(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, depth, 1.0);
    let x = h.xyz / h.w;
    if !all(abs(x) < vec3f(MAX_DISTANCE)) {
        return dark;
    }
    let n = gbuffer_normal(bits);
    let axis = light.direction;
    var arriving = params.area;
    var area = params.area;
    var cosine = dot(n, -axis);
    if light.kind != LIGHT_DIRECTIONAL {
        let toward = light.position - x;
        let square = dot(toward, toward);
        if square <= 0.0 {
            return dark;
        }
        let to = toward / sqrt(square);
        let angle = texel_angle(pixel);
        area = angle * square;
        cosine = dot(n, to);
        arriving = angle * (square / max(square, MIN_DISTANCE_SQUARED));
        if light.kind == LIGHT_PATCH {
            arriving *= max(-dot(to, axis), 0.0);
        } else {
            let factor = square * light.inverse_square_range;
            let window = clamp(1.0 - factor * factor, 0.0, 1.0);
            arriving *= window * window;
        }
        if light.kind == LIGHT_SPOT {
            let cone = clamp(-dot(to, axis) * light.spot_scale + light.spot_offset, 0.0, 1.0);
            arriving *= cone * cone;
        }
    }
    let flux = arriving * max(light.color, vec3f(0.0)) * gbuffer_diffuse(bits);
    if cosine <= 0.0 || largest(flux) <= 0.0 {
        return dark;
    }
    return RsmTexel(x, area / (6.0 * max(cosine, MIN_COSINE)), n, 0.0, flux, 0.0);
}

@compute @workgroup_size(8, 8)
fn texels(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= vec2u(params.side)) {
        return;
    }
    let depth = textureLoad(depths, id.xy, 0);
    let bits = textureLoad(gbuffer, id.xy, 0);
    lit_texels[params.first + hilbert_index(params.side, id.x, id.y)] = texel_at(id.xy, depth, bits);
}

@compute @workgroup_size(64)
fn shadow(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let i = flat_group(group, groups) * 64u + lane;
    if i >= shade.texels || all(lit_texels[i].flux == vec3f(0.0)) {
        return;
    }
    let x = (shade.local_from_space * vec4f(lit_texels[i].position, 1.0)).xyz;
    let turned = (shade.local_from_space * vec4f(lit_texels[i].normal, 0.0)).xyz;
    lit_texels[i].flux *= light_transmittance(shade.light, x, turned / max(length(turned), TINY), shade.extent);
}

fn importance(flux: vec3f) -> f32 {
    return flux.x + flux.y + flux.z;
}

// Flux of each run of texels, and the total flux before each run.
var<workgroup> sums: array<f32, 256>;
var<workgroup> before: array<f32, 257>;

fn run_length() -> u32 {
    return max((choice.texels + CHUNKS - 1u) / CHUNKS, 1u);
}

// Fraction of a texel with flux w below `edge`. `sum` is the flux before it in its run.
fn until(edge: f32, sum: f32, w: f32) -> f32 {
    return clamp((edge - sum) / w, 0.0, 1.0);
}

fn stratum(low: f32, high: f32) -> Vpl {
    var out = Vpl(vec3f(0.0), 0.0, vec3f(0.0), 0.0, vec3f(0.0), 0.0);
    if high <= low {
        return out;
    }
    // Last run that begins below `low`.
    var chunk = 0u;
    for (var step = CHUNKS / 2u; step > 0u; step /= 2u) {
        if before[chunk + step] < low {
            chunk += step;
        }
    }
    let run = run_length();
    var weight = 0.0;
    var anchored = false;
    var anchor = vec3f(0.0);
    var moment = vec3f(0.0);
    var normal = vec3f(0.0);
    var square = 0.0;
    for (; chunk < CHUNKS; chunk++) {
        if before[chunk] >= high {
            break;
        }
        let from_low = low - before[chunk];
        let from_high = high - before[chunk];
        let last = min((chunk + 1u) * run, choice.texels);
        var sum = 0.0;
        for (var i = min(chunk * run, choice.texels); i < last; i++) {
            let w = importance(lit_texels[i].flux);
            if w <= 0.0 {
                continue;
            }
            let portion = until(from_high, sum, w) - until(from_low, sum, w);
            sum += w;
            if portion <= 0.0 {
                continue;
            }
            let t = lit_texels[i];
            if !anchored {
                anchored = true;
                anchor = t.position;
            }
            let d = t.position - anchor;
            let v = portion * w;
            out.flux += portion * t.flux;
            weight += v;
            moment += v * d;
            normal += v * t.normal;
            square += v * (dot(d, d) + t.spread);
        }
    }
    if weight <= 0.0 {
        return Vpl(vec3f(0.0), 0.0, vec3f(0.0), 0.0, vec3f(0.0), 0.0);
    }
    let mean = moment / weight;
    out.position = anchor + mean;
    out.square = DISK * max(square / weight - dot(mean, mean), 0.0);
    out.normal = normal / weight;
    return out;
}

@compute @workgroup_size(256)
fn select_vpls(@builtin(local_invocation_index) lane: u32) {
    let run = run_length();
    let last = min((lane + 1u) * run, choice.texels);
    var sum = 0.0;
    for (var i = min(lane * run, choice.texels); i < last; i++) {
        sum += importance(lit_texels[i].flux);
    }
    sums[lane] = sum;
    workgroupBarrier();
    if lane == 0u {
        before[0] = 0.0;
        for (var c = 0u; c < CHUNKS; c++) {
            before[c + 1u] = before[c] + sums[c];
        }
    }
    workgroupBarrier();
    let total = before[CHUNKS];
    let count = f32(choice.vpls);
    for (var k = lane; k < choice.vpls; k += CHUNKS) {
        vpls[choice.first + k] = stratum(total * (f32(k) / count), total * (f32(k + 1u) / count));
    }
}
