// volume: probe irradiance as Bevy's irradiance volumes hold it, for what is drawn forward.
// Twin: crates/meshless_gi/src/frame/volume.rs. The twin asks from each side of a voxel which other
// voxel's light it reads; here the thread of that one, which sums its light once, writes it to all
// the sides that read it. A side that faces as a wall beside its voxel does has the wall's light,
// which the voxel's own thread writes. Every texel has one writer.

struct VolumeParams {
    size: vec3u,
    scale: f32,
    // The world's axes in the local space.
    axes: array<vec4f, 3>,
    // For each side the voxels ahead and beside that one.
    steps: array<array<vec4i, 9>, 6>,
}

// A position on a wall beside a voxel; its shares start here.
struct WallSample {
    normal: vec3f,
    start: u32,
}

// What a face takes from a point's function.
struct WallWeight {
    point: u32,
    part: f32,
}

const AHEAD: u32 = 4u;
// Of ways: free as far as the next voxel, and a wall there.
const UNOBSTRUCTED: u32 = 255u;
const DISTANCE_STEPS: f32 = 254.0;
const ALL_UNOBSTRUCTED: u32 = 0xffffffffu;
// A side reads a face where the cosine between them is more; in a voxel in the ground that does not
// matter.
const FACING: f32 = 0.5;
// Cosines that differ by less are the same.
const SAME: f32 = 1e-4;
const WEIGHT_BITS: u32 = 12u;

@group(0) @binding(0) var<uniform> params: VolumeParams;
// Where the shares of each voxel start, and at last where they end.
@group(0) @binding(1) var<storage, read> starts: array<u32>;
@group(0) @binding(2) var<storage, read> weights: array<u32>;
// Three a probe.
@group(0) @binding(3) var<storage, read> values: array<VectorIrradiance>;
// Where the faces of each voxel start, and at last where they end.
@group(0) @binding(4) var<storage, read> wall_starts: array<u32>;
// And one behind the last.
@group(0) @binding(5) var<storage, read> wall_samples: array<WallSample>;
@group(0) @binding(6) var<storage, read> wall_weights: array<WallWeight>;
// One a point.
@group(0) @binding(7) var<storage, read> point_values: array<VectorIrradiance>;
// How far the ways from each voxel to the next ones are free, a byte each: along the edges and
// against them. Then one that is 0 between the sides of a wall.
@group(0) @binding(8) var<storage, read> wall_distances: array<vec2u>;
@group(0) @binding(9) var voxels: texture_storage_3d<rgba16float, write>;

fn inside(voxel: vec3u) -> bool {
    return all(voxel < params.size);
}

fn index_of(voxel: vec3u) -> u32 {
    return voxel.x + params.size.x * (voxel.y + params.size.y * voxel.z);
}

// The voxel a step away; one below zero is far above.
fn stepped(voxel: vec3u, by: vec3i) -> vec3u {
    return vec3u(vec3i(voxel) + by);
}

// Whether a probe reaches the middle of a voxel.
fn is_reached(voxel: vec3u) -> bool {
    if !inside(voxel) {
        return false;
    }
    let i = index_of(voxel);
    return starts[i] < starts[i + 1u];
}

// The light at the middle of a voxel of the volume.
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

// The face of a voxel of the volume that `n` faces most, the first of those; one behind the voxel's
// last where none faces as it does.
fn face_of(voxel: vec3u, n: vec3f) -> u32 {
    let i = index_of(voxel);
    let end = wall_starts[i + 1u];
    var best = select(-2.0, FACING, is_reached(voxel));
    var found = end;
    for (var face = wall_starts[i]; face < end; face++) {
        let cosine = dot(wall_samples[face].normal, n);
        if cosine > best + SAME {
            best = cosine;
            found = face;
        }
    }
    return found;
}

fn has_face(voxel: vec3u, n: vec3f) -> bool {
    return face_of(voxel, n) < wall_starts[index_of(voxel) + 1u];
}

// The light of a face's wall.
fn on_a_wall(face: u32) -> vec3f {
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

// For a side without light ahead or of its own: the mean of those around the voxel ahead.
fn around(voxel: vec3u, side: u32, n: vec3f) -> vec3f {
    var sum = vec3f(0.0);
    var count = 0.0;
    for (var k = 0u; k < 9u; k++) {
        let to = stepped(voxel, params.steps[side][k].xyz);
        if is_reached(to) {
            sum += space_irradiance(light_of(to), n);
            count += 1.0;
        }
    }
    return sum / max(count, 1.0);
}

fn way_of(voxel: vec3u, side: u32) -> u32 {
    return (wall_distances[index_of(voxel)][side / 4u] >> (8u * (side % 4u))) & 255u;
}

// Whether something stands before the middle of the voxel a step away.
fn is_blocked(voxel: vec3u, by: vec3i) -> bool {
    var ends = false;
    for (var axis = 0u; axis < 3u; axis++) {
        let side = 2u * axis + select(0u, 1u, by[axis] < 0);
        ends = ends || (by[axis] != 0 && way_of(voxel, side) != UNOBSTRUCTED);
    }
    return ends;
}

// What a side stores beside its light.
fn stored_way(voxel: vec3u, side: u32) -> f32 {
    if all(wall_distances[index_of(voxel)] == vec2u(ALL_UNOBSTRUCTED)) {
        return -2.0;
    }
    if (wall_distances[index_of(voxel)].y >> 16u & 255u) == 0u {
        return -0.125;
    }
    return -(0.25 + f32(way_of(voxel, side)) / DISTANCE_STEPS);
}

fn store(voxel: vec3u, side: u32, light: vec3f) {
    // Surfaces that face an axis have the lower half, those that face away from it the upper one;
    // axes lie behind one another.
    let texel = voxel + params.size * vec3u(0u, side % 2u, side / 2u);
    textureStore(voxels, texel, vec4f(min(light * params.scale, vec3f(LARGEST_HALF)), stored_way(voxel, side)));
}

@compute @workgroup_size(4, 4, 4)
fn volume(@builtin(global_invocation_id) voxel: vec3u) {
    if !inside(voxel) {
        return;
    }
    let own = light_of(voxel);
    for (var side = 0u; side < 6u; side++) {
        let n = params.axes[side / 2u].xyz * select(1.0, -1.0, side % 2u == 1u);
        let ahead = params.steps[side][AHEAD].xyz;
        var light = space_irradiance(own, n);
        // The side of the voxel that has this one ahead, unless it keeps its own light.
        let behind = stepped(voxel, -ahead);
        if own.reached && inside(behind) && !has_face(behind, n) && !(is_reached(behind) && is_blocked(behind, ahead)) {
            store(behind, side, light);
        }
        let face = face_of(voxel, n);
        if face < wall_starts[index_of(voxel) + 1u] {
            store(voxel, side, on_a_wall(face));
            continue;
        }
        // One's own, where nothing is ahead.
        if is_reached(stepped(voxel, ahead)) && !(own.reached && is_blocked(voxel, ahead)) {
            continue;
        }
        if !own.reached {
            light = around(voxel, side, n);
        }
        store(voxel, side, light);
    }
}
