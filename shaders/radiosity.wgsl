// radiosity: b = ρE + M of every sender, its first coefficient. Twin:
// crates/meshless_gi/src/frame/radiosity.rs.

@group(0) @binding(0) var<uniform> params: SolveParams;
@group(0) @binding(2) var<storage, read> lights: array<FrameLight>;
@group(0) @binding(3) var<storage, read> projected: array<f32>;
@group(0) @binding(4) var<storage, read> points: array<Point>;
@group(0) @binding(5) var<storage, read> surfaces: array<PointSurface>;
@group(0) @binding(6) var<storage, read_write> senders: array<vec4f>;
// Eight numbers per sender if the bake has sky terms. Otherwise it is not read.
@group(0) @binding(7) var<storage, read> sky_visibility: array<f32>;

@compute @workgroup_size(64)
fn radiosity(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let j = flat_group(group, groups) * 64u + local;
    // The sky's coefficients follow those of the senders. They exist even without points.
    if j == 0u {
        senders[params.sky_sender] = vec4f(params.sky, 0.0);
        for (var k = 0u; k < params.sky_terms; k++) {
            senders[params.sky_sender + 1u + k] = params.sky_more[k];
        }
    }
    if j >= params.senders {
        return;
    }
    let surface = surfaces[j];
    var e = vec3f(0.0);
    for (var slot = 0u; slot < params.slots; slot++) {
        e += lights[slot].color * projected[slot * params.senders + j];
    }
    var terms = vec3f(0.0);
    for (var k = 0u; k < params.sky_terms; k++) {
        terms += params.sky_more[k].xyz * sky_visibility[j * params.sky_terms + k];
    }
    e += sky_light(params.sky, dot(surface.sky, points[j].normal), terms, params.sky_terms);
    senders[j] = vec4f(surface.albedo * e + surface.emission * params.emission, 0.0);
}
