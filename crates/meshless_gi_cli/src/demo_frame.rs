//! Irradiance of one light of the demo: a frame on the CPU, and the reference integrator.

use super::picture::View;
use glam::Vec3;
use meshless_gi::internals::eval::irradiance_at_all;
use meshless_gi::{
    BakedScene, CpuFrame, FrameLight, FrameSettings, Geometry, Irradiance, Light,
    ReferenceSettings, TriangleMesh,
};
use std::time::Instant;

/// Number of point lights that replace the rectangle in a frame.
const PATCHES: u32 = 64;
/// Number of diffuse bounces of a frame. The reference has all.
const BOUNCES: u32 = 12;

/// Light of the demo at one position, a small square.
pub struct DemoLight {
    pub name: &'static str,
    pub light: Light,
}

impl DemoLight {
    /// Creates a square light at `center` that faces `direction`.
    pub fn new(name: &'static str, center: Vec3, direction: Vec3) -> Self {
        const HALF_EDGE: f32 = 0.14;
        let (u, v) = direction.normalize().any_orthonormal_pair();
        Self {
            name,
            // A rectangle faces u × v.
            light: Light::Rect {
                center,
                u: u * HALF_EDGE,
                v: v * HALF_EDGE,
                radiance: Vec3::new(1.0, 0.9, 0.75) * 40.0,
            },
        }
    }
}

/// Irradiances of a frame at the samples of a view.
pub struct Frame {
    pub direct: Vec<Vec3>,
    pub indirect: Vec<Vec3>,
    /// Seconds of projection and solve.
    pub seconds: f64,
}

impl Frame {
    /// Returns direct plus indirect irradiance.
    pub fn total(&self) -> Vec<Vec3> {
        let pairs = self.direct.iter().zip(&self.indirect);
        pairs
            .map(|(direct, indirect)| *direct + *indirect)
            .collect()
    }
}

/// Computes a frame on the CPU.
pub fn compute(scene: &BakedScene, mesh: &TriangleMesh, view: &View, light: &DemoLight) -> Frame {
    let began = Instant::now();
    let mut frame = CpuFrame::new(scene);
    frame.set_lights(scene, &FrameLight::expand(&light.light, PATCHES));
    frame.solve(scene, &FrameSettings::bounces(BOUNCES));
    let seconds = began.elapsed().as_secs_f64();
    Frame {
        direct: view.evaluate(|s| {
            let lifted = s.position + s.normal * mesh.surface_relief(s.position);
            frame.direct(scene, lifted, s.normal)
        }),
        indirect: view.evaluate(|s| {
            frame
                .irradiance(scene, s.position, s.normal)
                .unwrap_or_default()
        }),
        seconds,
    }
}

/// Two independent estimates of the reference integrator at the samples of a view.
pub struct Reference {
    halves: [Vec<Irradiance>; 2],
    pub seconds: f64,
}

/// Integrates the reference with `paths` paths per sample.
pub fn reference(mesh: &TriangleMesh, view: &View, light: &DemoLight, paths: u32) -> Reference {
    let began = Instant::now();
    let points: Vec<(Vec3, Vec3)> = view.samples().map(|s| (s.position, s.normal)).collect();
    let halves = [1, 2].map(|seed| {
        let settings = ReferenceSettings {
            paths: paths / 2,
            bounces: None,
            seed,
        };
        irradiance_at_all(mesh, &[light.light], &points, &settings)
    });
    Reference {
        halves,
        seconds: began.elapsed().as_secs_f64(),
    }
}

impl Reference {
    /// Returns direct plus indirect irradiance.
    pub fn total(&self) -> Vec<Vec3> {
        let [one, other] = &self.halves;
        let pairs = one.iter().zip(other);
        pairs
            .map(|(a, b)| 0.5 * (a.direct + a.indirect + b.direct + b.indirect))
            .collect()
    }

    /// Returns the NRMSE of indirect irradiances against the reference.
    pub fn nrmse(&self, indirect: &[Vec3]) -> f64 {
        let [one, other] = &self.halves;
        nrmse(indirect, |i| one[i].indirect, |i| other[i].indirect)
    }
}

/// Returns ‖x − reference‖ / ‖reference‖ from two references with independent noise. The noise
/// cancels in products of one with the other.
fn nrmse(values: &[Vec3], one: impl Fn(usize) -> Vec3, other: impl Fn(usize) -> Vec3) -> f64 {
    let (mut square, mut power) = (0.0f64, 0.0f64);
    for (i, x) in values.iter().enumerate() {
        square += f64::from((*x - one(i)).dot(*x - other(i)));
        power += f64::from(one(i).dot(other(i)));
    }
    (square.max(0.0) / power).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reference_noise_is_not_counted_as_error() {
        let noise = |i: usize, k: usize| ((i * 7919 + k * 104_729) % 1000) as f32 / 500.0 - 1.0;
        let values = vec![Vec3::ONE; 3000];
        let noisy = |k: usize| move |i: usize| Vec3::splat(1.0 + 0.5 * noise(i * i, k + i));
        assert!(nrmse(&values, noisy(1), noisy(500)) < 0.06);
        let off: Vec<Vec3> = values.iter().map(|v| 1.2 * *v).collect();
        let found = nrmse(&off, noisy(1), noisy(500));
        assert!((found - 0.2).abs() < 0.03, "{found}");
    }
}
