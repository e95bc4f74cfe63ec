//! The experiment of [V11] with error measures. Each basis represents the light of the sphere over
//! the disk (`sphere_over_disk.rs`) from samples at the same points. The result is compared with
//! the solution of the integral equations.
//!
//! The points are Poisson disks of the project's own sampling, at several spacings. Samples of the
//! solution at the points measure the basis alone. Alternatively, as in [V11] §VII, samples come
//! from the iteration λ ← ε + Rλ in the basis itself. There R's integrals over the basis functions
//! are taken by quadrature, while the paper takes them as point lights.
//!
//! Errors are measured separately for sphere and disk, relative to the solution's root mean square
//! there: root mean square error, largest error, bias, and two measures of oscillation. [V11] names
//! oscillation but does not define it:
//!
//! - *oscillation*: the total variation along a meridian of the sphere or a ray of the disk,
//!   divided by that of the solution, minus 1. It is the mean over the azimuths. It is negative if
//!   an edge or a peak is flattened.
//! - *unevenness*: the root mean square of the deviation from the mean over all azimuths. The
//!   solution has none. In [V11] it is the difference between the red and the black line.

use super::point_set::{Basis, PointSet};
use super::sphere_over_disk::{Site, Solution, SphereOverDisk};
use super::{PointBasis, PointBasisError, PointSample, SurfaceField};
use glam::{DVec3, Vec3};
use meshless_gi::internals::samples::Random;
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Noise of the noisy samples, relative to each.
const NOISE: f64 = 0.05;
/// Iterations of λ ← ε + Rλ. Each reduces the error by a factor of forty. See
/// [`Solution::iterations`].
const ITERATIONS: usize = 8;
/// Azimuths of the error grid.
const AZIMUTHS: usize = 64;
/// Latitudes and radii of the error grid. A cell ends at the shadow's edge of \[V11\]'s scene.
const LATITUDES: usize = 120;
const RADII: usize = 200;

/// Represented quantity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Direct and reflected light together, B and D of \[V11\], with the shadow's edge.
    Total,
    /// Reflected light alone, B⁺ and D⁺. This project represents it in its basis.
    Indirect,
    /// Reflected light with 5 % noise on each sample, as Monte Carlo leaves it.
    Noisy,
    /// `Total`, iterated in the basis.
    SolvedTotal,
    /// `Indirect`, iterated in the basis with the direct light in it, as in \[V11\].
    SolvedIndirect,
}

/// Errors on one of the surfaces, relative to the solution's root mean square there. The bias is
/// relative to its mean.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SurfaceErrors {
    /// Root mean square error, weighted by area.
    pub rmse: f64,
    /// Largest error.
    pub largest: f64,
    /// Total variation along meridians or rays, divided by the solution's, minus 1.
    pub oscillation: f64,
    /// Root mean square of the deviation from the mean over the azimuths.
    pub unevenness: f64,
    /// Mean error over the mean.
    pub bias: f64,
    /// Fraction of the positions without a value. They count as 0.
    pub uncovered: f64,
}

/// Row of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ComparisonRow {
    /// Basis of the row.
    pub basis: Basis,
    /// Minimum distance of two points, meters.
    pub spacing: f64,
    /// Number of points with a sample.
    pub points: usize,
    /// Represented quantity.
    pub quantity: Quantity,
    /// Errors on the sphere.
    pub sphere: SurfaceErrors,
    /// Errors on the disk.
    pub disk: SurfaceErrors,
    /// [`PointBasis::ridge`] of the basis.
    pub ridge: f64,
}

/// Returns the solution's values at points as radiosity: total, indirect, and indirect with noise.
/// The vectors are β times the vector irradiances.
#[must_use]
pub fn exact_samples(solution: &Solution, points: &[(Vec3, Vec3)], seed: u64) -> Vec<PointSample> {
    let sample = |(i, &(x, _)): (usize, &(Vec3, Vec3))| {
        let site = solution.scene.site(x);
        let mut random = Random::new(seed, 0x6e_6f_69_73, i as u64);
        // Sum of twelve uniform numbers: approximately a normal deviate.
        let deviate: f64 = (0..12).map(|_| f64::from(random.unit())).sum::<f64>() - 6.0;
        let noise = 1.0 + NOISE * deviate;
        let indirect = solution.indirect(site);
        let reflected = solution.scene.albedo * solution.vector(x);
        let direct = direct_vector(&solution.scene, site);
        PointSample {
            value: DVec3::new(solution.total(site), indirect, noise * indirect),
            vector: [reflected + direct, reflected, noise * reflected],
        }
    };
    points.iter().enumerate().map(sample).collect()
}

/// Returns β times the vector irradiance of the light itself.
fn direct_vector(scene: &SphereOverDisk, site: Site) -> DVec3 {
    let lit = scene.direct(site) > 0.0;
    DVec3::Y * if lit { scene.albedo * scene.light } else { 0.0 }
}

/// Position of the grid on one of the surfaces.
struct SamplePoint {
    x: Vec3,
    n: Vec3,
    site: Site,
    /// Area of the cell, m².
    area: f64,
}

/// Returns the grid, ordered by latitude or radius, then by azimuth.
fn grid(scene: &SphereOverDisk) -> [Vec<SamplePoint>; 2] {
    let turns: Vec<(f64, f64)> = (0..AZIMUTHS)
        .map(|k| (TAU * (k as f64 + 0.37) / AZIMUTHS as f64).sin_cos())
        .collect();
    let sphere = (0..LATITUDES).flat_map(|i| {
        let step = PI / LATITUDES as f64;
        let latitude = -FRAC_PI_2 + (i as f64 + 0.5) * step;
        let (sine, cosine) = latitude.sin_cos();
        let area = scene.radius * scene.radius * cosine * step * TAU / AZIMUTHS as f64;
        turns.iter().map(move |&(s, c)| {
            let n = DVec3::new(cosine * c, sine, cosine * s);
            SamplePoint {
                x: (n * scene.radius + DVec3::Y * scene.height).as_vec3(),
                n: n.as_vec3(),
                site: Site::Sphere(latitude),
                area,
            }
        })
    });
    let disk = (0..RADII).flat_map(|i| {
        let step = scene.disk / RADII as f64;
        let u = (i as f64 + 0.5) * step;
        let area = u * step * TAU / AZIMUTHS as f64;
        turns.iter().map(move |&(s, c)| SamplePoint {
            x: DVec3::new(u * c, 0.0, u * s).as_vec3(),
            n: Vec3::Y,
            site: Site::Disk(u),
            area,
        })
    });
    [sphere.collect(), disk.collect()]
}

/// Evaluates the field at the positions.
fn evaluate(field: &SurfaceField<'_>, samples: &[SamplePoint]) -> Vec<Option<DVec3>> {
    samples.par_iter().map(|p| field(p.x, p.n)).collect()
}

/// Computes the errors of one channel on one surface.
fn errors_of(
    samples: &[SamplePoint],
    found: &[Option<DVec3>],
    channel: usize,
    truth: &dyn Fn(Site) -> f64,
) -> SurfaceErrors {
    let lines = samples.len() / AZIMUTHS;
    let value = |i: usize, k: usize| found[i * AZIMUTHS + k].map_or(0.0, |v| v[channel]);
    let right: Vec<f64> = (0..lines)
        .map(|i| truth(samples[i * AZIMUTHS].site))
        .collect();
    let (mut area, mut square, mut power, mut off, mut mean, mut uneven) =
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    let mut largest = 0.0f64;
    for (i, &right) in right.iter().enumerate() {
        let own = samples[i * AZIMUTHS].area;
        let around: f64 = (0..AZIMUTHS).map(|k| value(i, k)).sum::<f64>() / AZIMUTHS as f64;
        for k in 0..AZIMUTHS {
            let error = value(i, k) - right;
            area += own;
            square += own * error * error;
            power += own * right * right;
            off += own * error;
            mean += own * right;
            uneven += own * (value(i, k) - around).powi(2);
            largest = largest.max(error.abs());
        }
    }
    let scale = (power / area).sqrt();
    let variation =
        |at: &dyn Fn(usize) -> f64| -> f64 { (1..lines).map(|i| (at(i) - at(i - 1)).abs()).sum() };
    let varied: f64 = (0..AZIMUTHS)
        .map(|k| variation(&|i| value(i, k)))
        .sum::<f64>()
        / AZIMUTHS as f64;
    let missing = found.iter().filter(|v| v.is_none()).count();
    SurfaceErrors {
        rmse: (square / area).sqrt() / scale,
        largest: largest / scale,
        oscillation: varied / variation(&|i| right[i]) - 1.0,
        unevenness: (uneven / area).sqrt() / scale,
        bias: off / mean,
        uncovered: missing as f64 / found.len() as f64,
    }
}

/// Iterates λ ← ε + Rλ in a basis (\[V11\] Eq. (19)). Returns converged samples of total and of
/// reflected light at the points. The integral over the field is taken over the grid. Its error is
/// negligible.
///
/// # Errors
/// See [`PointBasis::fit`].
pub fn solve_in(
    basis: &dyn PointBasis,
    points: &[(Vec3, Vec3)],
    scene: &SphereOverDisk,
) -> Result<Vec<PointSample>, PointBasisError> {
    let grid = grid(scene);
    let direct: Vec<(f64, DVec3)> = points
        .iter()
        .map(|&(x, _)| {
            let site = scene.site(x);
            (scene.direct(site), direct_vector(scene, site))
        })
        .collect();
    let with = |reflected: &[(f64, DVec3)]| -> Vec<PointSample> {
        let pairs = direct.iter().zip(reflected);
        pairs
            .map(|(d, r)| PointSample {
                value: DVec3::new(d.0 + r.0, r.0, 0.0),
                vector: [d.1 + r.1, r.1, DVec3::ZERO],
            })
            .collect()
    };
    let mut samples = with(&vec![(0.0, DVec3::ZERO); points.len()]);
    for _ in 0..ITERATIONS {
        let field = basis.fit(&samples)?;
        let lit: [Vec<(DVec3, DVec3, f64)>; 2] = [0, 1].map(|k| {
            let values = evaluate(&field, &grid[k]);
            grid[k]
                .iter()
                .zip(values)
                .map(|(p, v)| {
                    let leaves = v.map_or(0.0, |v| v.x) * p.area;
                    (p.x.as_dvec3(), p.n.as_dvec3(), leaves)
                })
                .collect()
        });
        let reflected: Vec<(f64, DVec3)> = points
            .par_iter()
            .map(|&(x, n)| {
                // The sphere receives light from the disk, and the disk from the sphere.
                let from = match scene.site(x) {
                    Site::Sphere(_) => &lit[1],
                    Site::Disk(_) => &lit[0],
                };
                let (x, n) = (x.as_dvec3(), n.as_dvec3());
                let mut sum = DVec3::ZERO;
                for &(y, m, leaves) in from {
                    let way = y - x;
                    let facing = -way.dot(m);
                    if facing > 0.0 && way.dot(n) > 0.0 {
                        sum += way * (facing * leaves / way.length_squared().powi(2));
                    }
                }
                let e = sum * (scene.albedo / PI);
                (e.dot(n), e)
            })
            .collect();
        samples = with(&reflected);
    }
    Ok(samples)
}

/// Compares bases over one set of points with `truth`, one row per basis and quantity. The samples
/// are those of `known`. It is `truth` itself, except in the test that a wrong solution is
/// detected. `solved` adds the iteration in the bases. There the plugin's basis iterates as the
/// plugin does: with scalars (design D1), and with vectors for the display.
///
/// # Errors
/// Returns an error if a Gaussian system cannot be solved.
pub fn compare_bases(
    set: &PointSet,
    known: &Solution,
    truth: &Solution,
    bases: &[Basis],
    solved: bool,
    seed: u64,
) -> Result<Vec<ComparisonRow>, PointBasisError> {
    let grid = grid(&known.scene);
    let total = |site: Site| truth.total(site);
    let indirect = |site: Site| truth.indirect(site);
    let mut rows = Vec::new();
    for &which in bases {
        let basis = set.build(which)?;
        let points = set.points(which);
        let mut add = |samples: &[PointSample], quantities: &[Quantity]| {
            let field = basis.fit(samples)?;
            let found = [evaluate(&field, &grid[0]), evaluate(&field, &grid[1])];
            for (channel, &quantity) in quantities.iter().enumerate() {
                let right: &dyn Fn(Site) -> f64 = if channel == 0 { &total } else { &indirect };
                let errors = |k: usize| errors_of(&grid[k], &found[k], channel, right);
                rows.push(ComparisonRow {
                    basis: which,
                    spacing: set.spacing,
                    points: points.len(),
                    quantity,
                    sphere: errors(0),
                    disk: errors(1),
                    ridge: basis.ridge(),
                });
            }
            Ok::<(), PointBasisError>(())
        };
        add(
            &exact_samples(known, &points, seed),
            &[Quantity::Total, Quantity::Indirect, Quantity::Noisy],
        )?;
        if solved {
            let samples = match which {
                Basis::FlatVector | Basis::CorrectedFlatVector => {
                    let scalars = set.build(Basis::Flat)?;
                    solve_in(scalars.as_ref(), &points, &known.scene)?
                }
                _ => solve_in(basis.as_ref(), &points, &known.scene)?,
            };
            add(&samples, &[Quantity::SolvedTotal, Quantity::SolvedIndirect])?;
        }
    }
    Ok(rows)
}
