// Shadow rays from a surface to a light, through a baked scene. Twin:
// crates/meshless_gi/src/frame/project.rs. Needs lib/bvh.

const FAR: f32 = 1e30;
const EPSILON: f32 = 1.1920929e-7;

// Offset of a ray's start from the surface.
fn ray_offset(x: vec3f, extent: f32) -> f32 {
    let a = abs(x);
    return max(1e-5 * extent, 8.0 * EPSILON * max(max(a.x, max(a.y, a.z)), extent));
}

// Transmittance from `light` to (x, n).
fn light_transmittance(light: FrameLight, x: vec3f, n: vec3f, extent: f32) -> f32 {
    let off = ray_offset(x, extent);
    let origin = x + n * off;
    if light.kind == LIGHT_DIRECTIONAL {
        return transmittance_along(origin, -light.direction, FAR);
    }
    let to = light.position - origin;
    let distance = sqrt(dot(to, to));
    let max_t = distance - off;
    if max_t <= 0.0 {
        return 1.0;
    }
    return transmittance_along(origin, to / distance, max_t);
}
