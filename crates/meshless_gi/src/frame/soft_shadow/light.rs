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
        .with_range(range)
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

    /// Soft light of a point or rectangle light. Returns `None` for other kinds.
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

    /// The light in a bake's local space, where `local_from_world` turns, moves and scales
    /// uniformly: as [`FrameLight::to_local`](crate::frame::FrameLight::to_local), so that
    /// irradiance is the same in both spaces. A transform that mirrors turns u and v, and the side
    /// that shines stays.
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

/// Samples along an edge for a total of `samples`.
fn side(samples: u32) -> u32 {
    (samples as f32)
        .sqrt()
        .round()
        .clamp(1.0, SoftLight::MAX_SAMPLES as f32) as u32
}

/// Irradiance at (x, n) without shadows from `light` with color one, in a scene as large as
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

/// Fade factor of a light toward its range. `square` is a squared distance, m².
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

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Quat;

    /// A transform of the root moves, turns, scales or mirrors a scene. Its lights give the same
    /// irradiance.
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
