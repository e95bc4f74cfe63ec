//! Number of channels in which a scene's operator is applied. One channel suffices if the surfaces
//! are gray and all light has one chromaticity. All other scenes take three.
//! [`InventoryTracker`](super::InventoryTracker) collects the colors. [`ColorModeSelector`] decides
//! per scene, with hysteresis against lights that blink in another color.

use super::{ColorUniformity, GiColorMode};
use glam::Vec3;
use meshless_gi::Channels;
use std::fmt;

/// Number of consecutive frames of one color before a scene that had several returns to one
/// channel.
pub const MONOCHROME_HYSTERESIS_FRAMES: u32 = 60;

/// Colors of a scene's light.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SceneChromaticity {
    /// Uniformity of the colors.
    pub colors: ColorUniformity,
    /// Common color, largest part 1. White if there is none or if there are several.
    pub hue: Vec3,
}

/// A choice and its reason.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColorModeSelection {
    /// Channels of the frame.
    pub channels: Channels,
    /// `true` if a setting fixes the channels.
    pub forced: bool,
    /// Reason of the choice.
    pub reason: &'static str,
}

impl ColorModeSelection {
    /// Returns the choice in words.
    #[must_use]
    pub fn choice(&self) -> &'static str {
        match self.channels {
            Channels::Three => "three channels",
            Channels::One(_) => "one channel",
        }
    }
}

impl fmt::Display for ColorModeSelection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.choice(), self.reason)
    }
}

/// Selects the channels of one scene, frame by frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct ColorModeSelector {
    /// One channel with its hue, or three. `None` before any light shone.
    now: Option<Option<Vec3>>,
    /// Number of consecutive frames of one color.
    steady: u32,
}

impl ColorModeSelector {
    /// Creates a selector without history.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Returns the channels of this frame's solve. Three channels start with the frame that needs
    /// them. One channel starts after [`MONOCHROME_HYSTERESIS_FRAMES`] frames that need no more.
    /// The first light is taken as it is, and darkness changes nothing.
    pub fn select(
        &mut self,
        requested: GiColorMode,
        found: SceneChromaticity,
    ) -> ColorModeSelection {
        let waits = match found.colors {
            ColorUniformity::Dark => false,
            ColorUniformity::One => {
                self.steady = self.steady.saturating_add(1);
                let wait = self.now == Some(None) && self.steady < MONOCHROME_HYSTERESIS_FRAMES;
                self.now = Some((!wait).then_some(found.hue));
                wait
            }
            ColorUniformity::Surfaces | ColorUniformity::Lights => {
                (self.now, self.steady) = (Some(None), 0);
                false
            }
        };
        let (channels, reason) = match requested {
            GiColorMode::Rgb => (Channels::Three, "requested"),
            GiColorMode::Monochrome => (Channels::One(found.hue), "requested"),
            GiColorMode::Auto => match (self.now, found.colors) {
                (Some(Some(hue)), _) => (
                    Channels::One(hue),
                    "surfaces are gray and all light has one color",
                ),
                (_, ColorUniformity::Surfaces) => (Channels::Three, "surfaces are colored"),
                (_, ColorUniformity::Lights) => (Channels::Three, "lights differ in color"),
                (None, _) => (Channels::Three, "no light was on yet"),
                (Some(None), _) if waits => {
                    (Channels::Three, "lights differed in color until recently")
                }
                (Some(None), _) => (
                    Channels::Three,
                    "lights differed in color before all were off",
                ),
            },
        };
        ColorModeSelection {
            channels,
            forced: requested != GiColorMode::Auto,
            reason,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WARM: Vec3 = Vec3::new(1.0, 0.8, 0.5);

    fn chromaticity_of(colors: ColorUniformity) -> SceneChromaticity {
        SceneChromaticity { colors, hue: WARM }
    }

    fn auto(selector: &mut ColorModeSelector, colors: ColorUniformity) -> Channels {
        let selection = selector.select(GiColorMode::Auto, chromaticity_of(colors));
        assert!(!selection.forced && !selection.reason.is_empty());
        selection.channels
    }

    #[test]
    fn color_mode_switches_to_rgb_immediately_and_back_after_hysteresis() {
        let mut selector = ColorModeSelector::new();
        assert_eq!(auto(&mut selector, ColorUniformity::Dark), Channels::Three);
        assert_eq!(
            auto(&mut selector, ColorUniformity::One),
            Channels::One(WARM)
        );
        // The light blinks.
        assert_eq!(
            auto(&mut selector, ColorUniformity::Dark),
            Channels::One(WARM)
        );
        assert_eq!(
            auto(&mut selector, ColorUniformity::Lights),
            Channels::Three
        );
        for _ in 1..MONOCHROME_HYSTERESIS_FRAMES {
            assert_eq!(auto(&mut selector, ColorUniformity::One), Channels::Three);
        }
        assert_eq!(
            auto(&mut selector, ColorUniformity::One),
            Channels::One(WARM)
        );
        assert_eq!(
            auto(&mut selector, ColorUniformity::Surfaces),
            Channels::Three
        );
        // Darkness does not count as a color.
        for _ in 0..2 * MONOCHROME_HYSTERESIS_FRAMES {
            assert_eq!(auto(&mut selector, ColorUniformity::Dark), Channels::Three);
        }
        assert_eq!(auto(&mut selector, ColorUniformity::One), Channels::Three);
    }

    #[test]
    fn color_mode_of_periodically_colored_light_rarely_changes() {
        for period in [
            2,
            MONOCHROME_HYSTERESIS_FRAMES - 1,
            MONOCHROME_HYSTERESIS_FRAMES + 5,
        ] {
            let mut selector = ColorModeSelector::new();
            let (mut before, mut changes) = (Channels::Three, 0);
            for k in 0..1000 {
                let colors = if k % period == 0 {
                    ColorUniformity::Lights
                } else {
                    ColorUniformity::One
                };
                let now = auto(&mut selector, colors);
                // Never one channel where there are several colors.
                assert!(colors == ColorUniformity::One || now == Channels::Three);
                changes += u32::from(now != before);
                before = now;
            }
            assert!(
                changes <= 2 * 1000 / MONOCHROME_HYSTERESIS_FRAMES,
                "{period}: {changes}"
            );
            assert_eq!(changes == 0, period < MONOCHROME_HYSTERESIS_FRAMES);
        }
    }

    #[test]
    fn color_mode_setting_overrides_until_removed() {
        let mut selector = ColorModeSelector::new();
        for colors in [
            ColorUniformity::Dark,
            ColorUniformity::One,
            ColorUniformity::Lights,
        ] {
            let three = selector.select(GiColorMode::Rgb, chromaticity_of(colors));
            assert_eq!((three.channels, three.forced), (Channels::Three, true));
            let one = selector.select(GiColorMode::Monochrome, chromaticity_of(colors));
            assert_eq!((one.channels, one.forced), (Channels::One(WARM), true));
            assert_eq!(one.to_string(), "one channel: requested");
        }
        assert_eq!(
            auto(&mut selector, ColorUniformity::Lights),
            Channels::Three
        );
    }
}
