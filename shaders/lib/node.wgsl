// Light at a node. Twin: crates/meshless_gi/src/frame/subsplat.rs.

const KNOWN: u32 = 1u;
const COVERED: u32 = 2u;
const EVALUATED: u32 = 4u;
const PROBE_FRACTION: u32 = 0xff00u;

fn pack_halves(a: f32, b: f32) -> u32 {
    return pack2x16float(clamp(vec2f(a, b), vec2f(-MAX_HALF), vec2f(MAX_HALF)));
}

fn node_new(e: VectorIrradiance, predicted_luminance: f32, state: u32) -> SubsplatNode {
    return SubsplatNode(array<u32, 6>(
        pack_halves(e.x.x, e.x.y),
        pack_halves(e.x.z, e.y.x),
        pack_halves(e.y.y, e.y.z),
        pack_halves(e.z.x, e.z.y),
        pack_halves(e.z.z, predicted_luminance),
        state,
    ));
}

fn node_light(node: SubsplatNode) -> VectorIrradiance {
    let a = unpack2x16float(node.words[0]);
    let b = unpack2x16float(node.words[1]);
    let c = unpack2x16float(node.words[2]);
    let d = unpack2x16float(node.words[3]);
    let e = unpack2x16float(node.words[4]);
    return VectorIrradiance(vec4f(a, b.x, 0.0), vec4f(b.y, c, 0.0), vec4f(d, e.x, 0.0));
}

fn node_predicted_luminance(node: SubsplatNode) -> f32 {
    return unpack2x16float(node.words[4]).y;
}

// Fraction of the light that comes from probes, as bits of the state.
fn probe_fraction_bits(share: f32) -> u32 {
    return u32(255.0 * (1.0 - share) + 0.5) << 8u;
}

// Fraction of the light that comes from probes: 1 for a node without surface functions.
fn node_probe_fraction(node: SubsplatNode) -> f32 {
    if !node_is(node, COVERED) {
        return 1.0;
    }
    return f32((node.words[5] & PROBE_FRACTION) >> 8u) / 255.0;
}

fn node_is(node: SubsplatNode, bits: u32) -> bool {
    return (node.words[5] & bits) == bits;
}
