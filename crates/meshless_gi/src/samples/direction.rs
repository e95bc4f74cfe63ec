//! Directions over a hemisphere or a sphere: a Fibonacci lattice with a random shift, warped to a
//! density between uniform and cosine.
//!
//! A lattice converges faster than random points, and its shift keeps the estimate unbiased. The
//! density bounds both the normal and the tangential parts of a vector irradiance. Cosine sampling
//! alone divides the tangential parts by a cosine that goes to zero.

use glam::{Vec2, Vec3};

/// Fraction of the cosine density. The rest is uniform over the hemisphere. Every value is
/// unbiased.
const COSINE_SHARE: f32 = 0.75;

/// Computes two unit vectors that form a right-handed frame with the unit vector `n` (Duff et al.
/// 2017, branchless).
#[must_use]
pub fn tangents(n: Vec3) -> (Vec3, Vec3) {
    let sign = 1.0f32.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (
        Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
        Vec3::new(b, sign + n.y * n.y * a, -n.y),
    )
}

/// Computes point `i` of the Fibonacci lattice of `count` points in [0, 1)², moved by `shift`
/// around the torus.
#[must_use]
pub fn lattice(i: u32, count: u32, shift: Vec2) -> Vec2 {
    /// 2³² over the golden ratio: the lattice's second coordinate as an integer, exact for any
    /// count.
    const GOLDEN: u32 = 0x9e37_79b9;
    let u = (i as f32 + 0.5) / count as f32;
    let v = (i.wrapping_mul(GOLDEN) >> 8) as f32 * (1.0 / 16_777_216.0);
    let p = Vec2::new(u, v) + shift;
    (p - p.floor()).min(Vec2::splat(1.0 - f32::EPSILON))
}

fn on_circle(v: f32) -> (f32, f32) {
    let phi = core::f32::consts::TAU * v;
    (libm::sinf(phi), libm::cosf(phi))
}

/// Computes a direction of the upper hemisphere (z up) with density ∝ cosine, from two uniform
/// numbers.
#[must_use]
pub fn cosine_hemisphere(u: Vec2) -> Vec3 {
    let z = u.x.sqrt();
    let r = (1.0 - u.x).max(0.0).sqrt();
    let (s, c) = on_circle(u.y);
    Vec3::new(r * c, r * s, z)
}

/// Computes a direction uniform over the whole sphere, from two uniform numbers.
#[must_use]
pub fn uniform_sphere(u: Vec2) -> Vec3 {
    let z = 1.0 - 2.0 * u.x;
    let r = (1.0 - z * z).max(0.0).sqrt();
    let (s, c) = on_circle(u.y);
    Vec3::new(r * c, r * s, z)
}

/// Computes a direction of the upper hemisphere and its weight w = 1 / (π N p). Σ w · f(ω) · ω
/// estimates (1/π) ∫ f(ω) ω dω with `count` directions.
#[must_use]
pub fn gather_direction(i: u32, count: u32, shift: Vec2) -> (Vec3, f32) {
    let u = lattice(i, count, shift);
    // Density of z = cos θ: a · 2z + (1 − a). Its integral a z² + (1 − a) z = u.x is solved for z.
    let (a, b) = (COSINE_SHARE, 1.0 - COSINE_SHARE);
    let z = 2.0 * u.x / (b + (b * b + 4.0 * a * u.x).sqrt());
    let z = z.clamp(1e-6, 1.0);
    let r = (1.0 - z * z).max(0.0).sqrt();
    let (s, c) = on_circle(u.y);
    (Vec3::new(r * c, r * s, z), gather_weight(z, count))
}

/// Computes the weight of a direction of [`gather_direction`] whose cosine is `z`.
#[must_use]
pub fn gather_weight(z: f32, count: u32) -> f32 {
    let (a, b) = (COSINE_SHARE, 1.0 - COSINE_SHARE);
    // p(ω) = (2 a z + b) / 2π, so 1 / (π p) = 2 / (2 a z + b).
    2.0 / ((2.0 * a * z + b) * count as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Random;

    #[test]
    fn tangent_frames_are_right_handed_and_orthonormal() {
        let mut r = Random::new(1, 0, 0);
        for i in 0..1000 {
            let n = match i {
                0 => Vec3::Z,
                1 => Vec3::NEG_Z,
                _ => uniform_sphere(Vec2::new(r.unit(), r.unit())),
            };
            let (t, b) = tangents(n);
            assert!((t.cross(b) - n).length() < 1e-5, "{n}");
            assert!(t.is_normalized() && b.is_normalized());
        }
    }

    /// Computes Σ w ω and Σ w ω x² of one set of directions.
    fn moments(count: u32, direction: impl Fn(u32) -> (Vec3, f32)) -> (Vec3, Vec3) {
        (0..count).fold((Vec3::ZERO, Vec3::ZERO), |(first, second), i| {
            let (d, w) = direction(i);
            assert!(d.is_normalized() && w > 0.0);
            (first + w * d, second + w * d * d.x * d.x)
        })
    }

    /// Tests the closed forms (1/π) ∫ ω dω = (0, 0, 1) and (1/π) ∫ ω (ω·x)² dω = (0, 0, 1/4). The
    /// estimates are unbiased over all shifts. Their error is at most half that of the same number
    /// of independent directions with the same density.
    #[test]
    fn gather_weights_integrate_closed_forms() {
        const SHIFTS: u32 = 400;
        for count in [64u32, 256, 1000] {
            let (mut mean, mut lattice_error, mut random_error) = ([Vec3::ZERO; 2], 0.0, 0.0);
            for trial in 0..SHIFTS {
                let mut r = Random::new(7, u64::from(count), u64::from(trial));
                let shift = Vec2::new(r.unit(), r.unit());
                let (first, second) = moments(count, |i| gather_direction(i, count, shift));
                let off = [first - Vec3::Z, second - Vec3::Z * 0.25];
                for (m, o) in mean.iter_mut().zip(off) {
                    *m += o / SHIFTS as f32;
                    lattice_error += o.length_squared();
                }
                let shifts: Vec<Vec2> = (0..count).map(|_| Vec2::new(r.unit(), r.unit())).collect();
                // A lattice of one point gives one random direction. Its weight is that of a set of
                // one.
                let (first, second) = moments(count, |i| {
                    let (d, w) = gather_direction(0, 1, shifts[i as usize]);
                    (d, w / count as f32)
                });
                random_error +=
                    (first - Vec3::Z).length_squared() + (second - Vec3::Z * 0.25).length_squared();
            }
            assert!(
                lattice_error < 0.25 * random_error,
                "{count}: {lattice_error} {random_error}"
            );
            // Four standard errors of the mean, from the measured errors.
            let bound = 4.0 * lattice_error.sqrt() / SHIFTS as f32;
            assert!(
                mean.iter().all(|m| m.length() < bound),
                "{count}: {mean:?} {bound}"
            );
        }
    }
}
