// Entry points of kernels that write one texel for each pixel of a view. `first_scene` starts the
// view's image, `next_scene` continues the image of earlier scenes. Needs `params.size`, `output`,
// `earlier` and `fn pixel_texel(pixel: vec2u, before: vec4f) -> vec4f`.

@compute @workgroup_size(8, 8)
fn first_scene(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.size) {
        return;
    }
    textureStore(output, id.xy, pixel_texel(id.xy, vec4f(0.0)));
}

@compute @workgroup_size(8, 8)
fn next_scene(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.size) {
        return;
    }
    textureStore(output, id.xy, pixel_texel(id.xy, textureLoad(earlier, id.xy, 0)));
}
