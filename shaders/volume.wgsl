// volume: light in free space as Bevy's irradiance volumes hold it, for what is drawn forward. Twin: src/frame/volume.rs.

struct VolumeParams {
    // The corner of the volume, in the bake's local space, and the edges of a voxel.
    low: vec3f,
    cell_size: f32,
    voxel: vec3f,
    slot_mask: u32,
    size: vec3u,
    scale: f32,
    // The world's axes in the local space.
    axes: array<vec4f, 3>,
}

@group(0) @binding(0) var<uniform> params: VolumeParams;
@group(0) @binding(1) var<storage, read> points: array<Point>;
@group(0) @binding(2) var<storage, read> planes: array<vec4f>;
@group(0) @binding(3) var<storage, read> grid_slots: array<GridSlot>;
@group(0) @binding(4) var<storage, read> grid_entries: array<u32>;
// Three a probe.
@group(0) @binding(5) var<storage, read> values: array<VectorIrradiance>;
@group(0) @binding(6) var voxels: texture_storage_3d<rgba16float, write>;

// What surfaces beside `x` that face `n` receive: light a voxel before them, else nearer, else beside.
fn beside(x: vec3f, n: vec3f, t: vec3f, b: vec3f) -> vec3f {
    let reach = max(max(params.voxel.x, params.voxel.y), params.voxel.z);
    for (var k = 0u; k < 3u; k++) {
        let light = probe(x + n * ((1.0 - 0.5 * f32(k)) * reach));
        if light.reached {
            return space_irradiance(light, n);
        }
    }
    var sum = vec3f(0.0);
    var count = 0.0;
    for (var i = 0u; i < 9u; i++) {
        let u = f32(i % 3u) - 1.0;
        let v = f32(i / 3u) - 1.0;
        let light = probe(x + (n + t * u + b * v) * reach);
        if light.reached {
            sum += space_irradiance(light, n);
            count += 1.0;
        }
    }
    return sum / max(count, 1.0);
}

@compute @workgroup_size(4, 4, 4)
fn volume(@builtin(global_invocation_id) id: vec3u) {
    if any(id >= params.size * vec3u(1u, 2u, 3u)) {
        return;
    }
    // Surfaces that face an axis have the lower half, those that face away from it the upper one; axes lie behind one another.
    let axis = id.z / params.size.z;
    let away = id.y >= params.size.y;
    let voxel = id % params.size;
    let x = params.low + params.voxel * (vec3f(voxel) + 0.5);
    let n = params.axes[axis].xyz * select(1.0, -1.0, away);
    let t = params.axes[(axis + 1u) % 3u].xyz;
    let b = params.axes[(axis + 2u) % 3u].xyz;
    let light = beside(x, n, t, b) * params.scale;
    textureStore(voxels, id, vec4f(min(light, vec3f(LARGEST_HALF)), 1.0));
}
