//! Kernel `project`: scalar irradiance of each sender from one light of color one, shadows
//! included. It is the mean over the sender's samples, so that a shadow edge moves smoothly over
//! the sender (\[L08\] evaluates the light at its center). Visibility is a ray through the baked
//! BVH (design D8). The units are Bevy's: E = I cos θ / d², with Bevy's window at the range and
//! Bevy's cone.

use super::light::FrameLight;
use crate::asset::SceneData;
use crate::samples::LightSample;
use crate::scene::{Bvh, Ray};
use glam::Vec3;
use rayon::prelude::*;

/// Length of a directional light's shadow rays, meters.
pub const FAR: f32 = 1e30;

/// Returns the largest edge of the box around the geometry, meters, or 0 without geometry.
#[must_use]
pub fn extent(scene: &SceneData) -> f32 {
    let [min, max] = scene.bounds.map(Vec3::from_array);
    let size = (max - min).max_element();
    if size.is_finite() { size.max(0.0) } else { 0.0 }
}

/// Returns the offset of a shadow ray's origin from the surface at `x`, meters. The formula is that
/// of [`Geometry::ray_offset`](crate::scene::Geometry::ray_offset).
#[must_use]
#[inline]
pub fn ray_offset(x: Vec3, extent: f32) -> f32 {
    (1e-5 * extent).max(8.0 * f32::EPSILON * x.abs().max_element().max(extent))
}

/// Returns the squared distance below which a light becomes no brighter, m². This is Bevy's square
/// centimeter, scaled down with scenes below two meters.
#[must_use]
#[inline]
pub fn min_distance_squared(extent: f32) -> f32 {
    (2.5e-5 * extent * extent).clamp(f32::MIN_POSITIVE, 1e-4)
}

/// Returns the spacing of the samples of a sender, meters. Returns 0 if senders are lit at their
/// own points only.
///
/// Samples are distributed like the kernel weight, with a variance of 0.24 of its squared radius.
/// The disks of that level's points have 0.8 of the radius, and there are 0.7 of them per square of
/// that edge. A sample therefore represents a square of edge 2σ / √samples.
#[must_use]
pub fn sample_spacing(scene: &SceneData) -> f32 {
    const MAX_SAMPLED_SENDERS: usize = 256;
    let count = scene.light_samples.per_sender as usize;
    if count < 2 {
        return 0.0;
    }
    let senders = scene.light_samples.list.chunks_exact(count);
    let stride = senders.len().div_ceil(MAX_SAMPLED_SENDERS).max(1);
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

/// Computes [`unshadowed_within`] for a scene of two meters or more, at a single position.
#[must_use]
#[inline]
pub fn unshadowed(light: &FrameLight, x: Vec3, n: Vec3) -> f32 {
    unshadowed_within(light, x, n, f32::MAX, 0.0)
}

/// Returns the irradiance at (x, n) from `light` with color one and without shadows. `extent` is
/// the size of the scene, meters. The result is in 1/m² (point, spot, patch) or dimensionless
/// (directional). It is finite for every finite input.
///
/// A point or spot light closer to the position's plane than `sample_spacing` (meters) is moved to
/// that height. I cos θ / d² is much narrower there than the distance between samples. The samples
/// would miss the peak or apply it to all of their surface. The total power on a plane does not
/// depend on the height.
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

/// Returns the shadow ray from (x, n) to `light`. It starts and ends one [`ray_offset`] off the
/// surfaces. Returns `None` if the light is closer than these offsets.
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

/// Returns the irradiance at (x, n) from `light` with color one, shadows included.
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

/// Returns the part of `e` that reaches (x, n) from `light` through occluders.
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

/// Maximum number of samples of a sender for one patch of a rectangle light. The shadow edges of
/// the many patches blend.
pub const PATCH_SAMPLES: usize = 4;

/// Returns the samples of a sender's `own` onto which `light` is projected. These are all of them,
/// or at most [`PATCH_SAMPLES`] at regular steps for a patch.
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

/// Returns the irradiance of sender `j` from `light` with color one. `bvh` is the scene's BVH with
/// the current transmittances of its occluders.
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

/// Fills `out` with one value per sender.
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
