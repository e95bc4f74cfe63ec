//! Direct irradiance of emissive surfaces and the sky. A frame computes it through links, as part
//! of its indirect light. This module integrates it separately, which separates direct from
//! indirect light.
//!
//! Two kinds of samples are combined by the balance heuristic: positions on the emissive triangles
//! by area and emission, and cosine-weighted directions. Directions are better near an emitter,
//! positions far from it.

use crate::samples::{Random, cosine_hemisphere, lattice, tangents};
use crate::scene::{Emitters, Geometry, Hit, Ray, SkyRadiance, TriangleMesh};
use core::f32::consts::PI;
use glam::{Vec2, Vec3};

/// Number of samples of each kind per position. The error is about 0.3 % for an emitter in full
/// view.
const SAMPLES: u32 = 2048;

/// Integrator of the emissive surfaces of some meshes and the sky around them.
pub struct EmissionIntegrator<'a> {
    meshes: &'a [TriangleMesh],
    /// π times the sky's radiance, W/m².
    sky: SkyRadiance,
    /// Power of the emitters of all meshes.
    power: f32,
}

impl<'a> EmissionIntegrator<'a> {
    /// Creates the integrator of the emission of `meshes` under a sky of radiance `sky`, W/(m² sr).
    #[must_use]
    pub fn new(meshes: &'a [TriangleMesh], sky: SkyRadiance) -> Self {
        let emitters = meshes.iter().filter_map(|mesh| mesh.emitters());
        Self {
            meshes,
            sky: sky * PI,
            power: emitters.map(Emitters::power).sum(),
        }
    }

    /// Returns the height of nearby surface above `x`, in meters. See [`Geometry::surface_relief`].
    #[must_use]
    pub fn surface_relief(&self, x: Vec3) -> f32 {
        let rises = self.meshes.iter().map(|m| m.surface_relief(x));
        rises.fold(0.0, f32::max)
    }

    /// Returns `true` if there is nothing to integrate.
    #[must_use]
    pub fn is_dark(&self) -> bool {
        self.power <= 0.0 && self.sky.is_black()
    }

    /// Returns the irradiance at surface point (x, n) from emissive surfaces and the sky, in W/m².
    /// `stream` numbers the position. The result is the same for the same position and stream.
    #[must_use]
    pub fn irradiance(&self, x: Vec3, n: Vec3, stream: u64) -> Vec3 {
        if self.is_dark() {
            return Vec3::ZERO;
        }
        let lift = self
            .meshes
            .iter()
            .map(|m| m.ray_offset(x))
            .fold(0.0, f32::max);
        let start = x + n * lift;
        let mut random = Random::new(0x67_6c_6f_77, stream, 0);
        let mut shift = || Vec2::new(random.unit(), random.unit());
        let (for_directions, for_positions) = (shift(), shift());
        let mut sum = Vec3::ZERO;
        let (t, b) = tangents(n);
        for k in 0..SAMPLES {
            let d = cosine_hemisphere(lattice(k, SAMPLES, for_directions));
            let ray = Ray::new(start, (t * d.x + b * d.y + n * d.z).normalize_or(n));
            sum += match self.closest(&ray) {
                None => self.sky.toward(ray.direction) / SAMPLES as f32,
                Some((mesh, hit)) => self.contribution(&ray, n, mesh, &hit),
            };
            let u = lattice(k, SAMPLES, for_positions);
            let Some((mesh, position, primitive)) = self.position(u) else {
                continue;
            };
            let to = position - start;
            if to.dot(n) <= 0.0 {
                continue;
            }
            let ray = Ray::new(start, to.normalize_or(n));
            if let Some((first, hit)) = self.closest(&ray)
                && (first, hit.primitive) == (mesh, primitive)
            {
                sum += self.contribution(&ray, n, mesh, &hit);
            }
        }
        sum
    }

    /// Returns mesh, position and primitive of a sample of all emitters.
    fn position(&self, u: Vec2) -> Option<(usize, Vec3, u32)> {
        let mut rest = u.x * self.power;
        let mut last = None;
        for (m, mesh) in self.meshes.iter().enumerate() {
            let Some(emitters) = mesh.emitters() else {
                continue;
            };
            last = Some((m, emitters, (rest / emitters.power()).min(1.0)));
            if rest < emitters.power() {
                break;
            }
            rest -= emitters.power();
        }
        let (m, emitters, x) = last?;
        let (position, primitive) = emitters.position(Vec2::new(x, u.y))?;
        Some((m, position, primitive))
    }

    /// Returns the contribution of one sample that hits a surface: L cos θ / (sum of all densities
    /// that can generate it).
    fn contribution(&self, ray: &Ray, n: Vec3, mesh: usize, hit: &Hit) -> Vec3 {
        let mesh = &self.meshes[mesh];
        let Some(emitters) = mesh.emitters() else {
            return Vec3::ZERO;
        };
        let by_position = emitters.density(ray, hit) * emitters.power() / self.power;
        let cosine = ray.direction.dot(n);
        if cosine <= 0.0 || by_position <= 0.0 {
            return Vec3::ZERO;
        }
        let radiance = mesh.surface(ray, hit).emission / PI;
        let by_direction = cosine / PI;
        radiance * (cosine / (SAMPLES as f32 * (by_position + by_direction)))
    }

    /// Returns the closest hit of all meshes, with the index of its mesh.
    fn closest(&self, ray: &Ray) -> Option<(usize, Hit)> {
        self.meshes
            .iter()
            .enumerate()
            .filter_map(|(i, mesh)| Some((i, mesh.cast(ray)?)))
            .min_by(|(_, a), (_, b)| a.t.total_cmp(&b.t))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Material;

    /// Returns a square of edge 2 m that faces down at height `h`, with radiance 3.
    fn panel(h: f32) -> TriangleMesh {
        let v = |x: f32, z: f32| Vec3::new(x, h, z);
        let lit = Material {
            emissive: Vec3::new(3.0, 1.5, 0.0),
            ..Material::diffuse(Vec3::ZERO)
        };
        TriangleMesh::new(
            vec![
                [v(-1.0, -1.0), v(1.0, -1.0), v(1.0, 1.0)],
                [v(-1.0, -1.0), v(1.0, 1.0), v(-1.0, 1.0)],
            ],
            vec![0, 0],
            vec![lit],
        )
    }

    /// Returns the form factor from a point below the center of a parallel square: 4 times the form
    /// factor of a quarter from its corner.
    fn center_form_factor(h: f32) -> f32 {
        let a = 1.0 / h;
        let s = (1.0 + a * a).sqrt();
        4.0 / (2.0 * PI) * 2.0 * (a / s) * (a / s).atan()
    }

    #[test]
    fn panel_above_receiver_matches_form_factor() {
        for h in [0.02, 0.3, 1.0, 5.0, 40.0] {
            let mesh = [panel(h)];
            let light = EmissionIntegrator::new(&mesh, SkyRadiance::BLACK);
            let e = light.irradiance(Vec3::ZERO, Vec3::Y, 7);
            let right = 3.0 * PI * center_form_factor(h);
            assert!((e.x / right - 1.0).abs() < 4e-3, "{h}: {e} {right}");
            assert!((e.y / e.x - 0.5).abs() < 1e-4 && e.z == 0.0);
            assert_eq!(light.irradiance(Vec3::ZERO, Vec3::NEG_Y, 7), Vec3::ZERO);
        }
    }

    #[test]
    fn panel_next_to_receiver_matches_sum_of_parts() {
        let mesh = [panel(1.0)];
        let light = EmissionIntegrator::new(&mesh, SkyRadiance::BLACK);
        let parts = 200;
        let center = |i: i32| (2 * i + 1) as f32 / parts as f32 - 1.0;
        for (x, n) in [
            (Vec3::new(1.5, 0.0, 0.7), Vec3::Y),
            (Vec3::new(-0.8, 0.5, 0.4), Vec3::new(0.6, 0.0, 0.8)),
        ] {
            let mut right = 0.0f64;
            for i in 0..parts * parts {
                let to = Vec3::new(center(i % parts), 1.0, center(i / parts)) - x;
                let d = to.length();
                let area = 4.0 / (parts * parts) as f32;
                right += f64::from(3.0 * area * to.dot(n).max(0.0) * to.y / d.powi(4));
            }
            let e = f64::from(light.irradiance(x, n, 3).x);
            assert!((e / right - 1.0).abs() < 4e-3, "{e} {right}");
        }
    }

    #[test]
    fn sky_and_panel_add_up_to_hemisphere() {
        let mesh = [panel(1.0)];
        let light = EmissionIntegrator::new(&mesh, Vec3::ONE.into());
        let e = light.irradiance(Vec3::ZERO, Vec3::Y, 1);
        let share = center_form_factor(1.0);
        assert!((e.z / (PI * (1.0 - share)) - 1.0).abs() < 5e-3, "{e}");
        assert!(!light.is_dark() && EmissionIntegrator::new(&[], SkyRadiance::BLACK).is_dark());
    }
}
