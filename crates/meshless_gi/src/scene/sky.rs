//! Radiance of the sky as nine coefficients per color channel: spherical harmonics up to the second
//! degree \[RH01\]. They give the irradiance of diffuse surfaces with an error of about one
//! percent.
//!
//! L(ω) = c + d·ω + ω·Q ω, with Q symmetric and of zero trace, as in probes (`transport::probes`).
//! The nine polynomials are 1, (x, y, z) and (x² − z², y² − z², 2xy, 2xz, 2yz). Their coefficients
//! are c, d and (Q_xx, Q_yy, Q_xy, Q_xz, Q_yz). A uniform sky has only c.

use glam::{Mat3, Vec3};
use std::f32::consts::PI;

/// Radiance of the sky, W/(m² sr), in directions ω toward it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SkyRadiance {
    /// c, the mean over all directions.
    pub mean: Vec3,
    /// d (x, y, z) and Q_xx, Q_yy, Q_xy, Q_xz, Q_yz, RGB each.
    pub terms: [Vec3; SkyRadiance::TERMS],
}

impl From<Vec3> for SkyRadiance {
    fn from(radiance: Vec3) -> Self {
        Self {
            mean: radiance,
            ..Self::default()
        }
    }
}

impl SkyRadiance {
    /// Number of coefficients in addition to the mean.
    pub const TERMS: usize = 8;
    /// Black sky.
    pub const BLACK: Self = Self {
        mean: Vec3::ZERO,
        terms: [Vec3::ZERO; Self::TERMS],
    };

    /// Returns the polynomials of the terms in the unit direction `way`. Each is within ±1.
    #[must_use]
    #[inline]
    pub fn polynomials(way: Vec3) -> [f32; Self::TERMS] {
        let Vec3 { x, y, z } = way;
        [
            x,
            y,
            z,
            x * x - z * z,
            y * y - z * z,
            2.0 * x * y,
            2.0 * x * z,
            2.0 * y * z,
        ]
    }

    /// Returns the radiance from the unit direction `way`. The series may be negative near a very
    /// bright region.
    #[must_use]
    pub fn toward(&self, way: Vec3) -> Vec3 {
        let terms = self.terms.iter().zip(Self::polynomials(way));
        self.mean + terms.map(|(term, p)| *term * p).sum::<Vec3>()
    }

    /// Creates a sky with one color each straight up (+Y), at the horizon and straight down.
    /// Between them the color is the unique second-degree polynomial in the height.
    #[must_use]
    pub fn gradient(zenith: Vec3, horizon: Vec3, ground: Vec3) -> Self {
        // L = horizon + b y + a y² with y² = 1/3 + (y² − 1/3), and Q = a diag(−1/3, 2/3, −1/3).
        let a = 0.5 * (zenith + ground) - horizon;
        let mut sky = Self::from(horizon + a / 3.0);
        sky.terms[1] = 0.5 * (zenith - ground);
        sky.terms[3] = -a / 3.0;
        sky.terms[4] = 2.0 / 3.0 * a;
        sky
    }

    /// Fits the nine coefficients to a map. Each sample has a unit direction, a solid angle and a
    /// radiance. Solid angles are relative: they are scaled to the full sphere. Black without
    /// samples.
    #[must_use]
    pub fn of_map(samples: impl IntoIterator<Item = (Vec3, f32, Vec3)>) -> Self {
        let mut sum = [[0.0f64; 3]; 9];
        let mut sphere = 0.0f64;
        for (way, angle, radiance) in samples {
            if !(way.is_finite() && angle.is_finite() && radiance.is_finite()) {
                continue;
            }
            sphere += f64::from(angle);
            // By duality: with unit sphere averages <1> = 1, <ω ωᵀ> = I/3, and <(ω ωᵀ − I/3) ω·Qω>
            // = 2Q/15.
            let Vec3 { x, y, z } = way;
            let square = [x * x - 1.0 / 3.0, y * y - 1.0 / 3.0, x * y, x * z, y * z];
            let factors = [1.0, 3.0 * x, 3.0 * y, 3.0 * z]
                .into_iter()
                .chain(square.map(|s| 7.5 * s));
            for (sum, factor) in sum.iter_mut().zip(factors) {
                for (sum, c) in sum.iter_mut().zip(radiance.to_array()) {
                    *sum += f64::from(angle) * f64::from(factor) * f64::from(c);
                }
            }
        }
        if sphere <= 0.0 {
            return Self::BLACK;
        }
        let all = sum.map(|s| Vec3::from_array(s.map(|c| (c / sphere) as f32)));
        Self {
            mean: all[0],
            terms: std::array::from_fn(|k| all[k + 1]),
        }
    }

    /// Returns the same sky in rotated axes. `rotation` transforms directions from the old to the
    /// new axes, without scale.
    #[must_use]
    pub fn rotate(&self, rotation: Mat3) -> Self {
        let mut out = Self::from(self.mean);
        let t = &self.terms;
        for c in 0..3 {
            let d = rotation * Vec3::new(t[0][c], t[1][c], t[2][c]);
            let (xx, yy, xy, xz, yz) = (t[3][c], t[4][c], t[5][c], t[6][c], t[7][c]);
            let q = Mat3::from_cols(
                Vec3::new(xx, xy, xz),
                Vec3::new(xy, yy, yz),
                Vec3::new(xz, yz, -xx - yy),
            );
            let q = rotation * q * rotation.transpose();
            let numbers = [
                d.x, d.y, d.z, q.x_axis.x, q.y_axis.y, q.y_axis.x, q.z_axis.x, q.z_axis.y,
            ];
            for (term, number) in out.terms.iter_mut().zip(numbers) {
                term[c] = number;
            }
        }
        out
    }

    /// Returns `true` if the sky is the same in all directions.
    #[must_use]
    pub fn is_uniform(&self) -> bool {
        self.terms == [Vec3::ZERO; Self::TERMS]
    }

    /// Returns `true` if the sky emits no light.
    #[must_use]
    pub fn is_black(&self) -> bool {
        *self == Self::BLACK
    }

    /// Returns `true` if all coefficients are finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.mean.is_finite() && self.terms.iter().all(|t| t.is_finite())
    }

    /// Returns the irradiance of an unoccluded plane of normal `n`, W/m²: \[RH01\] Eq. (12) in
    /// these polynomials.
    #[must_use]
    pub fn irradiance(&self, n: Vec3) -> Vec3 {
        let factors = [2.0 / 3.0; 3].into_iter().chain([0.25; 5]);
        let terms = self.terms.iter().zip(Self::polynomials(n)).zip(factors);
        PI * (self.mean + terms.map(|((t, p), f)| *t * (p * f)).sum::<Vec3>())
    }
}

impl std::ops::Add for SkyRadiance {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            mean: self.mean + other.mean,
            terms: std::array::from_fn(|k| self.terms[k] + other.terms[k]),
        }
    }
}

impl std::iter::Sum for SkyRadiance {
    fn sum<I: Iterator<Item = Self>>(all: I) -> Self {
        all.fold(Self::BLACK, |a, b| a + b)
    }
}

impl std::ops::Mul<f32> for SkyRadiance {
    type Output = Self;

    fn mul(self, factor: f32) -> Self {
        Self {
            mean: self.mean * factor,
            terms: self.terms.map(|t| t * factor),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::{Random, cosine_hemisphere, lattice, tangents, uniform_sphere};
    use glam::{Quat, Vec2};

    fn any(seed: u64) -> SkyRadiance {
        let mut random = Random::new(seed, 1, 2);
        let mut color = || Vec3::new(random.unit(), random.unit(), random.unit()) - 0.4;
        SkyRadiance {
            mean: color() + 1.0,
            terms: std::array::from_fn(|_| color()),
        }
    }

    fn ways(count: u32) -> impl Iterator<Item = Vec3> {
        (0..count).map(move |k| uniform_sphere(lattice(k, count, Vec2::splat(0.3))).normalize())
    }

    #[test]
    fn sky_harmonics_from_own_map_round_trip() {
        let sky = any(3);
        let found = SkyRadiance::of_map(ways(20_000).map(|w| (w, 2.0, sky.toward(w))));
        let pairs = found.terms.iter().zip(&sky.terms);
        let off = pairs.map(|(a, b)| (*a - *b).length()).fold(0.0, f32::max);
        assert!(
            off < 2e-3 && (found.mean - sky.mean).length() < 1e-3,
            "{off}"
        );
        assert!(SkyRadiance::of_map([]).is_black());
    }

    #[test]
    fn sky_gradient_has_three_colors() {
        let colors = [
            Vec3::new(0.1, 0.3, 0.9),
            Vec3::new(0.9, 0.8, 0.7),
            Vec3::new(0.2, 0.1, 0.05),
        ];
        let sky = SkyRadiance::gradient(colors[0], colors[1], colors[2]);
        let ways = [Vec3::Y, Vec3::new(0.6, 0.0, -0.8), Vec3::NEG_Y];
        for (color, way) in colors.iter().zip(ways) {
            assert!((sky.toward(way) - *color).length() < 1e-6, "{way}");
        }
        assert!(!sky.is_uniform());
        let even = SkyRadiance::gradient(Vec3::ONE, Vec3::ONE, Vec3::ONE);
        assert!(even.is_uniform() && even.mean == Vec3::ONE);
    }

    #[test]
    fn rotated_sky_has_rotated_radiance() {
        let sky = any(5);
        let turn = Mat3::from_quat(Quat::from_euler(glam::EulerRot::XYZ, 0.3, 1.1, -0.7));
        let turned = sky.rotate(turn);
        for way in ways(50) {
            let d = turned.toward(turn * way) - sky.toward(way);
            assert!(d.length() < 1e-5, "{d}");
        }
        assert!((turned.toward(Vec3::X) - sky.toward(Vec3::X)).length() > 0.01);
    }

    #[test]
    fn sky_irradiance_matches_integral() {
        let sky = any(7);
        for n in ways(5) {
            let (t, b) = tangents(n);
            let count = 20_000;
            let sum: Vec3 = (0..count)
                .map(|k| {
                    let d = cosine_hemisphere(lattice(k, count, Vec2::ZERO));
                    sky.toward((t * d.x + b * d.y + n * d.z).normalize())
                })
                .sum();
            let right = sum * (PI / count as f32);
            let off = (sky.irradiance(n) - right).length();
            assert!(off < 2e-3 * right.length(), "{off} of {right}");
        }
    }
}
