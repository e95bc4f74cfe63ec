//! [V11]'s experiment with numbers: each basis writes down the light of the sphere over the disk
//! (`sphere_over_disk.rs`) from samples at the same points, and is compared with the solution of
//! the integral equations.
//!
//! The points are Poisson disks of the project's own sampling, at several spacings. Samples are
//! either the solution's own values at the points, which shows the basis alone, or, as in [V11]
//! §VII, what iteration in the basis itself gives: λ ← ε + Rλ with R's integrals over the basis
//! functions taken by quadrature (the paper takes them as point lights). Measured apart for sphere
//! and disk, in parts of the solution's root mean square there: root mean square error, largest
//! error, bias, and two measures of what [V11] names but does not define, oscillation:
//!
//! - *oscillation*: the total variation along a meridian of the sphere or a ray of the disk, over
//!   that of the solution, less 1, in the mean over the azimuths. Negative where an edge or a top
//!   is flattened.
//! - *unevenness*: the root mean square of what differs from the mean over all azimuths, which the
//!   solution does not: [V11]'s red line beside its black one.

use super::point_set::{Basis, PointSet};
use super::sphere_over_disk::{Site, Solution, SphereOverDisk};
use super::{PointBasis, PointBasisError, PointSample, SurfaceField};
use glam::{DVec3, Vec3};
use meshless_gi::internals::samples::Random;
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Noise of the noisy samples, relative to each.
const NOISE: f64 = 0.05;
/// Iterations of λ ← ε + Rλ: each gains a factor of forty, see [`Solution::iterations`].
const ITERATIONS: usize = 8;
/// Azimuths of the grid that errors are measured on.
const AZIMUTHS: usize = 64;
/// Latitudes and radii of it; a cell ends at the shadow's edge of \[V11\]'s scene.
const LATITUDES: usize = 120;
const RADII: usize = 200;

/// Recorded quantity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Direct and reflected light together, B and D of \[V11\]: with the shadow's edge.
    Total,
    /// Reflected light alone, B⁺ and D⁺: what this project writes in its basis.
    Indirect,
    /// Reflected light with noise of 5 % on each sample, as Monte Carlo leaves it.
    Noisy,
    /// As `Total`, iterated in the basis.
    SolvedTotal,
    /// As `Indirect`, iterated in the basis with the direct light in it, as in \[V11\].
    SolvedIndirect,
}

/// Errors on one of the surfaces, in parts of the solution's root mean square there (bias: of its
/// mean).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SurfaceErrors {
    /// Root mean square error, by area.
    pub rmse: f64,
    /// Largest error.
    pub largest: f64,
    /// Total variation along meridians or rays over the solution's, less 1.
    pub oscillation: f64,
    /// Root mean square of what differs from the mean over the azimuths.
    pub unevenness: f64,
    /// Mean error over the mean.
    pub bias: f64,
    /// Share of the positions without a value, which count as 0.
    pub uncovered: f64,
}

/// A row of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ComparisonRow {
    /// Basis of the row.
    pub basis: Basis,
    /// Smallest distance of two points, meters.
    pub spacing: f64,
    /// Number of points that have a sample.
    pub points: usize,
    /// Recorded quantity.
    pub quantity: Quantity,
    /// On the sphere.
    pub sphere: SurfaceErrors,
    /// On the disk.
    pub disk: SurfaceErrors,
    /// [`PointBasis::ridge`] of the basis.
    pub ridge: f64,
}

/// The solution's values at points: total, indirect, and indirect with noise, as radiosity; the
/// vectors are β times the vector irradiances.
#[must_use]
pub fn exact_samples(solution: &Solution, points: &[(Vec3, Vec3)], seed: u64) -> Vec<PointSample> {
    let sample = |(i, &(x, _)): (usize, &(Vec3, Vec3))| {
        let site = solution.scene.site(x);
        let mut random = Random::new(seed, 0x6e_6f_69_73, i as u64);
        // Twelve uniform numbers: a normal deviate, near enough.
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

/// β times the vector irradiance of the light itself.
fn direct_vector(scene: &SphereOverDisk, site: Site) -> DVec3 {
    let lit = scene.direct(site) > 0.0;
    DVec3::Y * if lit { scene.albedo * scene.light } else { 0.0 }
}

/// A position of the grid on both surfaces.
struct SamplePoint {
    x: Vec3,
    n: Vec3,
    site: Site,
    /// m².
    area: f64,
}

/// The grid: all azimuths of the first latitude, of the second, …; then of the radii.
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

/// The field at the positions, None as None.
fn evaluate(field: &SurfaceField<'_>, samples: &[SamplePoint]) -> Vec<Option<DVec3>> {
    samples.par_iter().map(|p| field(p.x, p.n)).collect()
}

/// Errors of one channel on one surface.
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

/// λ ← ε + Rλ in a basis (\[V11\] Eq. (19)): samples of total and of reflected light at the points
/// that the field through them gives back. The integral over the field is taken over the grid,
/// exactly enough not to be seen.
///
/// # Errors
/// As [`PointBasis::fit`].
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
                // What the sphere gets comes from the disk, and the other way round.
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

/// Compares bases over one set of points with `truth`, one row a basis and quantity. The samples
/// are `known`'s, which is the truth itself, except in the check that another answer is
/// noticed. `solved` asks for the iteration in the bases, too. There the plugin's basis iterates as
/// the plugin does: with scalars (design D1), and vectors for the display.
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
                Basis::Ours | Basis::OursTwice => {
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
