//! [`ChangeDetector`]: the changes of a scene since the device last computed it.
//!
//! A change is measured against the values on the device, and not against the last frame. A slow
//! drift adds up until it counts, and a scene that was out of view catches up.

use super::{GiColorMode, SlotTable};
use meshless_gi::{BakedScene, FrameSettings, MaterialFactors};

/// Values that the device's results of a scene were computed from. `K` identifies a light.
#[derive(Clone, Debug)]
pub struct ChangeDetector<K> {
    /// Light slots, as projected and applied.
    pub slots: SlotTable<K>,
    /// Settings of the last solve, and the requested color mode; `None` before the first solve.
    pub solved: Option<(FrameSettings, GiColorMode)>,
    /// Uploaded factors of the materials; empty for those of the bake.
    pub factors: Vec<MaterialFactors>,
    /// Transmittance of the occluders; empty for all open.
    pub gains: Vec<f32>,
}

impl<K: Copy + Ord> Default for ChangeDetector<K> {
    fn default() -> Self {
        Self {
            slots: SlotTable::new(),
            solved: None,
            factors: Vec::new(),
            gains: Vec::new(),
        }
    }
}

impl<K: Copy + Ord> ChangeDetector<K> {
    /// Forgets all values, after the device released the scene.
    pub fn forget(&mut self) {
        self.slots.forget();
        self.solved = None;
        self.factors.clear();
        self.gains.clear();
    }

    /// Returns `true` if the materials' factors differ from the uploaded ones. `false` for a bake
    /// whose materials are fixed.
    #[must_use]
    pub fn materials_changed(&self, bake: &BakedScene, factors: &[MaterialFactors]) -> bool {
        let Some(live) = &bake.materials else {
            return false;
        };
        let uploaded = match self.factors.is_empty() {
            true => &live.factors,
            false => &self.factors,
        };
        *uploaded != factors
    }

    /// Number of occluders whose transmittance differs from the device's.
    #[must_use]
    pub fn changed_occluders(&self, gains: &[f32]) -> usize {
        let known = |k: usize| self.gains.get(k).copied().unwrap_or(1.0);
        let now = gains.iter().enumerate();
        now.filter(|&(k, &gain)| gain != known(k)).count()
    }

    /// Returns `true` if a solve with `now` gives other values than the last one. Channels count
    /// only if a setting forces them: those that the plan selects give the same values.
    #[must_use]
    pub fn settings_changed(&self, now: &FrameSettings, mode: GiColorMode, forced: bool) -> bool {
        let Some((solved, solved_mode)) = self.solved else {
            return true;
        };
        let solved = match forced {
            true => solved,
            false => FrameSettings {
                channels: now.channels,
                ..solved
            },
        };
        solved != *now || solved_mode != mode
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use meshless_gi::Channels;

    #[test]
    fn changes_are_measured_against_the_device() {
        let mut changes = ChangeDetector::<u32>::default();
        let now = FrameSettings::default();
        assert!(changes.settings_changed(&now, GiColorMode::Auto, false));
        changes.solved = Some((now, GiColorMode::Auto));
        assert!(!changes.settings_changed(&now, GiColorMode::Auto, false));
        assert!(changes.settings_changed(&now, GiColorMode::Rgb, false));
        let one = FrameSettings {
            channels: Channels::One(Vec3::ONE),
            ..now
        };
        // Selected channels are no change, forced ones are.
        assert!(!changes.settings_changed(&one, GiColorMode::Auto, false));
        assert!(changes.settings_changed(&one, GiColorMode::Auto, true));
        // Unknown occluders are open.
        assert_eq!(changes.changed_occluders(&[1.0, 0.5]), 1);
        changes.gains = vec![1.0, 0.5];
        assert_eq!(changes.changed_occluders(&[1.0, 0.5]), 0);
        assert_eq!(changes.changed_occluders(&[0.0, 0.25]), 2);
        changes.forget();
        assert!(changes.solved.is_none() && changes.gains.is_empty());
    }
}
