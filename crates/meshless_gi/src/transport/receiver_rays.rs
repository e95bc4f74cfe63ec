//! Rays of a receiver's hemispherical gather.
//!
//! \[L08\] Eq. (16) gathers at the receiver's center. The value then represents the whole area
//! nearest to the center. This is wrong where irradiance varies over the area: in gaps, at contacts
//! and under edges. Rays therefore start from positions distributed over that area (a deviation
//! from \[L08\]). The row is the mean over it.

use crate::basis::{Hierarchy, LevelBasis, weight};
use crate::samples::{Random, free_height, gather_direction, lattice, tangents};
use crate::scene::{Geometry, Ray};
use glam::{Vec2, Vec3};

/// Number of start positions. Odd, so that even and odd rays start from all of them.
const STARTS: u32 = 7;
/// Radius of the area of a receiver, relative to the radius of the finest level's functions. Disks
/// of a Poisson level are 1 / 2.5 of that radius apart. About 0.6 of this distance covers the area
/// nearest to each.
const CELL_RADIUS: f32 = 0.24;

/// Rays of a receiver.
#[derive(Clone, Debug)]
pub struct ReceiverRays {
    /// Start positions above the surface, in meters.
    starts: [Vec3; STARTS as usize],
    /// Unit normal of the receiver.
    pub normal: Vec3,
    count: u32,
    shift: Vec2,
    /// Random numbers for further rays of the receiver.
    pub random: Random,
}

/// Ray of a receiver.
#[derive(Clone, Copy, Debug)]
pub struct ReceiverRay {
    /// Ray of unlimited length.
    pub ray: Ray,
    /// Cosine of the direction and the receiver's normal.
    pub cosine: f32,
    /// Weight w = 1 / (π N p) of the direction, see [`gather_direction`].
    pub weight: f32,
}

impl ReceiverRays {
    /// Creates `count` rays of receiver `i` at (`x`, `n`). All start from its center.
    #[must_use]
    pub fn at_center(
        geometry: &dyn Geometry,
        (x, n): (Vec3, Vec3),
        i: usize,
        count: u32,
        seed: u64,
    ) -> Self {
        let mut random = Random::new(seed, 0x67_61_74_68, i as u64);
        let shift = Vec2::new(random.unit(), random.unit());
        Self {
            starts: [x + n * geometry.ray_offset(x); STARTS as usize],
            normal: n,
            count,
            shift,
            random,
        }
    }

    /// Creates `count` rays of point `i` of the hierarchy, from positions distributed over its
    /// area. On a rough surface, all start from its center.
    #[must_use]
    pub fn over_cell(
        geometry: &dyn Geometry,
        hierarchy: &Hierarchy,
        i: usize,
        count: u32,
        seed: u64,
    ) -> Self {
        let surface = &hierarchy.surfaces[i];
        let (x, n) = (surface.position, surface.normal);
        let mut rays = Self::at_center(geometry, (x, n), i, count, seed);
        // On a rough surface only the highest parts are visible from the center. They receive more
        // light than the rest.
        if geometry.surface_relief(x) > 0.0 {
            return rays;
        }
        let finest = hierarchy.levels.last();
        let radius = CELL_RADIUS * finest.map_or(0.0, LevelBasis::radius);
        let l = hierarchy.level_of(i);
        let level = &hierarchy.levels[l];
        let own = &level.points[i - hierarchy.level_starts[l] as usize];
        let center = rays.starts[0];
        let height = 0.5 * free_height(geometry, x, n, radius);
        let (t, b) = tangents(n);
        let turn = Vec2::new(0.0, rays.random.unit());
        for (k, start) in rays.starts.iter_mut().enumerate() {
            let p = lattice(k as u32, STARTS, turn);
            let angle = p.y * std::f32::consts::TAU;
            let across = (t * libm::cosf(angle) + b * libm::sinf(angle)) * (p.x.sqrt() * radius);
            let down = Ray::segment(x + across + n * height, -n, height + 0.5 * radius);
            let Some(hit) = geometry.cast(&down) else {
                continue;
            };
            let there = geometry.hit_point(&down, &hit);
            let above = there.position + there.normal * geometry.ray_offset(there.position);
            let belongs = weight(own, &level.planes, there.position, there.normal) > 0.0;
            if there.lit && belongs && !geometry.is_occluded(center, above) {
                *start = above;
            }
        }
        rays
    }

    /// Returns the start position of ray `k`, in meters.
    #[must_use]
    pub fn start(&self, k: u32) -> Vec3 {
        self.starts[(k % STARTS) as usize]
    }

    /// Returns the rays of the hemisphere.
    pub fn iter(&self) -> impl Iterator<Item = ReceiverRay> + '_ {
        let n = self.normal;
        let (t, b) = tangents(n);
        (0..self.count).map(move |k| {
            let (d, weight) = gather_direction(k, self.count, self.shift);
            let direction = (t * d.x + b * d.y + n * d.z).normalize();
            ReceiverRay {
                ray: Ray::new(self.start(k), direction),
                cosine: d.z,
                weight,
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Point;
    use crate::scene::{Material, Surface, TriangleMesh};

    /// Creates a floor with a wall at x = 0.1 m, and a hierarchy of one function of radius 1 m at
    /// the origin.
    fn wall_beside_point() -> (TriangleMesh, Hierarchy) {
        let v = Vec3::new;
        let floor = [
            v(-2.0, 0.0, 2.0),
            v(2.0, 0.0, 2.0),
            v(2.0, 0.0, -2.0),
            v(-2.0, 0.0, -2.0),
        ];
        let wall = [
            v(0.1, 0.0, 2.0),
            v(0.1, 0.0, -2.0),
            v(0.1, 1.0, -2.0),
            v(0.1, 1.0, 2.0),
        ];
        let triangles: Vec<_> = [floor, wall]
            .into_iter()
            .flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]])
            .collect();
        let mesh = TriangleMesh::new(triangles, vec![0; 4], vec![Material::default()]);
        let level = LevelBasis::new(vec![Point::new(Vec3::ZERO, Vec3::Y, 1.0)], Vec::new());
        let surface = Surface {
            position: Vec3::ZERO,
            normal: Vec3::Y,
            albedo: Vec3::ONE,
            emission: Vec3::ZERO,
            front: true,
        };
        let hierarchy = Hierarchy {
            levels: vec![level.clone()],
            senders: vec![level],
            surfaces: vec![surface],
            level_starts: vec![0, 1],
            rays: 0,
            truncated: Vec::new(),
            origins: Vec::new(),
            emissive: Vec::new(),
        };
        (mesh, hierarchy)
    }

    #[test]
    fn rays_start_across_cell_and_not_behind_walls() {
        let (mesh, hierarchy) = wall_beside_point();
        let rays = ReceiverRays::over_cell(&mesh, &hierarchy, 0, 64, 1);
        let starts: Vec<Vec3> = (0..STARTS).map(|k| rays.start(k)).collect();
        let farthest = starts.iter().map(|x| x.length()).fold(0.0, f32::max);
        assert!((0.15..0.26).contains(&farthest), "{farthest}");
        assert!(
            starts.iter().all(|x| x.x < 0.1 && x.y > 0.0 && x.y < 1e-3),
            "{starts:?}"
        );
        assert_eq!(rays.iter().count(), 64);
        let center = ReceiverRays::at_center(&mesh, (Vec3::ZERO, Vec3::Y), 0, 64, 1);
        assert!(
            center
                .iter()
                .zip(rays.iter())
                .all(|(a, b)| a.ray.direction == b.ray.direction)
        );
    }
}
