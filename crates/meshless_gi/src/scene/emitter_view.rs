//! Sampling of emitters for a position, by power over squared distance.
//!
//! Samples by power alone have much noise in scenes with many emitters, because few of them are on
//! the emitter next to a position. Emitters form at most [`GROUPS`] compact groups. A sample
//! selects a group by its power over the squared distance, then an emitter of the group by power
//! and a position by area.

use super::{Emitters, Geometry, Hit, Ray};
use glam::{Vec2, Vec3};
use std::ops::Range;

/// Largest number of groups.
pub(super) const GROUPS: usize = 64;

/// Group of emitters that lie close to one another.
#[derive(Clone, Debug)]
pub(super) struct EmitterGroup {
    /// Fraction of the power of the emitters before the group.
    pub start: f32,
    /// Fraction of the power of the group.
    pub share: f32,
    /// Center, meters.
    pub center: Vec3,
    /// Largest distance of a corner from the center, meters.
    pub radius: f32,
}

/// Splits items with these centers into at most [`GROUPS`] ranges. Reorders the items so that those
/// of a range lie close to one another. The widest range is halved until there are enough ranges.
pub(super) fn split_into_groups<T>(
    items: &mut [T],
    center: &impl Fn(&T) -> Vec3,
) -> Vec<Range<usize>> {
    let extent = |items: &[T]| {
        let centers = items.iter().map(center);
        let (min, max) = centers.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(min, max), c| {
            (min.min(c), max.max(c))
        });
        (min, max)
    };
    let width = |items: &[T]| {
        let (min, max) = extent(items);
        (max - min).max_element()
    };
    let mut ranges: Vec<(Range<usize>, f32)> = vec![(0..items.len(), width(items))];
    while ranges.len() < GROUPS {
        let widest = (0..ranges.len()).max_by(|&a, &b| ranges[a].1.total_cmp(&ranges[b].1));
        let Some(k) = widest.filter(|&k| ranges[k].1 > 0.0) else {
            break;
        };
        let range = ranges[k].0.clone();
        let part = &mut items[range.clone()];
        let (min, max) = extent(part);
        let axis = (max - min).max_position();
        let middle = 0.5 * (min[axis] + max[axis]);
        part.sort_by(|a, b| center(a)[axis].total_cmp(&center(b)[axis]));
        let below = part.partition_point(|item| center(item)[axis] <= middle);
        let split = range.start + below.clamp(1, part.len() - 1);
        let halves = [range.start..split, split..range.end];
        ranges.splice(k..=k, halves.map(|r| (r.clone(), width(&items[r]))));
    }
    ranges.into_iter().map(|(range, _)| range).collect()
}

/// Sampling distribution of emitters for a position.
#[derive(Clone, Debug)]
pub struct EmitterView<'a> {
    emitters: &'a Emitters,
    /// Per group: fraction of all samples on this group and on earlier groups.
    ends: [f32; GROUPS],
}

impl<'a> EmitterView<'a> {
    /// Creates the distribution for `x` (meters).
    pub(super) fn new(emitters: &'a Emitters, x: Vec3) -> Self {
        let mut ends = [1.0; GROUPS];
        let mut sum = 0.0;
        let groups = emitters.groups();
        for (end, group) in ends.iter_mut().zip(groups) {
            let square = group
                .center
                .distance_squared(x)
                .max(group.radius * group.radius);
            sum += group.share / square.max(f32::MIN_POSITIVE);
            *end = sum;
        }
        // Positions without a finite sum lie on an emitter. Rays over the hemisphere sample the
        // rest.
        let scale = if sum.is_finite() { 1.0 / sum } else { 1.0 };
        for end in &mut ends[..groups.len()] {
            *end = (*end * scale).min(1.0);
        }
        Self { emitters, ends }
    }

    /// Returns the fraction of all samples before group `g`, and the fraction on it.
    fn group_fractions(&self, g: usize) -> (f32, f32) {
        let before = g.checked_sub(1).map_or(0.0, |g| self.ends[g]);
        (before, self.ends[g] - before)
    }

    /// Returns the position on an emitter for a uniform `u` in \[0, 1)², in meters, and the index
    /// of its primitive. `None` if nothing emits.
    #[must_use]
    pub fn position(&self, u: Vec2) -> Option<(Vec3, u32)> {
        let groups = self.emitters.groups();
        let g = self.ends[..groups.len()].partition_point(|&end| end <= u.x);
        let g = g.min(groups.len().checked_sub(1)?);
        let (before, part) = self.group_fractions(g);
        // The part of `u.x` within the fraction of the selected group is uniform again.
        let v = ((u.x - before) / part).clamp(0.0, 1.0);
        let power = groups[g].start + v * groups[g].share;
        self.emitters.position(Vec2::new(power, u.y))
    }

    /// Returns the ray from `start` to the position of `u` on an emitter, and its hit. `None` if
    /// the position is behind the plane with normal `n`, or is not visible.
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

    /// Returns the density per steradian of the directions toward [`position`](Self::position)s at
    /// a hit of `ray`. 0 if the hit is not on an emitter.
    #[must_use]
    pub fn density(&self, ray: &Ray, hit: &Hit) -> f32 {
        let Some(g) = self.emitters.group_of(hit.primitive) else {
            return 0.0;
        };
        let (_, part) = self.group_fractions(g);
        self.emitters.density(ray, hit) * part / self.emitters.groups()[g].share
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::lattice;
    use crate::scene::{Material, TriangleMesh};

    /// Returns two triangles of areas 2 and 0.5 m² at different heights, of emission 1 and 8, and
    /// 100 small triangles far away.
    fn mesh() -> TriangleMesh {
        let v = Vec3::new;
        let emissive = |e: f32| Material::emissive(Vec3::ZERO, Vec3::splat(e));
        let mut triangles = vec![
            [v(0.0, 2.0, 0.0), v(2.0, 2.0, 0.0), v(0.0, 2.0, 2.0)],
            [v(-2.0, 3.0, 0.0), v(-1.0, 3.0, 0.0), v(-2.0, 3.0, 1.0)],
        ];
        triangles.extend((0..100).map(|k| {
            let corner = v(20.0 + k as f32, 5.0, 0.0);
            [corner, corner + 0.3 * Vec3::X, corner + 0.3 * Vec3::Z]
        }));
        let mut materials = vec![0, 1];
        materials.resize(triangles.len(), 1);
        TriangleMesh::new(triangles, materials, vec![emissive(1.0), emissive(8.0)])
    }

    #[test]
    fn positions_are_distributed_by_power_over_squared_distance() {
        let mesh = mesh();
        let emitters = mesh.emitters().unwrap();
        let part_of_first_two = |x: Vec3| {
            let view = emitters.seen_from(x);
            let count = 6000;
            let first = (0..count)
                .filter(|&k| view.position(lattice(k, count, Vec2::ZERO)).unwrap().1 < 2)
                .count();
            first as f32 / count as f32
        };
        assert!(part_of_first_two(Vec3::ZERO) > 0.97);
        assert!(part_of_first_two(Vec3::X * 50.0) < 0.05);
    }

    /// Checks that the mean of 1 / density over samples is the solid angle of the emitters.
    #[test]
    fn density_integrates_solid_angle() {
        let mesh = mesh();
        let emitters = mesh.emitters().unwrap();
        // Solid angle of a triangle: Van Oosterom and Strackee 1983.
        let solid_angle = |t: usize, start: Vec3| {
            let [a, b, c] = mesh.triangle(t).unwrap().map(|p| (p - start).as_dvec3());
            let [x, y, z] = [a, b, c].map(glam::DVec3::length);
            let under = x * y * z + a.dot(b) * z + a.dot(c) * y + b.dot(c) * x;
            2.0 * a.dot(b.cross(c)).abs().atan2(under)
        };
        for start in [Vec3::new(0.3, 0.0, 0.4), Vec3::new(30.1, 4.9, 0.1)] {
            let view = emitters.seen_from(start);
            let count = 40_000;
            let sum: f64 = (0..count)
                .filter_map(|k| {
                    let u = lattice(k, count, Vec2::ZERO);
                    let (ray, hit) = view.visible(&mesh, start, Vec3::Y, u)?;
                    Some(1.0 / f64::from(view.density(&ray, &hit)))
                })
                .sum();
            let above = (0..mesh.len()).filter(|&t| mesh.triangle(t).unwrap()[0].y > start.y);
            let right: f64 = above.map(|t| solid_angle(t, start)).sum();
            let mean = sum / f64::from(count);
            assert!((mean / right - 1.0).abs() < 1e-2, "{mean} {right}");
        }
    }

    #[test]
    fn hidden_and_missing_emitters_have_no_samples() {
        let mesh = mesh();
        let emitters = mesh.emitters().unwrap();
        let u = Vec2::splat(0.5);
        let view = emitters.seen_from(Vec3::ZERO);
        assert!(view.visible(&mesh, Vec3::ZERO, Vec3::NEG_Y, u).is_none());
        let corners = [Vec3::X, Vec3::Y, Vec3::Z];
        let none = Emitters::new([(0, [Vec3::ZERO; 3], 1.0), (1, corners, 0.0)], 1.0);
        assert!(none.is_empty() && none.position(u).is_none());
        let view = none.seen_from(Vec3::ZERO);
        assert!(view.visible(&mesh, Vec3::ZERO, Vec3::Y, u).is_none());
    }
}
