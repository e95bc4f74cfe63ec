//! Kernel `soft_shadow`: occluded irradiance of lights with soft shadows, from baked visibility
//! (\[P14\] §5), without rays and without shadow maps.
//!
//! A light is a set of stratified samples. For each sample the four nearest directions of the point
//! are compared with the sample's distance. The results are weighted by direction
//! (percentage-closer filtering, since a mean depth has no surface at an edge). The visible
//! fraction of the irradiance E is f = Σ w v / Σ w with w = cos θ cos θ' / d². E itself has a
//! closed form. The kernel writes the occluded irradiance (1 − f) E as a vector. The renderer draws
//! the light without shadows, and `subtract_shadow` subtracts the occluded part. In full shadow
//! nothing is left, for any number of samples.
//!
//! Depths are compared in e = d² / (d² + s²). Deviations from \[P14\], which has one bias:
//!
//! - **Plane distance.** In a direction next to the sample's, the reference distance is that to the
//!   rectangle's plane. This avoids acne where a panel is close below a ceiling.
//! - **Depth bias.** The threshold lies in front of the light by the error of the point's depths in
//!   that direction ([`SoftShadowParams::before`]). Visibility goes from 0 to 1 over the same range
//!   ([`SoftShadowParams::ramp`]). Few components smooth an edge between near and far, and its
//!   middle is the position of the edge. Where depths are exact, geometry slightly nearer than the
//!   light hides it.
//!
//! Points without visibility take the mean of their parents (`flatten`, with no row in use), and
//! `subtract_shadow` evaluates all of it at pixels.

use super::flatten;
use super::layout::{SolveParams, VectorIrradiance};
use super::project::extent;
use crate::asset::SceneData;
use crate::samples::{Point, tangents};
use crate::scene::Geometry;
use crate::transport::pca::{Visibility, VisibilityCluster, frame};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::TAU;

mod light;

pub use light::{SoftLight, corners, lambert, unshadowed, window};

/// Golden ratio minus one, 1/φ.
pub const GOLDEN: f32 = 0.618_034;

/// Returns the position of sample `k` of `light`, as visible from x, meters.
#[must_use]
#[inline]
pub fn sample(light: &SoftLight, k: u32, x: Vec3) -> Vec3 {
    let center = Vec3::from_array(light.center);
    if light.kind == SoftLight::RECTANGLE {
        // A Fibonacci lattice: no two samples share a row or a column. The shadow of an edge
        // parallel to the rectangle's edge then has as many steps as there are samples.
        let at = k as f32 + 0.5;
        let turn = at * GOLDEN;
        let a = 2.0 * at / (light.columns * light.rows) as f32 - 1.0;
        let b = 2.0 * (turn - turn.floor()) - 1.0;
        return center + Vec3::from_array(light.u) * a + Vec3::from_array(light.v) * b;
    }
    if light.radius <= 0.0 {
        return center;
    }
    // A Fibonacci spiral on the sphere's visible disk: even rings, rotated by the golden angle.
    let away = x - center;
    let distance = away.dot(away).sqrt();
    let count = (light.columns * light.rows) as f32;
    let radius = light.radius.min(0.9 * distance) * ((k as f32 + 0.5) / count).sqrt();
    let turn = k as f32 * GOLDEN;
    let angle = TAU * (turn - turn.floor());
    let (t, b) = tangents(away / distance.max(f32::MIN_POSITIVE));
    center + (t * libm::cosf(angle) + b * libm::sinf(angle)) * radius
}

/// Computes the weight of a sample at `position` for (x, n), cos θ cos θ' / d² up to a factor, with
/// its direction and distance. Returns `None` if the sample does not light the point.
#[inline]
fn weigh(light: &SoftLight, position: Vec3, x: Vec3, n: Vec3) -> Option<(f32, Vec3, f32)> {
    let to = position - x;
    let square = to.dot(to);
    if square <= 0.0 {
        return None;
    }
    let distance = square.sqrt();
    let direction = to / distance;
    let mut w = n.dot(direction) / square;
    if light.kind == SoftLight::RECTANGLE {
        w *= -light.normal().dot(direction);
    }
    (w > 0.0 && w < 1e38).then_some((w, direction, distance))
}

/// Parameters of a dispatch. 48 bytes, the layout of `SoftShadowParams` in the shaders.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SoftShadowParams {
    /// Number of points with visibility.
    pub points: u32,
    /// Number of lights.
    pub lights: u32,
    /// Number of directions in a row of the map.
    pub columns: u32,
    /// Number of rows of the map.
    pub rows: u32,
    /// Largest edge of the scene's bounding box, meters.
    pub extent: f32,
    /// Depth bias for exact depths, as a fraction of the light's distance. An occluder at this
    /// fraction in front of the light hides half of it. Half this fraction hides nothing, and twice
    /// this fraction hides all of it.
    pub bias: f32,
    /// Distance of the threshold in front of the light, in root mean square errors of the depth.
    pub before: f32,
    /// Depth range over which visibility goes from 0 to 1, in the same unit.
    pub ramp: f32,
    /// Padding.
    pub pad: [u32; 4],
}

/// Default of [`SoftShadowParams::bias`].
pub const BIAS: f32 = 0.1;
/// Default of [`SoftShadowParams::before`].
pub const DEPTH_BIAS_SIGMAS: f32 = 3.0;
/// Default of [`SoftShadowParams::ramp`].
pub const DEPTH_RAMP_SIGMAS: f32 = 3.0;
/// Depth difference up to which depths count as equal. The 16-bit rounding of means and
/// coefficients is below this value. The rounding of components is part of their error.
pub const ROUNDING: f32 = 1e-3;

impl SoftShadowParams {
    /// Creates the parameters for a scene of size `extent`, meters.
    #[must_use]
    pub fn new(visibility: &Visibility, extent: f32, lights: usize) -> Self {
        Self {
            points: visibility.points.len() as u32,
            lights: lights as u32,
            columns: visibility.grid.columns,
            rows: visibility.grid.rows,
            extent,
            bias: BIAS,
            before: DEPTH_BIAS_SIGMAS,
            ramp: DEPTH_RAMP_SIGMAS,
            pad: [0; 4],
        }
    }
}

/// Visibility of a light sample in a direction (unit) at a distance (meters). The light lies in a
/// plane with a normal. A zero normal means no plane.
pub trait VisibilityQuery {
    /// Returns the visibility, 0 to 1.
    fn visibility_toward(&self, direction: Vec3, distance: f32, normal: Vec3) -> f32;
}

/// Visibility of one point, with its coefficients decoded.
pub struct DecodedVisibility<'a> {
    params: SoftShadowParams,
    visibility: &'a Visibility,
    cluster: VisibilityCluster,
    axes: [Vec3; 3],
    decoded: [f32; Visibility::MAX_COMPONENTS as usize + 2],
    numbers: usize,
}

impl<'a> DecodedVisibility<'a> {
    /// Decodes point `i`, which has the unit normal `n`.
    #[must_use]
    pub fn new(params: &SoftShadowParams, visibility: &'a Visibility, i: usize, n: Vec3) -> Self {
        let mut decoded = [0.0; Visibility::MAX_COMPONENTS as usize + 2];
        let numbers = visibility.decode(i, &mut decoded);
        let cluster = visibility.clusters[visibility.points[i].cluster as usize];
        let (t, b) = frame(cluster.tangent.into(), n);
        Self {
            params: *params,
            visibility,
            cluster,
            axes: [t, b, n],
            decoded,
            numbers,
        }
    }

    fn local(&self, v: Vec3) -> Vec3 {
        Vec3::from_array(self.axes.map(|axis| axis.dot(v)))
    }

    /// Returns e and its root mean square error.
    fn depth(&self, texel: u32) -> (f32, f32) {
        self.visibility
            .reconstruct(&self.cluster, &self.decoded[..self.numbers], texel)
    }
}

impl VisibilityQuery for DecodedVisibility<'_> {
    fn visibility_toward(&self, direction: Vec3, distance: f32, normal: Vec3) -> f32 {
        let grid = self.visibility.grid;
        let (local, plane) = (self.local(direction), self.local(normal));
        let (texels, weights) = grid.lookup(local);
        let mut visible = 0.0;
        for (texel, weight) in texels.into_iter().zip(weights) {
            let over = grid.direction(texel as usize).dot(plane);
            let far = match over < 0.0 {
                true => (distance * local.dot(plane) / over).clamp(0.5 * distance, 2.0 * distance),
                false => distance,
            };
            let light = self.cluster.encode(far);
            let close = self.cluster.encode(far * (1.0 - self.params.bias));
            let min = (light - close).max(ROUNDING);
            let (e, error) = self.depth(texel);
            let threshold = light - (self.params.before * error).max(min);
            let ramp = (self.params.ramp * error).max(min);
            visible += weight * (0.5 + (e - threshold) / ramp).clamp(0.0, 1.0);
        }
        visible
    }
}

/// Visibility by shadow rays, the reference for baked visibility.
pub struct RayVisibility<'a> {
    /// Geometry that the rays intersect.
    pub geometry: &'a dyn Geometry,
    /// Start of the rays, one ray offset above the surface, meters.
    pub start: Vec3,
}

impl VisibilityQuery for RayVisibility<'_> {
    fn visibility_toward(&self, direction: Vec3, distance: f32, _: Vec3) -> f32 {
        let end = self.start + direction * distance;
        let end = end - direction * self.geometry.ray_offset(end);
        if self.geometry.is_occluded(self.start, end) {
            0.0
        } else {
            1.0
        }
    }
}

/// Returns the visible fraction of `light` at (x, n), and the mean direction of its hidden part
/// times the weight of that part.
#[must_use]
pub fn visible_fraction(
    light: &SoftLight,
    x: Vec3,
    n: Vec3,
    sight: &impl VisibilityQuery,
) -> (f32, Vec3) {
    let normal = light.normal();
    let samples = light.columns * light.rows;
    let (mut sum, mut visible, mut hidden) = (0.0, 0.0, Vec3::ZERO);
    for k in 0..samples {
        if let Some((w, direction, distance)) = weigh(light, sample(light, k, x), x, n) {
            let v = sight.visibility_toward(direction, distance, normal);
            sum += w;
            visible += w * v;
            hidden += (w * (1.0 - v)) * direction;
        }
    }
    if sum > 0.0 {
        ((visible / sum).clamp(0.0, 1.0), hidden / sum)
    } else {
        (1.0, Vec3::ZERO)
    }
}

/// Minimum ratio of a vector's component along the normal to its tangential component. It limits
/// the length to ten times the normal component.
pub const MIN_ALONG: f32 = 0.1;

/// Returns the irradiance from `light` with color one that is occluded at (x, n). The dot product
/// of the vector with `n` is (1 − f) E, in 1/m². It is dimensionless for a rectangle.
#[must_use]
pub fn occluded_irradiance(
    params: &SoftShadowParams,
    light: &SoftLight,
    x: Vec3,
    n: Vec3,
    sight: &impl VisibilityQuery,
) -> Vec3 {
    let e = unshadowed(light, x, n, params.extent);
    if e <= 0.0 {
        return Vec3::ZERO;
    }
    let (f, hidden) = visible_fraction(light, x, n, sight);
    let along = hidden.dot(n);
    let across = hidden - n * along;
    let lean = across
        / along
            .max(MIN_ALONG * across.length())
            .max(f32::MIN_POSITIVE);
    (n + lean) * ((1.0 - f) * e)
}

/// Returns the occluded irradiance of all `lights` at one point with visibility, W/m². The fourth
/// floats of the three axes are red, green and blue of the unshadowed irradiance of all lights.
#[must_use]
pub fn soft_shadow_at(
    params: &SoftShadowParams,
    visibility: &Visibility,
    lights: &[SoftLight],
    i: usize,
    x: Vec3,
    n: Vec3,
) -> VectorIrradiance {
    let eye = DecodedVisibility::new(params, visibility, i, n);
    let mut sum = VectorIrradiance::default();
    for light in lights {
        let d = occluded_irradiance(params, light, x, n, &eye);
        let e = unshadowed(light, x, n, params.extent);
        let [r, g, b] = light.color;
        sum.add_scaled(
            1.0,
            &VectorIrradiance {
                x: [d.x * r, d.x * g, d.x * b, e * r],
                y: [d.y * r, d.y * g, d.y * b, e * g],
                z: [d.z * r, d.z * g, d.z * b, e * b],
            },
        );
    }
    sum
}

/// Fills the first `visibility.points` elements of `out`, one value per point.
pub fn soft_shadow(
    params: &SoftShadowParams,
    visibility: &Visibility,
    points: &[Point],
    lights: &[SoftLight],
    out: &mut [VectorIrradiance],
) {
    out[..visibility.points.len()]
        .par_iter_mut()
        .with_min_len(64)
        .enumerate()
        .for_each(|(i, out)| {
            let p = &points[i];
            *out = soft_shadow_at(params, visibility, lights, i, p.x(), p.n());
        });
}

/// Returns the occluded irradiance at all points of `scene`, W/m², from its own visibility
/// ([`occluded_irradiances_from`]). Zero for a bake without visibility.
#[must_use]
pub fn occluded_irradiances(scene: &SceneData, lights: &[SoftLight]) -> Vec<VectorIrradiance> {
    match &scene.visibility {
        Some(visibility) => occluded_irradiances_from(scene, visibility, lights),
        None => vec![VectorIrradiance::default(); scene.points.len()],
    }
}

/// Returns the occluded irradiance at all points of `scene` from a visibility of its first levels,
/// W/m². Runs [`soft_shadow`], then takes the mean of the parents at finer points.
#[must_use]
pub fn occluded_irradiances_from(
    scene: &SceneData,
    visibility: &Visibility,
    lights: &[SoftLight],
) -> Vec<VectorIrradiance> {
    let mut out = vec![VectorIrradiance::default(); scene.points.len()];
    let params = SoftShadowParams::new(visibility, extent(scene), lights.len());
    soft_shadow(&params, visibility, &scene.points, lights, &mut out);
    fill_finer_levels(scene, visibility.points.len(), &mut out);
    out
}

/// Fills points of the levels after the first `known` points with the mean of their parents, coarse
/// levels first. This is `flatten` with no row in use.
pub fn fill_finer_levels(scene: &SceneData, known: usize, values: &mut [VectorIrradiance]) {
    let none = SolveParams::default();
    for l in (0..scene.levels()).filter(|&l| scene.level(l).start >= known) {
        flatten::averages(
            &none,
            &scene.operator.rows,
            &scene.parents,
            scene.level(l),
            values,
        );
    }
}
