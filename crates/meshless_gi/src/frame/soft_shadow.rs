//! Kernel `soft`: what lamps with soft shadows do not reach, at the points that remember what they
//! see (\[P14\] §5): without a ray and without a shadow map.
//!
//! A light is a set of stratified samples. For each, the four nearest of the point's directions
//! tell whether something is nearer than the sample; the answers are weighted as the directions are
//! (percentage closer, not a comparison with a mean depth: an edge between near and far has no
//! surface half-way). That gives the visible fraction f = Σ w v / Σ w of the irradiance E, with w =
//! cos θ cos θ' / d²; E itself is known in closed form. The kernel writes the deficit (1 − f) E, as
//! a vector: what the engine draws without shadows is drawn at every pixel, and this is taken from
//! it. In full shadow nothing is left, however few the samples.
//!
//! Depths are compared in e = d² / (d² + s²). Where we deviate from \[P14\], which has one bias:
//!
//! - **A light on a plane is as far as the plane.** In a direction beside the sample's, the
//!   distance to compare with is that to the rectangle's plane: no acne where a panel hangs a
//!   hand's breadth below a ceiling.
//! - **The threshold lies before the light** by as much as the point's depths are wrong in that
//!   direction ([`SoftShadowParams::before`]), and visibility goes from nothing to all over as much
//!   ([`SoftShadowParams::ramp`]): few components make an edge between near and far smooth, and its
//!   middle is where the edge is. Where depths are exact, what is a little nearer than the light
//!   hides it.
//!
//! Points beyond those that remember take the mean of their parents (`flatten`, with no row in
//! use), and `splat` brings all of it to the screen.

use super::flatten;
use super::layout::{SolveParams, VectorIrradiance};
use super::project::extent;
use crate::asset::BakedScene;
use crate::samples::{Point, tangents};
use crate::scene::Geometry;
use crate::transport::pca::{Visibility, VisibilityCluster, frame};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::TAU;

mod light;

pub use light::{SoftLight, corners, lambert, unshadowed, window};

/// The golden section.
pub const GOLDEN: f32 = 0.618_034;

/// Sample `k` of `light` as seen from x: its place, meters.
#[must_use]
#[inline]
pub fn sample(light: &SoftLight, k: u32, x: Vec3) -> Vec3 {
    let center = Vec3::from_array(light.center);
    if light.kind == SoftLight::RECTANGLE {
        // A Fibonacci lattice: no two samples share a row or a column, so that the shadow of an
        // edge along the rectangle's has as many steps as there are samples.
        let at = k as f32 + 0.5;
        let turn = at * GOLDEN;
        let a = 2.0 * at / (light.columns * light.rows) as f32 - 1.0;
        let b = 2.0 * (turn - turn.floor()) - 1.0;
        return center + Vec3::from_array(light.u) * a + Vec3::from_array(light.v) * b;
    }
    if light.radius <= 0.0 {
        return center;
    }
    // The disk that x sees of it, by a Fibonacci spiral: even rings, turned by the golden angle.
    let away = x - center;
    let distance = away.dot(away).sqrt();
    let count = (light.columns * light.rows) as f32;
    let radius = light.radius.min(0.9 * distance) * ((k as f32 + 0.5) / count).sqrt();
    let turn = k as f32 * GOLDEN;
    let angle = TAU * (turn - turn.floor());
    let (t, b) = tangents(away / distance.max(f32::MIN_POSITIVE));
    center + (t * libm::cosf(angle) + b * libm::sinf(angle)) * radius
}

/// Weight of a sample at `place` for (x, n): cos θ cos θ' / d² up to a factor, with its direction
/// and distance; none where it does not shine there.
#[inline]
fn weigh(light: &SoftLight, place: Vec3, x: Vec3, n: Vec3) -> Option<(f32, Vec3, f32)> {
    let to = place - x;
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

/// What all threads know. 48 bytes, the layout of `SoftShadowParams` in the shaders.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SoftShadowParams {
    /// Points with visibility.
    pub points: u32,
    /// Lights.
    pub lights: u32,
    /// Directions in a row of the map.
    pub columns: u32,
    /// Rows of the map.
    pub rows: u32,
    /// Largest edge of the level's box, meters.
    pub extent: f32,
    /// Where depths are exact: what stands before the light by this part of its distance hides half
    /// of it, half as far before it nothing, twice as far all.
    pub bias: f32,
    /// How far before the light the threshold lies, in root mean square errors of the depth.
    pub before: f32,
    /// Over how much depth visibility goes from nothing to all, in the same.
    pub ramp: f32,
    /// Not used.
    pub pad: [u32; 4],
}

/// The usual [`SoftShadowParams::bias`].
pub const BIAS: f32 = 0.1;
/// The usual [`SoftShadowParams::before`].
pub const DEPTH_BIAS_SIGMAS: f32 = 3.0;
/// The usual [`SoftShadowParams::ramp`].
pub const DEPTH_RAMP_SIGMAS: f32 = 3.0;
/// Depths that differ by no more are not told apart: sixteen bits of a mean and of coefficients
/// leave less than that, and what components are rounded by is in their error.
pub const ROUNDING: f32 = 1e-3;

impl SoftShadowParams {
    /// The parameters for a level as large as `extent` meters.
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

/// How much is seen of a sample in a direction (unit), at a distance (meters), of a light on a
/// plane with a normal (zero for none).
pub trait VisibilityQuery {
    /// 0 to 1.
    fn sees(&self, direction: Vec3, distance: f32, normal: Vec3) -> f32;
}

/// A point with its coefficients decoded, to look in directions.
pub struct DecodedVisibility<'a> {
    params: SoftShadowParams,
    visibility: &'a Visibility,
    cluster: VisibilityCluster,
    axes: [Vec3; 3],
    decoded: [f32; Visibility::MAX_COMPONENTS as usize + 2],
    numbers: usize,
}

impl<'a> DecodedVisibility<'a> {
    /// Point `i`, which has the unit normal `n`.
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

    /// e and its root mean square error.
    fn depth(&self, texel: u32) -> (f32, f32) {
        self.visibility
            .reconstruct(&self.cluster, &self.decoded[..self.numbers], texel)
    }
}

impl VisibilityQuery for DecodedVisibility<'_> {
    fn sees(&self, direction: Vec3, distance: f32, normal: Vec3) -> f32 {
        let grid = self.visibility.grid;
        let (local, plane) = (self.local(direction), self.local(normal));
        let (texels, weights) = grid.lookup(local);
        let mut seen = 0.0;
        for (texel, weight) in texels.into_iter().zip(weights) {
            let over = grid.direction(texel as usize).dot(plane);
            let far = match over < 0.0 {
                true => (distance * local.dot(plane) / over).clamp(0.5 * distance, 2.0 * distance),
                false => distance,
            };
            let light = self.cluster.encode(far);
            let close = self.cluster.encode(far * (1.0 - self.params.bias));
            let least = (light - close).max(ROUNDING);
            let (e, error) = self.depth(texel);
            let threshold = light - (self.params.before * error).max(least);
            let ramp = (self.params.ramp * error).max(least);
            seen += weight * (0.5 + (e - threshold) / ramp).clamp(0.0, 1.0);
        }
        seen
    }
}

/// Sight by rays: what memory is compared with.
pub struct RayVisibility<'a> {
    /// What they meet.
    pub geometry: &'a dyn Geometry,
    /// Where they start, a lift above the surface, meters.
    pub start: Vec3,
}

impl VisibilityQuery for RayVisibility<'_> {
    fn sees(&self, direction: Vec3, distance: f32, _: Vec3) -> f32 {
        let end = self.start + direction * distance;
        let end = end - direction * self.geometry.ray_offset(end);
        if self.geometry.occluded(self.start, end) {
            0.0
        } else {
            1.0
        }
    }
}

/// Visible fraction of `light` at (x, n), and the mean direction, times its weight, of what is
/// hidden of it.
#[must_use]
pub fn visible_fraction(
    light: &SoftLight,
    x: Vec3,
    n: Vec3,
    sight: &impl VisibilityQuery,
) -> (f32, Vec3) {
    let normal = light.normal();
    let samples = light.columns * light.rows;
    let (mut sum, mut seen, mut hidden) = (0.0, 0.0, Vec3::ZERO);
    for k in 0..samples {
        if let Some((w, direction, distance)) = weigh(light, sample(light, k, x), x, n) {
            let v = sight.sees(direction, distance, normal);
            sum += w;
            seen += w * v;
            hidden += (w * (1.0 - v)) * direction;
        }
    }
    if sum > 0.0 {
        ((seen / sum).clamp(0.0, 1.0), hidden / sum)
    } else {
        (1.0, Vec3::ZERO)
    }
}

/// Vectors lean so far at most that their length is ten times their part along the normal.
pub const MIN_ALONG: f32 = 0.1;

/// What `light` with color one does not give to (x, n) because something is before it: a vector
/// whose dot product with `n` is (1 − f) E, 1/m² or, of a rectangle, dimensionless.
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

/// The deficit of all `lights` at one point that has visibility, W/m²; in the fourth floats of the
/// three axes red, green and blue of the irradiance that all of them would give without shadows.
#[must_use]
pub fn soft_at(
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

/// Fills the first `visibility.points` of `out`, one value a point.
pub fn soft(
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
            *out = soft_at(params, visibility, lights, i, p.x(), p.n());
        });
}

/// The deficit at all points of `scene`, W/m²: [`occluded_irradiances_from`] its own visibility. Zero without.
#[must_use]
pub fn occluded_irradiances(scene: &BakedScene, lights: &[SoftLight]) -> Vec<VectorIrradiance> {
    match &scene.visibility {
        Some(visibility) => occluded_irradiances_from(scene, visibility, lights),
        None => vec![VectorIrradiance::default(); scene.points.len()],
    }
}

/// The deficit at all points of `scene` by a visibility of its first levels, W/m²: [`soft`], and
/// the parents' mean where nothing is remembered.
#[must_use]
pub fn occluded_irradiances_from(
    scene: &BakedScene,
    visibility: &Visibility,
    lights: &[SoftLight],
) -> Vec<VectorIrradiance> {
    let mut out = vec![VectorIrradiance::default(); scene.points.len()];
    let params = SoftShadowParams::new(visibility, extent(scene), lights.len());
    soft(&params, visibility, &scene.points, lights, &mut out);
    fill_finer_levels(scene, visibility.points.len(), &mut out);
    out
}

/// Points of the levels behind the first `known` take the mean of their parents, coarse levels
/// first: `flatten` with no row in use.
pub fn fill_finer_levels(scene: &BakedScene, known: usize, values: &mut [VectorIrradiance]) {
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
