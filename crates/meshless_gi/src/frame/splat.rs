//! Kernel `splat`: irradiance at a surface point from the flat basis. This is the gather form of
//! the splatting of \[L08\] §4.1, with the Shepard quotient of Eq. (3) over the weights of Eqs.
//! (8)-(10). In a view it has one surface point per pixel, from depth and G-buffer.
//!
//! \[L08\] has one radius for all functions. Here radii differ (see `basis/flat.rs`), so each
//! function is weighted by (w / r)². r² is the area of its support: a wide function has a small
//! weight where narrow ones overlap it. The square favors the nearest function where light changes
//! within a radius, such as next to a lit ledge.
//!
//! If a scene has probes, surfaces and probes blend without a seam: the share of surface functions
//! goes to zero with their cover ([`surface_fraction`]), and kernel `probe` adds the rest. \[L08\]
//! has no such blend: all its receivers are baked.
//!
//! In a view, a surface that no function covers, such as the side of a book that stands out from
//! the next one, takes an estimate from functions on the surfaces that it meets in a crease
//! (`tilted_irradiance`). It has no cover, so probes and scenes evaluated later replace it.

use super::gbuffer;
use super::layout::{SplatParams, VectorIrradiance};
use super::subsplat::{SubsplatNode, state};
use crate::asset::{FlatBasis, SceneData};
use crate::basis::{NO_COVER, crease_weight, flat_weight, weight};
use crate::samples::Point;
use glam::{Mat4, Vec2, Vec3, Vec4};

/// Largest finite half float. Brighter values are clamped.
pub const MAX_HALF: f32 = 65_504.0;

/// Default [`SplatParams::seam`] of a scene with probes. Almost no points on baked surfaces have
/// less cover (`--test lab probes` prints their number). Their irradiance is thus the same as
/// without probes.
pub const FULL_COVER: f32 = 0.5;

/// Minimum cosine between the normals of a function and of a surface that it covers: 46 degrees. A
/// function has the light of its own side. A surface with a larger tilt counts as another surface,
/// such as a half-open door next to its jamb.
pub const MIN_COVER_COSINE: f32 = 0.7;
/// Cosine above which a function covers a surface with its full weight: 26 degrees.
pub const FULL_COVER_COSINE: f32 = 0.9;

/// Minimum fraction of a pixel within the support of functions. Zero marks a pixel without
/// functions.
pub const MIN_COVERED_FRACTION: f32 = 1.0 / 1024.0;

/// Returns the fraction of a function's weight that covers a surface, by the cosine between their
/// normals.
fn cover_of(cosine: f32) -> f32 {
    ((cosine - MIN_COVER_COSINE) / (FULL_COVER_COSINE - MIN_COVER_COSINE)).clamp(0.0, 1.0)
}

/// Returns the fraction of the light that functions on surfaces have at this cover, 0 to 1. It is 0
/// without cover and 1 from `seam` on.
#[must_use]
pub fn surface_fraction(cover: f32, seam: f32) -> f32 {
    if cover <= 0.0 {
        return 0.0;
    }
    if cover >= seam {
        return 1.0;
    }
    let t = cover / seam;
    t * t * (3.0 - 2.0 * t)
}

/// Returns the vector irradiance of the flat basis at `x`, for surfaces that face `n`. Returns
/// `None` if no function covers the point.
#[must_use]
pub fn splat_vector(
    points: &[Point],
    display: &FlatBasis,
    values: &[VectorIrradiance],
    x: Vec3,
    n: Vec3,
) -> Option<VectorIrradiance> {
    splat_covered(points, display, values, x, n).map(|(e, _)| e)
}

/// Computes the same with the cover: the sum of the weights of functions with a normal similar to
/// `n`.
#[must_use]
pub fn splat_covered(
    points: &[Point],
    display: &FlatBasis,
    values: &[VectorIrradiance],
    x: Vec3,
    n: Vec3,
) -> Option<(VectorIrradiance, f32)> {
    if !x.is_finite() || !n.is_finite() {
        return None;
    }
    let mut numerator = VectorIrradiance::default();
    let (mut sum, mut cover) = (0.0, 0.0);
    let mut denominator = 0.0;
    for &j in display.grid.indices_near(x) {
        let point = &points[j as usize];
        let w = weight(point, &display.planes, x, n);
        if w > 0.0 {
            let v = flat_weight(point, w);
            sum += w;
            cover += w * cover_of(n.dot(point.n()));
            denominator += v;
            numerator.add_scaled(v, &values[j as usize]);
        }
    }
    if sum <= NO_COVER {
        return None;
    }
    let mut out = VectorIrradiance::default();
    out.add_scaled(1.0 / denominator, &numerator);
    Some((out, cover))
}

/// Computes the light of a surface in a view, and the cover. If no function covers the point, it is
/// an estimate from functions of other orientation that the surface meets in a crease, with a cover
/// of 0. Returns `None` if there are none.
#[must_use]
pub fn splat_displayed(
    points: &[Point],
    display: &FlatBasis,
    values: &[VectorIrradiance],
    x: Vec3,
    n: Vec3,
) -> Option<(VectorIrradiance, f32)> {
    splat_covered(points, display, values, x, n)
        .or_else(|| Some((crease_vector(points, display, values, x, n)?, 0.0)))
}

/// Estimates the light of a surface from functions of other orientation that it meets in a crease.
fn crease_vector(
    points: &[Point],
    display: &FlatBasis,
    values: &[VectorIrradiance],
    x: Vec3,
    n: Vec3,
) -> Option<VectorIrradiance> {
    if !x.is_finite() || !n.is_finite() {
        return None;
    }
    let (mut e, mut sum) = (Vec3::ZERO, 0.0);
    for &j in display.grid.indices_near(x) {
        let point = &points[j as usize];
        let w = crease_weight(point, &display.planes, x, n);
        if w > 0.0 {
            e += w * tilted_irradiance(&values[j as usize], point.n(), n);
            sum += w;
        }
    }
    (sum > NO_COVER).then(|| {
        let [r, g, b] = (e / sum).to_array();
        let scaled = |part: f32| [part * r, part * g, part * b, 0.0];
        VectorIrradiance {
            x: scaled(n.x),
            y: scaled(n.y),
            z: scaled(n.z),
        }
    })
}

/// Estimates the irradiance for normal `n` from the vector irradiance of a function with normal
/// `n_j`, W/m². With c = n·n_j and the function's irradiance E_j = E⃗·n_j it is (1 + c) / 2 times
/// (1 − c) E_j + E⃗·n. The first factor is the form factor of a tilted surface for the half space
/// in front of the function, so the estimate is exact if the radiance there is uniform.
fn tilted_irradiance(e: &VectorIrradiance, n_j: Vec3, n: Vec3) -> Vec3 {
    let cosine = n.dot(n_j).clamp(-1.0, 1.0);
    let linear = (1.0 - cosine) * e.dot(n_j).max(Vec3::ZERO) + e.dot(n);
    (0.5 * (1.0 + cosine) * linear).max(Vec3::ZERO)
}

/// Returns the irradiance at (x, n), W/m².
#[must_use]
pub fn splat(
    points: &[Point],
    display: &FlatBasis,
    values: &[VectorIrradiance],
    x: Vec3,
    n: Vec3,
) -> Option<Vec3> {
    splat_vector(points, display, values, x, n).map(|e| e.dot(n).max(Vec3::ZERO))
}

/// Returns the texel that the shader writes for a pixel with this depth and G-buffer. RGB is
/// irradiance × `scale`. Alpha is the [`surface_fraction`] of functions on surfaces, 1 for all of
/// the light, [`MIN_COVERED_FRACTION`] for an estimate. All zero without light.
#[must_use]
pub fn splat_pixel(
    params: &SplatParams,
    scene: &SceneData,
    values: &[VectorIrradiance],
    pixel: [u32; 2],
    depth: f32,
    texel: [u32; 4],
) -> [f32; 4] {
    let Some((x, n)) = lit_pixel(params, pixel, depth, texel) else {
        return [0.0; 4];
    };
    match splat_displayed(&scene.points, &scene.display, values, x, n) {
        Some((e, cover)) => (e.dot(n).max(Vec3::ZERO) * params.scale)
            .min(Vec3::splat(MAX_HALF))
            .extend(surface_fraction(cover, params.seam).max(MIN_COVERED_FRACTION))
            .to_array(),
        None => [0.0; 4],
    }
}

/// Entry point `evaluate_list`, for one node of a list. Writes its light in world axes if no
/// earlier scene covered it. An estimate of an earlier scene stays if this one has no cover.
pub fn splat_node(
    params: &SplatParams,
    scene: &SceneData,
    values: &[VectorIrradiance],
    pixel: [u32; 2],
    depth: f32,
    texel: [u32; 4],
    node: &mut SubsplatNode,
) {
    let has_light = node.has_bits(state::EVALUATED | state::COVERED);
    if has_light && node.probe_fraction() < 1.0 {
        return;
    }
    let predicted_luminance = node.predicted_luminance();
    let Some((x, n)) = lit_pixel(params, pixel, depth, texel) else {
        *node = SubsplatNode::new(
            &VectorIrradiance::default(),
            predicted_luminance,
            state::EVALUATED,
        );
        return;
    };
    *node = match splat_displayed(&scene.points, &scene.display, values, x, n) {
        None if has_light => return,
        Some((_, cover)) if has_light && cover <= 0.0 => return,
        Some((e, cover)) => SubsplatNode::new(
            &to_world(params, &e),
            predicted_luminance,
            state::EVALUATED
                | state::KNOWN
                | state::COVERED
                | state::probe_fraction(surface_fraction(cover, params.seam)),
        ),
        None => SubsplatNode::new(
            &VectorIrradiance::default(),
            predicted_luminance,
            state::EVALUATED | state::KNOWN,
        ),
    };
}

/// Converts vector irradiance from the bake's local space to world axes, times the view's scale.
pub(super) fn to_world(params: &SplatParams, e: &VectorIrradiance) -> VectorIrradiance {
    let axis = |column: [f32; 4]| {
        let mut out = Vec4::ZERO;
        for (part, weight) in [e.x, e.y, e.z].into_iter().zip(column) {
            out += weight * params.scale * Vec4::from_array(part);
        }
        out.to_array()
    };
    let [x, y, z] = params.local_from_world.map(axis);
    VectorIrradiance { x, y, z }
}

/// Returns position and normal of a pixel's lit surface in the bake's local space. Returns `None`
/// for the background and for unlit materials.
pub(super) fn lit_pixel(
    params: &SplatParams,
    pixel: [u32; 2],
    depth: f32,
    texel: [u32; 4],
) -> Option<(Vec3, Vec3)> {
    // Reversed depth: 0 is infinitely far, the background.
    if depth <= 0.0 || gbuffer::is_unlit(texel) {
        return None;
    }
    Some(pixel_position(params, pixel, depth, texel))
}

/// Returns position and normal of a pixel's surface in the bake's local space.
#[must_use]
pub fn pixel_position(
    params: &SplatParams,
    pixel: [u32; 2],
    depth: f32,
    texel: [u32; 4],
) -> (Vec3, Vec3) {
    let [left, top, width, height] = params.viewport;
    let uv = Vec2::new(
        (pixel[0] as f32 + 0.5 - left) / width,
        (pixel[1] as f32 + 0.5 - top) / height,
    );
    let ndc = Vec4::new(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, depth, 1.0);
    let h = Mat4::from_cols_array_2d(&params.local_from_clip) * ndc;
    let world = gbuffer::normal(texel);
    let [a, b, c] = params.local_from_world.map(Vec4::from_array);
    let n = (a * world.x + b * world.y + c * world.z).truncate();
    (h.truncate() / h.w, n)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Vector irradiance of one channel along `v`.
    fn vector_of(v: Vec3) -> VectorIrradiance {
        let [x, y, z] = v.to_array().map(|e| [e, e, e, 0.0]);
        VectorIrradiance { x, y, z }
    }

    #[test]
    fn tilted_irradiance_is_exact_in_uniform_light() {
        // Uniform radiance above a floor: a wall sees half of it, a ceiling none.
        let floor = vector_of(3.0 * Vec3::Y);
        for (n, expected) in [
            (Vec3::X, 1.5),
            (Vec3::NEG_Y, 0.0),
            (Vec3::Y, 3.0),
            (Vec3::new(0.6, -0.8, 0.0), 0.3),
        ] {
            let e = tilted_irradiance(&floor, Vec3::Y, n);
            assert!(
                (e - Vec3::splat(expected)).abs().max_element() < 1e-6,
                "{n}: {e}"
            );
        }
    }

    #[test]
    fn tilted_irradiance_follows_side_of_light() {
        let from_left = vector_of(Vec3::new(-2.0, 1.0, 0.0));
        let lit = tilted_irradiance(&from_left, Vec3::Y, Vec3::NEG_X);
        assert_eq!(lit, Vec3::splat(1.5));
        assert_eq!(tilted_irradiance(&from_left, Vec3::Y, Vec3::X), Vec3::ZERO);
    }

    #[test]
    fn surface_without_cover_leaves_all_light_to_others() {
        assert_eq!(surface_fraction(0.0, 0.0), 0.0);
        assert_eq!(surface_fraction(0.1, 0.0), 1.0);
        assert_eq!(surface_fraction(0.25, 0.5), 0.5);
    }
}
