//! Soft shadows of a rectangle, measured: positions in its penumbra with the irradiance that the
//! reference integrator finds there, and how far a baked scene with visibility is from it ([P14]
//! §5). Sits beside the other measures: it reads the frame's kernels, nothing reads it but tests
//! and documents.

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

/// Visible fractions between which a position lies in the penumbra.
pub const PENUMBRA: [f32; 2] = [0.02, 0.98];
/// The reference cuts the rectangle into so many strata along each edge.
const STRATA: i32 = 16;
/// Irradiance, W/m², below which a position is not lit.
const MIN: f32 = 1e-4;

/// A position that a light would light, in the bake's local space.
#[derive(Clone, Copy, Debug)]
pub struct PenumbraSample {
    /// Meters.
    pub x: Vec3,
    /// Unit normal.
    pub n: Vec3,
    /// Irradiance of the light by the reference integrator, W/m².
    pub reference: f32,
    /// The same without shadows, W/m².
    pub unshadowed: f32,
}

impl PenumbraSample {
    /// True where the light is seen in part.
    #[must_use]
    pub fn in_penumbra(&self) -> bool {
        let f = self.reference / self.unshadowed;
        f > PENUMBRA[0] && f < PENUMBRA[1]
    }
}

/// Irradiance of a rectangle of one radiance, W/m², at (x, n) by the reference integrator: a random
/// sample in each of 256 strata. Zero for other lights.
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

/// Positions where importance particles of `paths` paths land, that the rectangle `light` of
/// radiance one lights or would light.
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

/// Occluded irradiance of `light` of color one at the points of `scene` by shadow rays at the first
/// `known` points, which are whole levels; the others take the mean of their parents.
#[must_use]
pub fn deficits_by_rays(
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

/// Error of irradiance without the share that `occluded_irradiances` reports as occluded, against
/// the reference, at `samples`: as the kernel `subtract_shadow` has it in a view.
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
