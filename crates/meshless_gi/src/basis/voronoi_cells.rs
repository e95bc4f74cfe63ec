//! Voronoi cells: the surface that each point of a level represents, as positions and areas in m².
//! The basis weight of the point is the largest of the level in its cell.
//!
//! A disk with the radius of the point's function is projected onto the surface at lattice points
//! of equal area. The lattice points where no other function of the level has a larger weight form
//! the cell. [G08] §2.4 takes areas from the local density of points. At edges and corners, with no
//! points beyond them, these areas are too large.

use super::{LevelBasis, WeightEntry};
use crate::samples::{Random, free_height, lattice, tangents};
use crate::scene::{Geometry, Ray};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Number of lattice points per disk. A third of them lie in the cell.
const LATTICE_POINTS: u32 = 64;

/// Part of a point's cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellPart {
    /// Position, meters.
    pub position: Vec3,
    /// Unit normal.
    pub normal: Vec3,
    /// Area that the part represents, m².
    pub area: f32,
}

/// Computes the cells of a level's points, each as at most `parts` parts of equal area. Also
/// returns the number of rays cast.
#[must_use]
pub fn find_cells(
    geometry: &dyn Geometry,
    level: &LevelBasis,
    parts: u32,
    seed: u64,
) -> (Vec<Vec<CellPart>>, u64) {
    let cells: Vec<(Vec<CellPart>, u64)> = (0..level.points.len())
        .into_par_iter()
        .map_init(Vec::new, |found, i| {
            let (seen, rays) = trace_cell(geometry, level, i, seed, found);
            (thinned(&seen, parts.max(1) as usize), rays)
        })
        .collect();
    let rays = cells.iter().map(|c| c.1).sum();
    (cells.into_iter().map(|c| c.0).collect(), rays)
}

/// Returns all parts of a cell and the number of rays cast.
fn trace_cell(
    geometry: &dyn Geometry,
    level: &LevelBasis,
    i: usize,
    seed: u64,
    found: &mut Vec<WeightEntry>,
) -> (Vec<CellPart>, u64) {
    let point = &level.points[i];
    let (x, n) = (point.x(), point.n());
    let (t, b) = tangents(n);
    let turn = Random::new(seed, 0x63_65_6c_6c, i as u64).unit();
    // Rays start below any surface above the point.
    let depth = 0.25 * point.radius;
    let height = 0.5 * free_height(geometry, x, n, 2.0 * depth);
    let lift = geometry.ray_offset(x);
    let area = std::f32::consts::PI * point.radius * point.radius / LATTICE_POINTS as f32;
    let mut seen = Vec::new();
    let mut rays = 1;
    for k in 0..LATTICE_POINTS {
        let angle = lattice(k, LATTICE_POINTS, Vec2::new(0.0, turn)).y * std::f32::consts::TAU;
        let r = ((k as f32 + 0.5) / LATTICE_POINTS as f32).sqrt() * point.radius;
        let across = (t * libm::cosf(angle) + b * libm::sinf(angle)) * r;
        let ray = Ray::segment(x + across + n * height, -n, height + depth);
        rays += 1;
        let Some(hit) = geometry.cast(&ray) else {
            continue;
        };
        let there = geometry.hit_point(&ray, &hit);
        let cosine = there.normal.dot(n);
        found.clear();
        level.raw_weights(there.position, there.normal, found);
        let own = |w: &&WeightEntry| w.index as usize == i;
        let weight = found.iter().find(own).map_or(0.0, |w| w.weight);
        let nearest = found.iter().all(|w| w.weight <= weight);
        if weight <= 0.0 || !nearest || cosine < 0.1 || !there.lit {
            continue;
        }
        // The ray from above passes over the bulge of a curved surface. The ray from below passes
        // under a ceiling.
        let open = [height.max(lift), lift].into_iter().any(|up| {
            rays += 1;
            !geometry.is_occluded(x + n * up, there.position + there.normal * up)
        });
        if open {
            seen.push(CellPart {
                position: there.position,
                normal: there.normal,
                area: area / cosine,
            });
        }
    }
    if seen.is_empty() {
        // The cell is narrower than the lattice: the point itself represents the area of one part.
        seen.push(CellPart {
            position: x,
            normal: n,
            area,
        });
    }
    (seen, rays)
}

/// Reduces the parts to at most `max`, and keeps the total area.
fn thinned(seen: &[CellPart], max: usize) -> Vec<CellPart> {
    let kept = max.min(seen.len());
    let area = seen.iter().map(|p| p.area).sum::<f32>() / kept as f32;
    // The lattice spirals outwards. Take the middle of each of `kept` equal stretches.
    (0..kept)
        .map(|k| CellPart {
            area,
            ..seen[(2 * k + 1) * seen.len() / (2 * kept)]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Point;
    use crate::scene::{Material, TriangleMesh};

    /// Points on a grid over a floor of 4 m by 4 m, with a wall on it.
    fn floor() -> (TriangleMesh, LevelBasis) {
        let at = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
        let triangles = vec![
            [at(-2.0, 0.0, 2.0), at(2.0, 0.0, 2.0), at(2.0, 0.0, -2.0)],
            [at(-2.0, 0.0, 2.0), at(2.0, 0.0, -2.0), at(-2.0, 0.0, -2.0)],
            [at(0.45, 0.0, 2.0), at(0.45, 0.0, -2.0), at(0.45, 1.0, -2.0)],
            [at(0.45, 0.0, 2.0), at(0.45, 1.0, -2.0), at(0.45, 1.0, 2.0)],
        ];
        let mesh = TriangleMesh::new(triangles, vec![0; 4], vec![Material::default()]);
        let points = (0..64)
            .map(|i| {
                let [x, z] = [i % 8, i / 8].map(|k| 0.5 * k as f32 - 1.75);
                Point::new(at(x, 0.0, z), Vec3::Y, 0.5)
            })
            .collect();
        (mesh, LevelBasis::new(points, Vec::new()))
    }

    #[test]
    fn voronoi_cells_partition_floor_area() {
        let (mesh, level) = floor();
        let (cells, rays) = find_cells(&mesh, &level, 6, 1);
        assert!(rays >= 64 * u64::from(LATTICE_POINTS));
        let area = |cell: &Vec<CellPart>| cell.iter().map(|p| p.area).sum::<f32>();
        let whole: f32 = cells.iter().map(area).sum();
        // The wall takes a strip 5 cm wide from the column that it divides: the strip is not
        // visible from the column's points at x = 0.25.
        let right = 16.0 - 4.0 * 0.05;
        assert!((whole - right).abs() < 0.03 * right, "{whole}");
        for (cell, p) in cells.iter().zip(&level.points) {
            let column = (p.position[0] - 0.25).abs() < 1e-3;
            let own = if column { 0.225 } else { 0.25 };
            assert!((area(cell) - own).abs() < 0.08, "{}", area(cell));
            assert_eq!(cell.len(), 6);
            for part in cell {
                let off = part.position - p.x();
                assert!(off.abs().max_element() < 0.26 && part.normal == Vec3::Y);
                assert!(!column || part.position.x < 0.45);
            }
        }
    }

    #[test]
    fn thinned_cell_parts_keep_total_area() {
        let piece = |k: usize| CellPart {
            position: Vec3::splat(k as f32),
            normal: Vec3::Y,
            area: 1.0,
        };
        let seen: Vec<_> = (0..10).map(piece).collect();
        for max in [1, 3, 10, 20] {
            let kept = thinned(&seen, max);
            assert_eq!(kept.len(), max.min(10));
            let area: f32 = kept.iter().map(|p| p.area).sum();
            assert!((area - 10.0).abs() < 1e-5);
        }
        assert_eq!(thinned(&seen, 1)[0].position, Vec3::splat(5.0));
    }
}
