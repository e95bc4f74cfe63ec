// Structs that kernels share with Rust, byte for byte. `tests/checks/shader_layout.rs` compares
// them with the types of the same names. SI units: meters, W/m², W/sr.

// Largest finite half. Larger values are clamped, so that they do not become infinite.
const MAX_HALF: f32 = 65504.0;

struct Point {
    position: vec3f,
    radius: f32,
    normal: vec3f,
    // Clip planes: first index in the low 24 bits, count in the high 8 bits.
    planes: u32,
}

// Sample of the direct light of a sender.
struct LightSample {
    position: vec3f,
    // Octahedral, unpack2x16snorm.
    normal: u32,
}

struct PointSurface {
    albedo: vec3f,
    pad0: f32,
    emission: vec3f,
    pad1: f32,
    sky: vec3f,
    pad2: f32,
}

struct FrameLight {
    position: vec3f,
    kind: u32,
    direction: vec3f,
    inverse_square_range: f32,
    color: vec3f,
    spot_scale: f32,
    spot_offset: f32,
    pad0: f32,
    pad1: f32,
    pad2: f32,
}

const LIGHT_NONE: u32 = 0u;
const LIGHT_POINT: u32 = 1u;
const LIGHT_SPOT: u32 = 2u;
const LIGHT_DIRECTIONAL: u32 = 3u;
const LIGHT_PATCH: u32 = 4u;

struct WeightEntry {
    index: u32,
    weight: f32,
}

struct Row {
    start: u32,
    count: u32,
    scale: f32,
    // Lowest tier of a frame that uses the row. 0 if there is no row.
    tier: u32,
}

struct Link {
    // x in the low half, y in the high half.
    xy: u32,
    // z in the low half, the sender's index in the high half.
    z_sender: u32,
}

// Part of a link that crosses one set of occluders.
struct PackedLinkTerm {
    link: u32,
    // x in the low half, y in the high half.
    xy: u32,
    // z in the low half, the index of the set in the high half.
    z_set: u32,
}

struct Column {
    member: u32,
    count: u32,
    value: u32,
    scale: f32,
}

struct BounceLink {
    gain: vec3f,
    sender: u32,
}

struct VectorIrradiance {
    x: vec4f,
    y: vec4f,
    z: vec4f,
}

struct SolveParams {
    sky: vec3f,
    emission: f32,
    points: u32,
    samples_per_sender: u32,
    senders: u32,
    finest_sender: u32,
    slots: u32,
    nodes: u32,
    extent: f32,
    tier: u32,
    sky_sender: u32,
    coarsest_points: u32,
    differences: u32,
    sample_spacing: f32,
    sky_terms: u32,
    channel: u32,
    pad0: u32,
    pad1: u32,
    hue: vec4f,
    sky_more: array<vec4f, 8>,
}

struct Span {
    first: u32,
    count: u32,
    base: u32,
    pad: u32,
}

struct SplatParams {
    local_from_clip: mat4x4f,
    local_from_world: mat3x3f,
    viewport: vec4f,
    size: vec2u,
    slot_mask: u32,
    cell_size: f32,
    scale: f32,
    seam: f32,
    pad0: u32,
    pad1: u32,
}

struct SubsplatParams {
    view_from_clip: mat4x4f,
    view_from_world: mat3x3f,
    viewport: vec4f,
    size: vec2u,
    coarsest_level: u32,
    finest_level: u32,
    depth_test: u32,
    normal_test: u32,
    depth_threshold: f32,
    normal_threshold: f32,
    radiance_threshold: f32,
    min_similarity: f32,
    detail: f32,
    diagonal: u32,
    starts: array<vec4u, 2>,
}

struct CellRange {
    near: f32,
    far: f32,
    low: u32,
    high: u32,
}

struct SubsplatNode {
    words: array<u32, 6>,
}

struct SpecularParams {
    max_roughness: f32,
    together: u32,
    pad0: u32,
    pad1: u32,
}

struct SpecularNode {
    words: array<u32, 4>,
}

struct CompositeParams {
    scale: f32,
    white: f32,
    pad0: f32,
    pad1: f32,
}

struct GridSlot {
    cell: vec3i,
    start: u32,
}

struct BvhNode {
    min: vec3f,
    first: u32,
    max: vec3f,
    count: u32,
}

struct BvhTriangle {
    a: vec3f,
    // 0 for static geometry, otherwise the occluder's number plus one.
    occluder: u32,
    b: vec3f,
    // Transmittance of an occluder.
    transmittance: f32,
    c: vec3f,
    pad2: u32,
}

// E·n of the three channels.
fn irradiance_dot(e: VectorIrradiance, n: vec3f) -> vec3f {
    return e.x.xyz * n.x + e.y.xyz * n.y + e.z.xyz * n.z;
}

fn add_scaled(sum: ptr<function, VectorIrradiance>, weight: f32, e: VectorIrradiance) {
    (*sum).x += weight * e.x;
    (*sum).y += weight * e.y;
    (*sum).z += weight * e.z;
}

// Workgroups are numbered row by row. One dimension has at most 65535 of them.
fn flat_group(group: vec3u, groups: vec3u) -> u32 {
    return group.y * groups.x + group.x;
}

// Light that casts soft shadows from baked visibility.
struct SoftLight {
    center: vec3f,
    kind: u32,
    u: vec3f,
    radius: f32,
    v: vec3f,
    inverse_square_range: f32,
    color: vec3f,
    columns: u32,
    rows: u32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

const SOFT_SPHERE: u32 = 1u;
const SOFT_RECTANGLE: u32 = 2u;

struct SoftShadowParams {
    points: u32,
    lights: u32,
    columns: u32,
    rows: u32,
    extent: f32,
    bias: f32,
    before: f32,
    ramp: f32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
    pad3: u32,
}

struct SubtractShadowParams {
    lights: u32,
    extent: f32,
    gloss: u32,
    pad0: u32,
}

struct VisibilityCluster {
    tangent: vec3f,
    components: u32,
    basis: u32,
    scales: u32,
    near: f32,
    pad0: u32,
}

struct VisiblePoint {
    cluster: u32,
    first: u32,
    error: u32,
    pad0: u32,
    mask: vec4u,
}
