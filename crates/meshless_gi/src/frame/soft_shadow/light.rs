//! Lights that cast soft shadows, and their irradiance without shadows.

use crate::frame::project::min_distance_squared;
use crate::scene::Light;
use bytemuck::{Pod, Zeroable};
use glam::{Mat4, Vec3};

/// A light that casts soft shadows from baked visibility, in the bake's local space. 80 bytes, the
/// layout of `SoftLight` in the shaders.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SoftLight {
    /// Position of the center, meters.
    pub center: [f32; 3],
    /// One of [`SoftLight::NONE`], [`SPHERE`](Self::SPHERE), [`RECTANGLE`](Self::RECTANGLE).
    pub kind: u32,
    /// Half edge of a rectangle, meters. The rectangle emits to the side of u × v.
    pub u: [f32; 3],
    /// Radius of a sphere, meters. 0 for a point.
    pub radius: f32,
    /// The other half edge of a rectangle, meters.
    pub v: [f32; 3],
    /// Inverse squared range from the center, 1/m². 0 means no range.
    pub inverse_square_range: f32,
    /// Sphere: intensity, W/sr. Rectangle: radiance, W/(m² sr).
    pub color: [f32; 3],
    /// Number of samples along u.
    pub columns: u32,
    /// Number of samples along v. A sphere has columns × rows samples on its disk visible from a
    /// point.
    pub rows: u32,
    /// Padding.
    pub pad: [u32; 3],
}

impl SoftLight {
    /// `kind` of a slot without a light.
    pub const NONE: u32 = 0;
    /// `kind` of a sphere, or of a point light, which is a sphere of radius 0.
    pub const SPHERE: u32 = 1;
    /// `kind` of a rectangle.
    pub const RECTANGLE: u32 = 2;
    /// Maximum number of samples along an edge.
    pub const MAX_SAMPLES: u32 = 16;

    /// Creates a sphere with about `samples` samples: meters, W/sr, `range` in meters or infinite.
    /// A sphere with values that are not finite, or above 10¹⁵ in these units, is
    /// [`NONE`](Self::NONE).
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
        .with_range(range)
    }

    /// Creates a rectangle of half edges `u` and `v` that emits `radiance` to the side of u × v,
    /// with about `samples` samples. A rectangle that is not finite, is beyond 10¹⁵ m, or has no
    /// area, is [`NONE`](Self::NONE).
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

    /// Creates the soft light of a point or rectangle light. Returns `None` for other kinds.
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

    /// Returns the light with a range, meters, toward which it fades as in Bevy. Infinite means no
    /// range.
    #[must_use]
    pub fn with_range(self, range: f32) -> Self {
        Self {
            inverse_square_range: match range.is_finite() {
                true => 1.0 / (range * range).max(1e-30),
                false => 0.0,
            },
            ..self
        }
        .or_none()
    }

    /// Returns the light in a bake's local space. `local_from_world` rotates, translates and scales
    /// uniformly. Irradiance is the same in both spaces, as with
    /// [`FrameLight::to_local`](crate::frame::FrameLight::to_local). A transform that mirrors swaps
    /// u and v, so that the emitting side stays the same.
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

    /// Returns the unit normal of a rectangle. Zero for other kinds and for a rectangle without
    /// area.
    #[must_use]
    pub fn normal(&self) -> Vec3 {
        Vec3::from_array(self.u)
            .cross(self.v.into())
            .normalize_or_zero()
    }
}

/// Upper bound of values in meters, W/sr and W/(m² sr). Their squares stay finite.
const MAX: f32 = 1e15;

/// Returns the number of samples along an edge for a total of `samples`.
fn side(samples: u32) -> u32 {
    (samples as f32)
        .sqrt()
        .round()
        .clamp(1.0, SoftLight::MAX_SAMPLES as f32) as u32
}

/// Returns the irradiance at (x, n) without shadows from `light` with color one, in a scene of size
/// `extent` (meters). A rectangle uses Lambert's sum ([`lambert`]). A sphere is evaluated as a
/// point, which is exact if it lies completely above the horizon. Both fade toward their range, as
/// in Bevy.
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

/// Returns the fade factor of a light toward its range. `square` is a squared distance, m².
#[must_use]
pub fn window(light: &SoftLight, square: f32) -> f32 {
    let factor = square * light.inverse_square_range;
    let fade = (1.0 - factor * factor).clamp(0.0, 1.0);
    fade * fade
}

/// Returns the corners of a rectangle with its center at `to`.
#[must_use]
pub fn corners(light: &SoftLight, to: Vec3) -> [Vec3; 4] {
    let (u, v) = (Vec3::from_array(light.u), Vec3::from_array(light.v));
    [to - u - v, to + u - v, to + u + v, to - u + v]
}

/// Returns half of Lambert's sum over the edges of a quadrilateral, clipped at the horizon of n
/// (\[L60\]). This is π times its form factor.
#[must_use]
pub fn lambert(corners: [Vec3; 4], n: Vec3) -> f32 {
    // The polygon is clipped at the horizon, which leaves at most five corners.
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

/// Returns the angle that an edge subtends, times the cosine between n and the normal of its plane.
fn arc(a: Vec3, b: Vec3, n: Vec3) -> f32 {
    let across = a.cross(b);
    let sine = across.length();
    if sine <= 0.0 {
        return 0.0;
    }
    libm::atan2f(sine, a.dot(b)) * n.dot(across) / sine
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Quat;

    /// The transform of the root translates, rotates, scales or mirrors a scene. Its lights give
    /// the same irradiance.
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
        for light in [panel.with_range(7.0), bulb] {
            for scale in [Vec3::splat(2.5), Vec3::new(-0.5, 0.5, 0.5)] {
                let root = Mat4::from_scale_rotation_translation(scale, turn, moved);
                let inverse = root.inverse();
                let local = light.to_local(&inverse);
                let direction = inverse.transform_vector3(n).normalize();
                // An extent so small that the minimum distance has no effect.
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
