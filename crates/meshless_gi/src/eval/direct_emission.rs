//! Direct irradiance of what glows without being a light: emissive surfaces and the sky. A frame
//! has them inside of its indirect light, where links carry them; here they are integrated on their
//! own, which separates direct from indirect light.
//!
//! Two kinds of samples share the work by the balance heuristic: positions on the emissive
//! triangles, by area and strength, and cosine-weighted directions. Near an emitter the directions
//! do well, far from it the positions.

use crate::samples::{Random, cosine_hemisphere, lattice, tangents};
use crate::scene::{Geometry, Hit, Ray, SkyRadiance, TriangleMesh};
use core::f32::consts::PI;
use glam::{Vec2, Vec3};
use std::collections::HashMap;

/// Samples of each kind at a position: about 0.3 % of error for an emitter in full view.
const SAMPLES: u32 = 2048;

/// A triangle that emits.
struct Emitter {
    corners: [Vec3; 3],
    normal: Vec3,
    area: f32,
    /// Share of all samples up to and with this triangle.
    until: f32,
    /// Its own share.
    share: f32,
}

/// Emissive surfaces of some meshes and the sky around them.
pub struct EmissionIntegrator<'a> {
    meshes: &'a [TriangleMesh],
    /// π times the sky's radiance, W/m².
    sky: SkyRadiance,
    emitters: Vec<Emitter>,
    /// Emitter of each emissive triangle, by mesh and index.
    emitter_of: HashMap<(usize, u32), usize>,
}

impl<'a> EmissionIntegrator<'a> {
    /// Creates the integrator of the emission of `meshes` under a sky of radiance `sky`, W/(m² sr).
    #[must_use]
    pub fn new(meshes: &'a [TriangleMesh], sky: SkyRadiance) -> Self {
        let mut emitters = Vec::new();
        let mut emitter_of = HashMap::new();
        let mut total = 0.0f64;
        for (m, mesh) in meshes.iter().enumerate() {
            for t in 0..mesh.len() {
                let strength = mesh.material(t).map_or(0.0, |m| m.emissive.max_element());
                let Some(corners) = mesh.triangle(t).filter(|_| strength > 0.0) else {
                    continue;
                };
                let cross = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
                let area = 0.5 * cross.length();
                if area <= 0.0 || !(area * strength).is_finite() {
                    continue;
                }
                total += f64::from(area * strength);
                emitter_of.insert((m, t as u32), emitters.len());
                emitters.push(Emitter {
                    corners,
                    normal: cross.normalize_or_zero(),
                    area,
                    until: 0.0,
                    share: area * strength,
                });
            }
        }
        let mut sum = 0.0f64;
        for emitter in &mut emitters {
            sum += f64::from(emitter.share);
            emitter.until = (sum / total) as f32;
            emitter.share = (f64::from(emitter.share) / total) as f32;
        }
        Self {
            meshes,
            sky: sky * PI,
            emitters,
            emitter_of,
        }
    }

    /// Height of nearby surface above `x`, meters. See [`Geometry::surface_relief`].
    #[must_use]
    pub fn surface_relief(&self, x: Vec3) -> f32 {
        let rises = self.meshes.iter().map(|m| m.surface_relief(x));
        rises.fold(0.0, f32::max)
    }

    /// True where there is nothing to integrate.
    #[must_use]
    pub fn is_dark(&self) -> bool {
        self.emitters.is_empty() && self.sky.is_black()
    }

    /// Irradiance at surface point (x, n) from what glows, W/m². `stream` numbers the position: the
    /// same position and stream give the same answer.
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
        let (for_directions, for_places) = (shift(), shift());
        let mut sum = Vec3::ZERO;
        let (t, b) = tangents(n);
        for k in 0..SAMPLES {
            let d = cosine_hemisphere(lattice(k, SAMPLES, for_directions));
            let ray = Ray::new(start, (t * d.x + b * d.y + n * d.z).normalize_or(n));
            sum += match self.closest(&ray) {
                None => self.sky.toward(ray.direction) / SAMPLES as f32,
                Some((mesh, hit)) => self.seen(&ray, n, mesh, &hit),
            };
            if self.emitters.is_empty() {
                continue;
            }
            // One number chooses the triangle; where it lies in the triangle's share is uniform
            // again.
            let u = lattice(k, SAMPLES, for_places);
            let index = self.emitters.partition_point(|e| e.until < u.x);
            let emitter = &self.emitters[index.min(self.emitters.len() - 1)];
            let within = 1.0 - (emitter.until - u.x) / emitter.share;
            let to = emitter.position_at(Vec2::new(within.clamp(0.0, 1.0), u.y)) - start;
            if to.dot(n) <= 0.0 {
                continue;
            }
            let ray = Ray::new(start, to.normalize_or(n));
            if let Some((mesh, hit)) = self.closest(&ray)
                && self
                    .emitter_of
                    .get(&(mesh, hit.primitive))
                    .is_some_and(|&i| std::ptr::eq(&raw const self.emitters[i], emitter))
            {
                sum += self.seen(&ray, n, mesh, &hit);
            }
        }
        sum
    }

    /// The share of one sample that met a surface: L cos θ / (all densities with which it might
    /// have been drawn).
    fn seen(&self, ray: &Ray, n: Vec3, mesh: usize, hit: &Hit) -> Vec3 {
        let Some(&index) = self.emitter_of.get(&(mesh, hit.primitive)) else {
            return Vec3::ZERO;
        };
        let emitter = &self.emitters[index];
        let cosine = ray.direction.dot(n);
        let facing = ray.direction.dot(emitter.normal).abs();
        if cosine <= 0.0 || facing <= 0.0 {
            return Vec3::ZERO;
        }
        let radiance = self.meshes[mesh].surface(ray, hit).emission / PI;
        let by_place = emitter.share / emitter.area * hit.t * hit.t / facing;
        let by_direction = cosine / PI;
        radiance * (cosine / (SAMPLES as f32 * (by_place + by_direction)))
    }

    /// The closest hit in any of the meshes.
    fn closest(&self, ray: &Ray) -> Option<(usize, Hit)> {
        self.meshes
            .iter()
            .enumerate()
            .filter_map(|(i, mesh)| Some((i, mesh.cast(ray)?)))
            .min_by(|(_, a), (_, b)| a.t.total_cmp(&b.t))
    }
}

impl Emitter {
    /// A position on the triangle, uniform in area for uniform `u`.
    fn position_at(&self, u: Vec2) -> Vec3 {
        let [a, b, c] = self.corners;
        let root = u.x.sqrt();
        a * (1.0 - root) + b * (root * (1.0 - u.y)) + c * (root * u.y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Material;

    /// A square of edge 2 m that faces down at height `h`, radiance 3.
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

    /// Form factor from a point below the center of a parallel square: 4 times that of a quarter
    /// seen from its corner.
    fn below_the_center(h: f32) -> f32 {
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
            let right = 3.0 * PI * below_the_center(h);
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
        let share = below_the_center(1.0);
        assert!((e.z / (PI * (1.0 - share)) - 1.0).abs() < 5e-3, "{e}");
        assert!(!light.is_dark() && EmissionIntegrator::new(&[], SkyRadiance::BLACK).is_dark());
    }
}
