// volume: probe irradiance in the format of Bevy's irradiance volumes, for forward rendering. Twin:
// crates/meshless_gi/src/frame/volume.rs. The twin computes for each side of a voxel the other
// voxel that provides its light. Here the thread of that voxel sums its light once and writes it to
// all sides that read it. A side with the normal of a wall next to its voxel has the wall's light.
// The voxel's own thread writes it. Every texel has one writer.

struct VolumeParams {
    size: vec3u,
    scale: f32,
    // The world's axes in the local space.
    axes: array<vec4f, 3>,
    // For each side the voxels ahead and those around the voxel ahead.
    steps: array<array<vec4i, 9>, 6>,
}

// Position on a wall next to a voxel. `start` is the index of its first weight.
struct WallSample {
    normal: vec3f,
    start: u32,
}

// Weight of a point's function at a wall sample.
struct WallWeight {
    point: u32,
    part: f32,
}

const STRAIGHT_STEP: u32 = 4u;
// Code of a direction without a wall up to the next voxel. Other codes are distances to a wall
// there.
const UNOBSTRUCTED: u32 = 255u;
const DISTANCE_STEPS: f32 = 254.0;
const ALL_UNOBSTRUCTED: u32 = 0xffffffffu;
// Minimum cosine between a side and the wall sample that it reads. Voxels without probes ignore it.
const MIN_FACING_COSINE: f32 = 0.5;
// Cosines that differ by less count as equal.
const COSINE_TOLERANCE: f32 = 1e-4;
const WEIGHT_BITS: u32 = 12u;

@group(0) @binding(0) var<uniform> params: VolumeParams;
// Index of the first weight of each voxel, and the end of the last.
@group(0) @binding(1) var<storage, read> starts: array<u32>;
@group(0) @binding(2) var<storage, read> weights: array<u32>;
// Three per probe.
@group(0) @binding(3) var<storage, read> values: array<VectorIrradiance>;
// Index of the first wall sample of each voxel, and the end of the last.
@group(0) @binding(4) var<storage, read> wall_starts: array<u32>;
// Wall samples, and one after the last.
@group(0) @binding(5) var<storage, read> wall_samples: array<WallSample>;
@group(0) @binding(6) var<storage, read> wall_weights: array<WallWeight>;
// One per point.
@group(0) @binding(7) var<storage, read> point_values: array<VectorIrradiance>;
// Distances to walls from each voxel toward its neighbors, one byte each: along the axes and
// against them. The next byte is 0 between the two sides of a wall.
@group(0) @binding(8) var<storage, read> wall_distances: array<vec2u>;
@group(0) @binding(9) var voxels: texture_storage_3d<rgba16float, write>;

fn is_in_volume(voxel: vec3u) -> bool {
    return all(voxel < params.size);
}

fn index_of(voxel: vec3u) -> u32 {
    return voxel.x + params.size.x * (voxel.y + params.size.y * voxel.z);
}

// Voxel at a step. Negative coordinates become large.
fn stepped(voxel: vec3u, by: vec3i) -> vec3u {
    return vec3u(vec3i(voxel) + by);
}

// `true` if a probe reaches the center of a voxel.
fn is_reached(voxel: vec3u) -> bool {
    if !is_in_volume(voxel) {
        return false;
    }
    let i = index_of(voxel);
    return starts[i] < starts[i + 1u];
}

// Light at the center of a voxel of the volume.
fn light_of(voxel: vec3u) -> ProbeIrradiance {
    let nothing = VectorIrradiance(vec4f(0.0), vec4f(0.0), vec4f(0.0));
    var linear = nothing;
    var even = nothing;
    var mixed = nothing;
    var all_parts = 0.0;
    let i = index_of(voxel);
    let end = starts[i + 1u];
    for (var at = starts[i]; at < end; at++) {
        let share = weights[at];
        let part = f32(share & ((1u << WEIGHT_BITS) - 1u));
        let j = PROBE_ROWS * (share >> WEIGHT_BITS);
        all_parts += part;
        add_scaled(&linear, part, values[j]);
        add_scaled(&even, part, values[j + 1u]);
        add_scaled(&mixed, part, values[j + 2u]);
    }
    let scale = 1.0 / max(all_parts, 1.0);
    return ProbeIrradiance(scaled(scale, linear), scaled(scale, even), scaled(scale, mixed), all_parts > 0.0);
}

// First wall sample of a voxel with the largest cosine to `n`. Returns the end of the voxel's range
// if no cosine is large enough.
fn wall_sample_of(voxel: vec3u, n: vec3f) -> u32 {
    let i = index_of(voxel);
    let end = wall_starts[i + 1u];
    var best = select(-2.0, MIN_FACING_COSINE, is_reached(voxel));
    var found = end;
    for (var face = wall_starts[i]; face < end; face++) {
        let cosine = dot(wall_samples[face].normal, n);
        if cosine > best + COSINE_TOLERANCE {
            best = cosine;
            found = face;
        }
    }
    return found;
}

fn has_wall_sample(voxel: vec3u, n: vec3f) -> bool {
    return wall_sample_of(voxel, n) < wall_starts[index_of(voxel) + 1u];
}

// Irradiance of a wall sample.
fn wall_irradiance(face: u32) -> vec3f {
    var e = VectorIrradiance(vec4f(0.0), vec4f(0.0), vec4f(0.0));
    let end = wall_samples[face + 1u].start;
    for (var at = wall_samples[face].start; at < end; at++) {
        let share = wall_weights[at];
        add_scaled(&e, share.part, point_values[share.point]);
    }
    let n = wall_samples[face].normal;
    return max((e.x * n.x + e.y * n.y + e.z * n.z).xyz, vec3f(0.0));
}

fn scaled(scale: f32, e: VectorIrradiance) -> VectorIrradiance {
    return VectorIrradiance(scale * e.x, scale * e.y, scale * e.z);
}

// Mean of the voxels around the voxel ahead, for a side without light in its own voxel and in the
// voxel ahead.
fn mean_of_neighbors(voxel: vec3u, side: u32, n: vec3f) -> vec3f {
    var sum = vec3f(0.0);
    var count = 0.0;
    for (var k = 0u; k < 9u; k++) {
        let to = stepped(voxel, params.steps[side][k].xyz);
        if is_reached(to) {
            sum += probe_irradiance(light_of(to), n);
            count += 1.0;
        }
    }
    return sum / max(count, 1.0);
}

fn wall_distance(voxel: vec3u, side: u32) -> u32 {
    return (wall_distances[index_of(voxel)][side / 4u] >> (8u * (side % 4u))) & 255u;
}

// `true` if a wall lies before the center of the voxel at a step.
fn is_blocked(voxel: vec3u, by: vec3i) -> bool {
    var ends = false;
    for (var axis = 0u; axis < 3u; axis++) {
        let side = 2u * axis + select(0u, 1u, by[axis] < 0);
        ends = ends || (by[axis] != 0 && wall_distance(voxel, side) != UNOBSTRUCTED);
    }
    return ends;
}

// Distance that a side stores in addition to its light.
fn encode_distance(voxel: vec3u, side: u32) -> f32 {
    if all(wall_distances[index_of(voxel)] == vec2u(ALL_UNOBSTRUCTED)) {
        return -2.0;
    }
    if (wall_distances[index_of(voxel)].y >> 16u & 255u) == 0u {
        return -0.125;
    }
    return -(0.25 + f32(wall_distance(voxel, side)) / DISTANCE_STEPS);
}

fn store(voxel: vec3u, side: u32, light: vec3f) {
    // Surfaces that face an axis use the lower half, those that face away use the upper half. The
    // axes are stacked along z.
    let texel = voxel + params.size * vec3u(0u, side % 2u, side / 2u);
    textureStore(voxels, texel, vec4f(min(light * params.scale, vec3f(MAX_HALF)), encode_distance(voxel, side)));
}

@compute @workgroup_size(4, 4, 4)
fn volume(@builtin(global_invocation_id) voxel: vec3u) {
    if !is_in_volume(voxel) {
        return;
    }
    let own = light_of(voxel);
    for (var side = 0u; side < 6u; side++) {
        let n = params.axes[side / 2u].xyz * select(1.0, -1.0, side % 2u == 1u);
        let ahead = params.steps[side][STRAIGHT_STEP].xyz;
        var light = probe_irradiance(own, n);
        // The side of the voxel that has this one ahead, unless it keeps its own light.
        let behind = stepped(voxel, -ahead);
        if own.reached && is_in_volume(behind) && !has_wall_sample(behind, n) && !(is_reached(behind) && is_blocked(behind, ahead)) {
            store(behind, side, light);
        }
        let face = wall_sample_of(voxel, n);
        if face < wall_starts[index_of(voxel) + 1u] {
            store(voxel, side, wall_irradiance(face));
            continue;
        }
        // A voxel's own light is stored if no voxel ahead provides it.
        if is_reached(stepped(voxel, ahead)) && !(own.reached && is_blocked(voxel, ahead)) {
            continue;
        }
        if !own.reached {
            light = mean_of_neighbors(voxel, side, n);
        }
        store(voxel, side, light);
    }
}
