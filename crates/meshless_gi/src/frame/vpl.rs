//! Kernel `vpl`: irradiance from virtual point lights, \[N09\] Eq. (2) with diffuse reflection at
//! both ends: E = Σ Φ ⟨V̂, N_l⟩ ⟨−V̂, N_s⟩ / (π r²). It optionally traces a shadow ray through a
//! baked scene, which \[N09\] lacks (§5, Fig. 13). On the screen it evaluates one position per
//! pixel, as the reference display.
//!
//! A light here represents a piece of surface instead of a point. Two terms differ from Eq. (2):
//! - r² + R² replaces r², where R is the radius of a disk with the same spread as the piece. On the
//!   axis of a uniform, flat disk this is exact at every distance. \[N09\] bounds r² from below by
//!   a constant, which "all RSM approaches" share and Fig. 13 shows.
//! - The mean of ⟨V̂, N⟩ over normals with a uniform distribution around N_l replaces the value at
//!   the mean normal. A piece of a sphere therefore also emits at more than 90° from its mean
//!   normal. Its light adds up to its flux within 2 %.
//!
//! Nearer than four radii, both terms are inaccurate if light and surface are at an angle, such as
//! next to an object on the floor. There a flat light is a square.

use super::gbuffer;
use super::layout::VectorIrradiance;
use super::project::ray_offset;
use super::rsm_layout::{Vpl, VplParams, VplViewParams};
use super::splat::MAX_HALF;
use super::subsplat::{SubsplatNode, state};
use crate::samples::tangents;
use crate::scene::{Bvh, Ray};
use glam::{Mat4, Vec2, Vec3, Vec4};
use std::f32::consts::{FRAC_1_PI, PI};

/// Squared radius of a uniform disk over its mean squared distance from the center.
pub const DISK: f32 = 2.0;
/// Offset of the start of shadow rays in multiples of [`ray_offset`], because positions come from a
/// depth buffer.
pub const RAY_OFFSET_SCALE: f32 = 4.0;

/// Squared distances over the squared radius of a light between which `near` blends to the formula
/// of a point light.
pub const NEAR_SQUARES: [f32; 2] = [9.0, 16.0];
/// Squared lengths of the mean normal between which a light becomes flat enough for `near`.
pub const NEAR_FLAT: [f32; 2] = [0.8, 0.9];
/// Height above the horizon below which a square fades, over half its edge and times the cosine
/// between the two normals.
pub const FADE: f32 = 0.1;
/// Lower bound of the length of an edge and of a form factor, in single precision.
pub const MIN_EDGE_LENGTH: f32 = 1e-7;

/// Returns the mean of max(0, V̂·N) over unit normals N with the mean `normal`. The normals have a
/// uniform distribution over a disk around it.
///
/// If all of them face V̂, the mean is linear, V̂·`normal`, and exact. If none does, it is 0.
/// Between these cases it is the mean over cosines with a uniform distribution within ±w. The width
/// is √(3σ²) of the cosine's variance σ² at the horizon. This variance is (1 − m²)/2 for a length m
/// near 1. The width is 1 for m = 0, where all directions are equally likely.
#[must_use]
#[inline]
pub fn mean_clamped_cosine(normal: Vec3, v: Vec3) -> f32 {
    let cosine = v.dot(normal);
    let s = (1.0 - normal.dot(normal)).clamp(0.0, 1.0);
    let w = (s * (1.5 - 0.5 * s)).sqrt();
    if cosine >= w {
        return cosine;
    }
    if cosine <= -w {
        return 0.0;
    }
    let above = cosine + w;
    above * above / (4.0 * w)
}

/// Returns the unshadowed contribution of one light at `x` to surfaces that face `n`, as a vector g
/// in 1/m². The vector irradiance is flux · g, and g·n is not negative. Zero if the light does not
/// reach the surface.
///
/// Far from the light this is \[N09\] Eq. (2) with the two terms above. Nearer than three radii of
/// a light with almost equal normals, it is the form factor of a square of that size (`near`).
/// Between three and four radii the two are blended.
#[must_use]
#[inline]
pub fn vpl_contribution(light: &Vpl, x: Vec3, n: Vec3) -> Vec3 {
    let toward = Vec3::from_array(light.position) - x;
    let square = toward.dot(toward);
    if square <= 0.0 || Vec3::from_array(light.flux).max_element() <= 0.0 {
        return Vec3::ZERO;
    }
    let normal = Vec3::from_array(light.normal);
    let flat = step(NEAR_FLAT[0], NEAR_FLAT[1], normal.dot(normal));
    let mut out = Vec3::ZERO;
    let mut beside = 1.0;
    if flat > 0.0 && square < NEAR_SQUARES[1] * light.square {
        let far = step(NEAR_SQUARES[0], NEAR_SQUARES[1], square / light.square);
        beside = 1.0 - flat * (1.0 - far);
        out = (1.0 - beside)
            * near_field_direction(toward, normal / normal.length(), light.square, n);
    }
    let to = toward / square.sqrt();
    if n.dot(to) > 0.0 {
        let cosine = mean_clamped_cosine(normal, -to);
        out += to * (beside * FRAC_1_PI * cosine / (square + light.square));
    }
    out
}

/// Returns 0 below `low`, 1 above `high`, and a smooth transition between.
fn step(low: f32, high: f32, v: f32) -> f32 {
    let t = ((v - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Returns the form factor of a square of uniform radiosity over its area, 1/m². The square lies at
/// `toward` from the point, has the normal `normal` and the area of a disk of squared radius
/// `disk`.
///
/// Computes Lambert's sum over the edges. The part below the surface's horizon is estimated as for
/// a sphere of equal form factor. Its cosines have the distribution of [`mean_clamped_cosine`]. A
/// square that hardly rises above the horizon of a surface with a similar normal fades. Rounding
/// then does not make a flat surface light itself.
fn near_field_direction(toward: Vec3, normal: Vec3, disk: f32, n: Vec3) -> Vec3 {
    if normal.dot(toward) >= 0.0 {
        return Vec3::ZERO;
    }
    let (t, b) = tangents(normal);
    let half = 0.5 * (PI * disk).sqrt();
    let top = n.dot(toward) + half * (n.dot(t).abs() + n.dot(b).abs());
    if top <= 0.0 {
        return Vec3::ZERO;
    }
    let corner = |v: Vec3| (toward + half * v).normalize_or_zero();
    let corners = [corner(t + b), corner(b - t), corner(-t - b), corner(t - b)];
    let mut sum = Vec3::ZERO;
    for i in 0..4 {
        let (u, v) = (corners[i], corners[(i + 1) % 4]);
        let across = u.cross(v);
        let sine = across.length();
        sum += across * (libm::atan2f(sine, u.dot(v)) / sine.max(MIN_EDGE_LENGTH));
    }
    // The sign depends on the orientation of the corners.
    let factor = sum * (0.5 * FRAC_1_PI * if sum.dot(toward) < 0.0 { -1.0 } else { 1.0 });
    let length = factor.length();
    if length <= MIN_EDGE_LENGTH {
        return Vec3::ZERO;
    }
    let to = factor / length;
    let wide = length.sqrt();
    let cosine = n.dot(to);
    let clipped = if cosine >= wide {
        cosine
    } else if cosine <= -wide {
        0.0
    } else {
        (cosine + wide) * (cosine + wide) / (4.0 * wide)
    };
    let fade = (top / (FADE * half * n.dot(normal)).max(MIN_EDGE_LENGTH * half)).min(1.0);
    // The vector whose dot product with `n` is the clipped form factor over the area.
    (to + n * (clipped - cosine)) * (fade * length * FRAC_1_PI / disk)
}

/// Returns the start of shadow rays from a surface, in the bake's space.
#[must_use]
#[inline]
pub fn start(params: &VplParams, x: Vec3, n: Vec3) -> Vec3 {
    let local = Mat4::from_cols_array_2d(&params.local_from_space);
    let turned = local.transform_vector3(n);
    let at = local.transform_point3(x);
    at + turned / turned.length().max(f32::MIN_POSITIVE)
        * (RAY_OFFSET_SCALE * ray_offset(at, params.extent))
}

/// Returns the transmittance of the baked scene from a light to the surface point with this
/// [`start`]. `arrives` is the point's share of the light's flux.
#[must_use]
#[inline]
pub fn vpl_transmittance(
    params: &VplParams,
    bvh: &Bvh,
    light: &Vpl,
    start: Vec3,
    arrives: f32,
) -> f32 {
    if params.nodes == 0 || Vec3::from_array(light.flux).max_element() * arrives < params.dim {
        return 1.0;
    }
    let local = Mat4::from_cols_array_2d(&params.local_from_space);
    let end = local.transform_point3(light.position.into());
    let ray = end - start;
    let length = ray.length();
    let max_t = length - ray_offset(end, params.extent);
    match max_t > 0.0 {
        true => bvh.transmittance(&Ray::segment(start, ray / length, max_t)),
        false => 1.0,
    }
}

/// Returns the vector irradiance of the lights above the surface's horizon at (`x`, `n`) of their
/// space. Its dot product with `n` is the sum of \[N09\] Eq. (2), W/m². `bvh` casts their shadows
/// unless `params.nodes` is 0.
#[must_use]
pub fn vpl_at(params: &VplParams, lights: &[Vpl], bvh: &Bvh, x: Vec3, n: Vec3) -> VectorIrradiance {
    let mut sum = VectorIrradiance::default();
    if !x.is_finite() || !n.is_finite() {
        return sum;
    }
    let start = start(params, x, n);
    for light in &lights[..params.vpls as usize] {
        let g = vpl_contribution(light, x, n);
        let e = Vec3::from_array(light.flux);
        let arrives = n.dot(g);
        if arrives <= 0.0 {
            continue;
        }
        let passes = vpl_transmittance(params, bvh, light, start, arrives);
        if passes <= 0.0 {
            continue;
        }
        let e = passes * e;
        let add =
            |axis: [f32; 4], d: f32| (Vec4::from_array(axis) + (e * d).extend(0.0)).to_array();
        sum.x = add(sum.x, g.x);
        sum.y = add(sum.y, g.y);
        sum.z = add(sum.z, g.z);
    }
    sum
}

/// Returns the texel that the shader writes for (px, py) with this depth and G-buffer, added to the
/// `earlier` texel. RGB is irradiance × `scale`. Alpha is 1 if it was 1 before or if light arrived.
#[must_use]
pub fn vpl_pixel(
    params: &VplViewParams,
    lit: &VplParams,
    lights: &[Vpl],
    bvh: &Bvh,
    (pixel, depth, texel): ([u32; 2], f32, [u32; 4]),
    earlier: [f32; 4],
) -> [f32; 4] {
    if depth <= 0.0 || gbuffer::is_unlit(texel) {
        return earlier;
    }
    let n = gbuffer::normal(texel);
    let e = vpl_at(lit, lights, bvh, pixel_position(params, pixel, depth), n).dot(n);
    let e = e.max(Vec3::ZERO) * params.scale;
    if e.max_element() <= 0.0 {
        return earlier;
    }
    (Vec4::from_array(earlier).truncate() + e)
        .min(Vec3::splat(MAX_HALF))
        .extend(1.0)
        .to_array()
}

/// Returns the position of a pixel in the space of the lights.
#[must_use]
pub fn pixel_position(params: &VplViewParams, pixel: [u32; 2], depth: f32) -> Vec3 {
    let [left, top, width, height] = params.viewport;
    let uv = (Vec2::new(pixel[0] as f32, pixel[1] as f32) + 0.5 - Vec2::new(left, top))
        / Vec2::new(width, height);
    let ndc = Vec4::new(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, depth, 1.0);
    let h = Mat4::from_cols_array_2d(&params.space_from_clip) * ndc;
    h.truncate() / h.w
}

/// Entry point `evaluate_list`, for one node of a list. Adds to the light of baked scenes, if they
/// were evaluated. Else the node holds its prediction, which is replaced.
pub fn vpl_node(
    params: &VplViewParams,
    lit: &VplParams,
    lights: &[Vpl],
    bvh: &Bvh,
    (pixel, depth, texel): ([u32; 2], f32, [u32; 4]),
    node: &mut SubsplatNode,
) {
    if depth <= 0.0 || gbuffer::is_unlit(texel) {
        return;
    }
    let (mut light, mut bits) = if node.has_bits(state::EVALUATED) {
        (node.light(), node.state())
    } else {
        (VectorIrradiance::default(), 0)
    };
    bits |= state::EVALUATED | state::KNOWN;
    let n = gbuffer::normal(texel);
    let e = vpl_at(lit, lights, bvh, pixel_position(params, pixel, depth), n);
    if [e.x, e.y, e.z]
        .iter()
        .flat_map(|axis| &axis[..3])
        .any(|v| *v != 0.0)
    {
        light.add_scaled(params.scale, &e);
        bits |= state::COVERED;
    }
    *node = SubsplatNode::new(&light, node.predicted_luminance(), bits);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The light that leaves a patch in all directions adds up to its flux, for any spread of its
    /// normals.
    #[test]
    fn vpl_patch_radiates_its_flux() {
        for m in [1.0, 0.99, 0.9, 0.7, 0.5, 0.2, 0.0] {
            let normal = m * Vec3::Y;
            let steps = 20_000;
            let sum: f64 = (0..steps)
                .map(|i| {
                    let y = (i as f32 + 0.5) / steps as f32 * 2.0 - 1.0;
                    f64::from(mean_clamped_cosine(
                        normal,
                        Vec3::new((1.0 - y * y).sqrt(), y, 0.0),
                    ))
                })
                .sum();
            let whole = sum * 4.0 / f64::from(steps);
            assert!((whole - 1.0).abs() < 0.02, "{m}: {whole}");
        }
        // Exact if all normals face the position.
        assert_eq!(mean_clamped_cosine(Vec3::Y * 0.9, Vec3::Y), 0.9);
        assert_eq!(mean_clamped_cosine(Vec3::Y, -Vec3::Y), 0.0);
    }

    #[test]
    fn vpl_contribution_at_degenerate_point_is_zero() {
        let light = Vpl {
            position: [0.0, 1.0, 0.0],
            normal: [0.0, -1.0, 0.0],
            flux: [1.0; 3],
            ..Vpl::default()
        };
        let params = VplParams::unshadowed(1);
        let at = |light: Vpl, x, n| vpl_at(&params, &[light], &Bvh::default(), x, n);
        assert!(
            (at(light, Vec3::ZERO, Vec3::Y).dot(Vec3::Y) - FRAC_1_PI)
                .abs()
                .max_element()
                < 1e-6
        );
        for (x, n) in [
            (Vec3::Y, Vec3::Y),
            (Vec3::ZERO, Vec3::ZERO),
            (Vec3::NAN, Vec3::Y),
            (Vec3::ZERO, Vec3::NAN),
            (Vec3::ZERO, -Vec3::Y),
            (2.0 * Vec3::Y, -Vec3::Y),
        ] {
            assert_eq!(at(light, x, n), VectorIrradiance::default(), "{x} {n}");
        }
        // A mean normal of zero: the light emits in all directions.
        let round = Vpl {
            normal: [0.0; 3],
            ..light
        };
        assert!(at(round, 2.0 * Vec3::Y, -Vec3::Y).y[0] < 0.0);
    }
}
