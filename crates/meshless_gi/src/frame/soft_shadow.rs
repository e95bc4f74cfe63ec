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
use super::project::{extent, min_distance_squared};
use crate::asset::BakedScene;
use crate::samples::{Point, tangents};
use crate::scene::{Geometry, Light};
use crate::transport::pca::{Visibility, VisibilityCluster, frame};
use bytemuck::{Pod, Zeroable};
use glam::{Mat4, Vec3};
use rayon::prelude::*;
use std::f32::consts::TAU;

/// A light that casts soft shadows from baked visibility, in the bake's local space. 80 bytes, the
/// layout of `SoftLight` in the shaders.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SoftLight {
    /// Meters.
    pub center: [f32; 3],
    /// One of [`SoftLight::NONE`], [`SPHERE`](Self::SPHERE), [`RECTANGLE`](Self::RECTANGLE).
    pub kind: u32,
    /// Half edge of a rectangle, meters; it emits to the side of u × v.
    pub u: [f32; 3],
    /// Radius of a sphere, meters; 0 for a point.
    pub radius: f32,
    /// The other half edge of a rectangle, meters.
    pub v: [f32; 3],
    /// 1 / range², 1/m², from the middle; 0 for no range.
    pub inverse_square_range: f32,
    /// Sphere: intensity, W/sr. Rectangle: radiance, W/(m² sr).
    pub color: [f32; 3],
    /// Samples along u.
    pub columns: u32,
    /// Samples along v; a sphere has columns × rows of them on the disk that a point sees.
    pub rows: u32,
    /// Not used.
    pub pad: [u32; 3],
}

impl SoftLight {
    /// `kind` of a slot without a light.
    pub const NONE: u32 = 0;
    /// `kind` of a sphere, or of a point, which is one without radius.
    pub const SPHERE: u32 = 1;
    /// `kind` of a rectangle.
    pub const RECTANGLE: u32 = 2;
    /// Most samples along an edge.
    pub const MAX_SAMPLES: u32 = 16;

    /// A sphere: meters, W/sr; `range` in meters or infinite; about `samples` samples. One that is
    /// not finite, or beyond 10¹⁵ of these, is [`NONE`](Self::NONE).
    #[must_use]
    pub fn sphere(center: Vec3, radius: f32, intensity: Vec3, range: f32, samples: u32) -> Self {
        let side = side(samples);
        let one = if radius > 0.0 { side } else { 1 };
        Self {
            center: center.to_array(),
            kind: Self::SPHERE,
            radius: radius.max(0.0),
            color: intensity.to_array(),
            columns: one,
            rows: one,
            ..Self::default()
        }
        .within(range)
    }

    /// A rectangle of half edges `u` and `v` that emits `radiance` to the side of u × v, with about
    /// `samples` samples. One that is not finite, is beyond 10¹⁵ m, or has no area, is
    /// [`NONE`](Self::NONE).
    #[must_use]
    pub fn rectangle(center: Vec3, u: Vec3, v: Vec3, radiance: Vec3, samples: u32) -> Self {
        let (long, wide) = (u.length(), v.length());
        if u.cross(v).length_squared() <= 0.0 {
            return Self::default();
        }
        let samples = samples.clamp(1, Self::MAX_SAMPLES * Self::MAX_SAMPLES) as f32;
        let columns = (samples * long / wide).sqrt().round().clamp(1.0, 16.0);
        let rows = (samples / columns).round().clamp(1.0, 16.0);
        Self {
            center: center.to_array(),
            kind: Self::RECTANGLE,
            u: u.to_array(),
            v: v.to_array(),
            color: radiance.to_array(),
            columns: columns as u32,
            rows: rows as u32,
            ..Self::default()
        }
        .or_none()
    }

    /// The soft light of a point or rectangle light; none for the other kinds.
    #[must_use]
    pub fn from_light(light: &Light, samples: u32) -> Option<Self> {
        match *light {
            Light::Point {
                position,
                intensity,
                range,
            } => Some(Self::sphere(position, 0.0, intensity, range, 1)),
            Light::Rect {
                center,
                u,
                v,
                radiance,
            } => Some(Self::rectangle(center, u, v, radiance, samples)),
            _ => None,
        }
    }

    /// The light with a range, meters: Bevy lets lights fade out there. Infinite for none.
    #[must_use]
    pub fn within(self, range: f32) -> Self {
        Self {
            inverse_square_range: match range.is_finite() {
                true => 1.0 / (range * range).max(1e-30),
                false => 0.0,
            },
            ..self
        }
        .or_none()
    }

    /// The light in a bake's local space, where `local_from_world` turns, moves and scales
    /// uniformly: as [`FrameLight::to_local`](super::FrameLight::to_local), so that irradiance is
    /// the same in both spaces. A transform that mirrors turns u and v, and the side that shines
    /// stays.
    #[must_use]
    pub fn to_local(&self, local_from_world: &Mat4) -> Self {
        let determinant = local_from_world.determinant();
        let length = determinant.abs().cbrt();
        let turned = |v: [f32; 3]| local_from_world.transform_vector3(v.into()).to_array();
        let mut out = *self;
        out.center = local_from_world
            .transform_point3(self.center.into())
            .to_array();
        (out.u, out.v) = match determinant < 0.0 {
            true => (turned(self.v), turned(self.u)),
            false => (turned(self.u), turned(self.v)),
        };
        if determinant < 0.0 {
            (out.columns, out.rows) = (self.rows, self.columns);
        }
        out.radius = self.radius * length;
        out.inverse_square_range = self.inverse_square_range / (length * length);
        if self.kind == Self::SPHERE {
            out.color = (Vec3::from_array(self.color) * length * length).to_array();
        }
        out.or_none()
    }

    fn or_none(self) -> Self {
        let numbers = [self.center, self.u, self.v, self.color];
        let finite = numbers.iter().flatten().all(|v| v.abs() < MAX)
            && self.radius < MAX
            && self.inverse_square_range.is_finite();
        if finite { self } else { Self::default() }
    }

    /// Normal of a rectangle, unit; zero for what has none.
    #[must_use]
    pub fn normal(&self) -> Vec3 {
        Vec3::from_array(self.u)
            .cross(self.v.into())
            .normalize_or_zero()
    }
}

/// Meters, W/sr and W/(m² sr) stay below: no square of them is infinite.
const MAX: f32 = 1e15;

/// Samples along an edge for so many in all.
fn side(samples: u32) -> u32 {
    (samples as f32)
        .sqrt()
        .round()
        .clamp(1.0, SoftLight::MAX_SAMPLES as f32) as u32
}

/// Irradiance at (x, n) without shadows from `light` with color one, in a level as large as
/// `extent` (meters): a rectangle by Lambert's sum ([`lambert`]), a sphere as a point, which is
/// exact for one that is wholly above it; both fade toward their range, as Bevy draws them.
#[must_use]
pub fn unshadowed(light: &SoftLight, x: Vec3, n: Vec3, extent: f32) -> f32 {
    let to = Vec3::from_array(light.center) - x;
    let square = to.dot(to);
    if light.kind == SoftLight::SPHERE {
        if square <= 0.0 {
            return 0.0;
        }
        let cosine = n.dot(to / square.sqrt()).max(0.0);
        return cosine / square.max(min_distance_squared(extent)) * window(light, square);
    }
    if light.kind != SoftLight::RECTANGLE || light.normal().dot(to) >= 0.0 {
        return 0.0;
    }
    lambert(corners(light, to), n) * window(light, square)
}

/// How a light fades toward its range, at the square of a distance, m².
#[must_use]
pub fn window(light: &SoftLight, square: f32) -> f32 {
    let factor = square * light.inverse_square_range;
    let fade = (1.0 - factor * factor).clamp(0.0, 1.0);
    fade * fade
}

/// Corners of a rectangle whose middle is at `to`.
#[must_use]
pub fn corners(light: &SoftLight, to: Vec3) -> [Vec3; 4] {
    let (u, v) = (Vec3::from_array(light.u), Vec3::from_array(light.v));
    [to - u - v, to + u - v, to + u + v, to - u + v]
}

/// Half of Lambert's sum over the edges of a quadrilateral, as far as it is above the horizon of n
/// (\[L60\]): π times its form factor.
#[must_use]
pub fn lambert(corners: [Vec3; 4], n: Vec3) -> f32 {
    // What is below the horizon goes: at most five corners are left.
    let mut sum = 0.0;
    let mut first = Vec3::ZERO;
    let mut last = Vec3::ZERO;
    let mut any = false;
    let mut edge = |p: Vec3| {
        if any {
            sum += arc(last, p, n);
        } else {
            first = p;
            any = true;
        }
        last = p;
    };
    for k in 0..4 {
        let (a, b) = (corners[k], corners[(k + 1) % 4]);
        let (ha, hb) = (n.dot(a), n.dot(b));
        if ha >= 0.0 {
            edge(a);
        }
        if (ha < 0.0) != (hb < 0.0) {
            edge(a + (b - a) * (ha / (ha - hb)));
        }
    }
    if any {
        sum += arc(last, first, n);
    }
    0.5 * sum.abs()
}

/// Angle under which an edge is seen, times the cosine between n and the normal of its plane.
fn arc(a: Vec3, b: Vec3, n: Vec3) -> f32 {
    let across = a.cross(b);
    let sine = across.length();
    if sine <= 0.0 {
        return 0.0;
    }
    libm::atan2f(sine, a.dot(b)) * n.dot(across) / sine
}

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

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Quat;

    /// Whether a root moves, turns, scales or mirrors a level: its lamps light it as before.
    #[test]
    fn soft_irradiance_is_equal_in_both_spaces() {
        let turn = Quat::from_axis_angle(Vec3::new(0.6, 0.0, 0.8), 0.7);
        let moved = Vec3::new(2.0, -1.0, 5.0);
        let panel = SoftLight::rectangle(
            Vec3::new(0.2, 3.0, 0.1),
            Vec3::X * 0.6,
            Vec3::new(0.0, 0.1, 0.3),
            Vec3::ONE,
            20,
        );
        let bulb = SoftLight::sphere(Vec3::new(0.2, 3.0, 0.1), 0.2, Vec3::ONE, 9.0, 20);
        let (x, n) = (
            Vec3::new(-0.4, 0.0, 0.3),
            Vec3::new(0.2, 0.9, 0.1).normalize(),
        );
        for light in [panel.within(7.0), bulb] {
            for scale in [Vec3::splat(2.5), Vec3::new(-0.5, 0.5, 0.5)] {
                let root = Mat4::from_scale_rotation_translation(scale, turn, moved);
                let inverse = root.inverse();
                let local = light.to_local(&inverse);
                let direction = inverse.transform_vector3(n).normalize();
                // A level so small that no distance is near.
                let there = unshadowed(&local, inverse.transform_point3(x), direction, 1e-3);
                let here = unshadowed(&light, x, n, 1e-3);
                let (here, there) = (light.color[0] * here, local.color[0] * there);
                assert!(
                    here > 0.01 && (here - there).abs() < 1e-4 * here,
                    "{here} {there}"
                );
                let apart = (light.radius - local.radius * scale.y).abs();
                assert!(apart < 1e-6 && light.columns * light.rows == local.columns * local.rows);
            }
        }
    }
}
