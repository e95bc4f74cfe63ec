// The levels of a view's subsplats and what its pixels show. Twins: src/frame/subsplat.rs and src/frame/pyramid.rs. Needs `screen` (a SubsplatParams), `depths`,
// `gbuffer`, and lib/gbuffer.

fn level_grid(k: u32) -> vec2u {
    return (screen.size + (1u << k) - 1u) >> vec2u(k);
}

fn level_start(k: u32) -> u32 {
    return screen.starts[k / 4u][k % 4u];
}

fn cell_index(k: u32, cell: vec2u) -> u32 {
    return level_start(k) + cell.y * level_grid(k).x + cell.x;
}

// Depth of a pixel, 0 where nothing is to be lit.
fn lit_depth(pixel: vec2u) -> f32 {
    return select(textureLoad(depths, pixel, 0), 0.0, gbuffer_is_unlit(textureLoad(gbuffer, pixel, 0)));
}

fn pixel_normal(pixel: vec2u) -> vec3f {
    return gbuffer_normal(textureLoad(gbuffer, pixel, 0));
}

fn view_place(pixel: vec2u, depth: f32) -> vec3f {
    let at = (vec2f(pixel) + 0.5 - screen.viewport.xy) / screen.viewport.zw;
    let h = screen.view_from_clip * vec4f(at.x * 2.0 - 1.0, 1.0 - at.y * 2.0, depth, 1.0);
    return h.xyz / h.w;
}
