// Luminance of a surface lit by a node. Twin: crates/meshless_gi/src/frame/refine.rs. Needs
// lib/node.

const RED: f32 = 0.2126;
const GREEN: f32 = 0.7152;
const BLUE: f32 = 0.0722;

fn luminance(node: SubsplatNode, normal: vec3f) -> f32 {
    return dot(vec3f(RED, GREEN, BLUE), max(irradiance_dot(node_light(node), normal), vec3f(0.0)));
}
