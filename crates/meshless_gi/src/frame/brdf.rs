//! Specular part of Bevy's standard material for virtual lights that are disks: D·V·F of \[RG18\]
//! §4.4, as in Bevy 0.19's `pbr_lighting.wgsl` (own implementation). Used by kernel `vpl_specular`
//! and its tests.
//!
//! - D, GGX (\[WML07\] Eq. (33)): α² / (π ((n·h)² (α² − 1) + 1)²), with 1 − (n·h)² from a cross
//!   product, so that small α keep their digits.
//! - V, Smith's correlated masking over 4 (n·v) (n·l) (\[RG18\] §4.4.2).
//! - F, Schlick: f₀ + (f₉₀ − f₀) p with p = (1 − l·h)⁵ and f₉₀ = min(1, 16.5 Σ f₀) as in Bevy.
//!
//! F is linear in f₀ and f₉₀. The reflection of a light is therefore stored as two numbers
//! ([`SpecularTerms`]), D V (1 − p) and D V p. After interpolation they are multiplied with the
//! pixel's own color.
//!
//! **Deviation from Bevy.** A light is a disk within an angle σ of its center. Half vectors turn by
//! half of that, so its lobe is a GGX with α'² = α² + sin²σ / 4. Energy is preserved. The highlight
//! is wider and never brighter than the disk. Bevy moves a light to the point of a sphere nearest
//! to the mirrored ray and scales by (α / α')² (\[K13\]). That highlight has a sharp edge and loses
//! energy at short distances.

use glam::Vec3;
use std::f32::consts::PI;

/// Smallest perceptual roughness, as Bevy uses for lights.
pub const MIN_ROUGHNESS: f32 = 0.089;
/// Smallest cosine between the normal and the direction to the eye.
pub const MIN_NDOTV: f32 = 1e-4;

/// Loss of a white surface at the first reflection, divided by the fourth power of its roughness,
/// for small roughness.
pub const MULTISCATTER_LOSS: f32 = 1.25;
/// Roll-off of this loss at large roughness.
pub const MULTISCATTER_ROLLOFF: f32 = 1.1;

/// Surface properties for the reflection of a light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShadingPoint {
    /// Unit normal.
    pub n: Vec3,
    /// Unit vector toward the eye.
    pub v: Vec3,
    /// Perceptual roughness, 0 to 1.
    pub roughness: f32,
}

/// Radiance toward the eye for an irradiance of 1, divided by f₀ and by f₉₀, 1/sr.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SpecularTerms {
    /// D V (1 − p).
    pub f0: f32,
    /// D V p.
    pub f90: f32,
}

/// Returns α² of a perceptual roughness.
#[must_use]
#[inline]
pub fn alpha_square(roughness: f32) -> f32 {
    let r = roughness.clamp(MIN_ROUGHNESS, 1.0);
    r * r * r * r
}

/// Returns f₉₀.
#[must_use]
pub fn f90(f0: Vec3) -> f32 {
    (50.0 * 0.33 * f0.element_sum()).min(1.0)
}

/// Returns the BRDF toward the eye for light from the direction `l` (unit, above the surface). The
/// light is a disk, and `spread` is the squared sine of half its angle.
#[must_use]
#[inline]
pub fn specular_terms(facet: &ShadingPoint, l: Vec3, spread: f32) -> SpecularTerms {
    let sum = l + facet.v;
    let length = sum.length();
    // The directions to the light and to the eye are opposite.
    if length <= 1e-6 {
        return SpecularTerms::default();
    }
    let h = sum / length;
    let a2 = (alpha_square(facet.roughness) + 0.25 * spread).min(1.0);
    let (nl, nv) = (facet.n.dot(l).max(0.0), facet.n.dot(facet.v).max(MIN_NDOTV));
    let nh = facet.n.dot(h);
    if nh <= 0.0 {
        return SpecularTerms::default();
    }
    let sine = facet.n.cross(h);
    let wide = sine.dot(sine) + a2 * nh * nh;
    let d = a2 / (PI * wide * wide);
    let masked = nl * (nv * nv * (1.0 - a2) + a2).sqrt() + nv * (nl * nl * (1.0 - a2) + a2).sqrt();
    let q = 1.0 - l.dot(h).clamp(0.0, 1.0);
    let p = q * q * q * q * q;
    let dv = d * 0.5 / masked;
    SpecularTerms {
        f0: dv * (1.0 - p),
        f90: dv * p,
    }
}

/// Returns the factor that compensates for multiple scattering between facets, 1 + f₀ (1 / E − 1)
/// (\[RG18\] §4.7.2). E is the albedo of a white surface after one reflection. Bevy reads it from a
/// table. Here it is 1 − 1.25 r⁴ / (1 + 1.1 r⁸), a fit to the albedos that a test below measures.
#[must_use]
pub fn multiscatter_compensation(roughness: f32, f0: Vec3) -> Vec3 {
    let r2 = roughness * roughness;
    let r4 = r2 * r2;
    let lost = MULTISCATTER_LOSS * r4 / (1.0 + MULTISCATTER_ROLLOFF * r4 * r4);
    Vec3::ONE + f0 * (lost / (1.0 - lost))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Random;

    fn facet(roughness: f32, slant: f32) -> ShadingPoint {
        ShadingPoint {
            n: Vec3::Y,
            v: Vec3::new(slant.sin(), slant.cos(), 0.0),
            roughness,
        }
    }

    /// Returns the albedo of a white mirror of this roughness. Directions are sampled from the
    /// distribution of the half vectors.
    fn albedo(facet: &ShadingPoint, spread: f32) -> f64 {
        let a2 = (alpha_square(facet.roughness) + 0.25 * spread).min(1.0);
        let mut random = Random::new(5, 0, 0);
        let count = 40_000;
        let mut sum = 0.0;
        for _ in 0..count {
            let (u, phi) = (random.unit(), 2.0 * PI * random.unit());
            let tan = (a2 * u / (1.0 - u)).sqrt();
            let h = Vec3::new(tan * phi.cos(), 1.0, tan * phi.sin()).normalize();
            let l = 2.0 * facet.v.dot(h) * h - facet.v;
            if l.y <= 0.0 || facet.v.dot(h) <= 0.0 {
                continue;
            }
            let wide = 1.0 - h.y * h.y + a2 * h.y * h.y;
            let density = a2 / (PI * wide * wide) * h.y / (4.0 * facet.v.dot(h));
            let g = specular_terms(facet, l, spread);
            sum += f64::from((g.f0 + g.f90) * l.y / density);
        }
        sum / f64::from(count)
    }

    /// The albedo is at most 1, and close to 1 for smooth surfaces. The multiple-scattering factor
    /// restores the lost energy.
    #[test]
    fn specular_albedo_conserves_energy() {
        for slant in [0.2, 0.8, 1.2] {
            for (roughness, min) in [
                (0.1, 0.98),
                (0.3, 0.93),
                (0.5, 0.7),
                (0.7, 0.5),
                (1.0, 0.25),
            ] {
                let facet = facet(roughness, slant);
                let found = albedo(&facet, 0.0);
                let whole = found * f64::from(multiscatter_compensation(roughness, Vec3::ONE).x);
                println!("{roughness} {slant}: {found:.3} {whole:.3}");
                assert!((min..1.003).contains(&found));
                assert!((whole - 1.0).abs() < if roughness < 0.8 { 0.1 } else { 0.3 });
            }
        }
    }

    /// Compares the wider lobe with the mean of the narrow lobe over the disk. The energies are
    /// equal. The maxima are equal within a tolerance that shows the error of the formula.
    #[test]
    fn widened_lobe_matches_disk_average() {
        for (roughness, sine) in [(0.15, 0.1f32), (0.3, 0.1), (0.3, 0.3), (0.5, 0.3)] {
            let eye = 0.5f32;
            let mirrored = Vec3::new(-eye.sin(), eye.cos(), 0.0);
            let facet = facet(roughness, eye);
            let (u, v) = mirrored.any_orthonormal_pair();
            // Offsets of the disk's center from the mirrored ray.
            let [mut energies, mut peaks] = [[0.0f32; 2]; 2];
            for i in -20..=20 {
                for j in -20..=20 {
                    let off = 2.5 * (sine + roughness * roughness) / 20.0;
                    let middle = mirrored + off * (i as f32 * u + j as f32 * v);
                    let by_formula = specular_terms(&facet, middle.normalize(), sine * sine).f0;
                    let mut mean = 0.0;
                    for k in 0..128 {
                        let (r, phi) = (((k as f32 + 0.5) / 128.0).sqrt(), 2.399_963 * k as f32);
                        let at = middle + sine * r * (phi.cos() * u + phi.sin() * v);
                        mean += specular_terms(&facet, at.normalize(), 0.0).f0 / 128.0;
                    }
                    for (k, value) in [by_formula, mean].into_iter().enumerate() {
                        energies[k] += value;
                        peaks[k] = peaks[k].max(value);
                    }
                }
            }
            let [energy, peak] = [energies[0] / energies[1], peaks[0] / peaks[1]];
            println!("roughness {roughness}, sine {sine}: energy {energy:.3}, peak {peak:.3}");
            assert!((energy - 1.0).abs() < 0.2, "{roughness} {sine}: {energy}");
            assert!((0.6..1.7).contains(&peak), "{roughness} {sine}: {peak}");
        }
    }

    #[test]
    fn specular_terms_degenerate_input_stay_finite() {
        let mut random = Random::new(9, 0, 0);
        let mut direction = || {
            let v = Vec3::new(random.unit(), random.unit(), random.unit()) * 2.0 - 1.0;
            v.normalize_or(Vec3::Y)
        };
        for i in 0..20_000 {
            let (n, v) = (direction(), direction());
            let l = match i % 3 {
                0 => direction(),
                1 => -v,
                _ => n,
            };
            let facet = ShadingPoint {
                n,
                v: if i % 5 == 0 { n } else { v },
                roughness: (i % 7) as f32 / 6.0,
            };
            let g = specular_terms(&facet, l, (i % 4) as f32 / 3.0);
            assert!(g.f0.is_finite() && g.f0 >= 0.0 && g.f90 >= 0.0);
            // Upper bound that follows from [`alpha_square`].
            let max = 1.0 / (PI * alpha_square(0.0)) * 0.5 / alpha_square(0.0).sqrt();
            assert!((g.f0 + g.f90) * n.dot(l).max(0.0) <= 1.01 * max);
            assert!(multiscatter_compensation(facet.roughness, Vec3::ONE).is_finite());
        }
    }
}
