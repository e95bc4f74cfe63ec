//! Light sources of the frame: meters, W/sr, W/m², linear RGB.

use super::SkyRadiance;
use glam::Vec3;

/// Light source. Units follow glTF and Bevy: E = I cos θ / d² at a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Light {
    /// Point light that emits uniformly in all directions.
    Point {
        /// Position, meters.
        position: Vec3,
        /// Radiant intensity, W/sr.
        intensity: Vec3,
        /// Distance in meters at which the smooth window (1 − (d/range)⁴…) ends, as in Bevy's
        /// shader. Infinite for no limit.
        range: f32,
    },
    /// Spot light. Falloff: clamp((cos t − cos outer)/(cos inner − cos outer), 0, 1)².
    Spot {
        /// Position, meters.
        position: Vec3,
        /// Unit direction of emission.
        direction: Vec3,
        /// Radiant intensity on the axis, W/sr.
        intensity: Vec3,
        /// Half angle of the cone of full intensity, radians.
        inner: f32,
        /// Half angle at which the intensity reaches zero, radians.
        outer: f32,
        /// Same as the range of a point light.
        range: f32,
    },
    /// Directional light at infinite distance.
    Directional {
        /// Unit direction of emission.
        direction: Vec3,
        /// Irradiance of a surface that faces the light, W/m².
        irradiance: Vec3,
    },
    /// Rectangle that emits to the side of `u × v`.
    Rect {
        /// Center, meters.
        center: Vec3,
        /// Half edge vector, meters.
        u: Vec3,
        /// Half edge vector, meters.
        v: Vec3,
        /// Radiance, W/(m² sr).
        radiance: Vec3,
    },
    /// Radiance from every direction without a hit.
    Sky {
        /// Radiance, W/(m² sr).
        radiance: SkyRadiance,
    },
}

/// Returns the sum of the sky lights among `lights`.
#[must_use]
pub fn sum_sky_lights(lights: &[Light]) -> SkyRadiance {
    let radiances = lights.iter().filter_map(|light| match light {
        Light::Sky { radiance } => Some(*radiance),
        _ => None,
    });
    radiances.sum()
}
