//! Specular reflection of single virtual lights at a surface point.

use super::LIGHT_GROUPS;
use super::settings::SpecularRadiance;
use crate::frame::brdf::{self, ShadingPoint, SpecularTerms};
use crate::frame::gbuffer;
use crate::frame::rsm_layout::{Vpl, VplParams, VplViewParams};
use crate::frame::vpl::{pixel_position, start, vpl_contribution, vpl_transmittance};
use crate::scene::Bvh;
use glam::{Mat4, Vec2, Vec3, Vec4};
use std::f32::consts::PI;

/// Lights and their occluders.
#[derive(Clone, Copy)]
pub struct VplSet<'a> {
    /// Number of lights, and the transform to the bake.
    pub lit: &'a VplParams,
    /// The lights.
    pub vpls: &'a [Vpl],
    /// BVH of the bake.
    pub bvh: &'a Bvh,
}

impl VplSet<'_> {
    /// Returns the number of lights that share a bit.
    #[must_use]
    pub fn lights_per_group(&self) -> u32 {
        self.lit.vpls.div_ceil(LIGHT_GROUPS).max(1)
    }
}

/// Receiving surface, in the space of the lights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Receiver {
    /// Position, meters.
    pub x: Vec3,
    /// Normal, eye, roughness.
    pub facet: ShadingPoint,
    /// Start of shadow rays, in the bake's space.
    pub start: Vec3,
}

/// Returns the receiver at a pixel.
#[must_use]
pub fn receiver(
    view: &VplViewParams,
    lights: &VplSet<'_>,
    pixel: [u32; 2],
    depth: f32,
    texel: [u32; 4],
) -> Receiver {
    let x = pixel_position(view, pixel, depth);
    let n = gbuffer::normal(texel);
    Receiver {
        x,
        facet: ShadingPoint {
            n,
            v: toward_eye(view, pixel),
            roughness: gbuffer::roughness(texel),
        },
        start: start(lights.lit, x, n),
    }
}

/// Returns the unit direction from a pixel's surface to the eye. It is the line of the pixel's
/// positions at all depths, for any projection.
fn toward_eye(view: &VplViewParams, pixel: [u32; 2]) -> Vec3 {
    let [left, top, width, height] = view.viewport;
    let uv = (Vec2::new(pixel[0] as f32, pixel[1] as f32) + 0.5 - Vec2::new(left, top))
        / Vec2::new(width, height);
    let m = Mat4::from_cols_array_2d(&view.space_from_clip);
    let far = m * Vec4::new(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, 0.0, 1.0);
    let near = far + m.z_axis;
    // Difference of the two positions, times both w, because the far one can be infinite.
    (near.truncate() * far.w - far.truncate() * near.w).normalize_or_zero()
}

/// Light over flux below which a light is ignored, 1/m².
pub const MIN: f32 = 1e-15;

/// Returns an upper bound of the brightness of a light in this reflection over that on a white matt
/// surface. The threshold of shadow rays uses it.
fn brightest(gloss: &SpecularTerms) -> f32 {
    (PI * (gloss.f0 + gloss.f90)).max(1.0)
}

/// Returns the specular terms of one light toward the eye, over its flux.
#[must_use]
pub fn specular_of_light(lights: &VplSet<'_>, i: u32, at: &Receiver) -> SpecularTerms {
    let light = &lights.vpls[i as usize];
    let n = at.facet.n;
    let g = vpl_contribution(light, at.x, n);
    let arrives = n.dot(g);
    // Smaller vectors have no valid direction in single precision.
    if arrives.is_nan() || arrives <= MIN {
        return SpecularTerms::default();
    }
    let toward = Vec3::from_array(light.position) - at.x;
    let spread = light.square / (toward.dot(toward) + light.square);
    let found = brdf::specular_terms(&at.facet, g / g.length(), spread);
    if found.f0 + found.f90 <= 0.0 {
        return SpecularTerms::default();
    }
    let bright = arrives * brightest(&found);
    let arrives = arrives * vpl_transmittance(lights.lit, lights.bvh, light, at.start, bright);
    SpecularTerms {
        f0: arrives * found.f0,
        f90: arrives * found.f90,
    }
}

/// Returns the specular radiance of all lights toward the eye, unscaled.
#[must_use]
pub fn specular_at(lights: &VplSet<'_>, at: &Receiver) -> SpecularRadiance {
    let mut sum = SpecularRadiance::default();
    for i in 0..lights.lit.vpls {
        let flux = Vec3::from_array(lights.vpls[i as usize].flux);
        let found = specular_of_light(lights, i, at);
        sum.f0 += found.f0 * flux;
        sum.f90 += found.f90 * flux;
    }
    sum
}
