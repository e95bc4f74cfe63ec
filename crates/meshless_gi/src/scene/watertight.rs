//! The watertight ray-triangle test of Woop, Benthin & Wald 2013 ([WBW13]): a ray through an edge
//! or a vertex of a closed mesh hits at least one of the adjacent triangles. The closest-hit casts
//! of the bake use this test.
//!
//! The triangle is transformed to a system in which the ray starts at the origin and runs along z
//! ([WBW13] §3.2). The three edge functions are then 2D cross products of the sheared vertices. Two
//! triangles that share an edge compute its function from the same values with opposite sign. An
//! edge function that is exactly zero in single precision is recomputed in double precision.
//! Products of single-precision values are exact there, so that the sign is correct ([WBW13] §3.3).
//!
//! Deviation from the paper: distances are compared after the division. Ties and near misses
//! therefore differ.

use super::Ray;
use glam::Vec3;

/// Ray with the constants of the test, which are computed once per ray.
#[derive(Clone, Copy, Debug)]
pub struct WatertightRay {
    origin: Vec3,
    /// World axes that become x, y and z.
    axes: [usize; 3],
    /// Shear in x and y and the scale in z.
    shear: Vec3,
}

/// Intersection of a ray with the plane of a triangle, inside the triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriangleHit {
    /// Distance in units of the length of the ray's direction.
    pub t: f32,
    /// Barycentric weight of the second vertex.
    pub u: f32,
    /// Barycentric weight of the third vertex.
    pub v: f32,
}

impl WatertightRay {
    /// Computes the constants of a ray. Its direction must not be zero.
    #[must_use]
    #[inline]
    pub fn new(ray: &Ray) -> Self {
        // z is the axis of the largest direction component. x and y are swapped if this reverses
        // the winding.
        let d = ray.direction;
        let a = d.abs();
        let z = if a.x > a.y && a.x > a.z {
            0
        } else if a.y > a.z {
            1
        } else {
            2
        };
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        if d[z] < 0.0 {
            (x, y) = (y, x);
        }
        Self {
            origin: ray.origin,
            axes: [x, y, z],
            shear: Vec3::new(d[x] / d[z], d[y] / d[z], 1.0 / d[z]),
        }
    }

    #[inline]
    fn sheared(&self, vertex: Vec3) -> Vec3 {
        let p = vertex - self.origin;
        let (x, y, z) = (p[self.axes[0]], p[self.axes[1]], p[self.axes[2]]);
        Vec3::new(x - self.shear.x * z, y - self.shear.y * z, z)
    }

    /// Returns the intersection with the triangle from either side, with t in (0, `max_t`].
    #[must_use]
    #[inline]
    pub fn intersect(&self, a: Vec3, b: Vec3, c: Vec3, max_t: f32) -> Option<TriangleHit> {
        let (a, b, c) = (self.sheared(a), self.sheared(b), self.sheared(c));
        let mut u = c.x * b.y - c.y * b.x;
        let mut v = a.x * c.y - a.y * c.x;
        let mut w = b.x * a.y - b.y * a.x;
        if u == 0.0 || v == 0.0 || w == 0.0 {
            u = edge(c, b);
            v = edge(a, c);
            w = edge(b, a);
        }
        // Zero counts as either sign: an edge belongs to both of its triangles.
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let det = u + v + w;
        if det == 0.0 {
            return None;
        }
        let t = (u * a.z + v * b.z + w * c.z) * self.shear.z / det;
        if !(t > 0.0 && t <= max_t) {
            return None;
        }
        Some(TriangleHit {
            t,
            u: v / det,
            v: w / det,
        })
    }
}

/// Returns the edge function from `p` to `q` with the correct sign.
#[cold]
fn edge(p: Vec3, q: Vec3) -> f32 {
    let exact = f64::from(p.x) * f64::from(q.y) - f64::from(p.y) * f64::from(q.x);
    exact as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: Vec3 = Vec3::new(0.0, 0.0, 2.0);
    const B: Vec3 = Vec3::new(1.0, 0.0, 2.0);
    const C: Vec3 = Vec3::new(0.0, 1.0, 2.0);

    fn intersect(origin: Vec3, direction: Vec3) -> Option<TriangleHit> {
        WatertightRay::new(&Ray::new(origin, direction)).intersect(A, B, C, f32::INFINITY)
    }

    #[test]
    fn watertight_hit_weights_match_vertices() {
        let hit = intersect(Vec3::new(0.25, 0.5, 0.0), Vec3::Z).unwrap();
        assert_eq!((hit.t, hit.u, hit.v), (2.0, 0.25, 0.5));
        // A hit from behind. Misses: the ray points away, ends before the triangle or passes next
        // to it.
        assert_eq!(
            intersect(Vec3::new(0.25, 0.5, 5.0), -Vec3::Z).unwrap().t,
            3.0
        );
        assert_eq!(intersect(Vec3::new(0.25, 0.5, 0.0), -Vec3::Z), None);
        assert_eq!(intersect(Vec3::new(0.75, 0.5, 0.0), Vec3::Z), None);
        let ray = Ray::new(Vec3::new(0.25, 0.5, 0.0), Vec3::Z);
        assert_eq!(WatertightRay::new(&ray).intersect(A, B, C, 1.9), None);
    }

    #[test]
    fn watertight_edges_and_vertices_are_hit() {
        for p in [A, B, C, 0.5 * (A + B), 0.5 * (B + C), 0.5 * (A + C)] {
            assert!(
                intersect(Vec3::new(p.x, p.y, 0.0), Vec3::Z).is_some(),
                "{p}"
            );
        }
    }

    #[test]
    fn watertight_coplanar_ray_and_degenerate_triangle_miss() {
        assert_eq!(intersect(Vec3::new(-1.0, 0.25, 2.0), Vec3::X), None);
        let ray = WatertightRay::new(&Ray::new(Vec3::ZERO, Vec3::Z));
        assert_eq!(ray.intersect(A, A, A, f32::INFINITY), None);
    }
}
