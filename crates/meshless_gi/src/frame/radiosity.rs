//! Kernel `radiosity`: b = ρE + M of every sender, from the projected lights and the sky (design
//! D1). This is the sender's coefficient. `pull` later replaces the coefficients of coarser senders
//! by the mean over their support.

use super::layout::SolveParams;
use super::light::FrameLight;
use crate::asset::PointSurface;
use crate::samples::Point;
use glam::{Vec3, Vec4};
use rayon::prelude::*;

/// Points, surfaces and sky visibility of the senders.
#[derive(Clone, Copy, Debug)]
pub struct SenderInputs<'a> {
    /// Points of the scene, senders first.
    pub points: &'a [Point],
    /// Surfaces of the senders.
    pub surfaces: &'a [PointSurface],
    /// Visibility of the sky's further terms, one row per sender. Empty if the bake supports a
    /// uniform sky only.
    pub sky: &'a [[f32; 8]],
}

/// Returns the direct irradiance of sender `j` from the sky, W/m².
#[must_use]
#[inline]
pub fn sky_at(params: &SolveParams, inputs: &SenderInputs<'_>, j: usize) -> Vec3 {
    let cosine = Vec3::from_array(inputs.surfaces[j].sky).dot(inputs.points[j].n());
    let mut e = Vec3::from_array(params.sky) * cosine.max(0.0);
    if params.sky_terms == 0 {
        return e;
    }
    for (term, visible) in params.sky_more.iter().zip(&inputs.sky[j]) {
        e += Vec4::from_array(*term).truncate() * *visible;
    }
    // The truncated series can be negative.
    e.max(Vec3::ZERO)
}

/// Returns the radiosity of sender `j`, W/m². `projected` holds the irradiances for light color
/// one: `params.senders` values per slot, slot after slot.
#[must_use]
#[inline]
pub fn radiosity_at(
    params: &SolveParams,
    lights: &[FrameLight],
    projected: &[f32],
    inputs: &SenderInputs<'_>,
    j: usize,
) -> Vec3 {
    let surface = &inputs.surfaces[j];
    let mut e = Vec3::ZERO;
    for (slot, light) in lights[..params.slots as usize].iter().enumerate() {
        e += Vec3::from_array(light.color) * projected[slot * params.senders as usize + j];
    }
    e += sky_at(params, inputs, j);
    Vec3::from_array(surface.albedo) * e + Vec3::from_array(surface.emission) * params.emission
}

/// Fills the first coefficients of the senders, followed by those of the sky, W/m².
pub fn radiosity(
    params: &SolveParams,
    lights: &[FrameLight],
    projected: &[f32],
    inputs: &SenderInputs<'_>,
    senders: &mut [[f32; 4]],
) {
    senders[..params.senders as usize]
        .par_iter_mut()
        .with_min_len(256)
        .enumerate()
        .for_each(|(j, b)| {
            *b = radiosity_at(params, lights, projected, inputs, j)
                .extend(0.0)
                .to_array();
        });
    let sky = params.sky_sender as usize;
    senders[sky] = Vec3::from_array(params.sky).extend(0.0).to_array();
    let terms = params.sky_terms as usize;
    senders[sky + 1..][..terms].copy_from_slice(&params.sky_more[..terms]);
}
