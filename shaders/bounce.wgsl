// bounce: radiosity of the senders after further bounces. Twin:
// crates/meshless_gi/src/frame/bounce.rs. Entry points: `sweep` is one Jacobi step.
// `gather`, `interpolate` (one dispatch per level, coarse to fine) and `add` add the baked bounces.

@group(0) @binding(0) var<uniform> params: SolveParams;
@group(0) @binding(1) var<uniform> span: Span;
@group(0) @binding(2) var<storage, read> points: array<Point>;
@group(0) @binding(3) var<storage, read> surfaces: array<PointSurface>;
@group(0) @binding(4) var<storage, read> pull_starts: array<u32>;
@group(0) @binding(5) var<storage, read> direct: array<vec4f>;
@group(0) @binding(6) var<storage, read> irradiance: array<VectorIrradiance>;
@group(0) @binding(7) var<storage, read_write> senders: array<vec4f>;
@group(0) @binding(8) var<storage, read> bounce_starts: array<u32>;
@group(0) @binding(9) var<storage, read> bounce_links: array<BounceLink>;
@group(0) @binding(10) var<storage, read_write> further: array<vec4f>;
@group(0) @binding(11) var<storage, read> parent_starts: array<u32>;
@group(0) @binding(12) var<storage, read> parent_entries: array<WeightEntry>;
// Eight numbers per sender if the bake has sky terms. Otherwise it is not read.
@group(0) @binding(13) var<storage, read> sky_visibility: array<f32>;

@compute @workgroup_size(64)
fn sweep(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let j = flat_group(group, groups) * 64u + local;
    if j >= params.senders {
        return;
    }
    if j < params.finest_sender && pull_starts[j] != pull_starts[j + 1u] {
        return;
    }
    var e = irradiance_dot(irradiance[j], points[j].normal);
    if params.differences == 0u {
        // `direct` already includes the reflected direct light of the sky.
        var terms = vec3f(0.0);
        for (var k = 0u; k < params.sky_terms; k++) {
            terms += params.sky_more[k].xyz * sky_visibility[j * params.sky_terms + k];
        }
        e -= sky_light(params.sky, dot(surfaces[j].sky, points[j].normal), terms, params.sky_terms);
    }
    e = max(e, vec3f(0.0));
    senders[j] = direct[j] + vec4f(surfaces[j].albedo * e, 0.0);
}

@compute @workgroup_size(64)
fn gather(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let k = flat_group(group, groups) * 64u + local;
    if k >= params.coarsest_points {
        return;
    }
    var sum = vec3f(0.0);
    let end = bounce_starts[k + 1u];
    for (var at = bounce_starts[k]; at < end; at++) {
        let link = bounce_links[at];
        sum += link.gain * direct[link.sender].xyz;
    }
    further[k] = vec4f(sum, 0.0);
}

@compute @workgroup_size(64)
fn interpolate(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let i = flat_group(group, groups) * 64u + local;
    if i >= span.count {
        return;
    }
    let j = span.first + i;
    var sum = vec4f(0.0);
    let end = parent_starts[j + 1u];
    for (var at = parent_starts[j]; at < end; at++) {
        let entry = parent_entries[at];
        if params.differences == 0u || entry.index < params.coarsest_points {
            sum += entry.weight * further[entry.index];
        }
    }
    further[j] = sum;
}

@compute @workgroup_size(64)
fn add(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let j = flat_group(group, groups) * 64u + local;
    if j >= params.senders {
        return;
    }
    senders[j] = direct[j] + further[j];
}
