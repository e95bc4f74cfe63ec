//! Basis of the probes between surfaces: functions on one level, for every direction of a normal.
//! It is built from the positions of `samples`. `frame::probe` evaluates it.
//!
//! The weights are those of [L08] Eqs. (8)-(9) without the terms of normals. The normal of a probe
//! is zero, and [L08] Eq. (10) is then the Euclidean distance. Clip planes end a function at walls,
//! as for functions on surfaces (design D7). The tested positions are other positions between
//! surfaces.

use super::LevelBasis;
use super::clip::{ClipSample, choose_planes};
use super::weight::{kernel, plane_at, weight_inside};
use crate::samples::{HashedGrid, Point, lattice, uniform_sphere};
use crate::scene::{Bounds, Geometry, Ray};
use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;

/// Radius of a function, relative to the spacing. A position with a visible probe within the
/// spacing then always has several functions.
pub const PROBE_OVERLAP: f32 = 1.75;
/// Largest number of positions whose visibility from a probe is tested.
const MAX_VISIBILITY_SAMPLES: usize = 192;
/// Number of directions from a probe that are searched for walls.
const WALLS: u32 = 48;

/// Computes w_j(x) of a probe, dimensionless in [0, 1]. The weight is 0 behind one of its clip
/// planes. The planes of occluders shift with the normal `n` of the lit surface. With a zero `n`,
/// they lie in the middle of the occluder.
#[must_use]
#[inline]
pub fn probe_weight(probe: &Point, planes: &[[f32; 4]], x: Vec3, n: Vec3) -> f32 {
    let squared = (x - probe.x()).length_squared();
    if squared < probe.radius * probe.radius {
        weight_inside(probe, planes, x, n, 1.0, squared)
    } else {
        0.0
    }
}

/// Builds probes at `positions`, `spacing` meters apart. Their clip planes follow from the
/// visibility of the positions in `crossed`. Also returns the number of rays cast.
#[must_use]
pub fn probe_basis(
    geometry: &dyn Geometry,
    positions: &[Vec3],
    crossed: &[Vec3],
    spacing: f32,
) -> (LevelBasis, u64) {
    let radius = PROBE_OVERLAP * spacing;
    let around = HashedGrid::build(crossed.len(), radius, |i| Bounds {
        min: crossed[i],
        max: crossed[i],
    });
    let found: Vec<(Vec<[f32; 4]>, u64)> = positions
        .par_iter()
        .map_init(Vec::new, |near, &x| {
            near.clear();
            let bounds = Bounds {
                min: x - radius,
                max: x + radius,
            };
            around.for_each_in(bounds, |i| {
                if crossed[i as usize].distance_squared(x) < radius * radius {
                    near.push(i);
                }
            });
            near.sort_unstable();
            near.dedup();
            let stride = near.len().div_ceil(MAX_VISIBILITY_SAMPLES).max(1);
            let looked = near.iter().step_by(stride).map(|&i| crossed[i as usize]);
            planes_of(geometry, x, radius, looked)
        })
        .collect();
    let mut planes: Vec<[f32; 4]> = Vec::new();
    let mut rays = 0;
    let points = positions
        .iter()
        .zip(found)
        .map(|(&x, (own, cast))| {
            let mut point = Point::new(x, Vec3::ZERO, radius);
            point.planes = planes.len() as u32 | (own.len() as u32) << 24;
            planes.extend(own);
            rays += cast;
            point
        })
        .collect();
    (LevelBasis::new(points, planes), rays)
}

/// Returns the clip planes of a probe at `x` and the number of rays cast.
fn planes_of(
    geometry: &dyn Geometry,
    x: Vec3,
    radius: f32,
    around: impl Iterator<Item = Vec3>,
) -> (Vec<[f32; 4]>, u64) {
    let geometry = geometry.with_occluders_closed().unwrap_or(geometry);
    let mut candidates: Vec<Vec4> = Vec::new();
    let mut rays = 0;
    let mut look = |way: Vec3, length: f32, candidates: &mut Vec<Vec4>| {
        let ray = Ray::segment(x, way, length);
        rays += 1;
        let hit = geometry.cast(&ray);
        if let Some(hit) = &hit {
            candidates.push(plane_at(&geometry.barrier(&ray, hit), radius));
        }
        hit.map(|hit| hit.t)
    };
    let mut samples = Vec::new();
    for y in around {
        let way = y - x;
        let length = way.length();
        if length < 1e-3 * radius {
            continue;
        }
        samples.push(ClipSample {
            x: y,
            n: Vec3::ZERO,
            weight: kernel(length / radius),
            blocked: look(way / length, length, &mut candidates).is_some(),
        });
    }
    for k in 0..WALLS {
        let way = uniform_sphere(lattice(k, WALLS, Vec2::ZERO)).normalize_or(Vec3::Y);
        // A probe has zero weight inside a wall, because no light reaches it.
        if let Some(t) = look(way, radius, &mut candidates) {
            let length = 0.5 * (t + radius);
            samples.push(ClipSample {
                x: x + way * length,
                n: Vec3::ZERO,
                weight: kernel(length / radius),
                blocked: true,
            });
        }
    }
    (
        choose_planes(&mut samples, &[], &candidates, x, radius),
        rays,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::{ProbePlacementSettings, Random, place_probes};
    use crate::scene::{Material, Quad, TriangleMesh};

    /// The six walls of a room, with fronts to the inside.
    fn room(low: Vec3, high: Vec3) -> Vec<Quad> {
        let size = high - low;
        (0..6)
            .map(|k| {
                let axis = [Vec3::X, Vec3::Y, Vec3::Z][k / 2];
                let (u, v) = (
                    [Vec3::Y, Vec3::Z, Vec3::X][k / 2],
                    [Vec3::Z, Vec3::X, Vec3::Y][k / 2],
                );
                let (u, v) = (u * size, v * size);
                let (origin, u, v) = match k % 2 {
                    0 => (low, u, v),
                    _ => (low + axis * size, v, u),
                };
                Quad {
                    corners: [origin, origin + u, origin + u + v, origin + v],
                    material: Material::diffuse(Vec3::splat(0.5)),
                }
            })
            .collect()
    }

    #[test]
    fn probe_functions_stop_at_thin_wall() {
        let mut quads = room(Vec3::ZERO, Vec3::splat(2.0));
        quads.extend(room(Vec3::X * 2.0, Vec3::new(4.0, 2.0, 2.0)));
        let mesh = TriangleMesh::from_quads(&quads);
        let eyes = [Vec3::ONE, Vec3::new(3.0, 1.0, 1.0)];
        let settings = ProbePlacementSettings {
            spacing: 0.4,
            max: 4096,
            seed: 1,
            drop_first: true,
        };
        let space = place_probes(&mesh, &eyes, &settings);
        let (basis, _) = probe_basis(&mesh, &space.probes, &space.crossed, 0.4);
        let reaching = |x: Vec3, planes: bool| {
            let own = |p: &Point| match planes {
                true => *p,
                false => Point { planes: 0, ..*p },
            };
            let all = basis.points.iter().map(own);
            all.filter(|p| probe_weight(p, &basis.planes, x, Vec3::ZERO) > 0.0)
                .map(|p| p.x())
                .collect::<Vec<_>>()
        };
        let mut random = Random::new(1, 2, 3);
        for _ in 0..2000 {
            let mut unit = || 0.02 + 0.96 * random.unit();
            let x = Vec3::new(4.0 * unit(), 2.0 * unit(), 2.0 * unit());
            let found = reaching(x, true);
            assert!(!found.is_empty(), "no probe reaches {x}");
            assert!(
                found.iter().all(|p| (p.x < 2.0) == (x.x < 2.0)),
                "{x}: {found:?}"
            );
        }
        // Without planes, probes reach through the wall.
        let found = reaching(Vec3::new(1.95, 1.0, 1.0), false);
        assert!(found.iter().any(|p| p.x > 2.0));
    }
}
