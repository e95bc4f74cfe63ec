//! Kernel `project`: the scalar irradiance of each sender from one light of color one, shadows
//! included: the mean over the sender's positions, so that a shadow's edge moves over it smoothly
//! (\[L08\] takes the light at its center). Visibility is a ray through the baked BVH (design D8).
//! The units are Bevy's: E = I cos θ / d², with its window at the range and its cone.

use super::light::FrameLight;
use crate::asset::SceneData;
use crate::samples::LightSample;
use crate::scene::{Bvh, Ray};
use glam::Vec3;
use rayon::prelude::*;

/// Length of a directional light's shadow rays, meters.
pub const FAR: f32 = 1e30;

/// Largest edge of the box around the geometry, meters; 0 where there is none.
#[must_use]
pub fn extent(scene: &SceneData) -> f32 {
    let [min, max] = scene.info.bounds.map(Vec3::from_array);
    let size = (max - min).max_element();
    if size.is_finite() { size.max(0.0) } else { 0.0 }
}

/// Offset of a shadow ray's start from the surface at `x`, meters. The same rule as
/// [`Geometry::ray_offset`](crate::scene::Geometry::ray_offset).
#[must_use]
#[inline]
pub fn ray_offset(x: Vec3, extent: f32) -> f32 {
    (1e-5 * extent).max(8.0 * f32::EPSILON * x.abs().max_element().max(extent))
}

/// Square of the distance below which a light grows no brighter, m²: Bevy's square centimeter, and
/// in scenes below two meters as much less.
#[must_use]
#[inline]
pub fn min_distance_squared(extent: f32) -> f32 {
    (2.5e-5 * extent * extent).clamp(f32::MIN_POSITIVE, 1e-4)
}

/// Spacing of the samples of a sender, meters. 0 if senders are lit at their own points only.
///
/// Positions are spread as the kernel weighs, with a variance of 0.24 of its radius squared; the
/// disks of that level's points are 0.8 of the radius, and there are 0.7 of them to a square of
/// that: a position stands for a square of edge 2σ / √positions.
#[must_use]
pub fn sample_spacing(scene: &SceneData) -> f32 {
    const ASKED: usize = 256;
    let count = scene.light_samples.per_sender as usize;
    if count < 2 {
        return 0.0;
    }
    let senders = scene.light_samples.list.chunks_exact(count);
    let stride = senders.len().div_ceil(ASKED).max(1);
    let (mut variance, mut sampled) = (0.0f32, 0u32);
    for own in senders.step_by(stride) {
        let share = 1.0 / count as f32;
        let middle: Vec3 = own.iter().map(|p| share * p.x()).sum();
        variance += own
            .iter()
            .map(|p| share * p.x().distance_squared(middle))
            .sum::<f32>();
        sampled += 1;
    }
    let sample_spacing = 2.0 * (variance / sampled.max(1) as f32).sqrt() / (count as f32).sqrt();
    if sample_spacing.is_finite() {
        sample_spacing
    } else {
        0.0
    }
}

/// [`unshadowed_within`] in a level of two meters or more, at a single position.
#[must_use]
#[inline]
pub fn unshadowed(light: &FrameLight, x: Vec3, n: Vec3) -> f32 {
    unshadowed_within(light, x, n, f32::MAX, 0.0)
}

/// Irradiance at (x, n) from `light` with color one and without shadows, in a scene as large as
/// `extent` (meters): 1/m² (point, spot, patch) or dimensionless (directional). Finite for every
/// input that is.
///
/// A point or spot light nearer to the position's plane than `sample_spacing` (meters) shines from
/// that height: I cos θ / d² is far narrower there than the positions are apart, which would miss
/// it or take it for all of their surface. What a plane receives does not depend on the height.
#[must_use]
#[inline]
pub fn unshadowed_within(
    light: &FrameLight,
    x: Vec3,
    n: Vec3,
    extent: f32,
    sample_spacing: f32,
) -> f32 {
    let axis = Vec3::from_array(light.direction);
    if light.kind == FrameLight::NONE {
        return 0.0;
    }
    if light.kind == FrameLight::DIRECTIONAL {
        return n.dot(-axis).max(0.0);
    }
    let to = Vec3::from_array(light.position) - x;
    let square = to.dot(to);
    if square <= 0.0 {
        return 0.0;
    }
    let height = n.dot(to);
    let to = to / square.sqrt();
    let mut e = n.dot(to).max(0.0) / square.max(min_distance_squared(extent));
    if light.kind == FrameLight::PATCH {
        return e * (-to.dot(axis)).max(0.0);
    }
    if height > 0.0 && height < sample_spacing {
        let lifted = square - height * height + sample_spacing * sample_spacing;
        e = sample_spacing / (lifted * lifted.sqrt());
    }
    let factor = square * light.inverse_square_range;
    let window = (1.0 - factor * factor).clamp(0.0, 1.0);
    e *= window * window;
    if light.kind == FrameLight::SPOT {
        let cone = (-to.dot(axis) * light.spot_scale + light.spot_offset).clamp(0.0, 1.0);
        e *= cone * cone;
    }
    e
}

/// The shadow ray from (x, n) to `light`: it starts and ends one [`ray_offset`] off the surfaces.
/// None where nothing fits between.
#[must_use]
#[inline]
pub fn shadow_ray(light: &FrameLight, x: Vec3, n: Vec3, extent: f32) -> Option<Ray> {
    let lift = ray_offset(x, extent);
    let origin = x + n * lift;
    if light.kind == FrameLight::DIRECTIONAL {
        return Some(Ray::segment(
            origin,
            -Vec3::from_array(light.direction),
            FAR,
        ));
    }
    let to = Vec3::from_array(light.position) - origin;
    let distance = to.dot(to).sqrt();
    let max_t = distance - lift;
    (max_t > 0.0).then(|| Ray::segment(origin, to / distance, max_t))
}

/// Irradiance at (x, n) from `light` with color one.
#[must_use]
#[inline]
pub fn project_at(bvh: &Bvh, extent: f32, light: &FrameLight, x: Vec3, n: Vec3) -> f32 {
    apply_shadow(
        bvh,
        extent,
        light,
        x,
        n,
        unshadowed_within(light, x, n, extent, 0.0),
    )
}

/// Part of `e` that reaches (x, n) from `light`, through occluders.
#[inline]
fn apply_shadow(bvh: &Bvh, extent: f32, light: &FrameLight, x: Vec3, n: Vec3, e: f32) -> f32 {
    if e <= 0.0 {
        return 0.0;
    }
    match shadow_ray(light, x, n, extent) {
        Some(ray) => e * bvh.transmittance(&ray),
        None => e,
    }
}

/// Most samples of a sender for one patch of a rectangle light. The patches are many, and their
/// shadow edges blend.
pub const PATCH_SAMPLES: usize = 4;

/// Samples among a sender's `own` that `light` is projected onto: all of them, or [`PATCH_SAMPLES`]
/// evenly from them.
pub fn samples_for_light<'a>(
    light: &FrameLight,
    own: &'a [LightSample],
) -> impl ExactSizeIterator<Item = &'a LightSample> {
    let stride = match light.kind {
        FrameLight::PATCH => own.len().div_ceil(PATCH_SAMPLES).max(1),
        _ => 1,
    };
    own.iter().skip(stride / 2).step_by(stride)
}

/// Irradiance of sender `j` from `light` with color one. `bvh` is the scene's, with the gains that
/// its occluders have now.
#[must_use]
#[inline]
pub fn project_sender(
    scene: &SceneData,
    bvh: &Bvh,
    extent: f32,
    sample_spacing: f32,
    light: &FrameLight,
    j: usize,
) -> f32 {
    let at = |x, n| project_at(bvh, extent, light, x, n);
    let near = |x, n| {
        let e = unshadowed_within(light, x, n, extent, sample_spacing);
        apply_shadow(bvh, extent, light, x, n, e)
    };
    let count = scene.light_samples.per_sender as usize;
    let finest = scene.finest_senders().start;
    if j < finest || count == 0 {
        let point = &scene.points[j];
        return at(point.x(), point.n());
    }
    let own = &scene.light_samples.list[(j - finest) * count..(j - finest + 1) * count];
    let samples = samples_for_light(light, own);
    let used = samples.len() as f32;
    samples.map(|p| near(p.x(), p.n())).sum::<f32>() / used
}

/// Fills `out`, one value a sender.
pub fn project(
    scene: &SceneData,
    bvh: &Bvh,
    extent: f32,
    sample_spacing: f32,
    light: &FrameLight,
    out: &mut [f32],
) {
    out.par_iter_mut()
        .with_min_len(16)
        .enumerate()
        .for_each(|(j, e)| *e = project_sender(scene, bvh, extent, sample_spacing, light, j));
}
