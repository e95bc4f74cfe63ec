//! Emissive triangles of a geometry, and sample positions on them by area and emission.
//!
//! Sampling an emitter by area has little noise far from it. Sampling the hemisphere has little
//! noise near it. Integrators combine both by the balance heuristic (\[VG95\] §3.2), which needs
//! the density of the area samples for every direction: [`Emitters::density`]. If the start of the
//! directions is fixed, [`Emitters::seen_from`] selects near emitters more often.

use super::emitter_view::{EmitterGroup, EmitterView, split_into_groups};
use super::{Hit, Ray};
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
    /// Fraction of all samples on this triangle or on an earlier one.
    end: f32,
    /// Fraction of all samples on this triangle.
    share: f32,
    /// Fraction of all samples per square meter.
    per_area: f32,
    /// Group of the triangle.
    group: u32,
}

impl Emitter {
    /// Returns the center of the triangle, meters.
    fn center(&self) -> Vec3 {
        self.corners.iter().sum::<Vec3>() / 3.0
    }
}

/// Emissive triangles of a geometry.
#[derive(Clone, Debug, Default)]
pub struct Emitters {
    emitters: Vec<Emitter>,
    groups: Vec<EmitterGroup>,
    index_of: HashMap<u32, u32>,
    power: f32,
    is_sparse: bool,
}

/// Largest fraction of the area of a geometry that sparse emitters cover.
const MAX_SPARSE_FRACTION: f64 = 0.5;

impl Emitters {
    /// Collects triangles: index of the primitive, corners in meters, and mean emission. All
    /// emissions have the same unit. Leaves out triangles without area or emission. `total_area` is
    /// the area of the geometry, m².
    #[must_use]
    pub fn new(
        triangles: impl IntoIterator<Item = (u32, [Vec3; 3], f32)>,
        total_area: f64,
    ) -> Self {
        let mut emitters = Vec::new();
        let (mut power, mut emissive_area) = (0.0f64, 0.0f64);
        for (primitive, corners, strength) in triangles {
            let cross = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            let area = 0.5 * cross.length();
            let share = area * strength;
            if !(share > 0.0 && share.is_finite()) {
                continue;
            }
            power += f64::from(share);
            emissive_area += f64::from(area);
            emitters.push(Emitter {
                primitive,
                corners,
                normal: cross.normalize_or_zero(),
                end: 0.0,
                share,
                per_area: strength,
                group: 0,
            });
        }
        let ranges = split_into_groups(&mut emitters, &Emitter::center);
        let part = |x: f64| (x / power) as f32;
        let mut sum = 0.0;
        let mut groups = Vec::with_capacity(ranges.len());
        for range in ranges {
            let own = &mut emitters[range];
            let start = sum;
            for emitter in &mut *own {
                sum += f64::from(emitter.share);
                emitter.end = part(sum);
                emitter.share = part(f64::from(emitter.share));
                emitter.per_area = part(f64::from(emitter.per_area));
                emitter.group = groups.len() as u32;
            }
            let center = own.iter().map(Emitter::center).sum::<Vec3>() / own.len().max(1) as f32;
            let corners = own.iter().flat_map(|e| e.corners);
            groups.push(EmitterGroup {
                start: part(start),
                share: part(sum - start),
                center,
                radius: corners.map(|c| c.distance(center)).fold(0.0, f32::max),
            });
        }
        let primitives = emitters.iter().map(|e| e.primitive);
        Self {
            index_of: primitives.zip(0..).collect(),
            groups: if emitters.is_empty() {
                Vec::new()
            } else {
                groups
            },
            emitters,
            power: power as f32,
            is_sparse: emissive_area <= MAX_SPARSE_FRACTION * total_area,
        }
    }

    /// Returns the sampling distribution of the emitters for `x` (meters).
    #[must_use]
    pub fn seen_from(&self, x: Vec3) -> EmitterView<'_> {
        EmitterView::new(self, x)
    }

    /// Returns the groups of emitters, in the order of the emitters.
    pub(super) fn groups(&self) -> &[EmitterGroup] {
        &self.groups
    }

    /// Returns the group of the primitive. `None` if it does not emit.
    pub(super) fn group_of(&self, primitive: u32) -> Option<usize> {
        let index = *self.index_of.get(&primitive)?;
        Some(self.emitters[index as usize].group as usize)
    }

    /// Returns `true` if emitters cover at most half of the area of the geometry. Area samples are
    /// only worth their cost in this case. Rays over the hemisphere sample the other emitters
    /// without noise.
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

    /// Returns the sum of area times mean emission over all triangles.
    #[must_use]
    pub fn power(&self) -> f32 {
        self.power
    }

    /// Returns the position on an emitter for a uniform `u` in \[0, 1)², in meters, and the index
    /// of its primitive. `None` if nothing emits.
    #[must_use]
    pub fn position(&self, u: Vec2) -> Option<(Vec3, u32)> {
        let index = self.emitters.partition_point(|e| e.end < u.x);
        let emitter = self.emitters.get(index).or(self.emitters.last())?;
        // The part of `u.x` within the fraction of the selected triangle is uniform again.
        let v = (1.0 - (emitter.end - u.x) / emitter.share).clamp(0.0, 1.0);
        let [a, b, c] = emitter.corners;
        let root = v.sqrt();
        let position = a * (1.0 - root) + b * (root * (1.0 - u.y)) + c * (root * u.y);
        Some((position, emitter.primitive))
    }

    /// Returns the density per steradian of the directions toward [`position`](Self::position)s at
    /// a hit of `ray`. 0 if the hit is not on an emitter.
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
    use crate::scene::{Geometry, Material, TriangleMesh};

    /// Returns two triangles of areas 2 and 0.5 m² at different heights, of emission 1 and 8.
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
}
