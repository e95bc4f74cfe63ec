// Where a pixel is in a baked scene. Twin: `place` in src/frame/splat.rs. Needs `params` (a SplatParams) and lib/gbuffer.

// Place and normal of a pixel in the bake's local space.
struct Place {
    x: vec3f,
    n: vec3f,
}

fn place(pixel: vec2u, depth: f32, texel: vec4u) -> Place {
    let uv = (vec2f(pixel) + 0.5 - params.viewport.xy) / params.viewport.zw;
    let h = params.local_from_clip * vec4f(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, depth, 1.0);
    return Place(h.xyz / h.w, params.local_from_world * gbuffer_normal(texel));
}
