//! Kernel `shade`: what a renderer that knows no shadows of a lamp drew at each pixel, and that does not get there because something is before the lamp (\[P14\] §5). The composite takes it
//! from the picture: the lamp's own light is replaced, and not drawn twice.
//!
//! The points know the irradiance D·n that is missing of all lamps and the irradiance E that they would give ([`soft`](super::soft) writes both). Splatted as [`splat`](super::splat) splats, their
//! quotient is the missing share, and the share times what was drawn at the pixel is taken away. The flat basis shows edges of shadows, while everything else is the pixel's own: in full shadow nothing is left, in
//! full light nothing is taken, and colours, normals and the falloff are those of the picture. With several lamps the share is that of their sum.
//!
//! What was drawn is Bevy 0.19's diffuse light: a rectangle's Lambert, a point lamp's Burley (\[RG18\] §4.5), each over the closed form of [`unshadowed`]. Its specular light is not taken.

use super::gbuffer;
use super::layout::{SplatParams, VectorIrradiance};
use super::project::extent;
use super::soft::{SoftLight, unshadowed};
use super::splat::{LARGEST_HALF, place};
use crate::asset::BakedScene;
use crate::basis::{NO_COVER, weight};
use crate::frame::brdf::{SLANTED, SMOOTHEST};
use bytemuck::{Pod, Zeroable};
use glam::{Mat4, Vec3, Vec4};
use std::f32::consts::FRAC_1_PI;

/// Part of what is missing that is taken away: pictures of halves are rounded, and must not fall below nothing.
pub const TAKEN: f32 = 0.998;

/// The lamps of a scene in a view. 16 bytes, the layout of `ShadeParams` in the shaders.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct ShadeParams {
    /// How many lamps the view was drawn with.
    pub lights: u32,
    /// Largest edge of the level's box, metres.
    pub extent: f32,
    /// Not used.
    pub pad: [u32; 2],
}

impl ShadeParams {
    /// For so many lamps in `scene`.
    #[must_use]
    pub fn new(scene: &BakedScene, lights: usize) -> Self {
        Self {
            lights: lights as u32,
            extent: extent(scene),
            pad: [0; 2],
        }
    }
}

/// The share of the lamps' light that is missing at (x, n), per channel, 0 to 1. None where no function covers the place. `deficits` is what [`soft::deficits`](super::soft::deficits) gives.
#[must_use]
pub fn missing(
    scene: &BakedScene,
    deficits: &[VectorIrradiance],
    x: Vec3,
    n: Vec3,
) -> Option<Vec3> {
    if !x.is_finite() || !n.is_finite() {
        return None;
    }
    let (mut hidden, mut whole, mut cover) = (Vec3::ZERO, Vec3::ZERO, 0.0);
    for &j in scene.display.grid.near(x) {
        let point = &scene.points[j as usize];
        let w = weight(point, &scene.display.planes, x, n);
        if w > 0.0 {
            let v = (w / point.radius) * (w / point.radius);
            let d = &deficits[j as usize];
            cover += w;
            hidden += v * d.dot(point.n()).max(Vec3::ZERO);
            whole += v * Vec3::new(d.x[3], d.y[3], d.z[3]);
        }
    }
    (cover > NO_COVER).then(|| (hidden / whole.max(Vec3::splat(f32::MIN_POSITIVE))).min(Vec3::ONE))
}

/// The diffuse BRDF of a white surface for light from `l`, seen from `v` (both unit), times π: 1 for Lambert's. \[RG18\] §4.5.
#[must_use]
pub fn burley(n: Vec3, v: Vec3, l: Vec3, roughness: f32) -> f32 {
    let sum = l + v;
    let lh = (l.dot(sum) / sum.length().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
    let r = roughness.clamp(SMOOTHEST, 1.0);
    let more = 2.0 * r * r * lh * lh - 0.5;
    let fifth = |v: f32| v * v * v * v * v;
    let nl = n.dot(l).clamp(0.0, 1.0);
    let nv = n.dot(v).clamp(SLANTED, 1.0);
    (1.0 + more * fifth(1.0 - nl)) * (1.0 + more * fifth(1.0 - nv))
}

/// Irradiance that `lights` were drawn with at (x, n), W/m², times what the BRDF has over a white Lambert surface's.
#[must_use]
pub fn drawn(
    params: &ShadeParams,
    lights: &[SoftLight],
    x: Vec3,
    n: Vec3,
    v: Vec3,
    roughness: f32,
) -> Vec3 {
    let mut sum = Vec3::ZERO;
    for light in &lights[..params.lights as usize] {
        let mut e = unshadowed(light, x, n, params.extent);
        if e <= 0.0 {
            continue;
        }
        if light.kind == SoftLight::SPHERE {
            e *= burley(
                n,
                v,
                (Vec3::from_array(light.center) - x).normalize(),
                roughness,
            );
        }
        sum += e * Vec3::from_array(light.color);
    }
    sum
}

/// One pixel: what the shader writes for the texel (px, py) with this depth and G-buffer. RGB: radiance × the view's `scale`; alpha: 1 where covered, else all is 0.
#[must_use]
pub fn shade_pixel(
    (params, view): (&ShadeParams, &SplatParams),
    scene: &BakedScene,
    deficits: &[VectorIrradiance],
    lights: &[SoftLight],
    pixel: [u32; 2],
    depth: f32,
    texel: [u32; 4],
) -> [f32; 4] {
    if depth <= 0.0 || gbuffer::is_unlit(texel) {
        return [0.0; 4];
    }
    let (x, n) = place(view, pixel, depth, texel);
    let Some(share) = missing(scene, deficits, x, n) else {
        return [0.0; 4];
    };
    if share == Vec3::ZERO {
        return [0.0, 0.0, 0.0, 1.0];
    }
    let v = eye_from(view, pixel, x);
    let drawn = drawn(params, lights, x, n, v, gbuffer::roughness(texel));
    let radiance = TAKEN * FRAC_1_PI * view.scale * share * gbuffer::diffuse(texel) * drawn;
    radiance
        .min(Vec3::splat(LARGEST_HALF))
        .extend(1.0)
        .to_array()
}

/// Unit, from x toward the eye: to where the pixel's ray begins.
fn eye_from(view: &SplatParams, pixel: [u32; 2], x: Vec3) -> Vec3 {
    let [left, top, width, height] = view.viewport;
    let (u, v) = (
        (pixel[0] as f32 + 0.5 - left) / width,
        (pixel[1] as f32 + 0.5 - top) / height,
    );
    let ndc = Vec4::new(u * 2.0 - 1.0, 1.0 - v * 2.0, 1.0, 1.0);
    let h = Mat4::from_cols_array_2d(&view.local_from_clip) * ndc;
    (h.truncate() / h.w - x).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Burley's albedo is that of Lambert within a few per cent, and it is the same from both sides.
    #[test]
    fn burley_is_nearly_lambert() {
        for roughness in [0.0, 0.3, 0.6, 1.0] {
            for slant in [0.1f32, 0.6, 1.1] {
                let v = Vec3::new(slant.sin(), slant.cos(), 0.0);
                let mut albedo = 0.0;
                let count = 64 * 64;
                for i in 0..count {
                    let (a, b) = ((i % 64) as f32 + 0.5, (i / 64) as f32 + 0.5);
                    let (sine, phi) = ((a / 64.0).sqrt(), b / 64.0 * std::f32::consts::TAU);
                    let l = Vec3::new(
                        sine * phi.cos(),
                        (1.0 - sine * sine).sqrt(),
                        sine * phi.sin(),
                    );
                    let f = burley(Vec3::Y, v, l, roughness);
                    assert!((f - burley(Vec3::Y, l, v, roughness)).abs() < 1e-5);
                    albedo += f / count as f32;
                }
                println!("{roughness} {slant}: {albedo:.3}");
                assert!(
                    (0.8..1.15).contains(&albedo),
                    "{roughness} {slant}: {albedo}"
                );
            }
        }
    }
}
