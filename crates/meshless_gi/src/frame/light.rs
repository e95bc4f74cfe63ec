//! Lights as kernel inputs: one slot per light, several slots for a rectangle. Color and geometry
//! are separate, so that a color change does not project the light again.

use crate::scene::Light;
use bytemuck::{Pod, Zeroable};
use glam::{Mat4, Vec3};

/// Light in the bake's local space. 64 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct FrameLight {
    /// Position, meters. Not used by directional lights.
    pub position: [f32; 3],
    /// One of [`FrameLight::NONE`], [`POINT`](Self::POINT), [`SPOT`](Self::SPOT),
    /// [`DIRECTIONAL`](Self::DIRECTIONAL), [`PATCH`](Self::PATCH).
    pub kind: u32,
    /// Unit vector: direction of emission of a spot or directional light, or normal of a patch.
    pub direction: [f32; 3],
    /// 1 / range² of point and spot lights, 1/m². 0 means an unlimited range.
    pub inverse_square_range: f32,
    /// Point and spot: intensity, W/sr. Directional: irradiance, W/m². Patch: radiance times area,
    /// W/sr.
    pub color: [f32; 3],
    /// 1 / (cos inner − cos outer) of a spot.
    pub spot_scale: f32,
    /// −cos outer / (cos inner − cos outer) of a spot.
    pub spot_offset: f32,
    /// Padding, not used.
    pub pad: [f32; 3],
}

/// Upper limit of lights, sky and surface emission, in W/sr or W/m². Sums of many lights at any
/// distance stay finite in single precision.
pub const MAX_INTENSITY: f32 = 1e18;

impl FrameLight {
    /// `kind` of a slot without a light.
    pub const NONE: u32 = 0;
    /// `kind` of a point light.
    pub const POINT: u32 = 1;
    /// `kind` of a spot light.
    pub const SPOT: u32 = 2;
    /// `kind` of a directional light.
    pub const DIRECTIONAL: u32 = 3;
    /// `kind` of one sample of a rectangle.
    pub const PATCH: u32 = 4;

    /// Creates a point light. `position` is in meters, `intensity` in W/sr, `range` in meters or
    /// infinite.
    #[must_use]
    pub fn point(position: Vec3, intensity: Vec3, range: f32) -> Self {
        Self {
            position: position.to_array(),
            kind: Self::POINT,
            inverse_square_range: inverse_square(range),
            color: intensity.to_array(),
            ..Self::default()
        }
        .or_none()
    }

    /// Creates a spot light that emits along `direction`. `position` is in meters, `intensity` is
    /// that on the axis in W/sr. The half angles `inner` and `outer` are in radians. `range` is in
    /// meters or infinite.
    #[must_use]
    pub fn spot(
        position: Vec3,
        direction: Vec3,
        intensity: Vec3,
        inner: f32,
        outer: f32,
        range: f32,
    ) -> Self {
        let cos_outer = libm::cosf(outer);
        let spot_scale = 1.0 / (libm::cosf(inner) - cos_outer).max(1e-4);
        Self {
            position: position.to_array(),
            kind: Self::SPOT,
            direction: direction.normalize_or_zero().to_array(),
            inverse_square_range: inverse_square(range),
            color: intensity.to_array(),
            spot_scale,
            spot_offset: -cos_outer * spot_scale,
            ..Self::default()
        }
        .or_none()
    }

    /// Creates a light at infinity that emits along `direction`. `irradiance` is that of a surface
    /// that faces the light, W/m².
    #[must_use]
    pub fn directional(direction: Vec3, irradiance: Vec3) -> Self {
        Self {
            kind: Self::DIRECTIONAL,
            direction: direction.normalize_or_zero().to_array(),
            color: irradiance.to_array(),
            ..Self::default()
        }
        .or_none()
    }

    /// Creates one sample of a surface that emits to the side of `normal`. `position` is in meters.
    /// `intensity` is radiance times area, W/sr.
    #[must_use]
    pub fn patch(position: Vec3, normal: Vec3, intensity: Vec3) -> Self {
        Self {
            position: position.to_array(),
            kind: Self::PATCH,
            direction: normal.normalize_or_zero().to_array(),
            color: intensity.to_array(),
            ..Self::default()
        }
        .or_none()
    }

    /// Returns the slots of `light`: `patches` or a few more for a rectangle, one for other lights.
    /// The sky has no slot, because its radiance belongs to
    /// [`FrameSettings`](super::FrameSettings). A light that is not finite keeps its slots, but
    /// they are [`NONE`](Self::NONE).
    #[must_use]
    pub fn expand(light: &Light, patches: u32) -> Vec<Self> {
        match *light {
            Light::Point {
                position,
                intensity,
                range,
            } => vec![Self::point(position, intensity, range)],
            Light::Spot {
                position,
                direction,
                intensity,
                inner,
                outer,
                range,
            } => vec![Self::spot(
                position, direction, intensity, inner, outer, range,
            )],
            Light::Directional {
                direction,
                irradiance,
            } => vec![Self::directional(direction, irradiance)],
            Light::Rect {
                center,
                u,
                v,
                radiance,
            } => patches_of(center, u, v, radiance, patches),
            Light::Sky { .. } => Vec::new(),
        }
    }

    /// Converts the light to a bake's local space. `local_from_world` rotates, translates and
    /// scales uniformly. Lengths are multiplied by the scale s and intensities by s², so irradiance
    /// is the same in both spaces.
    #[must_use]
    pub fn to_local(&self, local_from_world: &Mat4) -> Self {
        // Local meters per world meter.
        let length = local_from_world.determinant().abs().cbrt();
        let area = length * length;
        let direction = local_from_world.transform_vector3(self.direction.into());
        let mut out = *self;
        out.position = local_from_world
            .transform_point3(self.position.into())
            .to_array();
        out.direction = direction.normalize_or_zero().to_array();
        out.inverse_square_range = self.inverse_square_range / area;
        if self.kind != Self::DIRECTIONAL {
            out.color = (Vec3::from_array(self.color) * area).to_array();
        }
        out.or_none()
    }

    /// Returns `true` if a projection of `other` is valid for this light too: all except the color
    /// is equal.
    #[must_use]
    pub fn has_same_geometry(&self, other: &Self) -> bool {
        Self {
            color: other.color,
            ..*self
        } == *other
    }

    /// Returns the light with its color clamped to [`MAX_INTENSITY`]. Returns an empty slot if a
    /// number of the light is not finite.
    fn or_none(self) -> Self {
        if self.is_finite() {
            let color = Vec3::from_array(self.color);
            let max = Vec3::splat(MAX_INTENSITY);
            Self {
                color: color.clamp(-max, max).to_array(),
                ..self
            }
        } else {
            Self::default()
        }
    }

    fn is_finite(&self) -> bool {
        let all = |v: [f32; 3]| Vec3::from_array(v).is_finite();
        all(self.position)
            && all(self.direction)
            && all(self.color)
            && self.inverse_square_range.is_finite()
            && self.spot_scale.is_finite()
            && self.spot_offset.is_finite()
    }
}

/// Returns 1 / range², or 0 for an infinite range. A range of zero limits the light to 1e-15 m.
fn inverse_square(range: f32) -> f32 {
    if range.is_finite() {
        1.0 / (range * range).max(1e-30)
    } else {
        0.0
    }
}

/// Divides a rectangle into a grid of about `count` equal patches, as square as possible. Each
/// patch is sampled at its center.
fn patches_of(center: Vec3, u: Vec3, v: Vec3, radiance: Vec3, count: u32) -> Vec<FrameLight> {
    let normal = u.cross(v).normalize_or_zero();
    let area = 4.0 * u.cross(v).length();
    let (long, wide) = (u.length(), v.length());
    if area == 0.0 || !area.is_finite() {
        return Vec::new();
    }
    let count = count.clamp(1, 4096) as f32;
    let columns = (count * long / wide).sqrt().round().clamp(1.0, count);
    let rows = (count / columns).ceil().max(1.0);
    let color = radiance * (area / (columns * rows));
    let offset = |i: f32, of: f32| (2.0 * i + 1.0) / of - 1.0;
    let mut out = Vec::new();
    for row in 0..rows as u32 {
        for column in 0..columns as u32 {
            let position =
                center + u * offset(column as f32, columns) + v * offset(row as f32, rows);
            out.push(FrameLight::patch(position, normal, color));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Quat;

    #[test]
    fn rectangle_light_patches_preserve_power() {
        for count in [1, 4, 7, 16, 100] {
            let light = Light::Rect {
                center: Vec3::ONE,
                u: Vec3::X * 2.0,
                v: Vec3::Z * 0.5,
                radiance: Vec3::new(3.0, 2.0, 1.0),
            };
            let patches = FrameLight::expand(&light, count);
            assert!(patches.len() >= count as usize && patches.len() <= 2 * count as usize);
            let red: f32 = patches.iter().map(|p| p.color[0]).sum();
            assert!((red - 3.0 * 4.0).abs() < 1e-4, "{count}: {red}");
            let mean: Vec3 = patches
                .iter()
                .map(|p| Vec3::from_array(p.position))
                .sum::<Vec3>()
                / patches.len() as f32;
            assert!((mean - Vec3::ONE).length() < 1e-5);
            assert_eq!(patches[0].direction, [0.0, -1.0, 0.0]);
        }
    }

    #[test]
    fn non_finite_light_contributes_nothing() {
        let light = |x: f32| Light::Point {
            position: Vec3::splat(x),
            intensity: Vec3::ONE,
            range: f32::INFINITY,
        };
        assert_eq!(
            FrameLight::expand(&light(f32::NAN), 1),
            vec![FrameLight::default()]
        );
        assert_eq!(
            FrameLight::expand(&light(1.0), 1)[0].kind,
            FrameLight::POINT
        );
        assert_eq!(
            FrameLight::expand(
                &Light::Sky {
                    radiance: Vec3::ONE.into()
                },
                9
            ),
            vec![]
        );
    }

    #[test]
    fn projection_depends_on_geometry_only() {
        let light = FrameLight {
            kind: FrameLight::POINT,
            ..FrameLight::default()
        };
        let mut other = light;
        other.color = [1.0, 2.0, 3.0];
        assert!(light.has_same_geometry(&other));
        other.position[1] = 0.5;
        assert!(!light.has_same_geometry(&other));
    }

    #[test]
    fn scaled_light_keeps_irradiance() {
        // A root scaled by two: the local light has half the distance and a quarter of the
        // intensity.
        let root = Mat4::from_scale_rotation_translation(
            Vec3::splat(2.0),
            Quat::from_rotation_y(1.0),
            Vec3::new(1.0, 2.0, 3.0),
        );
        let light = FrameLight {
            position: [5.0, 1.0, 0.0],
            kind: FrameLight::POINT,
            color: [8.0; 3],
            inverse_square_range: 0.25,
            ..FrameLight::default()
        };
        let local = light.to_local(&root.inverse());
        assert!((local.color[0] - 2.0).abs() < 1e-5);
        assert!((local.inverse_square_range - 1.0).abs() < 1e-5);
        let back = root.transform_point3(local.position.into());
        assert!((back - Vec3::new(5.0, 1.0, 0.0)).length() < 1e-5);
    }
}
