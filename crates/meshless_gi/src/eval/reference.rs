//! Reference integrator: unbiased Monte Carlo irradiance at surface points, with standard errors.
//!
//! A path starts at the position and follows cosine-weighted directions. Every vertex uses
//! next-event estimation of the lights. The directions themselves sample the sky. Emissive surfaces
//! are sampled by directions and by positions on emitters, combined by the balance heuristic
//! (\[VG95\] §3.2). The density of a direction is cos θ / π, so its contribution to the irradiance
//! is the radiosity at its hit. Along a path E = Σ_m Π ρ · E_direct(y_m), which is [L08] Eq. (12)
//! unrolled. Direct irradiance arrives from lights, emissive surfaces and the sky without
//! reflection. Indirect irradiance was diffusely reflected at least once.
//!
//! The result is unbiased for any number of bounces, except that rays start slightly above the
//! surface ([`Geometry::ray_offset`]). Russian roulette divides the throughput by the survival
//! probability. The first direction and the first emitter position of a path come from lattices,
//! shifted at random for each position. The mean is less noisy than that of independent paths. The
//! standard error is that of independent paths, an upper bound.

use crate::samples::{Random, cosine_hemisphere, lattice, tangents};
use crate::scene::{EmitterView, Emitters, Geometry, Hit, Light, Ray, SkyRadiance};
use core::f32::consts::PI;
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;

/// Largest survival probability s of Russian roulette. A surviving path is weighted by ρ / s. The
/// sum over a path has a finite variance, and its standard error a meaning, only if ρ² < s. With
/// 0.999 this holds for ρ up to 0.9995 in a closed room.
const MAX_SURVIVE: f32 = 0.999;

/// Settings of the reference integrator.
#[derive(Clone, Copy, Debug)]
pub struct ReferenceSettings {
    /// Number of paths per position.
    pub paths: u32,
    /// Maximum number of diffuse bounces. `None` for all bounces, where paths end by Russian
    /// roulette.
    pub bounces: Option<u32>,
    /// Seed of the random numbers.
    pub seed: u64,
}

/// Irradiance at a position, W/m², with standard errors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Irradiance {
    /// Irradiance without reflection.
    pub direct: Vec3,
    /// Standard error of `direct`.
    pub direct_error: Vec3,
    /// Irradiance with at least one reflection.
    pub indirect: Vec3,
    /// Standard error of `indirect`.
    pub indirect_error: Vec3,
}

/// Returns the range falloff of a light as in Bevy's shader: (1 − (d²/r²)²)² up to r.
fn window(square: f32, range: f32) -> f32 {
    let t = square / (range * range);
    let f = (1.0 - t * t).max(0.0);
    if range.is_finite() { f * f } else { 1.0 }
}

/// Returns the irradiance of one light (not the sky) at a position lifted to `start`, in W/m². A
/// rectangle is sampled at one random position.
#[must_use]
pub fn direct_irradiance(
    geometry: &dyn Geometry,
    light: &Light,
    start: Vec3,
    n: Vec3,
    random: &mut Random,
) -> Vec3 {
    let light_source = |position: Vec3, intensity: Vec3, range: f32| {
        let to = position - start;
        let square = to.length_squared();
        let cosine = to.dot(n);
        if cosine <= 0.0 || square <= 0.0 {
            return None;
        }
        let distance = square.sqrt();
        let e = intensity * (cosine / (square * distance) * window(square, range));
        Some((e, -to / distance, position))
    };
    let shadowed = |found: Option<(Vec3, Vec3, Vec3)>| match found {
        Some((e, _, position)) if e != Vec3::ZERO && !geometry.is_occluded(start, position) => e,
        _ => Vec3::ZERO,
    };
    match *light {
        Light::Point {
            position,
            intensity,
            range,
        } => shadowed(light_source(position, intensity, range)),
        Light::Spot {
            position,
            direction,
            intensity,
            inner,
            outer,
            range,
        } => shadowed(
            light_source(position, intensity, range).map(|(e, toward, position)| {
                let span = (inner.cos() - outer.cos()).max(1e-4);
                let f = ((toward.dot(direction) - outer.cos()) / span).clamp(0.0, 1.0);
                (e * f * f, toward, position)
            }),
        ),
        Light::Directional {
            direction,
            irradiance,
        } => {
            let cosine = -direction.dot(n);
            if cosine <= 0.0 || geometry.cast(&Ray::new(start, -direction)).is_some() {
                Vec3::ZERO
            } else {
                irradiance * cosine
            }
        }
        Light::Rect {
            center,
            u,
            v,
            radiance,
        } => {
            let position =
                center + u * (2.0 * random.unit() - 1.0) + v * (2.0 * random.unit() - 1.0);
            let facing = u.cross(v);
            // The light's own model may lie in its plane. The shadow ray ends slightly before it.
            let position = position + facing.normalize_or_zero() * geometry.ray_offset(position);
            // Area 4 |u × v| and the emitter's cosine together: 4 (u × v) · direction.
            shadowed(light_source(position, radiance, f32::INFINITY).map(
                |(e, toward, position)| (e * (4.0 * facing.dot(toward)).max(0.0), toward, position),
            ))
        }
        Light::Sky { .. } => Vec3::ZERO,
    }
}

/// Scene and settings of a path.
struct PathTracer<'a> {
    geometry: &'a dyn Geometry,
    lights: &'a [Light],
    /// π times the radiance of the sky, W/m².
    sky: SkyRadiance,
    /// Emitters that are sampled by area.
    emitters: Option<&'a Emitters>,
    settings: &'a ReferenceSettings,
}

impl PathTracer<'_> {
    /// Returns the irradiance of all lights except the sky at a position lifted to `start`, in
    /// W/m².
    fn lights(&self, start: Vec3, n: Vec3, random: &mut Random) -> Vec3 {
        let of = |light| direct_irradiance(self.geometry, light, start, n, random);
        self.lights.iter().map(of).sum()
    }

    /// Returns one sample of the irradiance by emissive surfaces at a position lifted to `start`,
    /// in W/m². `u` selects the position on an emitter. The sample has its balance weight with
    /// [`Self::emitted`].
    fn emitter_sample(&self, view: &EmitterView<'_>, start: Vec3, n: Vec3, u: Vec2) -> Vec3 {
        let Some((ray, hit)) = view.visible(self.geometry, start, n, u) else {
            return Vec3::ZERO;
        };
        let by_direction = ray.direction.dot(n).max(f32::MIN_POSITIVE) / PI;
        let density = view.density(&ray, &hit) + by_direction;
        self.geometry.surface(&ray, &hit).emission * (by_direction / density)
    }

    /// Returns the emission at the hit of a cosine-weighted ray around `n`, in W/m². The result has
    /// its balance weight with [`Self::emitter_sample`].
    fn emitted(
        view: Option<&EmitterView<'_>>,
        ray: &Ray,
        n: Vec3,
        hit: &Hit,
        emission: Vec3,
    ) -> Vec3 {
        match view {
            Some(view) if emission != Vec3::ZERO => {
                let by_direction = ray.direction.dot(n).max(f32::MIN_POSITIVE) / PI;
                emission * (by_direction / (view.density(ray, hit) + by_direction))
            }
            _ => emission,
        }
    }

    /// Returns direct and indirect irradiance of one path from `start`, in W/m². `u` and `v` select
    /// the first direction and the first position on an emitter. `direct` is the irradiance of the
    /// lights at `start`.
    fn trace(
        &self,
        start: Vec3,
        n: Vec3,
        [u, v]: [Vec2; 2],
        direct: Vec3,
        random: &mut Random,
    ) -> [Vec3; 2] {
        let geometry = self.geometry;
        let bounces = self.settings.bounces;
        let max = bounces.unwrap_or(u32::MAX);
        let (mut position, mut normal, mut u, mut v) = (start, n, u, v);
        let mut throughput = Vec3::ONE;
        let mut sums = [direct, Vec3::ZERO];
        // Light from the next direction has `depth` reflections if it is emitted at the hit, and
        // one more if it is reflected there.
        let mut depth = 0u32;
        loop {
            let (t, b) = tangents(normal);
            let d = cosine_hemisphere(u);
            let ray = Ray::new(position, (t * d.x + b * d.y + normal * d.z).normalize());
            let hit = geometry.cast(&ray);
            let surface = hit.map(|hit| (hit, geometry.surface(&ray, &hit)));
            let view = self.emitters.map(|e| e.seen_from(position));
            let mut emitted = match &surface {
                Some((hit, surface)) => {
                    Self::emitted(view.as_ref(), &ray, normal, hit, surface.emission)
                }
                None => self.sky.toward(ray.direction),
            };
            if let Some(view) = &view {
                emitted += self.emitter_sample(view, position, normal, v);
            }
            sums[usize::from(depth > 0)] += throughput * emitted;
            let Some((_, surface)) = surface else { break };
            depth += 1;
            if depth > max {
                break;
            }
            throughput *= surface.albedo;
            if bounces.is_none() && depth > 3 {
                let survive = throughput.max_element().min(MAX_SURVIVE);
                if random.unit() >= survive {
                    break;
                }
                throughput /= survive;
            }
            if throughput == Vec3::ZERO {
                break;
            }
            normal = surface.normal;
            position = surface.position + normal * geometry.ray_offset(surface.position);
            sums[1] += throughput * self.lights(position, normal, random);
            u = Vec2::new(random.unit(), random.unit());
            v = Vec2::new(random.unit(), random.unit());
        }
        sums
    }
}

/// Returns the irradiance at surface point (`x`, `n`). `stream` numbers the position. The result is
/// the same for the same position, stream and settings.
#[must_use]
pub fn irradiance(
    geometry: &dyn Geometry,
    lights: &[Light],
    x: Vec3,
    n: Vec3,
    stream: u64,
    settings: &ReferenceSettings,
) -> Irradiance {
    let sky = lights.iter().filter_map(|light| match light {
        Light::Sky { radiance } => Some(*radiance * PI),
        _ => None,
    });
    let tracer = PathTracer {
        geometry,
        lights,
        sky: sky.sum(),
        emitters: geometry.emitters().filter(|e| e.is_sparse()),
        settings,
    };
    // Only rectangles are sampled at random. Other lights give every path the same direct light.
    let start = x + n * geometry.ray_offset(x);
    let is_random = lights.iter().any(|l| matches!(l, Light::Rect { .. }));
    let same_direct =
        (!is_random).then(|| tracer.lights(start, n, &mut Random::new(settings.seed, stream, 0)));
    // The first samples are stratified over the paths by lattices.
    let mut shift = Random::new(settings.seed ^ 0x73_68, stream, 0);
    let mut shift = || Vec2::new(shift.unit(), shift.unit());
    let shifts = [shift(), shift()];
    let mut sums = [DVec3::ZERO; 4];
    for path in 0..settings.paths {
        let mut random = Random::new(settings.seed ^ 0x72_65_66, stream, u64::from(path));
        let direct = same_direct.unwrap_or_else(|| tracer.lights(start, n, &mut random));
        let u = shifts.map(|shift| lattice(path, settings.paths, shift));
        // Squares in double precision: their difference to the squared mean is small.
        let [direct, indirect] = tracer
            .trace(start, n, u, direct, &mut random)
            .map(|e| e.as_dvec3());
        let values = [direct, direct * direct, indirect, indirect * indirect];
        for (sum, value) in sums.iter_mut().zip(values) {
            *sum += value;
        }
    }
    let count = f64::from(settings.paths.max(1));
    let [direct, direct_square, indirect, indirect_square] = sums.map(|s| s / count);
    let error = |mean: DVec3, square: DVec3| {
        let variance = (square - mean * mean).max(DVec3::ZERO) / (count - 1.0).max(1.0);
        DVec3::new(variance.x.sqrt(), variance.y.sqrt(), variance.z.sqrt()).as_vec3()
    };
    Irradiance {
        direct: direct.as_vec3(),
        direct_error: error(direct, direct_square),
        indirect: indirect.as_vec3(),
        indirect_error: error(indirect, indirect_square),
    }
}

/// Returns [`irradiance`] at many positions, computed in parallel. Position k is stream k.
#[must_use]
pub fn irradiance_at_all(
    geometry: &dyn Geometry,
    lights: &[Light],
    positions: &[(Vec3, Vec3)],
    settings: &ReferenceSettings,
) -> Vec<Irradiance> {
    positions
        .par_iter()
        .enumerate()
        .map(|(k, &(x, n))| irradiance(geometry, lights, x, n, k as u64, settings))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::EmissionIntegrator;
    use crate::scene::{Bounds, Material, Surface, TriangleMesh};

    /// Geometry without a list of emitters. Only rays of the hemisphere hit them.
    struct WithoutEmitters<'a>(&'a TriangleMesh);

    impl Geometry for WithoutEmitters<'_> {
        fn bounds(&self) -> Bounds {
            self.0.bounds()
        }

        fn cast(&self, ray: &Ray) -> Option<Hit> {
            self.0.cast(ray)
        }

        fn is_occluded(&self, from: Vec3, to: Vec3) -> bool {
            self.0.is_occluded(from, to)
        }

        fn surface(&self, ray: &Ray, hit: &Hit) -> Surface {
            self.0.surface(ray, hit)
        }
    }

    /// Returns a floor of 8 x 8 m and a sign of 30 x 10 cm. The sign is `height` meters above the
    /// center of the floor and faces down.
    fn sign_above_floor(height: f32) -> TriangleMesh {
        let quad = |x: f32, y: f32, z: f32| {
            [(-x, -z), (x, -z), (x, z), (-x, z)].map(|(x, z)| Vec3::new(x, y, z))
        };
        let mut triangles = Vec::new();
        for [a, b, c, d] in [quad(4.0, 0.0, 4.0), quad(0.15, height, 0.05)] {
            triangles.extend([[a, b, c], [a, c, d]]);
        }
        let sign = Material::emissive(Vec3::splat(0.3), Vec3::new(40.0, 20.0, 0.0));
        let floor = Material::diffuse(Vec3::splat(0.6));
        TriangleMesh::new(triangles, vec![0, 0, 1, 1], vec![floor, sign])
    }

    fn settings(paths: u32) -> ReferenceSettings {
        ReferenceSettings {
            paths,
            bounces: Some(4),
            seed: 5,
        }
    }

    #[test]
    fn small_emitter_has_little_noise() {
        let mesh = sign_above_floor(5.0);
        let meshes = std::slice::from_ref(&mesh);
        let right = EmissionIntegrator::new(meshes, SkyRadiance::BLACK);
        for x in [Vec3::ZERO, Vec3::new(2.0, 0.0, -1.0)] {
            let e = irradiance(&mesh, &[], x, Vec3::Y, 1, &settings(256));
            let right = right.irradiance(x, Vec3::Y, 1);
            assert!((e.direct.x / right.x - 1.0).abs() < 5e-3, "{e:?} {right}");
            assert!(e.direct_error.x < 5e-3 * right.x, "{e:?}");
            let without_emitters =
                irradiance(&WithoutEmitters(&mesh), &[], x, Vec3::Y, 1, &settings(256));
            assert!(
                without_emitters.direct_error.x > 0.3 * right.x || without_emitters.direct.x == 0.0
            );
        }
    }

    /// The mean is the same with and without samples of the emitters, far from an emitter and near
    /// it.
    #[test]
    fn balance_of_samples_is_unbiased() {
        for height in [0.1, 1.0] {
            let mesh = sign_above_floor(height);
            // A position on the floor, and one between floor and sign that faces the floor.
            for (x, n) in [
                (Vec3::new(0.2, 0.0, 0.1), Vec3::Y),
                (Vec3::new(0.05, 0.5 * height, 0.0), Vec3::NEG_Y),
            ] {
                let both = irradiance(&mesh, &[], x, n, 2, &settings(20_000));
                let without_emitters =
                    irradiance(&WithoutEmitters(&mesh), &[], x, n, 3, &settings(200_000));
                let parts = [
                    (
                        both.direct,
                        both.direct_error,
                        without_emitters.direct,
                        without_emitters.direct_error,
                    ),
                    (
                        both.indirect,
                        both.indirect_error,
                        without_emitters.indirect,
                        without_emitters.indirect_error,
                    ),
                ];
                let error = both.direct_error.x;
                assert!(error <= 0.01 * both.direct.x.max(0.1), "{both:?}");
                for (a, ea, b, eb) in parts {
                    let error = (ea * ea + eb * eb).x.sqrt();
                    assert!(
                        (a - b).x.abs() <= 4.0 * error,
                        "{height} {n}: {both:?} {without_emitters:?}"
                    );
                }
            }
        }
    }
}
