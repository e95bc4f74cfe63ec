//! Flat binary BVH over triangles for the frame's shadow rays, used on both CPU and GPU. The
//! triangles of occluders come after all others and store a transmittance that can change at run
//! time.

use super::Ray;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// BVH node, 32 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct BvhNode {
    /// Smallest corner in meters, padded so that the box test is conservative.
    pub min: [f32; 3],
    /// First child of an inner node, followed by the second child. First triangle of a leaf.
    pub first: u32,
    /// Largest corner in meters, padded in the same way.
    pub max: [f32; 3],
    /// Number of triangles. 0 for an inner node.
    pub count: u32,
}

/// Triangle for shadow rays, 48 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct BvhTriangle {
    /// First vertex, meters.
    pub a: [f32; 3],
    /// Number of the occluder plus one. 0 for static geometry.
    pub occluder: u32,
    /// Second vertex.
    pub b: [f32; 3],
    /// Transmittance in [0, 1]. 0 for geometry that is not an occluder.
    pub transmittance: f32,
    /// Third vertex.
    pub c: [f32; 3],
    /// Padding.
    pub pad2: u32,
}

/// Flat BVH. Node 0 is the root. A BVH without nodes has no geometry.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bvh {
    /// Nodes. Children come after their parent.
    pub nodes: Vec<BvhNode>,
    /// Triangles in leaf order.
    pub triangles: Vec<BvhTriangle>,
}

impl Bvh {
    /// Size of the traversal stack in nodes. This is the largest depth of a BVH.
    pub const STACK: usize = 64;
    /// Smallest magnitude of a direction component. Smaller components are replaced by this value.
    pub const MIN_COMPONENT: f32 = 1e-18;

    /// Largest number of occluders. A traversal stores one bit per crossed occluder.
    pub const MAX_OCCLUDERS: usize = 64;

    /// Returns the fraction of light that passes along `ray` with t in (0, `ray.max_t`). 0 behind
    /// static geometry. Otherwise the product of the transmittances of the crossed occluders. Each
    /// occluder is counted once.
    #[must_use]
    pub fn transmittance(&self, ray: &Ray) -> f32 {
        let (mut transmittance, mut crossed) = (1.0, 0u64);
        self.walk(ray, |triangle| {
            let bit = bit_of(triangle);
            if crossed & bit == 0 {
                crossed |= bit;
                transmittance *= match bit {
                    0 => 0.0,
                    _ => triangle.transmittance,
                };
            }
            transmittance <= 0.0
        });
        transmittance
    }

    /// Returns the occluders that `ray` crosses with t in (0, `ray.max_t`) as bits by occluder
    /// number. Static geometry is ignored.
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
            if let Some(t) = shear.intersects(&ray, triangle) {
                ray.max_t = t;
            }
            false
        });
        ray.max_t
    }

    /// Returns `true` if no light passes along `ray` with t in (0, `ray.max_t`).
    #[must_use]
    pub fn is_occluded(&self, ray: &Ray) -> bool {
        self.transmittance(ray) <= 0.0
    }

    /// Returns the index of the first triangle of an occluder.
    #[must_use]
    pub fn first_occluder(&self) -> usize {
        self.triangles.partition_point(|t| t.occluder == 0)
    }

    /// Sets the transmittance of each occluder by number. Occluders beyond the end of
    /// `transmittances` get 1.
    pub fn set_transmittances(&mut self, transmittances: &[f32]) {
        let first = self.first_occluder();
        for triangle in &mut self.triangles[first..] {
            let k = triangle.occluder as usize - 1;
            triangle.transmittance = transmittances.get(k).copied().unwrap_or(1.0);
        }
    }

    /// Calls `meet` with the triangles that `ray` hits, in arbitrary order, until `meet` returns
    /// `true`.
    #[inline]
    fn walk(&self, ray: &Ray, mut meet: impl FnMut(&BvhTriangle) -> bool) {
        if self.nodes.is_empty() {
            return;
        }
        // Infinities would give 0 · ∞. A direction component near zero is replaced by a very small
        // one.
        let guard = |d: f32| {
            if d.abs() < Self::MIN_COMPONENT {
                Self::MIN_COMPONENT
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
            if (leaf.iter()).any(|t| shear.intersects(ray, t).is_some() && meet(t)) {
                return;
            }
        }
    }
}

/// Returns the bit of a triangle's occluder. 0 for static geometry.
fn bit_of(triangle: &BvhTriangle) -> u64 {
    match triangle.occluder {
        0 => 0,
        k => 1 << ((k - 1) % 64),
    }
}

/// Coordinate system in which the ray runs along z: Woop, Benthin & Wald 2013. A ray through a
/// shared edge hits one of its triangles.
struct Shear {
    /// World axes that become x, y and z.
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
    fn intersects(&self, ray: &Ray, triangle: &BvhTriangle) -> Option<f32> {
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
