//! Number of channels in which a frame applies the operator.
//! [`FrameSettings`](super::FrameSettings) stores it, and the plan selects it
//! ([`crate::plan::ColorModeSelector`]).

#[cfg(feature = "bevy_reflect")]
use bevy_reflect::std_traits::ReflectDefault;
use glam::Vec3;

/// Channels in which the operator is applied.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(
    feature = "bevy_reflect",
    derive(bevy_reflect::Reflect),
    reflect(Default, Clone, Debug, PartialEq)
)]
pub enum Channels {
    /// Red, green and blue.
    #[default]
    Three,
    /// One channel, from which the others follow. Exact if all surfaces are gray and all light has
    /// this chromaticity (linear RGB). The brightness of the color has no effect. An invalid color
    /// (black or not finite) counts as white. For light of other colors, only the channel that is
    /// largest here counts. If several are largest, green is used.
    One(Vec3),
}

impl Channels {
    /// Returns the applied channel and the ratio of each channel to it (1 for itself). Returns
    /// `None` for three channels.
    #[must_use]
    pub fn one(self) -> Option<(usize, Vec3)> {
        let Self::One(hue) = self else { return None };
        let max = hue.max_element();
        let hue = match max.is_finite() && max > 0.0 && hue.is_finite() {
            true => (hue / max).max(Vec3::ZERO),
            false => Vec3::ONE,
        };
        let channel = if hue.y == 1.0 { 1 } else { hue.max_position() };
        Some((channel, hue))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn monochrome_light_uses_largest_channel_and_invalid_color_is_white() {
        assert_eq!(Channels::Three.one(), None);
        let one = |r, g, b| Channels::One(Vec3::new(r, g, b)).one().expect("one");
        assert_eq!(one(1.0, 4.0, 2.0), (1, Vec3::new(0.25, 1.0, 0.5)));
        assert_eq!(one(0.0, 0.0, 1e-30), (2, Vec3::Z));
        for v in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            assert_eq!(one(v, v, v), (1, Vec3::ONE));
        }
        assert_eq!(one(f32::NAN, 1.0, 1.0), (1, Vec3::ONE));
        assert_eq!(one(-1.0, 2.0, 0.0), (1, Vec3::Y));
    }
}
