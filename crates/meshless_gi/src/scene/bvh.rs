//! A flat binary BVH over triangles: what the frame's shadow rays walk, on the CPU and on the GPU
//! alike. The triangles of occluders, which a game opens and shuts, stand behind all others and
//! carry what passes them.

use super::Ray;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// A node. 32 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct BvhNode {
    /// Smallest corner, meters, already padded so that the box test is conservative.
    pub min: [f32; 3],
    /// An inner node: its first child, the second follows. A leaf: its first triangle.
    pub first: u32,
    /// Largest corner.
    pub max: [f32; 3],
    /// Number of triangles. 0 for an inner node.
    pub count: u32,
}

/// A triangle as the shadow rays see it. 48 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct BvhTriangle {
    /// First vertex, meters.
    pub a: [f32; 3],
    /// 0 for what stays, else one more than the number of the occluder that it belongs to.
    pub occluder: u32,
    /// Second vertex.
    pub b: [f32; 3],
    /// Transmittance in [0, 1]. 0 for geometry that is not an occluder.
    pub gain: f32,
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

impl Bvh {
    /// Nodes that a walk may have put aside: a BVH is at most this deep.
    pub const STACK: usize = 64;
    /// Components of a direction that are smaller are taken for this.
    pub const SMALLEST: f32 = 1e-18;

    /// Most occluders: one bit each of what a walk has crossed.
    pub const MAX_OCCLUDERS: usize = 64;

    /// Returns the fraction of light that passes along `ray` with t in (0, `ray.max_t`). 0 behind
    /// static geometry, else the product of the transmittances of the occluders on the way, each
    /// counted once.
    #[must_use]
    pub fn transmittance(&self, ray: &Ray) -> f32 {
        let (mut passes, mut crossed) = (1.0, 0u64);
        self.walk(ray, |triangle| {
            let bit = bit_of(triangle);
            if crossed & bit == 0 {
                crossed |= bit;
                passes *= match bit {
                    0 => 0.0,
                    _ => triangle.gain,
                };
            }
            passes <= 0.0
        });
        passes
    }

    /// The occluders that `ray` crosses with t in (0, `ray.max_t`), bit k for number k; what stays
    /// is looked through.
    #[must_use]
    pub fn crossed_occluders(&self, ray: &Ray) -> u64 {
        let mut crossed = 0;
        self.walk(ray, |triangle| {
            crossed |= bit_of(triangle);
            false
        });
        crossed
    }

    /// Returns the distance to the first hit of `ray` in meters, or `ray.max_t` without a hit.
    /// Occluders count at any transmittance.
    #[must_use]
    pub fn distance(&self, ray: &Ray) -> f32 {
        let mut ray = *ray;
        let shear = Shear::new(ray.direction);
        self.walk(&ray.clone(), |triangle| {
            if let Some(t) = shear.meets(&ray, triangle) {
                ray.max_t = t;
            }
            false
        });
        ray.max_t
    }

    /// True when no light passes along `ray` with t in (0, `ray.max_t`).
    #[must_use]
    pub fn occluded(&self, ray: &Ray) -> bool {
        self.transmittance(ray) <= 0.0
    }

    /// Index of the first triangle of an occluder.
    #[must_use]
    pub fn first_occluder(&self) -> usize {
        self.triangles.partition_point(|t| t.occluder == 0)
    }

    /// Sets what passes each occluder, by number; those that are missing are open.
    pub fn set_transmittances(&mut self, gains: &[f32]) {
        let first = self.first_occluder();
        for triangle in &mut self.triangles[first..] {
            let k = triangle.occluder as usize - 1;
            triangle.gain = gains.get(k).copied().unwrap_or(1.0);
        }
    }

    /// Shows `meet` the triangles that `ray` meets, in no order, until it says that it has seen
    /// enough.
    #[inline]
    fn walk(&self, ray: &Ray, mut meet: impl FnMut(&BvhTriangle) -> bool) {
        if self.nodes.is_empty() {
            return;
        }
        // No infinities, so that nothing is 0 · ∞: an axis that the ray hardly moves along counts
        // as one that it crosses very late.
        let guard = |d: f32| {
            if d.abs() < Self::SMALLEST {
                Self::SMALLEST
            } else {
                d
            }
        };
        let inverse = Vec3::ONE / Vec3::from_array(ray.direction.to_array().map(guard));
        let shear = Shear::new(ray.direction);
        let mut stack = [0u32; Self::STACK];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let node = &self.nodes[stack[top] as usize];
            let a = (Vec3::from_array(node.min) - ray.origin) * inverse;
            let b = (Vec3::from_array(node.max) - ray.origin) * inverse;
            let near = a.min(b).max_element().max(0.0);
            let far = a.max(b).min_element().min(ray.max_t);
            if near > far {
                continue;
            }
            if node.count == 0 {
                if top + 2 <= Self::STACK {
                    stack[top] = node.first;
                    stack[top + 1] = node.first + 1;
                    top += 2;
                }
                continue;
            }
            let first = node.first as usize;
            let leaf = &self.triangles[first..first + node.count as usize];
            if (leaf.iter()).any(|t| shear.meets(ray, t).is_some() && meet(t)) {
                return;
            }
        }
    }
}

/// The bit of a triangle's occluder; none for what stays.
fn bit_of(triangle: &BvhTriangle) -> u64 {
    match triangle.occluder {
        0 => 0,
        k => 1 << ((k - 1) % 64),
    }
}

/// A ray's own coordinate system, in which it runs along z: Woop, Benthin & Wald 2013. A ray
/// through a shared edge meets one of its triangles.
struct Shear {
    /// Axes that become x, y and z.
    axes: [usize; 3],
    s: Vec3,
}

impl Shear {
    fn new(direction: Vec3) -> Self {
        let a = direction.abs();
        let z = if a.x > a.y && a.x > a.z {
            0
        } else if a.y > a.z {
            1
        } else {
            2
        };
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        if direction[z] < 0.0 {
            (x, y) = (y, x);
        }
        Self {
            axes: [x, y, z],
            s: Vec3::new(direction[x], direction[y], 1.0) / direction[z],
        }
    }

    /// Returns the distance along the ray, or `None` if the ray misses the triangle.
    fn meets(&self, ray: &Ray, triangle: &BvhTriangle) -> Option<f32> {
        let [x, y, z] = self.axes;
        let corner = |v: [f32; 3]| {
            let v = Vec3::from_array(v) - ray.origin;
            Vec3::new(
                v[x] - self.s.x * v[z],
                v[y] - self.s.y * v[z],
                self.s.z * v[z],
            )
        };
        let (a, b, c) = (corner(triangle.a), corner(triangle.b), corner(triangle.c));
        let u = c.x * b.y - c.y * b.x;
        let v = a.x * c.y - a.y * c.x;
        let w = b.x * a.y - b.y * a.x;
        let outside = u.min(v).min(w) < 0.0 && u.max(v).max(w) > 0.0;
        let det = u + v + w;
        if outside || det == 0.0 {
            return None;
        }
        let t = (u * a.z + v * b.z + w * c.z) / det;
        (t > 0.0 && t < ray.max_t).then_some(t)
    }
}
