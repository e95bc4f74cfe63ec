// fmm_up: S-expansions of the nodes of a level, from their points or their children. Twin:
// crates/meshless_gi/src/frame/fmm_up.rs.

@group(0) @binding(6) var<storage, read_write> expansions: array<vec4f>;

fn expansion_at(base: u32) -> Spectrum {
    return Spectrum(expansions[base].xyz, expansions[base + 1u].xyz, expansions[base + 2u].xyz);
}

// One workgroup per node, one thread per term.
@compute @workgroup_size(64)
fn up(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let g = flat_group(group, groups);
    if g >= span.count {
        return;
    }
    let at = span.first + g;
    let node = nodes[at];
    for (var t = local; t < params.terms; t += 64u) {
        let e = exponents_of(terms[t].exponents);
        var sum = nothing();
        if node.children == 0u {
            for (var i = node.start; i < node.sources; i += 1u) {
                let point = fmm_points[i];
                let v = (node.center - point.position) / node.size;
                sum = plus(sum, monomial(v, e), source_of(point, radiosity[point.point].xyz));
            }
        } else {
            for (var c = node.first_child; c < node.first_child + node.children; c += 1u) {
                let child = nodes[c];
                let v = (node.center - child.center) / node.size;
                let ratio = child.size / node.size;
                // All terms with exponents up to these.
                for (var x = 0u; x <= e.x; x += 1u) {
                    for (var y = 0u; y <= e.y; y += 1u) {
                        for (var z = 0u; z <= e.z; z += 1u) {
                            let base = 3u * (c * params.terms + term_at(vec3u(x, y, z)));
                            let factor = power(ratio, x + y + z) * monomial(v, e - vec3u(x, y, z));
                            sum = plus(sum, factor, expansion_at(base));
                        }
                    }
                }
            }
        }
        let out = 3u * (at * params.terms + t);
        expansions[out] = vec4f(sum.x, 0.0);
        expansions[out + 1u] = vec4f(sum.y, 0.0);
        expansions[out + 2u] = vec4f(sum.z, 0.0);
    }
}
