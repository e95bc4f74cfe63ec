// Light of irradiance volumes at a surface. Replaces Bevy's module of this name if a scene has a
// MeshlessGI volume (src/plugin/effects/volume/shader.rs). Twin:
// crates/meshless_gi/src/frame/volume_sample.rs.
//
// A texel of such a volume has a negative fourth number: the distance from its voxel to a wall
// (crates/meshless_gi/src/frame/volume_distance.rs). Voxels with a wall nearer than the position
// are left out of the interpolation. Without a near wall, and in other volumes, the light is the
// value of the sampler, as in Bevy's module.
//
// If the view has a splatting texture (src/plugin/forward_display.rs) and its pixel shows this
// surface, the texture replaces the light of MeshlessGI volumes.
#define_import_path bevy_pbr::irradiance_volume

#import bevy_pbr::light_probe::{light_probe_iterator_new, light_probe_iterator_next}
#import bevy_pbr::mesh_view_bindings::{
    irradiance_volumes,
    irradiance_volume,
    irradiance_volume_sampler,
    light_probes,
};
#ifdef MESHLESS_GI_DISPLAY
#import bevy_pbr::mesh_view_bindings::{view, view_transmission_texture}
#endif
#import bevy_pbr::clustered_forward::ClusterableObjectIndexRanges

#ifdef LIGHTMAP
#import bevy_pbr::mesh_view_types::LIGHT_PROBE_FLAG_AFFECTS_LIGHTMAPPED_MESH_DIFFUSE;
#endif

#ifdef IRRADIANCE_VOLUMES_ARE_USABLE

// A texel of a voxel without walls in all directions has -2.
const MESHLESS_GI_NO_WALL_THRESHOLD: f32 = -1.999;
// Offset that is added to a stored distance.
const MESHLESS_GI_DISTANCE_OFFSET: f32 = 0.25;
// A position this far beyond a wall, in voxels, gets no light through it. The weight falls smoothly
// between the two distances.
const MESHLESS_GI_WALL_FADE_START: f32 = 0.01;
const MESHLESS_GI_WALL_FADE_END: f32 = 0.03;
// If less than this weight remains of the eight voxels, all of them count.
const MESHLESS_GI_MIN_WEIGHT: f32 = 1e-3;

#ifdef MESHLESS_GI_DISPLAY
// Largest difference of the distances of a surface and the splatting texture from the eye, relative
// to the distance.
const MESHLESS_GI_SAME_SURFACE: f32 = 0.01;

// Light of the splatting texture at a position, and 1. Returns 0 if there is no such texture or if
// its pixel shows another surface. Its fourth number is the negative distance from the eye along
// the view. The texture that Bevy binds instead has no negative values.
fn meshless_gi_display(world_position: vec3<f32>) -> vec4<f32> {
    let h = view.clip_from_world * vec4f(world_position, 1.0);
    let uv = h.xy / h.w * vec2f(0.5, -0.5) + 0.5;
    let shown = textureLoad(view_transmission_texture, vec2i(floor(view.viewport.xy + uv * view.viewport.zw)), 0);
    let away = (view.view_from_world * vec4f(world_position, 1.0)).z;
    let same = shown.a < 0.0 && abs(away - shown.a) < -MESHLESS_GI_SAME_SURFACE * shown.a;
    return select(vec4f(0.0), vec4f(shown.rgb / view.exposure, 1.0), same);
}
#endif

fn irradiance_volume_light(
    world_position: vec3<f32>,
    N: vec3<f32>,
    clusterable_object_index_ranges: ptr<function, ClusterableObjectIndexRanges>,
) -> vec3<f32> {
    var probes = light_probe_iterator_new(world_position, true, clusterable_object_index_ranges);
    let square = N * N;
    let is_away = N < vec3f(0.0);
    let away = vec3u(is_away);
    var light = vec3f(0.0);
    var all_volumes = 0.0;
    while (true) {
        let found = light_probe_iterator_next(&probes);
        if found.texture_index < 0 {
            break;
        }
#ifdef LIGHTMAP
        if (found.flags & LIGHT_PROBE_FLAG_AFFECTS_LIGHTMAPPED_MESH_DIFFUSE) == 0u {
            continue;
        }
#endif
        // Not a function with the texture as its argument: naga does not support it for a texture
        // of an array.
#ifdef MULTIPLE_LIGHT_PROBES_IN_ARRAY
        let voxels = irradiance_volumes[found.texture_index];
#else
        let voxels = irradiance_volume;
#endif
        let all_texels = vec3f(textureDimensions(voxels));
        let size = textureDimensions(voxels) / vec3u(1u, 2u, 3u);
        let local = (found.light_from_world * vec4f(world_position, 1.0)).xyz;
        // Clamped to the range of the voxel centers, which are half a texel inside.
        let position = clamp((local + 0.5) * vec3f(size), vec3f(0.5), vec3f(size) - 0.5);

        let corner = position / all_texels;
        let half = select(vec3f(0.0), vec3f(0.5), is_away);
        let third = 1.0 / 3.0;
        let x = textureSampleLevel(voxels, irradiance_volume_sampler, corner + vec3f(0.0, half.x, 0.0), 0.0);
        let y = textureSampleLevel(voxels, irradiance_volume_sampler, corner + vec3f(0.0, half.y, third), 0.0);
        let z = textureSampleLevel(voxels, irradiance_volume_sampler, corner + vec3f(0.0, half.z, 2.0 * third), 0.0);
        var here = x.rgb * square.x + y.rgb * square.y + z.rgb * square.z;

        var is_shown = false;
#ifdef MESHLESS_GI_DISPLAY
        let display = meshless_gi_display(world_position);
        is_shown = x.a < 0.0 && display.a > 0.0;
        here = select(here, display.rgb, is_shown);
#endif
        // At an unobstructed position all six texels of all eight voxels are open.
        if !is_shown && x.a < 0.0 && x.a > MESHLESS_GI_NO_WALL_THRESHOLD {
            let first = vec3u(position - 0.5);
            var sum = vec3f(0.0);
            var all_weights = 0.0;
            for (var k = 0u; k < 8u; k++) {
                let voxel = min(first + vec3u(k & 1u, (k >> 1u) & 1u, k >> 2u), size - 1u);
                let offset = position - (vec3f(voxel) + 0.5);
                let far = abs(offset);
                var weight = max(1.0 - far.x, 0.0) * max(1.0 - far.y, 0.0) * max(1.0 - far.z, 0.0);
                for (var axis = 0u; axis < 3u; axis++) {
                    let texel = voxel + size * vec3u(0u, select(0u, 1u, offset[axis] < 0.0), axis);
                    let way = textureLoad(voxels, texel, 0).a;
                    if way > MESHLESS_GI_NO_WALL_THRESHOLD {
                        let beyond = far[axis] + way + MESHLESS_GI_DISTANCE_OFFSET;
                        weight *= 1.0 - smoothstep(MESHLESS_GI_WALL_FADE_START, MESHLESS_GI_WALL_FADE_END, beyond);
                    }
                }
                if weight <= 0.0 {
                    continue;
                }
                let along_x = textureLoad(voxels, voxel + size * vec3u(0u, away.x, 0u), 0).rgb;
                let along_y = textureLoad(voxels, voxel + size * vec3u(0u, away.y, 1u), 0).rgb;
                let along_z = textureLoad(voxels, voxel + size * vec3u(0u, away.z, 2u), 0).rgb;
                sum += weight * (along_x * square.x + along_y * square.y + along_z * square.z);
                all_weights += weight;
            }
            if all_weights > MESHLESS_GI_MIN_WEIGHT {
                here = sum / all_weights;
            }
        }
        light += here * found.intensity * found.weight;
        all_volumes += found.weight;
    }
    if all_volumes != 0.0 {
        light /= all_volumes;
    }
    return light;
}

#endif
