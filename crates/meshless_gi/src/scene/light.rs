//! Light sources of the frame: meters, W/sr, W/m², linear RGB.

use super::SkyRadiance;
use glam::Vec3;

/// A light source. Units follow glTF and Bevy: E = I cos θ / d² at a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Light {
    /// Shines alike in all directions.
    Point {
        /// Meters.
        position: Vec3,
        /// W/sr.
        intensity: Vec3,
        /// Meters at which the smooth window (1 − (d/range)⁴…) ends, as Bevy's shader has it;
        /// infinite for none.
        range: f32,
    },
    /// Shines in a cone. Falloff: clamp((cos t − cos outer)/(cos inner − cos outer), 0, 1)².
    Spot {
        /// Meters.
        position: Vec3,
        /// Unit, where the light goes.
        direction: Vec3,
        /// W/sr on the axis.
        intensity: Vec3,
        /// Half angle of the full cone, radians.
        inner: f32,
        /// Half angle where it ends, radians.
        outer: f32,
        /// As for a point light.
        range: f32,
    },
    /// From infinitely far.
    Directional {
        /// Unit, where the light goes.
        direction: Vec3,
        /// W/m² on a surface that faces the light.
        irradiance: Vec3,
    },
    /// A rectangle that emits to the side of `u × v`.
    Rect {
        /// Meters.
        center: Vec3,
        /// Half edge, meters.
        u: Vec3,
        /// Half edge, meters.
        v: Vec3,
        /// W/(m² sr).
        radiance: Vec3,
    },
    /// Radiance from every direction that meets nothing.
    Sky {
        /// W/(m² sr).
        radiance: SkyRadiance,
    },
}
