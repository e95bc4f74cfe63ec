//! One level of the basis: its functions, and their normalized (Shepard) weights at any position,
//! [L08] Eqs. (1)-(3).
//!
//! Kernels read a level's points, clip planes and hashed grid in this layout. See [`HashedGrid`].

use super::WeightEntry;
use super::weight::{reach, weight_inside};
use crate::samples::{F_SQUASH, HashedGrid, Point};
use crate::scene::Bounds;
use glam::Vec3;

/// Functions of one level or of the flat display basis.
#[derive(Clone, Debug, PartialEq)]
pub struct LevelBasis {
    /// Functions, with their radii and plane ranges.
    pub points: Vec<Point>,
    /// Clip planes (n, d). A position p is on the function's side if n·p + d ≥ 0.
    pub planes: Vec<[f32; 4]>,
    /// Grid that finds the functions near a position.
    pub grid: HashedGrid,
}

/// Computes the bounding box of the support of a function: an ellipsoid squashed along its normal
/// (\[L08\] Eq. (10)).
#[must_use]
pub fn support_bounds(point: &Point) -> Bounds {
    // Semi-axes r across and r / (1 + F) along n. The half extent along axis k is r · sqrt(1 − n_k²
    // + n_k² / (1 + F)²).
    let n = point.n();
    let along = 1.0 / ((1.0 + F_SQUASH) * (1.0 + F_SQUASH));
    let squared = (Vec3::ONE - n * n * (1.0 - along)).max(Vec3::splat(along));
    let half =
        point.radius * 1.0001 * Vec3::new(squared.x.sqrt(), squared.y.sqrt(), squared.z.sqrt());
    Bounds {
        min: point.x() - half,
        max: point.x() + half,
    }
}

impl LevelBasis {
    /// Creates a level of functions. The plane ranges of `points` refer to `planes`.
    #[must_use]
    pub fn new(points: Vec<Point>, planes: Vec<[f32; 4]>) -> Self {
        // A cell is as large as the mean support. A lower bound keeps the largest function from
        // touching thousands of cells.
        let (sum, largest) = points.iter().fold((0.0f64, 0.0f32), |(sum, largest), p| {
            (sum + f64::from(p.radius), largest.max(p.radius))
        });
        let cell = if largest > 0.0 {
            let mean = (sum / points.len() as f64) as f32;
            mean.max(largest / 8.0)
        } else {
            1.0
        };
        let grid = HashedGrid::build(points.len(), cell, |i| support_bounds(&points[i]));
        Self {
            points,
            planes,
            grid,
        }
    }

    /// Returns the support radius of the first function, meters. All functions of a hierarchy level
    /// share it. Returns 0 if the level is empty.
    #[must_use]
    pub fn radius(&self) -> f32 {
        self.points.first().map_or(0.0, |point| point.radius)
    }

    /// Appends the weights w_j(x, n) of all functions that cover the position (\[L08\] Eq. (8)),
    /// not normalized, to `out`. Returns their sum.
    #[inline]
    pub fn raw_weights(&self, x: Vec3, n: Vec3, out: &mut Vec<WeightEntry>) -> f32 {
        self.raw_weights_among(self.grid.indices_near(x), x, n, out)
    }

    /// Computes [`raw_weights`](Self::raw_weights) with the functions that the grid lists near `x`.
    #[inline]
    pub(super) fn raw_weights_among(
        &self,
        near: &[u32],
        x: Vec3,
        n: Vec3,
        out: &mut Vec<WeightEntry>,
    ) -> f32 {
        const BATCH_SIZE: usize = 32;
        let mut sum = 0.0;
        let mut reaching = [(0u32, 0.0f32, 0.0f32); BATCH_SIZE];
        for some in near.chunks(BATCH_SIZE) {
            // Two of three functions do not reach the position, and branch prediction fails. The
            // ones that do are therefore selected first, without a branch.
            let mut count = 0;
            for &index in some {
                let (cosine, squared, inside) = reach(&self.points[index as usize], x, n);
                reaching[count] = (index, cosine, squared);
                count += usize::from(inside);
            }
            for &(index, cosine, squared) in &reaching[..count] {
                let point = &self.points[index as usize];
                let w = weight_inside(point, &self.planes, x, n, cosine, squared);
                if w > 0.0 {
                    sum += w;
                    out.push(WeightEntry { index, weight: w });
                }
            }
        }
        sum
    }

    /// Computes the basis functions B_j(x, n) that are not zero, \[L08\] Eq. (2): weights that sum
    /// to one. Replaces `out`. If no function covers the position, returns `false` and clears
    /// `out`.
    #[inline]
    pub fn weights(&self, x: Vec3, n: Vec3, out: &mut Vec<WeightEntry>) -> bool {
        self.weights_among(self.grid.indices_near(x), x, n, out)
    }

    /// Computes [`weights`](Self::weights) with the functions that the grid lists near `x`.
    #[inline]
    pub(super) fn weights_among(
        &self,
        near: &[u32],
        x: Vec3,
        n: Vec3,
        out: &mut Vec<WeightEntry>,
    ) -> bool {
        out.clear();
        let sum = self.raw_weights_among(near, x, n, out);
        if sum <= super::NO_COVER {
            out.clear();
            return false;
        }
        let inverse = 1.0 / sum;
        for w in out.iter_mut() {
            w.weight *= inverse;
        }
        true
    }
}
