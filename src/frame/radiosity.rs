//! Kernel `radiosity`: b = ρE + M of every sender, from the projected lights and the sky (design D1): its coefficient until `pull` replaces those of
//! coarser senders by the mean over their support.

use super::layout::SolveParams;
use super::light::FrameLight;
use crate::asset::PointSurface;
use crate::samples::Point;
use glam::Vec3;
use rayon::prelude::*;

/// Radiosity of sender `j`, W/m². `projected` holds the irradiances of light colour one, slot after slot, `params.senders` each.
#[must_use]
#[inline]
pub fn radiosity_at(
    params: &SolveParams,
    lights: &[FrameLight],
    projected: &[f32],
    point: &Point,
    surface: &PointSurface,
    j: usize,
) -> Vec3 {
    let mut e = Vec3::ZERO;
    for (slot, light) in lights[..params.slots as usize].iter().enumerate() {
        e += Vec3::from_array(light.color) * projected[slot * params.senders as usize + j];
    }
    e += Vec3::from_array(params.sky) * Vec3::from_array(surface.sky).dot(point.n()).max(0.0);
    Vec3::from_array(surface.albedo) * e + Vec3::from_array(surface.emission) * params.emission
}

/// Fills the senders' first coefficients, the sky's behind them, W/m².
pub fn radiosity(
    params: &SolveParams,
    lights: &[FrameLight],
    projected: &[f32],
    points: &[Point],
    surfaces: &[PointSurface],
    senders: &mut [[f32; 4]],
) {
    senders[..params.senders as usize]
        .par_iter_mut()
        .with_min_len(256)
        .enumerate()
        .for_each(|(j, b)| {
            *b = radiosity_at(params, lights, projected, &points[j], &surfaces[j], j)
                .extend(0.0)
                .to_array();
        });
    senders[params.sky_sender as usize] = Vec3::from_array(params.sky).extend(0.0).to_array();
}
