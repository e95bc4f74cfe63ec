//! Kernel `rsm`: a reflective shadow map (\[N09\] §3.1) becomes virtual point lights. The map is a
//! small deferred view from the light that holds dynamic objects and nothing else: what static
//! surfaces reflect is in the bake.
//!
//! | entry | function |
//! |---|---|
//! | [`texel`] | depth and G-buffer → position, normal and reflected flux of each texel |
//! | [`shadow`] | sets the flux of texels in the shadow of a baked scene to zero |
//! | [`select_vpls`] | texels → virtual point lights |
//!
//! Deviations from \[N09\]. Its texels all subtend the same solid angle, which §5 names as a
//! visible error (Fig. 13); ours have the exact one. Its VPLs are a fixed grid of texels, which
//! flickers as surfaces move past them (§5.1) and loses what lies between; ours are strata of equal
//! flux along a Hilbert curve through the map, with boundaries inside of texels: a stratum's light
//! is the mean of its texels, so that all flux is kept and nothing jumps.

use super::gbuffer;
use super::project::shadow_ray;
use super::rsm_layout::{RsmParams, RsmSelectParams, RsmShadowParams, RsmTexel, Vpl};
use super::{FrameLight, vpl};
use crate::scene::Bvh;
use glam::{Mat4, Vec2, Vec3, Vec4};

/// Threads of `select_vpls`. Each sums a run of texels.
pub const CHUNKS: usize = 256;
/// Largest distance from the space's origin, meters. Texels beyond it are dark.
pub const FARTHEST: f32 = 1e8;
/// Lower bound of the cosine in a texel's area.
pub const MIN_COSINE: f32 = 0.1;
/// Squared distance below which a light grows no brighter (a square centimeter, as for Bevy's
/// lights), m².
pub const NEAREST_SQUARE: f32 = 1e-4;

/// Index of texel (x, y) along Hilbert's curve through a map of `side` texels. Neighbors on the
/// curve are neighbors in the map, unlike on Morton's curve.
#[must_use]
pub fn hilbert_index(side: u32, x: u32, y: u32) -> u32 {
    let (mut x, mut y, mut at) = (x, y, 0);
    let mut s = side / 2;
    while s > 0 {
        let rx = u32::from(x & s != 0);
        let ry = u32::from(y & s != 0);
        at += s * s * ((3 * rx) ^ ry);
        // Turns the quarter, so that its curve begins where the last one ended.
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

/// Solid angle of the parallelogram with corner `a` and edges `e`, `f`, seen from the origin, sr:
/// two triangles by Van Oosterom & Strackee's formula. The volume a·(e×f) is the same for both, and
/// no difference of nearly equal numbers.
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

/// Solid angle of the texel at (`column`, `row`) from the upper left, sr.
fn texel_angle(params: &RsmParams, pixel: [u32; 2]) -> f32 {
    let [forward, right, up] = [params.forward, params.right, params.up].map(Vec3::from_array);
    let step = 2.0 / params.side as f32;
    let corner =
        forward + right * (pixel[0] as f32 * step - 1.0) + up * (1.0 - pixel[1] as f32 * step);
    solid_angle(corner, right * step, up * -step)
}

/// One texel: what the shader writes at [`hilbert_index`] for the texel (column, row) with this
/// depth and G-buffer.
///
/// Reflected flux Φρ: of a light, I(ω) dω with Bevy's cone and window at the range; of a
/// directional light, irradiance times the texel's cross-section. Nothing where nothing was drawn,
/// where no light applies, and on the side that looks away.
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
    // A NaN is not below either.
    if !x.abs().cmplt(Vec3::splat(FARTHEST)).all() {
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
        let mut flux = angle * (square / square.max(NEAREST_SQUARE));
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
        // A square of area A: A / 6.
        spread: area / (6.0 * cosine.max(MIN_COSINE)),
        normal: n.to_array(),
        flux: flux.to_array(),
        ..dark
    }
}

/// All texels of a map, in the order of the curve. `depth` and `gbuffer` row by row.
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

/// Transmittance of a baked scene from the light to a texel.
#[must_use]
pub fn light_transmittance(params: &RsmShadowParams, bvh: &Bvh, texel: &RsmTexel) -> f32 {
    let local = Mat4::from_cols_array_2d(&params.local_from_space);
    let x = local.transform_point3(texel.position.into());
    let n = local.transform_vector3(texel.normal.into());
    let n = n / n.length().max(f32::MIN_POSITIVE);
    // Dynamic objects are not in the tree: the offset is for rounding only.
    shadow_ray(&params.light, x, n, params.extent).map_or(1.0, |ray| bvh.transmittance(&ray))
}

/// Takes the flux from the texels that a baked scene keeps the light from. Once for each scene.
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

/// Importance of a texel when strata are cut: the sum of its channels, so that none is neglected.
fn importance(texel: &RsmTexel) -> f32 {
    texel.flux[0] + texel.flux[1] + texel.flux[2]
}

/// The virtual point lights of a light: `params.vpls` strata of equal flux along the curve. A texel
/// on a boundary belongs to both sides, in parts.
///
/// Each is the flux-weighted mean of its stratum. Sums are grouped as the shader's threads do it.
#[must_use]
pub fn select_vpls(params: &RsmSelectParams, texels: &[RsmTexel]) -> Vec<Vpl> {
    let texels = &texels[..params.texels as usize];
    let run = texels.len().div_ceil(CHUNKS).max(1);
    // Flux before each run.
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

/// The light of the flux from `low` to `high`.
fn stratum(texels: &[RsmTexel], run: usize, before: &[f32], low: f32, high: f32) -> Vpl {
    if high <= low {
        return Vpl::default();
    }
    // The last run that begins below `low`.
    let mut chunk = before[..CHUNKS].partition_point(|b| *b < low).max(1) - 1;
    let (mut flux, mut weight) = (Vec3::ZERO, 0.0);
    let (mut position, mut normal, mut square) = (Vec3::ZERO, Vec3::ZERO, 0.0);
    // Positions are summed relative to the first, so that their spread is no difference of large
    // squares.
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
                // The corner is seen at cos = 1/√3: cos³ of the middle's solid angle, nearly.
                let ratio = texel_angle(&params, [0, 0]) / texel_angle(&params, [32, 32]);
                assert!((ratio - 3f32.powf(-1.5)).abs() < 0.01, "{ratio}");
            }
        }
    }
}
