//! In how many channels a scene's operator is applied: one where its surfaces are gray and all that
//! shines has one chromaticity, three else. [`InventoryTracker`](super::InventoryTracker) knows
//! what there is; [`ColorModeSelector`] decides, scene by scene, so that nothing goes back and
//! forth with a light that blinks in another color.

use super::{ColorUniformity, GiColorMode};
use glam::Vec3;
use meshless_gi::Channels;
use std::fmt;

/// Frames of one color, one after another, before a scene that had several is one channel again.
pub const MONOCHROME_HYSTERESIS_FRAMES: u32 = 60;

/// What colors a scene's light has.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SceneChromaticity {
    /// Whether it is one.
    pub colors: ColorUniformity,
    /// That one, largest part 1; white where there are none or several.
    pub hue: Vec3,
}

/// A choice and its reason.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColorModeSelection {
    /// What frames take.
    pub channels: Channels,
    /// A setting says so: nothing else has a say.
    pub forced: bool,
    /// Why.
    pub why: &'static str,
}

impl ColorModeSelection {
    /// The choice in words.
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
        write!(f, "{}: {}", self.choice(), self.why)
    }
}

/// Picks, frame by frame, for one scene.
#[derive(Clone, Copy, Debug, Default)]
pub struct ColorModeSelector {
    /// One channel, with its hue, or three; none before anything shone.
    now: Option<Option<Vec3>>,
    /// Frames of one color in a row.
    steady: u32,
}

impl ColorModeSelector {
    /// Nothing seen yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// What this frame's solve takes. Three channels come with the frame that needs them, one
    /// channel only after [`MONOCHROME_HYSTERESIS_FRAMES`] frames that do with it; what shines
    /// first is taken as it is, and darkness changes nothing.
    pub fn pick(&mut self, asked: GiColorMode, found: SceneChromaticity) -> ColorModeSelection {
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
        let (channels, why) = match asked {
            GiColorMode::Rgb => (Channels::Three, "they are asked for"),
            GiColorMode::Monochrome => (Channels::One(found.hue), "it is asked for"),
            GiColorMode::Auto => match (self.now, found.colors) {
                (Some(Some(hue)), _) => (
                    Channels::One(hue),
                    "surfaces are gray and all that shines has one color",
                ),
                (_, ColorUniformity::Surfaces) => (Channels::Three, "surfaces are colored"),
                (_, ColorUniformity::Lights) => (Channels::Three, "what shines differs in color"),
                (None, _) => (Channels::Three, "nothing has shone yet"),
                (Some(None), _) if waits => {
                    (Channels::Three, "there were several colors until just now")
                }
                (Some(None), _) => (
                    Channels::Three,
                    "there were several colors before it went dark",
                ),
            },
        };
        ColorModeSelection {
            channels,
            forced: asked != GiColorMode::Auto,
            why,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WARM: Vec3 = Vec3::new(1.0, 0.8, 0.5);

    fn found(colors: ColorUniformity) -> SceneChromaticity {
        SceneChromaticity { colors, hue: WARM }
    }

    fn auto(picker: &mut ColorModeSelector, colors: ColorUniformity) -> Channels {
        let picked = picker.pick(GiColorMode::Auto, found(colors));
        assert!(!picked.forced && !picked.why.is_empty());
        picked.channels
    }

    #[test]
    fn color_mode_switches_to_rgb_at_once_and_back_after_hysteresis() {
        let mut picker = ColorModeSelector::new();
        assert_eq!(auto(&mut picker, ColorUniformity::Dark), Channels::Three);
        assert_eq!(auto(&mut picker, ColorUniformity::One), Channels::One(WARM));
        // The light blinks.
        assert_eq!(
            auto(&mut picker, ColorUniformity::Dark),
            Channels::One(WARM)
        );
        assert_eq!(auto(&mut picker, ColorUniformity::Lights), Channels::Three);
        for _ in 1..MONOCHROME_HYSTERESIS_FRAMES {
            assert_eq!(auto(&mut picker, ColorUniformity::One), Channels::Three);
        }
        assert_eq!(auto(&mut picker, ColorUniformity::One), Channels::One(WARM));
        assert_eq!(
            auto(&mut picker, ColorUniformity::Surfaces),
            Channels::Three
        );
        // Darkness is no sign of anything.
        for _ in 0..2 * MONOCHROME_HYSTERESIS_FRAMES {
            assert_eq!(auto(&mut picker, ColorUniformity::Dark), Channels::Three);
        }
        assert_eq!(auto(&mut picker, ColorUniformity::One), Channels::Three);
    }

    #[test]
    fn color_mode_of_periodically_colored_light_rarely_changes() {
        for period in [
            2,
            MONOCHROME_HYSTERESIS_FRAMES - 1,
            MONOCHROME_HYSTERESIS_FRAMES + 5,
        ] {
            let mut picker = ColorModeSelector::new();
            let (mut before, mut changes) = (Channels::Three, 0);
            for k in 0..1000 {
                let colors = if k % period == 0 {
                    ColorUniformity::Lights
                } else {
                    ColorUniformity::One
                };
                let now = auto(&mut picker, colors);
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
    fn color_mode_setting_overrides_and_is_removed_with_it() {
        let mut picker = ColorModeSelector::new();
        for colors in [
            ColorUniformity::Dark,
            ColorUniformity::One,
            ColorUniformity::Lights,
        ] {
            let three = picker.pick(GiColorMode::Rgb, found(colors));
            assert_eq!((three.channels, three.forced), (Channels::Three, true));
            let one = picker.pick(GiColorMode::Monochrome, found(colors));
            assert_eq!((one.channels, one.forced), (Channels::One(WARM), true));
            assert_eq!(one.to_string(), "one channel: it is asked for");
        }
        assert_eq!(auto(&mut picker, ColorUniformity::Lights), Channels::Three);
    }
}
