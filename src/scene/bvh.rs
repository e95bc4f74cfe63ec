//! A flat binary BVH over triangles: what the frame's shadow rays walk, on the CPU and on the GPU alike.

use bytemuck::{Pod, Zeroable};

/// A node. 32 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct BvhNode {
    /// Smallest corner, metres, already padded so that the box test is conservative.
    pub min: [f32; 3],
    /// An inner node: its first child, the second follows. A leaf: its first triangle.
    pub first: u32,
    /// Largest corner.
    pub max: [f32; 3],
    /// How many triangles; 0 for an inner node.
    pub count: u32,
}

/// A triangle as the shadow rays see it. 48 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct BvhTriangle {
    /// First vertex, metres.
    pub a: [f32; 3],
    /// Not used.
    pub pad0: u32,
    /// Second vertex.
    pub b: [f32; 3],
    /// Not used.
    pub pad1: u32,
    /// Third vertex.
    pub c: [f32; 3],
    /// Not used.
    pub pad2: u32,
}

/// The flat BVH. Node 0 is the root; no nodes means no geometry.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bvh {
    /// Nodes; children lie behind their parent.
    pub nodes: Vec<BvhNode>,
    /// Triangles in leaf order.
    pub triangles: Vec<BvhTriangle>,
}
