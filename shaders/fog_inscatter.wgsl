// fog_inscatter: radiance that fog at each voxel center scatters to the eye. Twin:
// crates/meshless_gi/src/frame/fog_inscatter.rs.

struct FogInscatterParams {
    world_from_voxels: mat4x4f,
    eye: vec4f,
    // Step per side from a voxel to the voxel that provides its light.
    steps: array<vec4i, 6>,
    size: vec3u,
    asymmetry: f32,
}

// Directions without a wall up to the next voxel have less.
const UNOBSTRUCTED_THRESHOLD: f32 = -1.252;
// Minimum distance from the eye. It prevents a division by zero.
const MIN_EYE_DISTANCE: f32 = 1e-12;

@group(0) @binding(0) var<uniform> params: FogInscatterParams;
@group(0) @binding(1) var voxels: texture_3d<f32>;
@group(0) @binding(2) var light: texture_storage_3d<rgba16float, write>;

fn texel(voxel: vec3u, side: u32) -> vec4f {
    return textureLoad(voxels, voxel + params.size * vec3u(0u, side & 1u, side >> 1u), 0);
}

fn is_free(voxel: vec3u, way: vec3i) -> bool {
    for (var k = 0u; k < 3u; k++) {
        if way[k] != 0 && texel(voxel, 2u * k + select(0u, 1u, way[k] < 0)).a >= UNOBSTRUCTED_THRESHOLD {
            return false;
        }
    }
    return true;
}

// Light of a voxel for a side. The voxel behind it stores it, if no wall lies between the two.
fn own(voxel: vec3u, side: u32) -> vec3f {
    let step = params.steps[side].xyz;
    // Negative coordinates become large.
    let behind = vec3u(vec3i(voxel) - step);
    if all(behind < params.size) && is_free(voxel, -step) {
        return texel(behind, side).rgb;
    }
    return texel(voxel, side).rgb;
}

@compute @workgroup_size(4, 4, 4)
fn fog_inscatter(@builtin(global_invocation_id) voxel: vec3u) {
    if any(voxel >= params.size) {
        return;
    }
    let middle = (params.world_from_voxels * vec4f(vec3f(voxel) + 0.5, 1.0)).xyz;
    let toward = middle * params.eye.w - params.eye.xyz;
    let d = toward / max(length(toward), MIN_EYE_DISTANCE);
    let g = params.asymmetry;
    let even = vec3f(1.0 / 6.0) + 2.0 * g * g * (d * d - 1.0 / 3.0);
    var sum = vec3f(0.0);
    for (var axis = 0u; axis < 3u; axis++) {
        let along = 0.75 * g * d[axis];
        sum += (even[axis] + along) * own(voxel, 2u * axis) + (even[axis] - along) * own(voxel, 2u * axis + 1u);
    }
    textureStore(light, voxel, vec4f(clamp(sum, vec3f(0.0), vec3f(MAX_HALF)), texel(voxel, 0u).a));
}
