//! Accuracy of soft shadows of a rectangle light: the error of a baked scene with visibility at
//! positions in the penumbra, against the reference integrator ([P14] §5). The module depends on
//! the kernels of the frame. Only tests and documents use it.

use super::{Errors, errors};
use glam::Vec3;
use meshless_gi::internals::eval::direct_irradiance;
use meshless_gi::internals::frame::project::extent;
use meshless_gi::internals::frame::soft_shadow::{
    self, RayVisibility, SoftLight, SoftShadowParams, unshadowed,
};
use meshless_gi::internals::frame::{VectorIrradiance, subtract_shadow};
use meshless_gi::internals::samples::{Random, trace_particles};
use meshless_gi::{BakedScene, Geometry, Light, TriangleMesh};
use rayon::prelude::*;

/// Range of the visible fraction of a light in the penumbra.
pub const PENUMBRA: [f32; 2] = [0.02, 0.98];
/// Number of strata of the rectangle along each edge in the reference.
const STRATA: i32 = 16;
/// Irradiance, W/m², below which a position counts as unlit.
const MIN: f32 = 1e-4;

/// Position that the light reaches if unoccluded, in the bake's local space.
#[derive(Clone, Copy, Debug)]
pub struct PenumbraSample {
    /// Position, meters.
    pub x: Vec3,
    /// Unit normal.
    pub n: Vec3,
    /// Irradiance of the light by the reference integrator, W/m².
    pub reference: f32,
    /// Irradiance without shadows, W/m².
    pub unshadowed: f32,
}

impl PenumbraSample {
    /// Returns `true` if the light is partly visible from the position.
    #[must_use]
    pub fn is_in_penumbra(&self) -> bool {
        let f = self.reference / self.unshadowed;
        f > PENUMBRA[0] && f < PENUMBRA[1]
    }
}

/// Returns the irradiance of a rectangle of radiance one, W/m², at (x, n) by the reference
/// integrator. It takes a random sample in each of 256 strata. Returns zero for other lights.
#[must_use]
pub fn shadowed_irradiance(
    mesh: &TriangleMesh,
    light: &Light,
    x: Vec3,
    n: Vec3,
    stream: u64,
) -> f32 {
    let Light::Rect {
        center,
        u,
        v,
        radiance,
    } = *light
    else {
        return 0.0;
    };
    let start = x + n * mesh.ray_offset(x);
    let mut random = Random::new(9, stream, 0);
    let at = |i: i32| (2 * i + 1) as f32 / STRATA as f32 - 1.0;
    let mut sum = 0.0;
    for i in 0..STRATA * STRATA {
        let part = Light::Rect {
            center: center + u * at(i % STRATA) + v * at(i / STRATA),
            u: u / STRATA as f32,
            v: v / STRATA as f32,
            radiance,
        };
        sum += direct_irradiance(mesh, &part, start, n, &mut random).x;
    }
    sum
}

/// Returns the hits of importance particles of `paths` paths that the rectangle `light` of radiance
/// one reaches if unoccluded.
#[must_use]
pub fn penumbra_samples(
    scene: &BakedScene,
    mesh: &TriangleMesh,
    light: &Light,
    paths: u64,
) -> Vec<PenumbraSample> {
    let viewpoints: Vec<Vec3> = scene.info().viewpoints.iter().map(|&v| v.into()).collect();
    let landed = trace_particles(mesh, &viewpoints, 0..paths, 0xfeed, false).candidates;
    let soft_light = SoftLight::from_light(light, 1).unwrap_or_default();
    let extent = extent(scene.data());
    landed
        .par_iter()
        .enumerate()
        .filter_map(|(i, c)| {
            let (x, n) = (c.surface.position, c.surface.normal);
            let unshadowed = unshadowed(&soft_light, x, n, extent);
            (unshadowed > MIN).then(|| PenumbraSample {
                x,
                n,
                reference: shadowed_irradiance(mesh, light, x, n, i as u64),
                unshadowed,
            })
        })
        .collect()
}

/// Returns the occluded irradiance of `light` of color one at the points of `scene`. The first
/// `known` points, which are complete levels, take shadow rays. The others take the mean of their
/// parents.
#[must_use]
pub fn occluded_irradiances_by_rays(
    scene: &BakedScene,
    mesh: &TriangleMesh,
    light: &SoftLight,
    known: usize,
) -> Vec<VectorIrradiance> {
    let params = SoftShadowParams {
        extent: extent(scene.data()),
        ..SoftShadowParams::default()
    };
    let mut out = vec![VectorIrradiance::default(); scene.data().points.len()];
    out[..known]
        .par_iter_mut()
        .zip(&scene.data().points)
        .with_min_len(64)
        .for_each(|(out, point)| {
            let (x, n) = (point.x(), point.n());
            let rays = RayVisibility {
                geometry: mesh,
                start: x + n * mesh.ray_offset(x),
            };
            let d = soft_shadow::occluded_irradiance(&params, light, x, n, &rays);
            let e = unshadowed(light, x, n, params.extent);
            let channels = |v: f32| [v, v, v, e];
            (out.x, out.y, out.z) = (channels(d.x), channels(d.y), channels(d.z));
        });
    soft_shadow::fill_finer_levels(scene.data(), known, &mut out);
    out
}

/// Computes errors of the irradiance at `samples` against the reference. The occluded part in
/// `occluded_irradiances` is subtracted from it, as by the kernel `subtract_shadow` in a view.
#[must_use]
pub fn shadow_errors(
    scene: &BakedScene,
    occluded_irradiances: &[VectorIrradiance],
    samples: &[PenumbraSample],
) -> Errors {
    let got: Vec<Vec3> = samples
        .par_iter()
        .map(|p| {
            let missing =
                subtract_shadow::occluded_radiance(scene.data(), occluded_irradiances, p.x, p.n)
                    .unwrap_or_default();
            p.unshadowed * (Vec3::ONE - missing)
        })
        .collect();
    let right: Vec<Vec3> = samples.iter().map(|p| Vec3::splat(p.reference)).collect();
    errors(&got, &right, &vec![Vec3::ZERO; right.len()])
}
