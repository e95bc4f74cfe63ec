//! Kernel `radiosity`: b = ρE + M at every lit point, from the projected lights and the sky (design D1). A sender's own radiosity is its
//! coefficient until `pull` replaces it by the mean over its support.

use super::layout::SolveParams;
use super::light::FrameLight;
use crate::asset::PointSurface;
use crate::samples::Point;
use glam::Vec3;
use rayon::prelude::*;

/// Radiosity of point `p`, W/m². `projected` holds the irradiances of light colour one, slot after slot, `params.lit` each.
#[must_use]
#[inline]
pub fn radiosity_at(
    params: &SolveParams,
    lights: &[FrameLight],
    projected: &[f32],
    point: &Point,
    surface: &PointSurface,
    p: usize,
) -> Vec3 {
    let mut e = Vec3::ZERO;
    for (slot, light) in lights[..params.slots as usize].iter().enumerate() {
        e += Vec3::from_array(light.color) * projected[slot * params.lit as usize + p];
    }
    e += Vec3::from_array(params.sky) * Vec3::from_array(surface.sky).dot(point.n()).max(0.0);
    Vec3::from_array(surface.albedo) * e + Vec3::from_array(surface.emission) * params.emission
}

/// Fills `radiosity` (one a lit point) and the senders' first coefficients, the sky's behind them, W/m².
pub fn radiosity(
    params: &SolveParams,
    lights: &[FrameLight],
    projected: &[f32],
    points: &[Point],
    surfaces: &[PointSurface],
    radiosity: &mut [[f32; 4]],
    senders: &mut [[f32; 4]],
) {
    radiosity
        .par_iter_mut()
        .with_min_len(256)
        .enumerate()
        .for_each(|(p, b)| {
            *b = radiosity_at(params, lights, projected, &points[p], &surfaces[p], p)
                .extend(0.0)
                .to_array();
        });
    let count = params.senders as usize;
    senders[..count].copy_from_slice(&radiosity[..count]);
    senders[params.sky_sender as usize] = Vec3::from_array(params.sky).extend(0.0).to_array();
}
