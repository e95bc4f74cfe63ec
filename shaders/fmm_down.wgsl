// fmm_down: R-expansions of the nodes of a level, and irradiance at the points of the leaves. Twin:
// crates/meshless_gi/src/frame/fmm_down.rs.

struct FmmEntry {
    source: u32,
    weight: f32,
}

@group(0) @binding(6) var<storage, read> expansions: array<vec4f>;
@group(0) @binding(7) var<storage, read_write> locals: array<vec4f>;
@group(0) @binding(8) var<storage, read> entries: array<FmmEntry>;
@group(0) @binding(9) var<storage, read_write> values: array<VectorIrradiance>;

const MAX_FMM_TERMS: u32 = 84u;
const NO_TERM: u32 = 4294967295u;

// Taylor coefficients of 1/r⁴ at the unit vector of a pair, and the derivatives of the kernel: xx,
// xy, xz and yy, yz, zz.
var<workgroup> scalar: array<f32, MAX_FMM_TERMS>;
var<workgroup> tensor: array<vec3f, 2u * MAX_FMM_TERMS>;
// The source's expansion. Terms of degree n are multiplied by (its size over the distance)ⁿ.
var<workgroup> scaled: array<vec3f, 3u * MAX_FMM_TERMS>;
var<workgroup> sums: array<Spectrum, 64>;

fn lower(at: u32) -> f32 {
    if at == NO_TERM {
        return 0.0;
    }
    return scalar[at];
}

// Fills `scalar` and `tensor` for a unit vector. Uses all threads of the workgroup.
fn derive(r: vec3f, local: u32) {
    workgroupBarrier();
    for (var degree = 0u; degree <= params.order; degree += 1u) {
        let n = f32(degree);
        for (var t = terms_to(degree) - (degree + 1u) * (degree + 2u) / 2u + local; t < terms_to(degree); t += 64u) {
            if degree == 0u {
                scalar[0] = 1.0;
            } else {
                let down = terms[t].down;
                let one = dot(r, vec3f(lower(down[0]), lower(down[1]), lower(down[2])));
                let two = lower(down[3]) + lower(down[4]) + lower(down[5]);
                scalar[t] = -(2.0 * n + 2.0) / n * one - (n + 2.0) / n * two;
            }
        }
        workgroupBarrier();
    }
    for (var t = local; t < params.terms; t += 64u) {
        let term = terms[t];
        let one = vec3f(lower(term.down[0]), lower(term.down[1]), lower(term.down[2]));
        let s = scalar[t];
        let low = vec3f(
            r.x * r.x * s + 2.0 * r.x * one.x + lower(term.down[3]),
            r.x * r.y * s + r.x * one.y + r.y * one.x + lower(term.down[6]),
            r.x * r.z * s + r.x * one.z + r.z * one.x + lower(term.down[7]),
        );
        let high = vec3f(
            r.y * r.y * s + 2.0 * r.y * one.y + lower(term.down[4]),
            r.y * r.z * s + r.y * one.z + r.z * one.y + lower(term.down[8]),
            r.z * r.z * s + 2.0 * r.z * one.z + lower(term.down[5]),
        );
        tensor[2u * t] = term.factorial * low;
        tensor[2u * t + 1u] = term.factorial * high;
    }
    workgroupBarrier();
}

// Product of the kernel's derivative at term t and a source.
fn product(t: u32, m: Spectrum) -> Spectrum {
    let low = tensor[2u * t];
    let high = tensor[2u * t + 1u];
    return Spectrum(
        low.x * m.x + low.y * m.y + low.z * m.z,
        low.y * m.x + high.x * m.y + high.y * m.z,
        low.z * m.x + high.y * m.y + high.z * m.z,
    );
}

// Writes a node's expansion into `scaled` after all threads have finished with the previous one.
// `derive` has the barrier after it.
fn load(node: u32, ratio: f32, local: u32) {
    workgroupBarrier();
    for (var t = local; t < params.terms; t += 64u) {
        let factor = power(ratio, terms[t].degree);
        let base = 3u * (node * params.terms + t);
        scaled[3u * t] = factor * expansions[base].xyz;
        scaled[3u * t + 1u] = factor * expansions[base + 1u].xyz;
        scaled[3u * t + 2u] = factor * expansions[base + 2u].xyz;
    }
}

fn loaded(t: u32) -> Spectrum {
    return Spectrum(scaled[3u * t], scaled[3u * t + 1u], scaled[3u * t + 2u]);
}

fn local_at(base: u32) -> Spectrum {
    return Spectrum(locals[base].xyz, locals[base + 1u].xyz, locals[base + 2u].xyz);
}

// One workgroup per node, one thread per term. At most two rounds.
@compute @workgroup_size(64)
fn receive(
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
    var sum = array<Spectrum, 2>(nothing(), nothing());
    for (var i = node.far; i < node.local; i += 1u) {
        let entry = entries[i];
        let source = nodes[entry.source];
        let r = node.center - source.center;
        let inverse = 1.0 / length(r);
        load(entry.source, source.size * inverse, local);
        derive(r * inverse, local);
        for (var k = 0u; k < 2u; k += 1u) {
            let t = local + 64u * k;
            if t < params.terms {
                let e = exponents_of(terms[t].exponents);
                var own = nothing();
                let last = terms_to(params.order - terms[t].degree);
                for (var a = 0u; a < last; a += 1u) {
                    let both = e + exponents_of(terms[a].exponents);
                    own = plus(own, 1.0, product(term_at(both), loaded(a)));
                }
                let factor = entry.weight * inverse * inverse * power(node.size * inverse, terms[t].degree);
                sum[k] = plus(sum[k], factor, own);
            }
        }
    }
    for (var i = node.local; i < node.multipole; i += 1u) {
        let entry = entries[i];
        let source = nodes[entry.source];
        for (var j = source.start; j < source.sources; j += 1u) {
            let r = node.center - fmm_points[j].position;
            let inverse = 1.0 / length(r);
            derive(r * inverse, local);
            let m = source_of(fmm_points[j], radiosity[fmm_points[j].point].xyz);
            for (var k = 0u; k < 2u; k += 1u) {
                let t = local + 64u * k;
                if t < params.terms {
                    let factor = entry.weight * inverse * inverse * power(node.size * inverse, terms[t].degree);
                    sum[k] = plus(sum[k], factor, product(t, m));
                }
            }
        }
    }
    let parent = nodes[node.parent];
    let v = (node.center - parent.center) / parent.size;
    let ratio = node.size / parent.size;
    for (var k = 0u; k < 2u; k += 1u) {
        let t = local + 64u * k;
        if t < params.terms {
            var own = sum[k];
            if node.parent != at {
                let e = exponents_of(terms[t].exponents);
                var moved = nothing();
                let last = terms_to(params.order - terms[t].degree);
                for (var a = 0u; a < last; a += 1u) {
                    let d = exponents_of(terms[a].exponents);
                    let base = 3u * (node.parent * params.terms + term_at(e + d));
                    moved = plus(moved, monomial(v, d), local_at(base));
                }
                own = plus(own, power(ratio, terms[t].degree), moved);
            }
            let out = 3u * (at * params.terms + t);
            locals[out] = vec4f(own.x, 0.0);
            locals[out + 1u] = vec4f(own.y, 0.0);
            locals[out + 2u] = vec4f(own.z, 0.0);
        }
    }
}

// Near list of a point.
fn near_by(node: FmmNode, receiver: FmmOperatorPoint) -> Spectrum {
    var f = nothing();
    for (var i = node.near; i < node.finish; i += 1u) {
        let entry = entries[i];
        let source = nodes[entry.source];
        for (var j = source.start; j < source.sources; j += 1u) {
            let other = fmm_points[j];
            let r = receiver.position - other.position;
            let leaving = dot(other.normal, r);
            let arriving = -dot(receiver.normal, r);
            let square = dot(r, r);
            if leaving > 0.0 && arriving > 0.0 && square > params.nearest {
                let spread = square + select(0.0, other.share, params.disks == 1u);
                let k = -entry.weight * other.share * leaving / (square * spread);
                let b = k * radiosity[other.point].xyz;
                f = plus(f, 1.0, Spectrum(r.x * b, r.y * b, r.z * b));
            }
        }
    }
    return f;
}

// One workgroup per leaf: the multipole list with one thread per term, then one thread per point.
@compute @workgroup_size(64)
fn evaluate(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = flat_group(group, groups);
    if at >= span.count {
        return;
    }
    let node = nodes[at];
    if node.children != 0u {
        return;
    }
    if node.multipole < node.near {
        for (var p = node.receivers; p < node.end; p += 1u) {
            let receiver = fmm_points[p];
            var own = nothing();
            for (var i = node.multipole; i < node.near; i += 1u) {
                let entry = entries[i];
                let source = nodes[entry.source];
                let r = receiver.position - source.center;
                let inverse = 1.0 / length(r);
                load(entry.source, source.size * inverse, local);
                derive(r * inverse, local);
                for (var t = local; t < params.terms; t += 64u) {
                    own = plus(own, entry.weight * inverse * inverse, product(t, loaded(t)));
                }
            }
            sums[local] = own;
            for (var width = 32u; width > 0u; width /= 2u) {
                workgroupBarrier();
                if local < width {
                    sums[local] = plus(sums[local], 1.0, sums[local + width]);
                }
            }
            if local == 0u {
                values[receiver.point].x = vec4f(sums[0].x, 0.0);
                values[receiver.point].y = vec4f(sums[0].y, 0.0);
                values[receiver.point].z = vec4f(sums[0].z, 0.0);
            }
            workgroupBarrier();
        }
    }
    storageBarrier();
    for (var p = node.receivers + local; p < node.end; p += 64u) {
        let receiver = fmm_points[p];
        let v = (receiver.position - node.center) / node.size;
        var f = near_by(node, receiver);
        for (var t = 0u; t < params.terms; t += 1u) {
            let base = 3u * (at * params.terms + t);
            f = plus(f, monomial(v, exponents_of(terms[t].exponents)), local_at(base));
        }
        if node.multipole < node.near {
            let far = values[receiver.point];
            f = plus(f, 1.0, Spectrum(far.x.xyz, far.y.xyz, far.z.xyz));
        }
        let sky = radiosity[params.sky].xyz;
        values[receiver.point].x = vec4f(receiver.factor * f.x + receiver.sky.x * sky, 0.0);
        values[receiver.point].y = vec4f(receiver.factor * f.y + receiver.sky.y * sky, 0.0);
        values[receiver.point].z = vec4f(receiver.factor * f.z + receiver.sky.z * sky, 0.0);
    }
}
