//! Directions over a hemisphere as a rectangular map of equal solid angles, for depth lookups
//! ([P14] §4.2, §5).
//!
//! \[P14\] distributes its directions evenly and searches the four nearest. Here they are the texel
//! centers of a map, so the four nearest of any direction are a bilinear cell with weights. The map
//! is Shirley and Chiu's concentric map from the square to the disk, followed by Lambert's map from
//! the disk to the hemisphere. Both preserve areas, and neither has a seam.

use glam::Vec3;
use std::f32::consts::{FRAC_PI_2, FRAC_PI_4};

/// Map of the hemisphere about z.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HemisphereGrid {
    /// Number of texels per row.
    pub columns: u32,
    /// Number of rows.
    pub rows: u32,
}

impl Default for HemisphereGrid {
    /// Creates a map of 2016 directions, as in \[P14\] §6.
    fn default() -> Self {
        Self {
            columns: 48,
            rows: 42,
        }
    }
}

/// Coefficients of atan(t) / t for |t| ≤ 1 as a polynomial in t², exact to 1e-5 (Abramowitz and
/// Stegun 4.4.47). The polynomial gives the same numbers on every device, unlike `atan`.
const ATAN_COEFFICIENTS: [f32; 5] = [0.999_866, -0.330_299_5, 0.180_141, -0.085_133, 0.020_835_1];

impl HemisphereGrid {
    /// Creates a map of about `directions` texels with an aspect ratio of about 8 to 7.
    #[must_use]
    pub fn with_directions(directions: u32) -> Self {
        let columns = (directions as f32 * (8.0 / 7.0)).sqrt().round().max(1.0) as u32;
        let rows = (directions as f32 / columns as f32).round().max(1.0) as u32;
        Self { columns, rows }
    }

    /// Returns the number of directions.
    #[must_use]
    pub fn len(self) -> usize {
        self.columns as usize * self.rows as usize
    }

    /// Returns `true` if there are no directions.
    #[must_use]
    pub fn is_empty(self) -> bool {
        self.len() == 0
    }

    /// Returns the unit direction of texel `i`, z up.
    #[must_use]
    pub fn direction(self, i: usize) -> Vec3 {
        let at = |k: usize, of: u32| (2 * k + 1) as f32 / of as f32 - 1.0;
        let columns = self.columns as usize;
        let (a, b) = (at(i % columns, self.columns), at(i / columns, self.rows));
        let (r, phi) = if a.abs() > b.abs() {
            (a, FRAC_PI_4 * (b / a))
        } else if b == 0.0 {
            (0.0, 0.0)
        } else {
            (b, FRAC_PI_2 - FRAC_PI_4 * (a / b))
        };
        let square = r * r;
        let across = r * (2.0 - square).max(0.0).sqrt();
        Vec3::new(
            across * libm::cosf(phi),
            across * libm::sinf(phi),
            1.0 - square,
        )
    }

    /// Returns the four texels around the unit direction `d` (z up, clamped to the horizon) and
    /// their weights. The weights sum to one.
    #[must_use]
    #[inline]
    pub fn lookup(self, d: Vec3) -> ([u32; 4], [f32; 4]) {
        let r = (1.0 - d.z).clamp(0.0, 1.0).sqrt();
        let (x, y) = (d.x.abs(), d.y.abs());
        let (large, small) = (x.max(y), x.min(y));
        let t = if large > 0.0 { small / large } else { 0.0 };
        let q = t * t;
        let arc = t
            * (ATAN_COEFFICIENTS[0]
                + q * (ATAN_COEFFICIENTS[1]
                    + q * (ATAN_COEFFICIENTS[2]
                        + q * (ATAN_COEFFICIENTS[3] + q * ATAN_COEFFICIENTS[4]))));
        let other = (r * arc * (1.0 / FRAC_PI_4)).min(r);
        let (a, b) = if x > y { (r, other) } else { (other, r) };
        let texel = |v: f32, sign: f32, of: u32| {
            let at = (0.5 * (1.0 + v.copysign(sign)) * of as f32 - 0.5).clamp(0.0, (of - 1) as f32);
            let low = (at as u32).min(of.saturating_sub(2));
            (low, (low + 1).min(of - 1), at - low as f32)
        };
        let (left, right, u) = texel(a, d.x, self.columns);
        let (top, bottom, v) = texel(b, d.y, self.rows);
        let index = |column: u32, row: u32| row * self.columns + column;
        (
            [
                index(left, top),
                index(right, top),
                index(left, bottom),
                index(right, bottom),
            ],
            [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v],
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::{Random, uniform_sphere};
    use glam::Vec2;

    #[test]
    fn hemisphere_directions_are_uniform() {
        for (columns, rows) in [(48, 42), (7, 9), (1, 1)] {
            let grid = HemisphereGrid { columns, rows };
            let (mut mean, mut square) = (Vec3::ZERO, 0.0);
            for i in 0..grid.len() {
                let d = grid.direction(i);
                assert!((d.length() - 1.0).abs() < 1e-5 && d.z >= 0.0, "{i}: {d}");
                mean += d / grid.len() as f32;
                square += d.z * d.z / grid.len() as f32;
            }
            if grid.len() > 50 {
                // Closed forms of the uniform hemisphere. Texel centers deviate by a part of a
                // texel.
                let texel = 1.0 / grid.len() as f32;
                assert!(mean.truncate().length() < 1e-4, "{mean}");
                assert!((mean.z - 0.5).abs() < texel, "{mean}");
                assert!((square - 1.0 / 3.0).abs() < texel, "{square}");
            }
        }
        assert_eq!(
            HemisphereGrid::with_directions(2016),
            HemisphereGrid::default()
        );
        assert_eq!(HemisphereGrid::with_directions(1).len(), 1);
    }

    #[test]
    fn hemisphere_lookup_returns_nearest_directions() {
        let grid = HemisphereGrid::default();
        for i in 0..grid.len() {
            let (texels, weights) = grid.lookup(grid.direction(i));
            let own: f32 = texels
                .iter()
                .zip(weights)
                .filter(|(t, _)| **t as usize == i)
                .map(|(_, w)| w)
                .sum();
            assert!(own > 0.998, "{i}: {texels:?} {weights:?}");
        }
        let mut random = Random::new(2, 0, 0);
        for _ in 0..20_000 {
            let mut d = uniform_sphere(Vec2::new(random.unit(), random.unit()));
            d.z = d.z.abs();
            let (texels, weights) = grid.lookup(d);
            assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-6);
            let mean: Vec3 = texels
                .iter()
                .zip(weights)
                .map(|(&t, w)| w * grid.direction(t as usize))
                .sum();
            // A texel is 0.056 wide, and the rim is half a texel away.
            assert!(mean.angle_between(d) < 0.05, "{d} {mean}");
        }
    }

    #[test]
    fn hemisphere_lookup_invalid_direction_stays_in_map() {
        for grid in [
            HemisphereGrid::default(),
            HemisphereGrid::with_directions(1),
            HemisphereGrid::with_directions(3),
        ] {
            for d in [
                Vec3::Z,
                Vec3::X,
                -Vec3::Y,
                -Vec3::Z,
                Vec3::ZERO,
                Vec3::NAN,
                Vec3::splat(f32::INFINITY),
            ] {
                let (texels, _) = grid.lookup(d);
                assert!(texels.iter().all(|&t| (t as usize) < grid.len()), "{d}");
            }
        }
    }
}
