//! Alternative bases of [V11] §VI: Shepard's inverse square and Gaussian radial functions over the
//! normal-sensitive distance. [L08]'s own multilevel functions are behind the same interface, so
//! that the three can be compared. Only `accuracy/` uses them. A bake uses `shepard.rs` and
//! `flat.rs`.
//!
//! The Gaussian functions neither sum to one, nor are they 1 at their own point and 0 at the
//! others. Interpolation of values requires a solve for the coefficients. [V11] gives no method.
//! This module solves the dense system by LU.
//!
//! §VI defines the argument as "site distance divided by the nominal radius". These functions are
//! so wide that the system is almost singular. §V states that functions are "nearly zero" at the
//! nominal radius, which makes them four times as narrow. [`GaussianBasis::new`] supports both: it
//! takes the width in nominal radii.

use super::dense::Lu;
use glam::{DVec3, Vec3};
use meshless_gi::internals::basis::{LevelBasis, WeightEntry};
use rayon::prelude::*;

/// Number t of other points within a nominal radius ([V11] §V, as in [L08]).
const NEIGHBORS: usize = 10;
/// Argument from which the Gaussian is zero ([V11] §V.A).
const GAUSSIAN_END: f64 = 4.0;
/// Term added to the diagonal of a singular Gaussian system, and its growth factor between
/// attempts.
const RIDGE: [f64; 2] = [1e-12, 100.0];
/// Maximum term on a diagonal of ones. With a larger term the functions do not interpolate.
const MAX_RIDGE: f64 = 1e-2;

/// Data of a point: three channels of a scalar and of a vector. The scalar is the component of the
/// vector along the point's normal.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PointSample {
    /// Value per channel, W/m².
    pub value: DVec3,
    /// Vector per channel. Only bases with vector coefficients read it.
    pub vector: [DVec3; 3],
}

/// Function on surfaces: three channels by position and unit normal. `None` outside of its domain.
pub type SurfaceField<'a> = Box<dyn Fn(Vec3, Vec3) -> Option<DVec3> + Sync + 'a>;

/// Errors of a fit.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PointBasisError {
    /// Number of samples that differs from the number of points.
    #[error("{samples} samples for {points} points")]
    Count {
        /// Number of points of the basis.
        points: usize,
        /// Number of samples.
        samples: usize,
    },
    /// Point, normal or sample that is not finite.
    #[error("point {0} or its sample is not finite")]
    NotFinite(usize),
    /// Gaussian system that cannot be solved.
    #[error(
        "the system of {points} Gaussian functions stays singular with {ridge:e} on its diagonal"
    )]
    Singular {
        /// Number of functions.
        points: usize,
        /// Largest ridge that was tried.
        ridge: f64,
    },
}

/// Basis over surface points. It maps samples at the points to a function on all surfaces.
pub trait PointBasis: Sync {
    /// Fits a function to these samples, one per point.
    ///
    /// # Errors
    /// Returns an error if the samples are not one per point or not finite.
    fn fit(&self, samples: &[PointSample]) -> Result<SurfaceField<'_>, PointBasisError>;

    /// Returns the term that was added to the diagonal of the basis' system. The diagonal entries
    /// themselves are 1. Returns 0 if the system is regular or the basis has none.
    fn ridge(&self) -> f64 {
        0.0
    }
}

/// Checks that each of `points` points has a finite sample.
///
/// # Errors
/// Returns an error if the counts differ or a sample is not finite.
pub fn check_samples(points: usize, samples: &[PointSample]) -> Result<(), PointBasisError> {
    if points != samples.len() {
        return Err(PointBasisError::Count {
            points,
            samples: samples.len(),
        });
    }
    let finite = |s: &PointSample| s.value.is_finite() && s.vector.iter().all(|v| v.is_finite());
    match samples.iter().position(|s| !finite(s)) {
        Some(i) => Err(PointBasisError::NotFinite(i)),
        None => Ok(()),
    }
}

/// Returns the normal-sensitive distance of \[V11\] Eq. (15), meters: |p − q| over the cosine of
/// the normals. It is infinite if the normals are 90° or more apart.
#[must_use]
pub fn site_distance(x_p: Vec3, n_p: Vec3, x_q: Vec3, n_q: Vec3) -> f64 {
    let cosine = f64::from(n_p.dot(n_q));
    if cosine <= 0.0 {
        return f64::INFINITY;
    }
    f64::from((x_p - x_q).length()) / cosine
}

fn check_points(points: &[(Vec3, Vec3)]) -> Result<(), PointBasisError> {
    match points
        .iter()
        .position(|(x, n)| !(x.is_finite() && n.is_finite()))
    {
        Some(i) => Err(PointBasisError::NotFinite(i)),
        None => Ok(()),
    }
}

/// Shepard's interpolation with inverse squared site distances over all points, ϕ^S of \[V11\] Eqs.
/// (14), (16).
#[derive(Clone, Debug)]
pub struct ShepardBasis(Vec<(Vec3, Vec3)>);

impl ShepardBasis {
    /// Creates the basis of points (x, n).
    ///
    /// # Errors
    /// Returns an error if a point is not finite.
    pub fn new(points: Vec<(Vec3, Vec3)>) -> Result<Self, PointBasisError> {
        check_points(&points)?;
        Ok(Self(points))
    }
}

impl PointBasis for ShepardBasis {
    fn fit(&self, samples: &[PointSample]) -> Result<SurfaceField<'_>, PointBasisError> {
        check_samples(self.0.len(), samples)?;
        let values: Vec<DVec3> = samples.iter().map(|s| s.value).collect();
        Ok(Box::new(move |x, n| {
            let (mut sum, mut weights) = (DVec3::ZERO, 0.0);
            for (&(x_j, n_j), value) in self.0.iter().zip(&values) {
                let d = site_distance(x, n, x_j, n_j);
                let w = 1.0 / (d * d);
                // The weight is infinite at a point, or if it overflows. The value is that of the
                // point.
                if w.is_infinite() {
                    return Some(*value);
                }
                sum += w * *value;
                weights += w;
            }
            (weights > 0.0).then(|| sum / weights)
        }))
    }
}

/// Gaussian radial functions over the site distance, ϕ^G of \[V11\] Eqs. (12), (17), with the
/// coefficients that pass through the samples.
#[derive(Clone, Debug)]
pub struct GaussianBasis {
    points: Vec<(Vec3, Vec3)>,
    /// Standard deviation of each function, meters.
    widths: Vec<f64>,
    system: Lu,
    ridge: f64,
}

impl GaussianBasis {
    /// Creates the basis of points (x, n). The standard deviation of each function is `width` times
    /// its nominal radius. The nominal radius is the site distance to the tenth nearest other
    /// point. If fewer points face the same way, it is the distance to the farthest of them. If the
    /// system is singular within rounding, a term is added to its diagonal. See
    /// [`PointBasis::ridge`].
    ///
    /// # Errors
    /// Returns an error if a point is not finite or the system stays singular.
    pub fn new(points: Vec<(Vec3, Vec3)>, width: f64) -> Result<Self, PointBasisError> {
        check_points(&points)?;
        let radii: Vec<f64> = (0..points.len())
            .into_par_iter()
            .map(|i| nominal_radius(&points, i))
            .collect();
        let widths: Vec<f64> = radii.iter().map(|a| width * a).collect();
        let row = |&(x, n): &(Vec3, Vec3)| -> Vec<f64> {
            let all = points.iter().zip(&widths);
            all.map(|(&(x_j, n_j), &s)| gaussian(site_distance(x, n, x_j, n_j) / s))
                .collect()
        };
        let rows: Vec<Vec<f64>> = points.par_iter().map(row).collect();
        let mut ridge = 0.0;
        loop {
            let mut matrix = rows.clone();
            for (i, row) in matrix.iter_mut().enumerate() {
                row[i] += ridge;
            }
            if let Some(system) = Lu::new(matrix) {
                return Ok(Self {
                    points,
                    widths,
                    system,
                    ridge,
                });
            }
            if ridge >= MAX_RIDGE {
                return Err(PointBasisError::Singular {
                    points: points.len(),
                    ridge,
                });
            }
            ridge = if ridge == 0.0 {
                RIDGE[0]
            } else {
                ridge * RIDGE[1]
            };
        }
    }

    /// Returns the smallest over the largest pivot of the system: about the reciprocal of its
    /// condition number.
    #[must_use]
    pub fn pivots(&self) -> f64 {
        self.system.pivots
    }
}

/// Computes G(r) of \[V11\] Eq. (12).
fn gaussian(r: f64) -> f64 {
    if r < GAUSSIAN_END {
        (-0.5 * r * r).exp()
    } else {
        0.0
    }
}

/// Returns the site distance of point `i` to the tenth nearest other point. Returns 1 m if the
/// distances to all others are infinite.
fn nominal_radius(points: &[(Vec3, Vec3)], i: usize) -> f64 {
    let (x, n) = points[i];
    let others = points.iter().enumerate().filter(|(j, _)| *j != i);
    let mut all: Vec<f64> = others
        .map(|(_, &(y, m))| site_distance(x, n, y, m))
        .filter(|d| d.is_finite() && *d > 0.0)
        .collect();
    all.sort_unstable_by(f64::total_cmp);
    let reached = all.get(NEIGHBORS - 1).or(all.last());
    reached.copied().unwrap_or(1.0)
}

impl PointBasis for GaussianBasis {
    fn fit(&self, samples: &[PointSample]) -> Result<SurfaceField<'_>, PointBasisError> {
        check_samples(self.points.len(), samples)?;
        let values: Vec<DVec3> = samples.iter().map(|s| s.value).collect();
        let coefficients = self.system.solve(&values);
        if let Some(i) = coefficients.iter().position(|c| !c.is_finite()) {
            return Err(PointBasisError::NotFinite(i));
        }
        Ok(Box::new(move |x, n| {
            let all = self.points.iter().zip(&self.widths).zip(&coefficients);
            let terms = all.map(|((&(x_j, n_j), &s), &c)| {
                let w = gaussian(site_distance(x, n, x_j, n_j) / s);
                w * c
            });
            Some(terms.sum())
        }))
    }

    fn ridge(&self) -> f64 {
        self.ridge
    }
}

/// Multilevel functions of \[L08\] Eqs. (1)-(7). The first level takes the samples. Each further
/// level takes the differences that remain at its points. One level is \[V11\]'s "Lehtinen's
/// basis".
#[derive(Clone, Copy, Debug)]
pub struct MultilevelBasis<'a>(pub &'a [LevelBasis]);

impl MultilevelBasis<'_> {
    /// Computes F_l(p) of \[L08\] Eq. (6) over `levels`. `coefficients` holds all levels in order.
    /// Returns `None` if no level covers the position.
    fn sum(
        levels: &[LevelBasis],
        coefficients: &[DVec3],
        x: Vec3,
        n: Vec3,
        found: &mut Vec<WeightEntry>,
    ) -> Option<DVec3> {
        let mut first = 0;
        let mut sum = None;
        for level in levels {
            if level.weights(x, n, found) {
                let own = found.iter();
                let own: DVec3 = own
                    .map(|w| f64::from(w.weight) * coefficients[first + w.index as usize])
                    .sum();
                sum = Some(sum.unwrap_or(DVec3::ZERO) + own);
            }
            first += level.points.len();
        }
        sum
    }
}

impl PointBasis for MultilevelBasis<'_> {
    fn fit(&self, samples: &[PointSample]) -> Result<SurfaceField<'_>, PointBasisError> {
        let points = self.0.iter().map(|level| level.points.len()).sum();
        check_samples(points, samples)?;
        let mut coefficients: Vec<DVec3> = Vec::with_capacity(points);
        for (l, level) in self.0.iter().enumerate() {
            let first = coefficients.len();
            let own: Vec<DVec3> = level
                .points
                .par_iter()
                .zip(&samples[first..])
                .map_init(Vec::new, |found, (p, sample)| {
                    let coarser = Self::sum(&self.0[..l], &coefficients, p.x(), p.n(), found);
                    sample.value - coarser.unwrap_or(DVec3::ZERO)
                })
                .collect();
            coefficients.extend(own);
        }
        Ok(Box::new(move |x, n| {
            Self::sum(self.0, &coefficients, x, n, &mut Vec::new())
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use meshless_gi::internals::samples::Point;

    fn points() -> Vec<(Vec3, Vec3)> {
        let lattice = (0..8).flat_map(|i| (0..8).map(move |j| (i, j)));
        lattice
            .map(|(i, j)| {
                let off = 0.3 * ((i * 5 + j * 3) % 4) as f32;
                (Vec3::new(i as f32, 0.0, j as f32 + off), Vec3::Y)
            })
            .collect()
    }

    fn samples(points: &[(Vec3, Vec3)]) -> Vec<PointSample> {
        let value = |x: Vec3| DVec3::new(1.0, f64::from(x.x), f64::from((0.7 * x.x).sin() + x.z));
        points
            .iter()
            .map(|&(x, _)| PointSample {
                value: value(x),
                ..PointSample::default()
            })
            .collect()
    }

    #[test]
    fn basis_distance_grows_with_normal_angle() {
        let tilted = Vec3::new(0.6, 0.8, 0.0);
        assert_eq!(site_distance(Vec3::ZERO, Vec3::Y, Vec3::X, Vec3::Y), 1.0);
        let d = site_distance(Vec3::ZERO, Vec3::Y, Vec3::X, tilted);
        assert!((d - 1.25).abs() < 1e-6, "{d}");
        let away = site_distance(Vec3::ZERO, Vec3::Y, Vec3::X, Vec3::NEG_Y);
        assert_eq!(away, f64::INFINITY);
    }

    #[test]
    fn shepard_and_gaussian_interpolate_samples() {
        let points = points();
        let samples = samples(&points);
        let shepard = ShepardBasis::new(points.clone()).expect("finite");
        let narrow = GaussianBasis::new(points.clone(), 0.25).expect("regular");
        let wide = GaussianBasis::new(points.clone(), 1.0).expect("regular");
        assert!(
            narrow.pivots() > 1e3 * wide.pivots(),
            "wide functions must have smaller pivots"
        );
        assert_eq!(narrow.ridge(), 0.0);
        for basis in [&shepard as &dyn PointBasis, &narrow, &wide] {
            let field = basis.fit(&samples).expect("one per point");
            for (&(x, n), sample) in points.iter().zip(&samples) {
                let found = field(x, n).expect("defined");
                assert!((found - sample.value).length() < 1e-6);
            }
        }
        // Shepard's functions sum to one, and they are flat near a point. Narrow Gaussians have
        // holes.
        let between = Vec3::new(3.5, 0.0, 3.6);
        let at = |basis: &dyn PointBasis| {
            let field = basis.fit(&samples).expect("one per point");
            field(between, Vec3::Y).expect("defined")
        };
        assert!((at(&shepard).x - 1.0).abs() < 1e-12);
        assert!((at(&narrow).x - 1.0).abs() > 1e-3);
        assert!((at(&wide) - DVec3::new(1.0, 3.5, 0.0)).truncate().length() < 0.02);
        let field = shepard.fit(&samples).expect("one per point");
        assert_eq!(field(between, Vec3::NEG_Y), None, "no point faces that way");
    }

    #[test]
    fn singular_basis_is_regularized_or_rejected() {
        let mut twice = points();
        twice.push(twice[11]);
        let basis = GaussianBasis::new(twice.clone(), 0.5).expect("with a ridge");
        assert!(basis.ridge() > 0.0);
        let samples = samples(&twice);
        let field = basis.fit(&samples).expect("one per point");
        let found = field(twice[11].0, Vec3::Y).expect("defined");
        assert!((found - samples[11].value).length() < 1e-3);
        let short = basis.fit(&samples[1..]).err();
        assert!(matches!(
            short,
            Some(PointBasisError::Count {
                points: 65,
                samples: 64
            })
        ));
        let mut bad = samples.clone();
        bad[3].value.y = f64::NAN;
        assert_eq!(basis.fit(&bad).err(), Some(PointBasisError::NotFinite(3)));
        twice[2].0.x = f32::INFINITY;
        assert_eq!(
            ShepardBasis::new(twice.clone()).err(),
            Some(PointBasisError::NotFinite(2))
        );
        assert!(GaussianBasis::new(twice, 1.0).is_err());
    }

    #[test]
    fn hierarchy_levels_add_residuals() {
        let points = points();
        let level = |of: &[(Vec3, Vec3)], radius| {
            let points = of.iter().map(|&(x, n)| Point::new(x, n, radius));
            LevelBasis::new(points.collect(), Vec::new())
        };
        let coarse: Vec<(Vec3, Vec3)> = points.iter().copied().step_by(5).collect();
        let levels = [level(&coarse, 4.0), level(&points, 2.5)];
        let all = [coarse.clone(), points.clone()].concat();
        let error = |basis: MultilevelBasis<'_>, at: &[(Vec3, Vec3)]| {
            let field = basis.fit(&samples(at)).expect("one per point");
            let there = samples(&points);
            let off = points.iter().zip(&there).map(|(&(x, n), s)| {
                let found = field(x, n).expect("covered");
                (found - s.value).length_squared()
            });
            off.sum::<f64>()
        };
        let one = error(MultilevelBasis(&levels[1..]), &points);
        let two = error(MultilevelBasis(&levels), &all);
        assert!(two < 0.8 * one, "{two} {one}");
        assert!(MultilevelBasis(&levels).fit(&samples(&points)).is_err());
    }
}
