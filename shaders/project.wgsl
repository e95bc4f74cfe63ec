// project: scalar irradiance of each sender from one light of color one with shadows. It is the
// mean over the sender's samples. Twin: crates/meshless_gi/src/frame/project.rs. One row of
// workgroups per changed light.

@group(0) @binding(0) var<uniform> params: SolveParams;
@group(0) @binding(2) var<storage, read> lights: array<FrameLight>;
@group(0) @binding(3) var<storage, read> changed: array<u32>;
@group(0) @binding(4) var<storage, read> points: array<Point>;
@group(0) @binding(5) var<storage, read> nodes: array<BvhNode>;
@group(0) @binding(6) var<storage, read> triangles: array<BvhTriangle>;
// Sorted by slot, `params.senders` values each.
@group(0) @binding(7) var<storage, read_write> projected: array<f32>;
// `params.samples_per_sender` for each sender of the finest sender level.
@group(0) @binding(8) var<storage, read> light_samples: array<LightSample>;

// Maximum number of samples of a sender that one patch of a rectangle light lights.
const PATCH_SAMPLES: u32 = 4u;

fn bvh_nodes() -> u32 {
    return params.nodes;
}

// Square of the distance below which the light does not get brighter.
fn min_distance_squared(extent: f32) -> f32 {
    return clamp(2.5e-5 * extent * extent, 1.17549435e-38, 1e-4);
}

// A point or spot light closer to the sample's plane than `sample_spacing` is moved to that height.
fn unshadowed(light: FrameLight, x: vec3f, n: vec3f, sample_spacing: f32) -> f32 {
    let axis = light.direction;
    if light.kind == LIGHT_NONE {
        return 0.0;
    }
    if light.kind == LIGHT_DIRECTIONAL {
        return max(dot(n, -axis), 0.0);
    }
    let toward = light.position - x;
    let square = dot(toward, toward);
    if square <= 0.0 {
        return 0.0;
    }
    let height = dot(n, toward);
    let to = toward / sqrt(square);
    var e = max(dot(n, to), 0.0) / max(square, min_distance_squared(params.extent));
    if light.kind == LIGHT_PATCH {
        return e * max(-dot(to, axis), 0.0);
    }
    if height > 0.0 && height < sample_spacing {
        let lifted = square - height * height + sample_spacing * sample_spacing;
        e = sample_spacing / (lifted * sqrt(lifted));
    }
    let factor = square * light.inverse_square_range;
    let window = clamp(1.0 - factor * factor, 0.0, 1.0);
    e *= window * window;
    if light.kind == LIGHT_SPOT {
        let cone = clamp(-dot(to, axis) * light.spot_scale + light.spot_offset, 0.0, 1.0);
        e *= cone * cone;
    }
    return e;
}

fn sample_normal(bits: u32) -> vec3f {
    var p = unpack2x16snorm(bits);
    let z = 1.0 - abs(p.x) - abs(p.y);
    if z < 0.0 {
        p = (1.0 - abs(p.yx)) * select(vec2f(1.0), vec2f(-1.0), p < vec2f(0.0));
    }
    return normalize(vec3f(p, z));
}

fn project_at(light: FrameLight, x: vec3f, n: vec3f, sample_spacing: f32) -> f32 {
    let e = unshadowed(light, x, n, sample_spacing);
    if e <= 0.0 {
        return e;
    }
    return e * light_transmittance(light, x, n, params.extent);
}

@compute @workgroup_size(64)
fn project(@builtin(global_invocation_id) id: vec3u) {
    let j = id.x;
    if j >= params.senders {
        return;
    }
    let slot = changed[id.y];
    let light = lights[slot];
    var e = 0.0;
    if j < params.finest_sender || params.samples_per_sender == 0u {
        e = project_at(light, points[j].position, points[j].normal, 0.0);
    } else {
        let first = (j - params.finest_sender) * params.samples_per_sender;
        var stride = 1u;
        if light.kind == LIGHT_PATCH {
            stride = (params.samples_per_sender + PATCH_SAMPLES - 1u) / PATCH_SAMPLES;
        }
        var used = 0.0;
        for (var k = first + stride / 2u; k < first + params.samples_per_sender; k += stride) {
            e += project_at(light, light_samples[k].position, sample_normal(light_samples[k].normal), params.sample_spacing);
            used += 1.0;
        }
        e /= used;
    }
    projected[slot * params.senders + j] = e;
}
