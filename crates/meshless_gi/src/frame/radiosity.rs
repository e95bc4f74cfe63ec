//! Kernel `radiosity`: b = ρE + M of every sender, from the projected lights and the sky (design
//! D1): its coefficient until `pull` replaces those of coarser senders by the mean over their
//! support.

use super::layout::SolveParams;
use super::light::FrameLight;
use crate::asset::PointSurface;
use crate::samples::Point;
use glam::{Vec3, Vec4};
use rayon::prelude::*;

/// What sender `j` has straight from the sky, W/m². `seen` holds the sender's numbers of the sky's
/// terms, where the bake has them.
#[must_use]
#[inline]
pub fn sky_at(
    params: &SolveParams,
    point: &Point,
    surface: &PointSurface,
    seen: &[[f32; 8]],
    j: usize,
) -> Vec3 {
    let mut e =
        Vec3::from_array(params.sky) * Vec3::from_array(surface.sky).dot(point.n()).max(0.0);
    if params.sky_terms == 0 {
        return e;
    }
    for (term, seen) in params.sky_more.iter().zip(&seen[j]) {
        e += Vec4::from_array(*term).truncate() * *seen;
    }
    // The series may fall below zero.
    e.max(Vec3::ZERO)
}

/// Radiosity of sender `j`, W/m². `projected` holds the irradiances of light color one, slot after
/// slot, `params.senders` each.
#[must_use]
#[inline]
pub fn radiosity_at(
    params: &SolveParams,
    lights: &[FrameLight],
    projected: &[f32],
    point: &Point,
    surface: &PointSurface,
    seen: &[[f32; 8]],
    j: usize,
) -> Vec3 {
    let mut e = Vec3::ZERO;
    for (slot, light) in lights[..params.slots as usize].iter().enumerate() {
        e += Vec3::from_array(light.color) * projected[slot * params.senders as usize + j];
    }
    e += sky_at(params, point, surface, seen, j);
    Vec3::from_array(surface.albedo) * e + Vec3::from_array(surface.emission) * params.emission
}

/// Fills the senders' first coefficients, those of the sky behind them, W/m². `seen` is empty where
/// the bake knows a uniform sky only.
pub fn radiosity(
    params: &SolveParams,
    lights: &[FrameLight],
    projected: &[f32],
    points: &[Point],
    surfaces: &[PointSurface],
    seen: &[[f32; 8]],
    senders: &mut [[f32; 4]],
) {
    senders[..params.senders as usize]
        .par_iter_mut()
        .with_min_len(256)
        .enumerate()
        .for_each(|(j, b)| {
            *b = radiosity_at(params, lights, projected, &points[j], &surfaces[j], seen, j)
                .extend(0.0)
                .to_array();
        });
    let sky = params.sky_sender as usize;
    senders[sky] = Vec3::from_array(params.sky).extend(0.0).to_array();
    let terms = params.sky_terms as usize;
    senders[sky + 1..][..terms].copy_from_slice(&params.sky_more[..terms]);
}
