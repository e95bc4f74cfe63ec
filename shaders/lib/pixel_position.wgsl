// Where a pixel is in a bake's local space, and how vectors come back from there. Twin: `place` and
// `to_world` of crates/meshless_gi/src/frame/splat.rs. Needs `params`: SplatParams.

// Place and normal of a pixel in the bake's local space.
struct PixelPosition {
    x: vec3f,
    n: vec3f,
}

fn pixel_position(pixel: vec2u, depth: f32, texel: vec4u) -> PixelPosition {
    let uv = (vec2f(pixel) + 0.5 - params.viewport.xy) / params.viewport.zw;
    let h = params.local_from_clip * vec4f(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, depth, 1.0);
    return PixelPosition(h.xyz / h.w, params.local_from_world * gbuffer_normal(texel));
}

// One axis of the world, of vectors in the bake's local space.
fn world_axis(e: VectorIrradiance, column: vec3f) -> vec4f {
    return params.scale * (column.x * e.x + column.y * e.y + column.z * e.z);
}

// Vectors in the bake's local space in the axes of the world, times the view's scale.
fn to_world(e: VectorIrradiance) -> VectorIrradiance {
    return VectorIrradiance(
        world_axis(e, params.local_from_world[0]),
        world_axis(e, params.local_from_world[1]),
        world_axis(e, params.local_from_world[2]),
    );
}
