// fog_voxels: what fog at the middle of each voxel would send to the eye of a level's light in free space. Twin: src/frame/fog_voxels.rs, which says what is computed.

struct FogVoxelsParams {
    world_from_voxels: mat4x4f,
    eye: vec4f,
    size: vec3u,
    asymmetry: f32,
}

// Where the eye is there is no direction.
const NEAREST: f32 = 1e-12;

@group(0) @binding(0) var<uniform> params: FogVoxelsParams;
@group(0) @binding(1) var voxels: texture_3d<f32>;
@group(0) @binding(2) var light: texture_storage_3d<rgba16float, write>;

@compute @workgroup_size(4, 4, 4)
fn fog_voxels(@builtin(global_invocation_id) voxel: vec3u) {
    if any(voxel >= params.size) {
        return;
    }
    let middle = (params.world_from_voxels * vec4f(vec3f(voxel) + 0.5, 1.0)).xyz;
    let towards = middle * params.eye.w - params.eye.xyz;
    let d = towards / max(length(towards), NEAREST);
    let g = params.asymmetry;
    let even = vec3f(1.0 / 6.0) + 2.0 * g * g * (d * d - 1.0 / 3.0);
    var sum = vec3f(0.0);
    var says = 0.0;
    for (var axis = 0u; axis < 3u; axis++) {
        let along = 0.75 * g * d[axis];
        let ahead = textureLoad(voxels, voxel + params.size * vec3u(0u, 0u, axis), 0);
        let back = textureLoad(voxels, voxel + params.size * vec3u(0u, 1u, axis), 0);
        sum += (even[axis] + along) * ahead.rgb + (even[axis] - along) * back.rgb;
        if axis == 0u {
            says = ahead.a;
        }
    }
    textureStore(light, voxel, vec4f(clamp(sum, vec3f(0.0), vec3f(LARGEST_HALF)), says));
}
