//! Kernel `subtract_shadow`: radiance that a renderer without shadows drew at each pixel for light
//! that is occluded (\[P14\] §5). The composite subtracts it, so that the picture contains no
//! occluded light.
//!
//! Points have the occluded irradiance D·n of all lights and their unshadowed irradiance E
//! ([`soft_shadow`](super::soft_shadow) writes both). Both are interpolated as in
//! [`splat`](super::splat). Their quotient is the occluded fraction, and its product with the drawn
//! radiance is subtracted. Shadow edges have the resolution of the flat basis. All other detail is
//! per pixel: colors, normals and falloff are those of the picture. Full shadow leaves no light,
//! and full light is not reduced. Several lights have one common fraction, that of their sum.
//!
//! The drawn radiance is that of Bevy 0.19. Rectangles: Lambert, and specular by linearly
//! transformed cosines (\[HDHN16\]) with Bevy's tables. Point lights: Burley's diffuse BRDF
//! (\[RG18\] §4.5) over [`unshadowed`]. The specular light of point lights is not subtracted.

use super::gbuffer;
use super::layout::{SplatParams, VectorIrradiance};
use super::project::extent;
use super::soft_shadow::{SoftLight, corners, lambert, unshadowed, window};
use super::splat::{MAX_HALF, lit_pixel};
use crate::asset::SceneData;
use crate::basis::{NO_COVER, flat_weight, weight};
use crate::frame::brdf::{MIN_NDOTV, MIN_ROUGHNESS};
use bytemuck::{Pod, Zeroable};
use glam::{Mat4, Vec3, Vec4};
use std::f32::consts::FRAC_1_PI;

/// Fraction of the occluded radiance that is subtracted. Half-float pictures are rounded and must
/// not become negative.
pub const SUBTRACTED_FRACTION: f32 = 0.998;

/// Lights of a scene in a view. 16 bytes, the layout of `SubtractShadowParams` in the shaders.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SubtractShadowParams {
    /// Number of lights that the view was drawn with.
    pub lights: u32,
    /// Largest edge of the scene's bounding box, meters.
    pub extent: f32,
    /// 1 if the renderer drew the specular light of rectangles too, by [`LtcTables`]. 0 for diffuse
    /// light only.
    pub gloss: u32,
    /// Padding.
    pub pad: u32,
}

impl SubtractShadowParams {
    /// Creates the parameters for the given number of lights in `scene`.
    #[must_use]
    pub fn new(scene: &SceneData, lights: usize) -> Self {
        Self {
            lights: lights as u32,
            extent: extent(scene),
            ..Self::default()
        }
    }
}

/// Returns the occluded fraction of the lights' irradiance at (x, n), per channel, 0 to 1. Returns
/// `None` if no function covers the position. `occluded_irradiances` is the result of
/// [`soft_shadow::occluded_irradiances`](super::soft_shadow::occluded_irradiances).
#[must_use]
pub fn occluded_radiance(
    scene: &SceneData,
    occluded_irradiances: &[VectorIrradiance],
    x: Vec3,
    n: Vec3,
) -> Option<Vec3> {
    if !x.is_finite() || !n.is_finite() {
        return None;
    }
    let (mut hidden, mut whole, mut cover) = (Vec3::ZERO, Vec3::ZERO, 0.0);
    for &j in scene.display.grid.indices_near(x) {
        let point = &scene.points[j as usize];
        let w = weight(point, &scene.display.planes, x, n);
        if w > 0.0 {
            let v = flat_weight(point, w);
            let d = &occluded_irradiances[j as usize];
            cover += w;
            hidden += v * d.dot(point.n()).max(Vec3::ZERO);
            whole += v * Vec3::new(d.x[3], d.y[3], d.z[3]);
        }
    }
    (cover > NO_COVER).then(|| (hidden / whole.max(Vec3::splat(f32::MIN_POSITIVE))).min(Vec3::ONE))
}

/// Returns the diffuse BRDF of a white surface for light from `l` and view direction `v` (both
/// unit), times π. It is 1 for a Lambert surface. \[RG18\] §4.5.
#[must_use]
pub fn burley(n: Vec3, v: Vec3, l: Vec3, roughness: f32) -> f32 {
    let sum = l + v;
    let lh = (l.dot(sum) / sum.length().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
    let r = roughness.clamp(MIN_ROUGHNESS, 1.0);
    let more = 2.0 * r * r * lh * lh - 0.5;
    let pow5 = |v: f32| v * v * v * v * v;
    let nl = n.dot(l).clamp(0.0, 1.0);
    let nv = n.dot(v).clamp(MIN_NDOTV, 1.0);
    (1.0 + more * pow5(1.0 - nl)) * (1.0 + more * pow5(1.0 - nv))
}

/// Tables of linearly transformed cosines (\[HDHN16\]), over perceptual roughness and √(1 − cos θ)
/// of the view angle. Both go from 0 to 1 between the middles of the first and the last texel.
#[derive(Clone, Debug, PartialEq)]
pub struct LtcTables {
    /// Texels along an edge.
    pub size: u32,
    /// First the inverse of the matrix (m₀₀, m₂₀, m₀₂, m₂₂, by rows and columns). Then, in two
    /// channels, the reflectance of the lobe over f₀ and over 1 − f₀. Row by row.
    pub layers: [Vec<[f32; 4]>; 2],
}

impl LtcTables {
    /// Interpolates layer `layer` between its texels, both coordinates from 0 to 1.
    fn sample_layer(&self, layer: usize, u: f32, v: f32) -> Vec4 {
        let last = self.size - 1;
        let texel_weight = |v: f32| {
            let at = v.clamp(0.0, 1.0) * last as f32;
            (
                at as u32,
                (at as u32 + 1).min(last),
                at - (at as u32) as f32,
            )
        };
        let (left, right, x) = texel_weight(u);
        let (top, bottom, y) = texel_weight(v);
        let texel =
            |i: u32, j: u32| Vec4::from_array(self.layers[layer][(j * self.size + i) as usize]);
        let a = texel(left, top).lerp(texel(right, top), x);
        let b = texel(left, bottom).lerp(texel(right, bottom), x);
        a.lerp(b, y)
    }
}

/// Surface of a pixel for lighting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LitSurface {
    /// Unit normal.
    pub n: Vec3,
    /// Unit direction toward the eye.
    pub v: Vec3,
    /// Diffuse reflectance.
    pub diffuse: Vec3,
    /// Specular reflectance at normal incidence.
    pub f0: Vec3,
    /// Perceptual roughness.
    pub roughness: f32,
}

impl LitSurface {
    /// Creates the surface of a G-buffer's texel, with a normal in the space of `v`.
    #[must_use]
    pub fn from_texel(texel: [u32; 4], n: Vec3, v: Vec3) -> Self {
        Self {
            n,
            v,
            diffuse: gbuffer::diffuse(texel),
            f0: gbuffer::f0(texel),
            roughness: gbuffer::roughness(texel),
        }
    }
}

/// Specular lobe of a surface: the rows of the transform of the lobe into a cosine, and the
/// reflected fraction.
struct Lobe {
    rows: [Vec3; 3],
    weight: Vec3,
}

impl Lobe {
    fn new(tables: &LtcTables, surface: &LitSurface) -> Self {
        let (n, v) = (surface.n, surface.v);
        let nv = n.dot(v).clamp(MIN_NDOTV, 1.0);
        let slant = (1.0 - nv).sqrt();
        let m = tables.sample_layer(0, surface.roughness, slant);
        let f = tables.sample_layer(1, surface.roughness, slant);
        let across = v - n * v.dot(n);
        let t = across / across.length().max(f32::MIN_POSITIVE);
        Self {
            rows: [m.x * t + m.z * n, t.cross(n), m.y * t + m.w * n],
            weight: surface.f0 * f.x + (Vec3::ONE - surface.f0) * f.y,
        }
    }

    /// Returns the part of a rectangle's radiance that the surface reflects to the eye.
    fn mirror_radiance(&self, light: &SoftLight, to: Vec3) -> f32 {
        let turned = |p: Vec3| Vec3::from_array(self.rows.map(|row| row.dot(p)));
        let quad = corners(light, to).map(turned);
        FRAC_1_PI * lambert(quad, Vec3::Z)
    }
}

/// Returns the radiance that `lights` were drawn with at x on `surface`, W/(m² sr). Without tables
/// it contains diffuse light only.
#[must_use]
pub fn drawn(
    params: &SubtractShadowParams,
    tables: Option<&LtcTables>,
    lights: &[SoftLight],
    x: Vec3,
    surface: &LitSurface,
) -> Vec3 {
    let lobe = tables.map(|tables| Lobe::new(tables, surface));
    let mut sum = Vec3::ZERO;
    for light in &lights[..params.lights as usize] {
        let to = Vec3::from_array(light.center) - x;
        let color = Vec3::from_array(light.color);
        let e = FRAC_1_PI * unshadowed(light, x, surface.n, params.extent);
        if light.kind == SoftLight::SPHERE {
            if e > 0.0 {
                let l = to.normalize();
                sum += e
                    * burley(surface.n, surface.v, l, surface.roughness)
                    * surface.diffuse
                    * color;
            }
            continue;
        }
        sum += e * surface.diffuse * color;
        if let Some(lobe) = &lobe
            && light.kind == SoftLight::RECTANGLE
            && light.normal().dot(to) < 0.0
        {
            sum +=
                lobe.mirror_radiance(light, to) * window(light, to.dot(to)) * lobe.weight * color;
        }
    }
    sum
}

/// Returns the texel that the shader writes for (px, py) with this depth and G-buffer. RGB is
/// radiance × the view's `scale`. Alpha is 1 if a function covers the pixel, else all is 0.
#[must_use]
pub fn subtract_shadow_pixel(
    (params, view): (&SubtractShadowParams, &SplatParams),
    scene: &SceneData,
    occluded_irradiances: &[VectorIrradiance],
    (lights, tables): (&[SoftLight], Option<&LtcTables>),
    pixel: [u32; 2],
    depth: f32,
    texel: [u32; 4],
) -> [f32; 4] {
    let Some((x, n)) = lit_pixel(view, pixel, depth, texel) else {
        return [0.0; 4];
    };
    let Some(share) = occluded_radiance(scene, occluded_irradiances, x, n) else {
        return [0.0; 4];
    };
    if share == Vec3::ZERO {
        return [0.0, 0.0, 0.0, 1.0];
    }
    let surface = LitSurface::from_texel(texel, n, eye_from(view, pixel, x));
    let drawn = drawn(params, tables, lights, x, &surface);
    let radiance = SUBTRACTED_FRACTION * view.scale * share * drawn;
    radiance.min(Vec3::splat(MAX_HALF)).extend(1.0).to_array()
}

/// Returns the unit direction from x toward the eye: to the start of the pixel's ray.
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

    /// With an identity table, a white mirror equals a white Lambert surface.
    #[test]
    fn cosine_lobe_matches_lambert_reflection() {
        let tables = LtcTables {
            size: 2,
            layers: [vec![[1.0, 0.0, 0.0, 1.0]; 4], vec![[1.0, 0.0, 0.0, 0.0]; 4]],
        };
        let params = SubtractShadowParams {
            lights: 1,
            extent: 4.0,
            gloss: 1,
            pad: 0,
        };
        let panel = SoftLight::rectangle(
            Vec3::new(0.3, 2.0, -0.2),
            Vec3::new(0.5, 0.2, 0.0),
            Vec3::new(0.0, 0.1, 0.7),
            Vec3::new(3.0, 2.0, 1.0),
            16,
        )
        .with_range(5.0);
        let n = Vec3::new(0.2, 0.9, 0.1).normalize();
        let surface = LitSurface {
            n,
            v: Vec3::new(0.5, 0.6, -0.3).normalize(),
            diffuse: Vec3::ONE,
            f0: Vec3::ZERO,
            roughness: 0.5,
        };
        let mirror = LitSurface {
            diffuse: Vec3::ZERO,
            f0: Vec3::ONE,
            ..surface
        };
        let [matte, mirrored] =
            [surface, mirror].map(|s| drawn(&params, Some(&tables), &[panel], Vec3::ZERO, &s));
        assert!(matte.x > 0.05);
        assert!(
            (matte - mirrored).abs().max_element() < 1e-5 * matte.x,
            "{matte} {mirrored}"
        );
        // Behind the panel there is neither diffuse nor specular light.
        let behind = Vec3::new(0.3, 4.0, -0.2);
        assert_eq!(
            drawn(&params, Some(&tables), &[panel], behind, &mirror),
            Vec3::ZERO
        );
    }

    /// Burley's albedo is that of Lambert within a few percent, and it is the same from both sides.
    #[test]
    fn burley_albedo_is_near_lambert_and_reciprocal() {
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
