//! Emissive triangles of a geometry, and directions toward them drawn by area and strength.
//!
//! Sampling an emitter by area has little noise far from it, sampling the hemisphere has little
//! noise near it. Integrators combine both by the balance heuristic (\[VG95\] §3.2), which
//! needs the density of the area samples for every direction: [`Emitters::density`].

use super::{Geometry, Hit, Ray};
use glam::{Vec2, Vec3};
use std::collections::HashMap;

/// Emissive triangle.
#[derive(Clone, Copy, Debug)]
struct Emitter {
    /// Index of the triangle in the geometry.
    primitive: u32,
    /// Corners, meters.
    corners: [Vec3; 3],
    /// Unit normal.
    normal: Vec3,
    /// Part of all samples that lie on this triangle or on an earlier one.
    end: f32,
    /// Part of all samples that lie on this triangle.
    share: f32,
    /// Samples per square meter, as a part of all samples.
    per_area: f32,
}

/// Emissive triangles of a geometry.
#[derive(Clone, Debug, Default)]
pub struct Emitters {
    emitters: Vec<Emitter>,
    index_of: HashMap<u32, u32>,
    power: f32,
    is_sparse: bool,
}

/// Largest part of the area of a geometry that sparse emitters cover.
const SPARSE: f64 = 0.5;

impl Emitters {
    /// Collects triangles: index of the primitive, corners in meters, and mean emission of any unit
    /// that all have in common. Leaves out those without area or emission. `total_area` is that of
    /// the geometry, m².
    #[must_use]
    pub fn new(
        triangles: impl IntoIterator<Item = (u32, [Vec3; 3], f32)>,
        total_area: f64,
    ) -> Self {
        let mut emitters = Vec::new();
        let mut index_of = HashMap::new();
        let (mut sum, mut emissive_area) = (0.0f64, 0.0f64);
        for (primitive, corners, strength) in triangles {
            let cross = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            let area = 0.5 * cross.length();
            let power = area * strength;
            if !(power > 0.0 && power.is_finite()) {
                continue;
            }
            sum += f64::from(power);
            emissive_area += f64::from(area);
            index_of.insert(primitive, emitters.len() as u32);
            emitters.push((
                sum,
                Emitter {
                    primitive,
                    corners,
                    normal: cross.normalize_or_zero(),
                    end: 0.0,
                    share: power,
                    per_area: strength,
                },
            ));
        }
        let part = |x: f64| (x / sum) as f32;
        let finish = |(end, emitter): (f64, Emitter)| Emitter {
            end: part(end),
            share: part(f64::from(emitter.share)),
            per_area: part(f64::from(emitter.per_area)),
            ..emitter
        };
        Self {
            emitters: emitters.into_iter().map(finish).collect(),
            index_of,
            power: sum as f32,
            is_sparse: emissive_area <= SPARSE * total_area,
        }
    }

    /// Returns `true` if emitters cover at most half of the area of the geometry. Samples of their
    /// area are worth their cost then. Rays of the hemisphere find the others without noise.
    #[must_use]
    pub fn is_sparse(&self) -> bool {
        self.is_sparse
    }

    /// Returns `true` if nothing emits.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.emitters.is_empty()
    }

    /// Returns `true` if the primitive emits.
    #[must_use]
    pub fn contains(&self, primitive: u32) -> bool {
        self.index_of.contains_key(&primitive)
    }

    /// Sum of area times mean emission over all triangles.
    #[must_use]
    pub fn power(&self) -> f32 {
        self.power
    }

    /// Position on an emitter for a uniform `u` in \[0, 1)², meters, and the index of its
    /// primitive. `None` if nothing emits.
    #[must_use]
    pub fn position(&self, u: Vec2) -> Option<(Vec3, u32)> {
        let index = self.emitters.partition_point(|e| e.end < u.x);
        let emitter = self.emitters.get(index).or(self.emitters.last())?;
        // Relative to the triangle's share, the number that selected it is uniform again.
        let v = (1.0 - (emitter.end - u.x) / emitter.share).clamp(0.0, 1.0);
        let [a, b, c] = emitter.corners;
        let root = v.sqrt();
        let position = a * (1.0 - root) + b * (root * (1.0 - u.y)) + c * (root * u.y);
        Some((position, emitter.primitive))
    }

    /// Ray from `start` to the position of `u` on an emitter, and its hit. `None` if the position
    /// is behind the plane with normal `n`, or is not visible.
    #[must_use]
    pub fn visible(
        &self,
        geometry: &dyn Geometry,
        start: Vec3,
        n: Vec3,
        u: Vec2,
    ) -> Option<(Ray, Hit)> {
        let (position, primitive) = self.position(u)?;
        let to = position - start;
        if to.dot(n) <= 0.0 {
            return None;
        }
        let ray = Ray::new(start, to.try_normalize()?);
        let hit = geometry.cast(&ray)?;
        (hit.primitive == primitive).then_some((ray, hit))
    }

    /// Density per steradian of the directions toward [`position`](Self::position)s, at a hit of
    /// `ray`. 0 if the hit is not on an emitter.
    #[must_use]
    pub fn density(&self, ray: &Ray, hit: &Hit) -> f32 {
        let Some(&index) = self.index_of.get(&hit.primitive) else {
            return 0.0;
        };
        let emitter = &self.emitters[index as usize];
        let facing = ray.direction.dot(emitter.normal).abs();
        emitter.per_area * hit.t * hit.t / facing.max(f32::MIN_POSITIVE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::lattice;
    use crate::scene::{Material, TriangleMesh};

    /// Two triangles of areas 2 and 0.5 m² at different heights, of emission 1 and 8.
    fn mesh() -> TriangleMesh {
        let v = Vec3::new;
        let emissive = |e: f32| Material::emissive(Vec3::ZERO, Vec3::splat(e));
        TriangleMesh::new(
            vec![
                [v(0.0, 2.0, 0.0), v(2.0, 2.0, 0.0), v(0.0, 2.0, 2.0)],
                [v(-2.0, 3.0, 0.0), v(-1.0, 3.0, 0.0), v(-2.0, 3.0, 1.0)],
            ],
            vec![0, 1],
            vec![emissive(1.0), emissive(8.0)],
        )
    }

    #[test]
    fn positions_are_distributed_by_power() {
        let mesh = mesh();
        let emitters = mesh.emitters().unwrap();
        assert!((emitters.power() - 6.0).abs() < 1e-5);
        let count = 6000;
        let first = (0..count)
            .filter(|&k| {
                let u = lattice(k, count, Vec2::ZERO);
                emitters.position(u).unwrap().1 == 0
            })
            .count();
        assert!((first as f32 / count as f32 - 2.0 / 6.0).abs() < 1e-3);
    }

    /// The mean of 1 / density over samples is the solid angle of the emitters.
    #[test]
    fn density_integrates_solid_angle() {
        let mesh = mesh();
        let emitters = mesh.emitters().unwrap();
        let start = Vec3::new(0.3, 0.0, 0.4);
        let count = 20_000;
        let sum: f64 = (0..count)
            .filter_map(|k| {
                let u = lattice(k, count, Vec2::ZERO);
                let (ray, hit) = emitters.visible(&mesh, start, Vec3::Y, u)?;
                Some(1.0 / f64::from(emitters.density(&ray, &hit)))
            })
            .sum();
        // Solid angle of a triangle: Van Oosterom and Strackee 1983.
        let solid_angle = |t: usize| {
            let [a, b, c] = mesh.triangle(t).unwrap().map(|p| (p - start).as_dvec3());
            let [x, y, z] = [a, b, c].map(glam::DVec3::length);
            let under = x * y * z + a.dot(b) * z + a.dot(c) * y + b.dot(c) * x;
            2.0 * a.dot(b.cross(c)).abs().atan2(under)
        };
        let right = solid_angle(0) + solid_angle(1);
        let mean = sum / f64::from(count);
        assert!((mean / right - 1.0).abs() < 2e-3, "{mean} {right}");
    }

    #[test]
    fn hidden_and_missing_emitters_have_no_samples() {
        let mesh = mesh();
        let emitters = mesh.emitters().unwrap();
        let u = Vec2::splat(0.5);
        assert!(
            emitters
                .visible(&mesh, Vec3::ZERO, Vec3::NEG_Y, u)
                .is_none()
        );
        let corners = [Vec3::X, Vec3::Y, Vec3::Z];
        let none = Emitters::new([(0, [Vec3::ZERO; 3], 1.0), (1, corners, 0.0)], 1.0);
        assert!(none.is_empty() && none.position(u).is_none());
        assert!(none.visible(&mesh, Vec3::ZERO, Vec3::Y, u).is_none());
    }
}
