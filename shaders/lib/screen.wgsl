// Levels of a view's subsplats, and surfaces of its pixels. Twins:
// crates/meshless_gi/src/frame/subsplat.rs and crates/meshless_gi/src/frame/pyramid.rs. Needs
// `screen` (a SubsplatParams), `depths`, `gbuffer`, and lib/gbuffer.

fn level_grid(k: u32) -> vec2u {
    return (screen.size + (1u << k) - 1u) >> vec2u(k);
}

fn level_start(k: u32) -> u32 {
    return screen.starts[k / 4u][k % 4u];
}

fn cell_index(k: u32, cell: vec2u) -> u32 {
    return level_start(k) + cell.y * level_grid(k).x + cell.x;
}

// Depth of a pixel, 0 if it has no lit surface.
fn lit_depth(pixel: vec2u) -> f32 {
    return select(textureLoad(depths, pixel, 0), 0.0, gbuffer_is_unlit(textureLoad(gbuffer, pixel, 0)));
}

fn pixel_normal(pixel: vec2u) -> vec3f {
    return gbuffer_normal(textureLoad(gbuffer, pixel, 0));
}

const MAX_REACH_PIXELS: f32 = 1600.0;

// Reference length of depth tolerances: the distance z, but at most MAX_REACH_PIXELS widths of a
// pixel.
fn depth_reach(z: f32, depth: f32) -> f32 {
    let m = screen.view_from_clip;
    let w = m[2].w * depth + m[3].w;
    let width = 2.0 * abs(m[1].y) / max(screen.viewport.w * abs(w), 1.17549435e-38);
    return min(abs(z), MAX_REACH_PIXELS * width);
}

const PLANE: f32 = 0.01;

// Similarity of two surface points by the distance of each from the plane of the other. It is 1 up
// to half of PLANE times `reach`, and 0 from PLANE times `reach` on.
fn plane_similarity(x: vec3f, n: vec3f, other_x: vec3f, other_n: vec3f, reach: f32) -> f32 {
    let off = max(abs(dot(other_x - x, n)), abs(dot(other_x - x, other_n)));
    return clamp(2.0 - 2.0 * off / (PLANE * reach), 0.0, 1.0);
}

fn view_position(pixel: vec2u, depth: f32) -> vec3f {
    let at = (vec2f(pixel) + 0.5 - screen.viewport.xy) / screen.viewport.zw;
    let h = screen.view_from_clip * vec4f(at.x * 2.0 - 1.0, 1.0 - at.y * 2.0, depth, 1.0);
    return h.xyz / h.w;
}
