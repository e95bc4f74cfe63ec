//! One level of the basis: its functions, and their normalized (Shepard) weights at any position,
//! [L08] Eqs. (1)-(3).
//!
//! A level's points, clip planes and hashed grid are the layout that the kernels read; see
//! [`HashedGrid`].

use super::WeightEntry;
use super::kernel::{reach, weight_inside};
use crate::samples::{F_SQUASH, HashedGrid, Point};
use crate::scene::Bounds;
use glam::Vec3;

/// The functions of one level (or of the flat display basis).
#[derive(Clone, Debug, PartialEq)]
pub struct LevelBasis {
    /// The functions, with their radii and plane ranges.
    pub points: Vec<Point>,
    /// Their clip planes (n, d): a position p is on the function's side where n·p + d ≥ 0.
    pub planes: Vec<[f32; 4]>,
    /// Grid that finds the functions near a position.
    pub grid: HashedGrid,
}

/// The box around the support of a function: an ellipsoid squashed along its normal (\[L08\] Eq.
/// (10)).
#[must_use]
pub fn support_bounds(point: &Point) -> Bounds {
    // Semi-axes r across and r / (1 + F) along n: half extent along axis k is r · sqrt(1 − n_k² +
    // n_k² / (1 + F)²).
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
    /// A level of functions. `planes` are what the points' plane ranges mean.
    #[must_use]
    pub fn new(points: Vec<Point>, planes: Vec<[f32; 4]>) -> Self {
        // A cell as large as the mean support, but not so small that the largest is entered in
        // thousands.
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

    /// Support radius of the first function, meters. All functions of a level of a hierarchy share
    /// it. Returns 0 if there are none.
    #[must_use]
    pub fn radius(&self) -> f32 {
        self.points.first().map_or(0.0, |point| point.radius)
    }

    /// Weights w_j(x, n) of all functions that cover the position (\[L08\] Eq. (8)), not
    /// normalized, appended to `out`. Returns their sum.
    #[inline]
    pub fn raw_weights(&self, x: Vec3, n: Vec3, out: &mut Vec<WeightEntry>) -> f32 {
        self.raw_weights_among(self.grid.near(x), x, n, out)
    }

    /// As [`raw_weights`](Self::raw_weights), with the functions that the grid lists near `x`.
    #[inline]
    pub(super) fn raw_weights_among(
        &self,
        near: &[u32],
        x: Vec3,
        n: Vec3,
        out: &mut Vec<WeightEntry>,
    ) -> f32 {
        const AT_ONCE: usize = 32;
        let mut sum = 0.0;
        let mut reaching = [(0u32, 0.0f32, 0.0f32); AT_ONCE];
        for some in near.chunks(AT_ONCE) {
            // Two of three do not reach the position, which no processor can foresee: first those
            // that do are sorted out, without a branch.
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

    /// The basis functions B_j(x, n) that are not zero, \[L08\] Eq. (2): weights that sum to one.
    /// Replaces `out`; false, and `out` empty, where no function covers the position.
    #[inline]
    pub fn weights(&self, x: Vec3, n: Vec3, out: &mut Vec<WeightEntry>) -> bool {
        self.weights_among(self.grid.near(x), x, n, out)
    }

    /// As [`weights`](Self::weights), with the functions that the grid lists near `x`.
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
