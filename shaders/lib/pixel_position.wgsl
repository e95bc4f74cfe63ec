// Surface points of a view's pixels in a bake's local space, and the transform of vectors back to
// the world's axes. Twin: `lit_pixel`, `pixel_position` and `to_world` of
// crates/meshless_gi/src/frame/splat.rs. Needs lib/gbuffer.

@group(0) @binding(0) var<uniform> params: SplatParams;
@group(0) @binding(1) var depths: texture_depth_2d;
@group(0) @binding(2) var gbuffer: texture_2d<u32>;
@group(0) @binding(8) var output: texture_storage_2d<rgba16float, write>;
@group(0) @binding(9) var earlier: texture_2d<f32>;

// Position and normal of a pixel's surface in the bake's local space.
struct PixelPosition {
    x: vec3f,
    n: vec3f,
    // `false` for the background and for unlit materials. x and n are undefined then.
    lit: bool,
}

fn pixel_position(pixel: vec2u) -> PixelPosition {
    let depth = textureLoad(depths, pixel, 0);
    let texel = textureLoad(gbuffer, pixel, 0);
    let uv = (vec2f(pixel) + 0.5 - params.viewport.xy) / params.viewport.zw;
    let h = params.local_from_clip * vec4f(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, depth, 1.0);
    // Reversed depth: 0 is infinitely far, without a surface.
    let lit = depth > 0.0 && !gbuffer_is_unlit(texel);
    return PixelPosition(h.xyz / h.w, params.local_from_world * gbuffer_normal(texel), lit);
}

// Component of vectors in the bake's local space along one axis of the world.
fn world_axis(e: VectorIrradiance, column: vec3f) -> vec4f {
    return params.scale * (column.x * e.x + column.y * e.y + column.z * e.z);
}

// Transforms vectors from the bake's local space to the axes of the world, times the view's scale.
fn to_world(e: VectorIrradiance) -> VectorIrradiance {
    return VectorIrradiance(
        world_axis(e, params.local_from_world[0]),
        world_axis(e, params.local_from_world[1]),
        world_axis(e, params.local_from_world[2]),
    );
}
