//! Settings of specular reflections of virtual lights, and the nodes that store them.

use super::ROUGHNESS_FADE;
use crate::frame::brdf;
use crate::frame::splat::MAX_HALF;
use crate::frame::subsplat::{MAX_COARSEST_LEVEL, SubsplatParams, SubsplatSettings};
#[cfg(feature = "bevy_reflect")]
use bevy_reflect::std_traits::ReflectDefault;
use bytemuck::{Pod, Zeroable};
use glam::{Mat4, Vec3};
use half::f16;

/// Settings of specular reflections of virtual lights.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "bevy_reflect",
    derive(bevy_reflect::Reflect),
    reflect(Default, Clone, Debug, PartialEq)
)]
pub struct SpecularSettings {
    /// Level at which every node evaluates every light, 2 to [`MAX_COARSEST_LEVEL`]. Its cells have
    /// 2^coarsest_level pixels. Much narrower highlights may be missed (\[N09\] §3.3.1).
    pub coarsest_level: u32,
    /// Level below which only pixels without similar neighbors are evaluated, at least 1.
    pub finest_level: u32,
    /// Difference between a light and its prediction from which the light is refined, as a fraction
    /// of the specular light of all lights.
    pub radiance_threshold: f32,
    /// Perceptual roughness up to which non-metals show specular light. Metals always do.
    pub max_roughness: f32,
    /// `true` to refine by the sum of the lights: one list for all of them. For comparison.
    pub together: bool,
}

impl Default for SpecularSettings {
    fn default() -> Self {
        Self {
            coarsest_level: 4,
            finest_level: 1,
            radiance_threshold: 0.02,
            max_roughness: 0.6,
            together: false,
        }
    }
}

impl SpecularSettings {
    /// Returns the parameters of the kernel: those of subsplats, and the others.
    #[must_use]
    pub fn params(
        &self,
        view_from_clip: Mat4,
        view_from_world: Mat4,
        viewport: [f32; 4],
        size: [u32; 2],
    ) -> (SubsplatParams, SpecularParams) {
        let positive = |v: f32| if v.is_nan() { 0.0 } else { v.max(0.0) };
        let screen = SubsplatSettings {
            coarsest_level: self.coarsest_level.clamp(2, MAX_COARSEST_LEVEL),
            finest_level: self.finest_level,
            radiance_threshold: positive(self.radiance_threshold),
            ..SubsplatSettings::default()
        };
        let params = SpecularParams {
            max_roughness: positive(self.max_roughness).min(1.0 + ROUGHNESS_FADE),
            together: u32::from(self.together),
            ..SpecularParams::default()
        };
        let screen = SubsplatParams::new(&screen, view_from_clip, view_from_world, viewport, size);
        (screen, params)
    }
}

/// Parameters of `vpl_specular` in addition to those of the view. 16 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SpecularParams {
    /// See [`SpecularSettings::max_roughness`].
    pub max_roughness: f32,
    /// 1 to refine by the sum of the lights.
    pub together: u32,
    /// Padding.
    pub pad0: u32,
    /// Padding.
    pub pad1: u32,
}

/// Specular light at a node, as half floats. 16 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct SpecularNode {
    /// Half floats, two per word, the first in the low bits: red, green, blue over f₀, then over
    /// f₉₀. The last word is 1 if the result is known.
    pub words: [u32; 4],
}

impl SpecularNode {
    /// Creates a node with this light.
    #[must_use]
    pub fn new(light: &SpecularRadiance) -> Self {
        let pack = |a: f32, b: f32| {
            let bits = |v: f32| u32::from(f16::from_f32(v.clamp(0.0, MAX_HALF)).to_bits());
            bits(a) | bits(b) << 16
        };
        let [a, b] = [light.f0, light.f90];
        Self {
            words: [pack(a.x, a.y), pack(a.z, b.x), pack(b.y, b.z), 1],
        }
    }

    /// Returns the light of the node. Returns `None` if it is unknown.
    #[must_use]
    pub fn light(&self) -> Option<SpecularRadiance> {
        let half = |i: usize| {
            let word = self.words[i / 2] >> (16 * (i % 2));
            f16::from_bits(word as u16).to_f32()
        };
        (self.words[3] == 1).then(|| SpecularRadiance {
            f0: Vec3::new(half(0), half(1), half(2)),
            f90: Vec3::new(half(3), half(4), half(5)),
        })
    }
}

/// Radiance times the view's scale, over f₀ and over f₉₀.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SpecularRadiance {
    /// Part over f₀.
    pub f0: Vec3,
    /// Part over f₉₀.
    pub f90: Vec3,
}

impl SpecularRadiance {
    pub(super) fn add(&mut self, weight: f32, other: &Self) {
        self.f0 += weight * other.f0;
        self.f90 += weight * other.f90;
    }

    /// Returns the radiance for a surface with this f₀.
    #[must_use]
    pub fn evaluate(&self, f0: Vec3) -> Vec3 {
        f0 * self.f0 + brdf::f90(f0) * self.f90
    }
}
