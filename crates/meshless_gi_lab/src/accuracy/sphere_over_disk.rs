//! Reference solution of the scene of [V11] §VIII: a sphere over a disk under light from straight
//! above, as two coupled integral equations.
//!
//! By symmetry the radiosity depends on one number on each surface. It is B(ζ) on the sphere, by
//! latitude, and D(u) on the disk, by radius ([V11] Eqs. (20), (21)):
//!
//! B(ζ) = B*(ζ) + β ∫₀ᴿ D(u) ∮ F(u, τ, ζ) dτ u du, D(u) = D*(u) + β ∫ B(ζ) ∮ F(u, τ, ζ) dτ r² cos ζ
//! dζ,
//!
//! F = max(0, n_p·(q − p)) max(0, n_q·(p − q)) / (π |q − p|⁴) for p on the sphere and q on the
//! disk. Both surfaces have zero form factor to themselves. The parts of the other surface that are
//! not visible from a position lie behind its horizon. F needs no further visibility term ([V11]
//! §VIII).
//!
//! [`SphereOverDisk::solve`] computes the inner integral in closed form. It computes the outer
//! integrals by the midpoint rule over cells that end at the shadow's edge. Its error falls with
//! the square of the cell size. [`SphereOverDisk::solve_sums`] is the discretization of [V11] Eqs.
//! (22), (23): plain sums over evenly spaced latitudes, radii and azimuths. The paper uses n = 100.
//! The thirteenth radius is then 5, exactly the shadow's edge, and half a cell receives too little
//! light.
//!
//! The text of the available copy of [V11] is damaged. The constants follow from these constraints:
//!
//! - Eq. (5) must be K = (1/π) cos / d². Otherwise the disk would send the sphere more light than
//!   it has.
//! - With r = 5, R = 40, h = 20, β = 0.9, μ = 0.9 the largest B⁺ is 0.577, and D* = βμ = 0.81. The
//!   axes of the paper's Figure 10 end above these values (0.6 and 1). With μ = 1 the largest B⁺
//!   would exceed 0.6.
//! - h is the height of the sphere's center.

use glam::{DVec2, DVec3, Vec3};
use meshless_gi::Light;
use meshless_gi::internals::scene::{ImplicitObject, ImplicitScene, Shape};
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Convergence threshold: change between two iterations, relative to the direct light.
const CONVERGENCE_THRESHOLD: f64 = 1e-14;
/// Maximum number of iterations. It is never reached, because the gain of two reflections is below
/// one half.
const MAX_ITERATIONS: usize = 1000;
/// Maximum number of cells. The solver stores two kernels of the square of this number.
const MAX_CELLS: usize = 8192;

/// Sphere over a disk. Its origin is the center of the disk, +Y is up. Lengths in meters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SphereOverDisk {
    /// Radius r of the sphere.
    pub radius: f64,
    /// Radius R of the disk.
    pub disk: f64,
    /// Height h of the sphere's center over the disk.
    pub height: f64,
    /// Reflectance β of both surfaces.
    pub albedo: f64,
    /// Irradiance μ of a surface that faces the light, W/m².
    pub light: f64,
}

impl Default for SphereOverDisk {
    /// Returns the scene of \[V11\]: r = 5, R = 40, h = 20, β = 0.9, μ = 0.9.
    fn default() -> Self {
        Self {
            radius: 5.0,
            disk: 40.0,
            height: 20.0,
            albedo: 0.9,
            light: 0.9,
        }
    }
}

/// Errors of the solver.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SphereOverDiskError {
    /// Length, reflectance or light out of range.
    #[error(
        "invalid scene {0:?}: 0 < radius < disk, radius < height, 0 ≤ albedo ≤ 1 and 0 ≤ light must hold, all finite"
    )]
    Scene(SphereOverDisk),
    /// Number of cells out of range.
    #[error("{0} cells: must be 8 to {MAX_CELLS}")]
    Cells(usize),
}

/// Radiosities that solve the two equations.
#[derive(Clone, Debug)]
pub struct Solution {
    /// Scene of the solution.
    pub scene: SphereOverDisk,
    /// Latitudes ζ of the cell centers, radians, ascending.
    pub latitudes: Vec<f64>,
    /// B(ζ) − B*(ζ) at the latitudes, W/m².
    pub sphere: Vec<f64>,
    /// Vector irradiance of the reflected light at the latitudes, W/m²: outwards from the axis, and
    /// up. Empty for [`SphereOverDisk::solve_sums`].
    pub vectors: Vec<DVec2>,
    /// Radii u of the cell centers, meters, ascending.
    pub radii: Vec<f64>,
    /// D(u) − D*(u) at the radii, W/m².
    pub disk: Vec<f64>,
    /// Number of iterations of λ ← ε + Rλ.
    pub iterations: usize,
}

/// Position on one of the two surfaces, by its coordinate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Site {
    /// Latitude on the sphere, radians.
    Sphere(f64),
    /// Distance from the axis on the disk, meters.
    Disk(f64),
}

impl SphereOverDisk {
    fn check(&self) -> Result<(), SphereOverDiskError> {
        let all = [self.radius, self.disk, self.height, self.albedo, self.light];
        let sound = all.iter().all(|v| v.is_finite())
            && self.radius > 0.0
            && self.radius < self.disk
            && self.radius < self.height
            && (0.0..=1.0).contains(&self.albedo)
            && self.light >= 0.0;
        if sound {
            Ok(())
        } else {
            Err(SphereOverDiskError::Scene(*self))
        }
    }

    /// Returns B*(ζ) = βμ max(0, sin ζ) (\[V11\] Eq. (20)), W/m².
    #[must_use]
    pub fn direct_sphere(&self, latitude: f64) -> f64 {
        self.albedo * self.light * latitude.sin().max(0.0)
    }

    /// Returns D*(u), W/m²: βμ outside of the sphere's shadow, 0 in it (\[V11\] Eq. (20)).
    #[must_use]
    pub fn direct_disk(&self, u: f64) -> f64 {
        if self.radius < u && u < self.disk {
            self.albedo * self.light
        } else {
            0.0
        }
    }

    /// Returns the direct radiosity, W/m².
    #[must_use]
    pub fn direct(&self, site: Site) -> f64 {
        match site {
            Site::Sphere(latitude) => self.direct_sphere(latitude),
            Site::Disk(u) => self.direct_disk(u),
        }
    }

    /// Returns the coordinate of a position on or near one of the surfaces.
    #[must_use]
    pub fn site(&self, x: Vec3) -> Site {
        let from_center = x.as_dvec3() - DVec3::Y * self.height;
        let distance = from_center.length();
        if distance < 0.5 * (self.radius + self.height) {
            let sine = (from_center.y / distance.max(f64::MIN_POSITIVE)).clamp(-1.0, 1.0);
            Site::Sphere(sine.asin())
        } else {
            Site::Disk(f64::from(x.x).hypot(f64::from(x.z)))
        }
    }

    /// Returns geometry for ray casts: the sphere, and the disk as the upper end of a flat
    /// cylinder.
    #[must_use]
    pub fn geometry(&self) -> ImplicitScene {
        let object = |shape| ImplicitObject {
            shape,
            albedo: Vec3::splat(self.albedo as f32),
            radiance: Vec3::ZERO,
        };
        ImplicitScene::new(vec![
            object(Shape::Sphere {
                center: Vec3::Y * self.height as f32,
                radius: self.radius as f32,
            }),
            object(Shape::Cylinder {
                center: Vec3::NEG_Y,
                axis: Vec3::Y,
                radius: self.disk as f32,
                half_height: 1.0,
            }),
        ])
    }

    /// Returns the light: parallel, from straight above.
    #[must_use]
    pub fn lights(&self) -> Vec<Light> {
        vec![Light::Directional {
            direction: Vec3::NEG_Y,
            irradiance: Vec3::splat(self.light as f32),
        }]
    }

    /// Computes ∮ (a + b cos τ) / |q − p|⁴ dτ. The azimuths τ are those at which the sphere's
    /// position at `latitude` and the disk's position at `u` are visible from each other.
    ///
    /// With |q − p|² = c − e cos τ, J = ∫ dτ / (c − e cos τ) = 2 / √(c² − e²) · atan(√((c + e) / (c
    /// − e)) tan(τ/2)) and s = sin τ / (c − e cos τ): ∫ dτ / (c − e cos τ)² = (e s + c J) / (c² −
    /// e²) and ∫ cos τ dτ / (c − e cos τ)² = (c s + e J) / (c² − e²).
    fn ring(&self, latitude: f64, u: f64, a: f64, b: f64) -> f64 {
        let (sine, cosine) = latitude.sin_cos();
        let (rho, y) = (self.radius * cosine, self.height + self.radius * sine);
        // n_p·(q − p) = u cos ζ cos τ − (r + h sin ζ) is positive for |τ| below this.
        let (min, max) = (self.radius + self.height * sine, u * cosine);
        let end = if min >= max {
            return 0.0;
        } else if min <= -max {
            PI
        } else {
            (min / max).acos()
        };
        let c = u * u + rho * rho + y * y;
        let e = 2.0 * u * rho;
        let root = (c - e) * (c + e);
        let j = 2.0 / root.sqrt() * (((c + e) / (c - e)).sqrt() * (0.5 * end).tan()).atan();
        let s = end.sin() / (c - e * end.cos());
        2.0 * (a * (e * s + c * j) + b * (c * s + e * j)) / root
    }

    /// Computes ∮ F dτ, 1/m².
    fn form(&self, latitude: f64, u: f64) -> f64 {
        let (sine, cosine) = latitude.sin_cos();
        let y = (self.height + self.radius * sine) / PI;
        let a = -(self.radius + self.height * sine) * y;
        self.ring(latitude, u, a, u * cosine * y)
    }

    /// Computes the vector irradiance at the sphere's position, outwards and up. The source is a
    /// ring of the disk with 1 W/m² and a circumference of one meter per radian.
    fn vector(&self, latitude: f64, u: f64) -> DVec2 {
        let (sine, cosine) = latitude.sin_cos();
        let (rho, y) = (self.radius * cosine, self.height + self.radius * sine);
        let outwards = self.ring(latitude, u, -rho * y / PI, u * y / PI);
        DVec2::new(outwards, self.ring(latitude, u, -y * y / PI, 0.0))
    }

    /// Computes F at one azimuth, 1/m².
    fn form_factor(&self, latitude: f64, u: f64, azimuth: f64) -> f64 {
        let (sine, cosine) = latitude.sin_cos();
        let p = DVec3::new(self.radius * cosine, self.height + self.radius * sine, 0.0);
        let to_disk = DVec3::new(u * azimuth.cos(), 0.0, u * azimuth.sin()) - p;
        let facing = to_disk.dot(DVec3::new(cosine, sine, 0.0)).max(0.0);
        facing * p.y / (PI * to_disk.length_squared().powi(2))
    }

    /// Solves the equations with `cells` latitudes and about as many radii.
    ///
    /// # Errors
    /// Returns an error if the scene is out of range, or the number of cells is not between 8 and
    /// 8192.
    pub fn solve(&self, cells: usize) -> Result<Solution, SphereOverDiskError> {
        self.check()?;
        check_cells(cells)?;
        // With an even number, a cell ends at the equator, where B* has its kink.
        let cells = cells.next_multiple_of(2);
        let latitudes = cell_centers(-FRAC_PI_2, FRAC_PI_2, cells);
        let dark = (cells as f64 * self.radius / self.disk).ceil() as usize;
        let dark = dark.clamp(1, cells - 1);
        let mut radii = cell_centers(0.0, self.radius, dark);
        radii.extend(cell_centers(self.radius, self.disk, cells - dark));
        let bands: Vec<f64> = latitudes
            .iter()
            .map(|z| self.radius * self.radius * z.cos() * PI / cells as f64)
            .collect();
        let widths = |j: usize| {
            if j < dark {
                self.radius / dark as f64
            } else {
                (self.disk - self.radius) / (cells - dark) as f64
            }
        };
        let rings: Vec<f64> = (0..cells).map(|j| radii[j] * widths(j)).collect();
        let form = rows(&latitudes, |z| {
            radii.iter().map(|&u| self.form(z, u)).collect()
        });
        let mut solution = self.iterate(latitudes, radii, &form, &bands, &rings);
        let disk: Vec<f64> = (0..cells)
            .map(|j| rings[j] * (solution.disk[j] + self.direct_disk(solution.radii[j])))
            .collect();
        solution.vectors = rows(&solution.latitudes, |z| {
            let all = solution.radii.iter().zip(&disk);
            all.map(|(&u, &d)| d * self.vector(z, u)).sum()
        });
        Ok(solution)
    }

    /// Solves the equations by \[V11\] Eqs. (22), (23) with n = m = k = `n`: evenly spaced
    /// latitudes, radii and azimuths, each at the center of its cell.
    ///
    /// # Errors
    /// See [`solve`](Self::solve).
    pub fn solve_sums(&self, n: usize) -> Result<Solution, SphereOverDiskError> {
        self.check()?;
        check_cells(n)?;
        let latitudes = cell_centers(-FRAC_PI_2, FRAC_PI_2, n);
        let radii = cell_centers(0.0, self.disk, n);
        let azimuths = cell_centers(0.0, TAU, n);
        let part = 1.0 / n as f64;
        let bands: Vec<f64> = latitudes
            .iter()
            .map(|z| self.radius * self.radius * z.cos() * PI * part)
            .collect();
        let rings: Vec<f64> = radii.iter().map(|u| u * self.disk * part).collect();
        let form = rows(&latitudes, |z| {
            let sum = |&u: &f64| {
                azimuths
                    .iter()
                    .map(|&t| self.form_factor(z, u, t))
                    .sum::<f64>()
            };
            radii.iter().map(|u| sum(u) * TAU * part).collect()
        });
        Ok(self.iterate(latitudes, radii, &form, &bands, &rings))
    }

    /// Iterates λ ← ε + Rλ until it converges (\[V11\] §VII, Eq. (24)). `form[i][j]` is ∮ F dτ.
    /// `bands` and `rings` are the measures r² cos ζ dζ and u du.
    fn iterate(
        &self,
        latitudes: Vec<f64>,
        radii: Vec<f64>,
        form: &[Vec<f64>],
        bands: &[f64],
        rings: &[f64],
    ) -> Solution {
        let direct_b: Vec<f64> = latitudes.iter().map(|&z| self.direct_sphere(z)).collect();
        let direct_d: Vec<f64> = radii.iter().map(|&u| self.direct_disk(u)).collect();
        let (mut b, mut d) = (vec![0.0; latitudes.len()], vec![0.0; radii.len()]);
        let mut iterations = 0;
        while iterations < MAX_ITERATIONS {
            iterations += 1;
            let leaves = |direct: &[f64], more: &[f64], area: &[f64]| -> Vec<f64> {
                (0..area.len())
                    .map(|i| self.albedo * (direct[i] + more[i]) * area[i])
                    .collect()
            };
            let from_disk = leaves(&direct_d, &d, rings);
            let from_sphere = leaves(&direct_b, &b, bands);
            let next_b: Vec<f64> = form
                .par_iter()
                .map(|row| row.iter().zip(&from_disk).map(|(f, d)| f * d).sum())
                .collect();
            let mut next_d = vec![0.0; radii.len()];
            for (row, b) in form.iter().zip(&from_sphere) {
                for (d, f) in next_d.iter_mut().zip(row) {
                    *d += f * b;
                }
            }
            let change = |a: &[f64], b: &[f64]| {
                let pairs = a.iter().zip(b);
                pairs.fold(0.0f64, |max, (a, b)| max.max((a - b).abs()))
            };
            let max = change(&b, &next_b).max(change(&d, &next_d));
            (b, d) = (next_b, next_d);
            if max <= CONVERGENCE_THRESHOLD * self.albedo * self.light {
                break;
            }
        }
        Solution {
            scene: *self,
            latitudes,
            sphere: b,
            vectors: Vec::new(),
            radii,
            disk: d,
            iterations,
        }
    }
}

fn check_cells(cells: usize) -> Result<(), SphereOverDiskError> {
    if (8..=MAX_CELLS).contains(&cells) {
        Ok(())
    } else {
        Err(SphereOverDiskError::Cells(cells))
    }
}

/// Returns the centers of `count` equal cells.
fn cell_centers(from: f64, to: f64, count: usize) -> Vec<f64> {
    // The product comes first: the thirteenth of a hundred radii up to 40 is exactly 5, and
    // rounding does not move it off the shadow's edge.
    let at = |k: usize| from + (k as f64 + 0.5) * (to - from) / count as f64;
    (0..count).map(at).collect()
}

fn rows<T: Send>(latitudes: &[f64], row: impl Fn(f64) -> T + Sync) -> Vec<T> {
    latitudes.par_iter().map(|&z| row(z)).collect()
}

/// Interpolates linearly between the positions. Extrapolates linearly beyond the outermost ones.
fn interpolate_linearly<T>(positions: &[f64], values: &[T], at: f64) -> T
where
    T: Copy
        + std::ops::Add<Output = T>
        + std::ops::Sub<Output = T>
        + std::ops::Mul<f64, Output = T>,
{
    let i = positions
        .partition_point(|&p| p < at)
        .clamp(1, positions.len() - 1);
    let t = (at - positions[i - 1]) / (positions[i] - positions[i - 1]);
    values[i - 1] + (values[i] - values[i - 1]) * t
}

impl Solution {
    /// Returns the radiosity of reflected light, B⁺ or D⁺ of \[V11\] Figure 10, W/m².
    #[must_use]
    pub fn indirect(&self, site: Site) -> f64 {
        match site {
            Site::Sphere(latitude) => interpolate_linearly(&self.latitudes, &self.sphere, latitude),
            Site::Disk(u) => interpolate_linearly(&self.radii, &self.disk, u),
        }
    }

    /// Returns the total radiosity, B or D, W/m².
    #[must_use]
    pub fn total(&self, site: Site) -> f64 {
        self.indirect(site) + self.scene.direct(site)
    }

    /// Returns the vector irradiance of the reflected light at `x`, W/m², over the hemisphere of
    /// the surface normal. On the disk the normal is up everywhere, and only the vertical component
    /// is returned.
    #[must_use]
    pub fn vector(&self, x: Vec3) -> DVec3 {
        match self.scene.site(x) {
            Site::Disk(u) => {
                let part = self.indirect(Site::Disk(u)) / self.scene.albedo;
                DVec3::Y * if part.is_finite() { part } else { 0.0 }
            }
            Site::Sphere(_) if self.vectors.is_empty() => DVec3::ZERO,
            Site::Sphere(latitude) => {
                let v = interpolate_linearly(&self.latitudes, &self.vectors, latitude);
                let out = DVec3::new(f64::from(x.x), 0.0, f64::from(x.z)).normalize_or_zero();
                out * v.x + DVec3::Y * v.y
            }
        }
    }

    /// Returns the largest differences of the reflected light to a finer solution, on the sphere
    /// and on the disk. They are measured at the positions of `self`, relative to the largest value
    /// of `finer`.
    #[must_use]
    pub fn difference(&self, finer: &Self) -> [f64; 2] {
        let max = |values: &[f64]| values.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        let b = self.latitudes.iter().zip(&self.sphere);
        let b: Vec<f64> = b
            .map(|(&z, v)| v - finer.indirect(Site::Sphere(z)))
            .collect();
        let d = self.radii.iter().zip(&self.disk);
        let d: Vec<f64> = d.map(|(&u, v)| v - finer.indirect(Site::Disk(u))).collect();
        [max(&b) / max(&finer.sphere), max(&d) / max(&finer.disk)]
    }
}
