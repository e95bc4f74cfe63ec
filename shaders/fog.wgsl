// fog: radiance that fog between the eye and a pixel scatters from a scene's indirect light. Drawn
// as one triangle with additive blending, after the engine's own fog. Twin:
// crates/meshless_gi/src/frame/fog.rs.

struct FogParams {
    view_from_clip: mat4x4f,
    fog_from_view: mat4x4f,
    voxels_from_view: mat4x4f,
    earlier: array<mat4x4f, 4>,
    viewport: vec4f,
    color: vec3f,
    extinction: f32,
    offset: vec3f,
    density: f32,
    size: vec3u,
    steps: u32,
    low: vec3f,
    earlier_count: u32,
    high: vec3f,
    textured: u32,
    radius: f32,
    part: f32,
}

@group(0) @binding(0) var<uniform> params: FogParams;
@group(0) @binding(1) var depth: texture_depth_2d;
@group(0) @binding(2) var depth_samples: texture_depth_multisampled_2d;
@group(0) @binding(3) var voxels: texture_3d<f32>;
@group(0) @binding(4) var light: texture_3d<f32>;
@group(0) @binding(5) var light_sampler: sampler;
@group(0) @binding(6) var density: texture_3d<f32>;
@group(0) @binding(7) var density_sampler: sampler;

// Transmittances below this count as zero.
const MIN_TRANSMITTANCE: f32 = 1e-3;
const PARALLEL: f32 = 1e-9;
// Longer than any ray.
const MAX_RAY_LENGTH: f32 = 3.4e38;
// Same constants as in the module that reads volumes at surfaces:
// shaders/engine/irradiance_volume.wgsl.
const NO_WALL_THRESHOLD: f32 = -1.999;
const DISTANCE_OFFSET: f32 = 0.25;
const WALL_FADE_START: f32 = 0.01;
const WALL_FADE_END: f32 = 0.03;
const MIN_WEIGHT_SUM: f32 = 1e-3;

// From the near plane to the surface in a pixel, in view space.
struct Ray {
    origin: vec3f,
    direction: vec3f,
    length: f32,
}

struct Outgoing {
    sent: f32,
    left: f32,
}

// Full-screen triangle.
@vertex
fn fog_screen(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    let corner = vec2f(f32((index << 1u) & 2u), f32(index & 2u));
    return vec4f(corner * 2.0 - 1.0, 0.0, 1.0);
}

@fragment
fn fog(@builtin(position) position: vec4f) -> @location(0) vec4f {
    return vec4f(light_of(position.xy, textureLoad(depth, vec2u(position.xy), 0)), 0.0);
}

// The same for views with several samples per pixel. Reads the first sample, as the engine's fog
// does.
@fragment
fn fog_sampled(@builtin(position) position: vec4f) -> @location(0) vec4f {
    return vec4f(light_of(position.xy, textureLoad(depth_samples, vec2u(position.xy), 0)), 0.0);
}

fn light_of(pixel: vec2f, seen: f32) -> vec3f {
    let ray = ray_to(pixel, seen);
    let whole = range_in_box(ray, params.fog_from_view, vec3f(-0.5), vec3f(0.5));
    var lit = range_in_box(ray, params.voxels_from_view, params.low, params.high);
    lit = vec2f(max(lit.x, whole.x), min(lit.y, whole.y));
    if lit.y <= lit.x {
        return vec3f(0.0);
    }
    var left = transmittance_to(ray, whole, lit.x);
    let steps = steps_of(whole, lit);
    let part = (lit.y - lit.x) / f32(steps);
    var sum = vec3f(0.0);
    var dense = params.density;
    var out = outgoing(dense, part);
    for (var k = 0u; k < steps; k++) {
        if left < MIN_TRANSMITTANCE {
            break;
        }
        let x = ray.origin + (lit.x + (f32(k) + 0.5) * part) * ray.direction;
        if params.textured != 0u {
            dense = density_at(x);
            out = outgoing(dense, part);
        }
        if !is_earlier(x) {
            sum += left * out.sent * arriving((params.voxels_from_view * vec4f(x, 1.0)).xyz);
        }
        left *= out.left;
    }
    return sum * params.color;
}

// Scattered radiance and transmittance of a part of a ray with this density.
fn outgoing(dense: f32, part: f32) -> Outgoing {
    let lost = dense * params.extinction;
    return Outgoing(dense * exp(-lost * params.radius) * part * mean_transmittance(lost * part), exp(-lost * part));
}

// Transmittance of the fog between the position where the ray enters it and the position `enters`.
fn transmittance_to(ray: Ray, whole: vec2f, enters: f32) -> f32 {
    let before = enters - whole.x;
    var steps = 1u;
    if params.textured != 0u {
        steps = steps_of_part(before / (whole.y - whole.x));
    }
    let part = before / f32(steps);
    var through = 0.0;
    for (var k = 0u; k < steps; k++) {
        through += density_at(ray.origin + (whole.x + (f32(k) + 0.5) * part) * ray.direction);
    }
    return exp(-through * params.extinction * part);
}

// Number of steps of a part of a ray, in proportion to those of a whole ray.
fn steps_of_part(part: f32) -> u32 {
    return clamp(u32(ceil(f32(params.steps) * part)), 1u, params.steps);
}

fn steps_of(whole: vec2f, lit: vec2f) -> u32 {
    let by_light = max(u32(min(ceil((lit.y - lit.x) / params.part), f32(params.steps))), 1u);
    if params.textured == 0u {
        return by_light;
    }
    return max(by_light, steps_of_part((lit.y - lit.x) / (whole.y - whole.x)));
}

fn density_at(x: vec3f) -> f32 {
    if params.textured == 0u {
        return params.density;
    }
    let at = (params.fog_from_view * vec4f(x, 1.0)).xyz + 0.5 + params.offset;
    return params.density * textureSampleLevel(density, density_sampler, at, 0.0).r;
}

fn mean_transmittance(x: f32) -> f32 {
    if x < 1e-2 {
        return 1.0 - x * (0.5 - x / 6.0);
    }
    return (1.0 - exp(-x)) / x;
}

fn is_earlier(x: vec3f) -> bool {
    for (var k = 0u; k < params.earlier_count; k++) {
        let at = (params.earlier[k] * vec4f(x, 1.0)).xyz;
        if all(abs(at) <= vec3f(0.5)) {
            return true;
        }
    }
    return false;
}

fn unprojected(uv: vec2f, depth: f32) -> vec4f {
    return params.view_from_clip * vec4f(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, depth, 1.0);
}

fn ray_to(pixel: vec2f, seen: f32) -> Ray {
    let uv = (pixel - params.viewport.xy) / params.viewport.zw;
    let first = unprojected(uv, 1.0);
    let near = first.xyz / first.w;
    // Without a far plane the farthest position is a direction.
    let far = unprojected(uv, 0.0);
    let direction = normalize(far.xyz - far.w * near);
    let surface = unprojected(uv, seen);
    var length = MAX_RAY_LENGTH;
    if surface.w > 0.0 {
        length = dot(surface.xyz / surface.w - near, direction);
    }
    return Ray(near, direction, length);
}

// Range of a ray inside of a box in another space. The second value is the smaller one if the ray
// misses the box.
fn range_in_box(ray: Ray, space: mat4x4f, low: vec3f, high: vec3f) -> vec2f {
    let o = (space * vec4f(ray.origin, 1.0)).xyz;
    let toward = (space * vec4f(ray.direction, 0.0)).xyz;
    let d = select(toward, vec3f(PARALLEL), abs(toward) < vec3f(PARALLEL));
    let a = (low - o) / d;
    let b = (high - o) / d;
    let enters = min(a, b);
    let leaves = max(a, b);
    return vec2f(
        max(max(enters.x, enters.y), max(enters.z, 0.0)),
        min(min(leaves.x, leaves.y), min(leaves.z, ray.length)),
    );
}

// Twin: `read_voxels` of crates/meshless_gi/src/frame/volume_sample.rs.
fn arriving(unclamped: vec3f) -> vec3f {
    let size = vec3f(params.size);
    let position = clamp(unclamped, vec3f(0.5), size - 0.5);
    let here = textureSampleLevel(light, light_sampler, position / size, 0.0);
    // At an unobstructed position all eight voxels are open.
    if here.a >= 0.0 || here.a < NO_WALL_THRESHOLD {
        return here.rgb;
    }
    let first = vec3u(position - 0.5);
    var sum = vec3f(0.0);
    var all_weights = 0.0;
    for (var k = 0u; k < 8u; k++) {
        let voxel = min(first + vec3u(k & 1u, (k >> 1u) & 1u, k >> 2u), params.size - 1u);
        let offset = position - (vec3f(voxel) + 0.5);
        let far = abs(offset);
        var weight = max(1.0 - far.x, 0.0) * max(1.0 - far.y, 0.0) * max(1.0 - far.z, 0.0);
        for (var axis = 0u; axis < 3u; axis++) {
            let texel = voxel + params.size * vec3u(0u, select(0u, 1u, offset[axis] < 0.0), axis);
            let way = textureLoad(voxels, texel, 0).a;
            if way > NO_WALL_THRESHOLD {
                let beyond = far[axis] + way + DISTANCE_OFFSET;
                weight *= 1.0 - smoothstep(WALL_FADE_START, WALL_FADE_END, beyond);
            }
        }
        if weight > 0.0 {
            sum += weight * textureLoad(light, voxel, 0).rgb;
            all_weights += weight;
        }
    }
    if all_weights > MIN_WEIGHT_SUM {
        return sum / all_weights;
    }
    return here.rgb;
}
