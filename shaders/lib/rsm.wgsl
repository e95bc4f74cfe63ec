// Structs of reflective shadow maps, byte for byte as in
// crates/meshless_gi/src/frame/rsm_layout.rs. `tests/checks/shader_layout.rs` compares them. All
// are in one space: the world's axes, meters, an origin near the view.

struct RsmParams {
    space_from_clip: mat4x4f,
    light: FrameLight,
    forward: vec3f,
    side: u32,
    right: vec3f,
    first: u32,
    up: vec3f,
    area: f32,
}

struct RsmTexel {
    position: vec3f,
    spread: f32,
    normal: vec3f,
    pad0: f32,
    flux: vec3f,
    pad1: f32,
}

struct RsmShadowParams {
    local_from_space: mat4x4f,
    light: FrameLight,
    texels: u32,
    nodes: u32,
    extent: f32,
    pad: u32,
}

struct RsmSelectParams {
    texels: u32,
    first: u32,
    vpls: u32,
    pad: u32,
}

struct Vpl {
    position: vec3f,
    square: f32,
    normal: vec3f,
    pad0: f32,
    flux: vec3f,
    pad1: f32,
}

struct VplParams {
    local_from_space: mat4x4f,
    vpls: u32,
    nodes: u32,
    extent: f32,
    dim: f32,
}

struct VplViewParams {
    space_from_clip: mat4x4f,
    viewport: vec4f,
    size: vec2u,
    scale: f32,
    pad: u32,
}
