//! Kernel `rsm`: converts a reflective shadow map (\[N09\] §3.1) to virtual point lights (VPLs).
//! The map is a small deferred view from the light. It contains only dynamic objects, because the
//! bake has the reflection of static surfaces.
//!
//! | entry | function |
//! |---|---|
//! | [`texel`] | depth and G-buffer → position, normal and reflected flux of each texel |
//! | [`shadow`] | sets the flux of texels in the shadow of a baked scene to zero |
//! | [`select_vpls`] | texels → virtual point lights |
//!
//! Deviations from \[N09\]:
//!
//! - **Solid angle.** In \[N09\] all texels subtend the same solid angle, which its §5 names as a
//!   visible error (Fig. 13). Here each texel has its exact solid angle.
//! - **Selection.** In \[N09\] the VPLs are a fixed grid of texels. It flickers as surfaces move
//!   past them (§5.1) and loses everything between them. Here they are strata of equal flux along a
//!   Hilbert curve through the map, with boundaries inside texels. The light of a stratum is the
//!   mean of its texels, so all flux is kept and VPLs move continuously.

use super::gbuffer;
use super::project::shadow_ray;
use super::rsm_layout::{RsmParams, RsmSelectParams, RsmShadowParams, RsmTexel, Vpl};
use super::{FrameLight, vpl};
use crate::scene::Bvh;
use glam::{Mat4, Vec2, Vec3, Vec4};

/// Threads of `select_vpls`. Each sums a run of texels.
pub const CHUNKS: usize = 256;
/// Largest distance from the space's origin, meters. Texels beyond it are dark.
pub const MAX_DISTANCE: f32 = 1e8;
/// Lower bound of the cosine in a texel's area.
pub const MIN_COSINE: f32 = 0.1;
/// Squared distance below which the irradiance of a light does not increase, m². One square
/// centimeter, as for Bevy's lights.
pub const MIN_DISTANCE_SQUARED: f32 = 1e-4;

/// Returns the index of texel (x, y) along the Hilbert curve through a map of `side` texels.
/// Neighbors on the curve are neighbors in the map, unlike on a Morton curve.
#[must_use]
pub fn hilbert_index(side: u32, x: u32, y: u32) -> u32 {
    let (mut x, mut y, mut at) = (x, y, 0);
    let mut s = side / 2;
    while s > 0 {
        let rx = u32::from(x & s != 0);
        let ry = u32::from(y & s != 0);
        at += s * s * ((3 * rx) ^ ry);
        // Rotates the quadrant, so that its curve begins at the end of the previous one.
        if ry == 0 {
            if rx == 1 {
                (x, y) = ((side - 1) - x, (side - 1) - y);
            }
            (x, y) = (y, x);
        }
        s /= 2;
    }
    at
}

/// Returns the solid angle, from the origin, of the parallelogram with corner `a` and edges `e`,
/// `f`, sr. Sums two triangles by Van Oosterom & Strackee's formula. The volume a·(e×f) is the same
/// for both and involves no cancellation.
fn solid_angle(a: Vec3, e: Vec3, f: Vec3) -> f32 {
    let volume = a.dot(e.cross(f)).abs();
    let corners = [a, a + e, a + e + f, a + f];
    let half = |b: Vec3, c: Vec3| {
        let (la, lb, lc) = (a.length(), b.length(), c.length());
        let below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
        libm::atan2f(volume, below)
    };
    2.0 * (half(corners[1], corners[2]) + half(corners[2], corners[3]))
}

/// Returns the solid angle of the texel at (`column`, `row`) from the upper left, sr.
fn texel_angle(params: &RsmParams, pixel: [u32; 2]) -> f32 {
    let [forward, right, up] = [params.forward, params.right, params.up].map(Vec3::from_array);
    let step = 2.0 / params.side as f32;
    let corner =
        forward + right * (pixel[0] as f32 * step - 1.0) + up * (1.0 - pixel[1] as f32 * step);
    solid_angle(corner, right * step, up * -step)
}

/// Returns the texel that the shader writes at [`hilbert_index`] for the texel (column, row) with
/// this depth and G-buffer.
///
/// The texel stores the reflected flux Φρ. Φ of a directional light is the irradiance times the
/// texel's cross-section. Φ of other lights is I(ω) dω with Bevy's cone and its window at the
/// range. The texel is zero for the background, for unlit materials, for positions that the light
/// does not reach, and for surfaces that face away.
#[must_use]
pub fn texel(params: &RsmParams, pixel: [u32; 2], depth: f32, gbuffer: [u32; 4]) -> RsmTexel {
    let light = &params.light;
    let dark = RsmTexel::default();
    if depth <= 0.0 || gbuffer::is_unlit(gbuffer) || light.kind == FrameLight::NONE {
        return dark;
    }
    let uv = (Vec2::new(pixel[0] as f32, pixel[1] as f32) + 0.5) / params.side as f32;
    let ndc = Vec4::new(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, depth, 1.0);
    let h = Mat4::from_cols_array_2d(&params.space_from_clip) * ndc;
    let x = h.truncate() / h.w;
    // The negated comparison rejects NaN too.
    if !x.abs().cmplt(Vec3::splat(MAX_DISTANCE)).all() {
        return dark;
    }
    let n = gbuffer::normal(gbuffer);
    let axis = Vec3::from_array(light.direction);
    let (arriving, area, cosine);
    if light.kind == FrameLight::DIRECTIONAL {
        (arriving, area, cosine) = (params.area, params.area, n.dot(-axis));
    } else {
        let toward = Vec3::from_array(light.position) - x;
        let square = toward.dot(toward);
        if square <= 0.0 {
            return dark;
        }
        let to = toward / square.sqrt();
        let angle = texel_angle(params, pixel);
        (area, cosine) = (angle * square, n.dot(to));
        let mut flux = angle * (square / square.max(MIN_DISTANCE_SQUARED));
        if light.kind == FrameLight::PATCH {
            flux *= (-to.dot(axis)).max(0.0);
        } else {
            let factor = square * light.inverse_square_range;
            let window = (1.0 - factor * factor).clamp(0.0, 1.0);
            flux *= window * window;
        }
        if light.kind == FrameLight::SPOT {
            let cone = (-to.dot(axis) * light.spot_scale + light.spot_offset).clamp(0.0, 1.0);
            flux *= cone * cone;
        }
        arriving = flux;
    }
    let flux = arriving * Vec3::from_array(light.color).max(Vec3::ZERO) * gbuffer::diffuse(gbuffer);
    if cosine <= 0.0 || flux.max_element() <= 0.0 {
        return dark;
    }
    RsmTexel {
        position: x.to_array(),
        // Mean squared distance of a square of area A from its center: A / 6.
        spread: area / (6.0 * cosine.max(MIN_COSINE)),
        normal: n.to_array(),
        flux: flux.to_array(),
        ..dark
    }
}

/// Returns all texels of a map, in the order of the curve. `depth` and `gbuffer` are stored row by
/// row.
///
/// # Panics
/// Panics if there are fewer than `params.side`² of them.
#[must_use]
pub fn texels(params: &RsmParams, depth: &[f32], gbuffer: &[[u32; 4]]) -> Vec<RsmTexel> {
    let side = params.side as usize;
    let mut out = vec![RsmTexel::default(); side * side];
    for y in 0..params.side {
        for x in 0..params.side {
            let i = y as usize * side + x as usize;
            out[hilbert_index(params.side, x, y) as usize] =
                texel(params, [x, y], depth[i], gbuffer[i]);
        }
    }
    out
}

/// Returns the transmittance of a baked scene from the light to a texel.
#[must_use]
pub fn light_transmittance(params: &RsmShadowParams, bvh: &Bvh, texel: &RsmTexel) -> f32 {
    let local = Mat4::from_cols_array_2d(&params.local_from_space);
    let x = local.transform_point3(texel.position.into());
    let n = local.transform_vector3(texel.normal.into());
    let n = n / n.length().max(f32::MIN_POSITIVE);
    // Dynamic objects are not in the BVH, so the offset only covers rounding.
    shadow_ray(&params.light, x, n, params.extent).map_or(1.0, |ray| bvh.transmittance(&ray))
}

/// Multiplies the flux of each texel by the transmittance of a baked scene. Runs once per scene.
pub fn shadow(params: &RsmShadowParams, bvh: &Bvh, texels: &mut [RsmTexel]) {
    if params.nodes == 0 {
        return;
    }
    for texel in &mut texels[..params.texels as usize] {
        if texel.flux != [0.0; 3] {
            let passes = light_transmittance(params, bvh, texel);
            texel.flux = texel.flux.map(|f| f * passes);
        }
    }
}

/// Returns the importance of a texel for the strata: the sum of its channels, so that every channel
/// counts.
fn importance(texel: &RsmTexel) -> f32 {
    texel.flux[0] + texel.flux[1] + texel.flux[2]
}

/// Returns the virtual point lights of a light: `params.vpls` strata of equal flux along the curve.
/// A texel on a boundary contributes a part to each of the two strata.
///
/// Each virtual point light is the flux-weighted mean of its stratum. Sums are grouped like the
/// threads of the shader.
#[must_use]
pub fn select_vpls(params: &RsmSelectParams, texels: &[RsmTexel]) -> Vec<Vpl> {
    let texels = &texels[..params.texels as usize];
    let run = texels.len().div_ceil(CHUNKS).max(1);
    // Flux before each run of texels.
    let mut before = [0.0f32; CHUNKS + 1];
    for c in 0..CHUNKS {
        let first = (c * run).min(texels.len());
        let last = (first + run).min(texels.len());
        let sum = texels[first..last]
            .iter()
            .fold(0.0, |s, t| s + importance(t));
        before[c + 1] = before[c] + sum;
    }
    let total = before[CHUNKS];
    let edge = |k: u32| total * (k as f32 / params.vpls as f32);
    (0..params.vpls)
        .map(|k| stratum(texels, run, &before, edge(k), edge(k + 1)))
        .collect()
}

/// Returns the virtual point light of the flux from `low` to `high`.
fn stratum(texels: &[RsmTexel], run: usize, before: &[f32], low: f32, high: f32) -> Vpl {
    if high <= low {
        return Vpl::default();
    }
    // The last run that begins below `low`.
    let mut chunk = before[..CHUNKS].partition_point(|b| *b < low).max(1) - 1;
    let (mut flux, mut weight) = (Vec3::ZERO, 0.0);
    let (mut position, mut normal, mut square) = (Vec3::ZERO, Vec3::ZERO, 0.0);
    // Positions are summed relative to the first one. This avoids cancellation of large squares in
    // their spread.
    let mut anchor = None;
    while chunk < CHUNKS && before[chunk] < high {
        let first = (chunk * run).min(texels.len());
        let last = (first + run).min(texels.len());
        let (low, high) = (low - before[chunk], high - before[chunk]);
        let mut sum = 0.0;
        for texel in &texels[first..last] {
            let w = importance(texel);
            if w <= 0.0 {
                continue;
            }
            let until = |edge: f32| ((edge - sum) / w).clamp(0.0, 1.0);
            let share = until(high) - until(low);
            sum += w;
            if share <= 0.0 {
                continue;
            }
            let x = Vec3::from_array(texel.position);
            let d = x - *anchor.get_or_insert(x);
            let v = share * w;
            flux += share * Vec3::from_array(texel.flux);
            weight += v;
            position += v * d;
            normal += v * Vec3::from_array(texel.normal);
            square += v * (d.dot(d) + texel.spread);
        }
        chunk += 1;
    }
    let Some(anchor) = anchor.filter(|_| weight > 0.0) else {
        return Vpl::default();
    };
    let mean = position / weight;
    let spread = (square / weight - mean.dot(mean)).max(0.0);
    Vpl {
        position: (anchor + mean).to_array(),
        square: vpl::DISK * spread,
        normal: (normal / weight).to_array(),
        flux: flux.to_array(),
        ..Vpl::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hilbert_curve_visits_each_texel_once_by_neighbors() {
        for side in [1, 2, 8, 64] {
            let mut at = vec![None; (side * side) as usize];
            for y in 0..side {
                for x in 0..side {
                    let cell = &mut at[hilbert_index(side, x, y) as usize];
                    assert!(cell.replace((x, y)).is_none());
                }
            }
            for pair in at.windows(2) {
                let ((a, b), (c, d)) = (pair[0].unwrap(), pair[1].unwrap());
                assert_eq!(a.abs_diff(c) + b.abs_diff(d), 1, "side {side}");
            }
        }
    }

    #[test]
    fn cube_faces_cover_each_direction_once() {
        let light = FrameLight::point(Vec3::new(3.0, 1.0, 2.0), Vec3::ONE, f32::INFINITY);
        let eye = Vec3::from_array(light.position);
        let clip = Mat4::perspective_infinite_reverse_rh(std::f32::consts::FRAC_PI_2, 1.0, 0.1);
        for side in [1, 4, 64] {
            let view = Mat4::look_at_rh(eye, eye + Vec3::X, Vec3::Y);
            let m = super::super::rsm_layout::space_from_clip(&view.inverse(), &clip, Vec3::ZERO);
            let params = RsmParams::new(m, &light, side, 0);
            let all: f64 = (0..side * side)
                .map(|i| f64::from(texel_angle(&params, [i % side, i / side])))
                .sum();
            let right = 4.0 * std::f64::consts::PI / 6.0;
            assert!((all / right - 1.0).abs() < 1e-4, "{side}: {all}");
            if side == 64 {
                // The corner lies at cos = 1/√3, so its solid angle is about cos³ of that in the
                // middle.
                let ratio = texel_angle(&params, [0, 0]) / texel_angle(&params, [32, 32]);
                assert!((ratio - 3f32.powf(-1.5)).abs() < 0.01, "{ratio}");
            }
        }
    }
}
