//! Detection of changes since the device last computed a result: [`ChangeDetector`] for the results
//! of a scene, [`MapChangeDetector`] for the virtual lights of all reflective shadow maps.
//!
//! A change is measured against the values on the device, and not against the last frame. A slow
//! drift adds up until it counts, and a scene that was out of view catches up. The recording of a
//! pass stores the values that it used. No other part of the plugin compares values of earlier
//! frames to decide whether a pass runs.

use super::{GiColorMode, LightId, SlotTable, light_slots};
use meshless_gi::internals::frame::SoftLight;
use meshless_gi::{BakedScene, Bounds, FrameSettings, MaterialFactors};
use std::sync::{Arc, Weak};

/// Values that the device's results of a scene were computed from. `K` identifies a light, `V`
/// describes the parameters and the texture of a volume.
#[derive(Clone, Debug)]
pub struct ChangeDetector<K, V = ()> {
    /// Bake of the scene.
    bake: Weak<BakedScene>,
    /// Light slots, as projected and applied.
    pub slots: SlotTable<K>,
    /// Settings of the last solve, and the requested color mode. `None` before the first solve.
    pub solved: Option<(FrameSettings, GiColorMode)>,
    /// Uploaded factors of the materials. Empty for those of the bake.
    pub factors: Vec<MaterialFactors>,
    /// Transmittance of the occluders. Empty if all are open.
    pub transmittances: Vec<f32>,
    /// Lights with soft shadows, as shadowed. `None` if the device holds no shadows.
    pub soft_lights: Option<Vec<SoftLight>>,
    /// Volume with the light of the last solve. `None` if there is none.
    pub volume: Option<V>,
}

impl<K: Copy + Ord, V> Default for ChangeDetector<K, V> {
    fn default() -> Self {
        Self {
            bake: Weak::new(),
            slots: SlotTable::new(),
            solved: None,
            factors: Vec::new(),
            transmittances: Vec::new(),
            soft_lights: None,
            volume: None,
        }
    }
}

impl<K: Copy + Ord, V: PartialEq> ChangeDetector<K, V> {
    /// Creates a detector for a bake that the device does not hold yet.
    #[must_use]
    pub fn new(bake: &Arc<BakedScene>) -> Self {
        Self {
            bake: Arc::downgrade(bake),
            ..Self::default()
        }
    }

    /// Clears all values but the bake, after the device released the scene.
    pub fn reset(&mut self) {
        self.slots.reset();
        self.solved = None;
        self.factors.clear();
        self.transmittances.clear();
        self.soft_lights = None;
        self.volume = None;
    }

    /// Returns `true` if the scene has another bake than at the creation of the detector.
    #[must_use]
    pub fn bake_changed(&self, bake: &Arc<BakedScene>) -> bool {
        self.bake.as_ptr() != Arc::as_ptr(bake)
    }

    /// Returns `true` if the materials' factors differ from the uploaded ones. `false` for a bake
    /// whose materials are fixed.
    #[must_use]
    pub fn materials_changed(&self, bake: &BakedScene, factors: &[MaterialFactors]) -> bool {
        let Some(dynamic) = &bake.data().materials else {
            return false;
        };
        let uploaded = match self.factors.is_empty() {
            true => &dynamic.factors,
            false => &self.factors,
        };
        *uploaded != factors
    }

    /// Number of occluders whose transmittance differs from the device's.
    #[must_use]
    pub fn changed_occluders(&self, transmittances: &[f32]) -> usize {
        let known = |k: usize| self.transmittances.get(k).copied().unwrap_or(1.0);
        let now = transmittances.iter().enumerate();
        now.filter(|&(k, &t)| t != known(k)).count()
    }

    /// Returns `true` if the shadows of `lights` differ from the device's, in a scene with these
    /// bounds. `true` if the device holds no shadows.
    #[must_use]
    pub fn soft_lights_changed(&self, lights: &[SoftLight], bounds: Bounds) -> bool {
        let tolerance = light_slots::tolerance(bounds);
        let same = |held: &Vec<SoftLight>| light_slots::same_soft_shadow(held, lights, tolerance);
        !self.soft_lights.as_ref().is_some_and(same)
    }

    /// Returns `true` if the device does not hold the light of the last solve in this volume.
    #[must_use]
    pub fn volume_changed(&self, now: &V) -> bool {
        self.volume.as_ref() != Some(now)
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

/// Number of frames without a change in which maps are still drawn. Meshes and textures reach the
/// device a few frames after they changed.
const SETTLE_FRAMES: u32 = 8;

/// Values that the virtual lights on the device were computed from. `L` describes a light with its
/// maps, `S` a baked scene that shadows reflected light.
#[derive(Clone, Debug)]
pub struct MapChangeDetector<L, S> {
    /// Lights of the last frame.
    lights: Vec<L>,
    /// Number of frames without a change of lights or objects.
    unchanged_frames: u32,
    /// Lights whose virtual lights are complete.
    complete: Vec<LightId>,
    /// Number of frames since the last change in which all maps were drawn completely.
    complete_frames: u32,
    /// Scenes that shadowed the reflected light.
    shadowers: Vec<S>,
}

impl<L, S> Default for MapChangeDetector<L, S> {
    fn default() -> Self {
        Self {
            lights: Vec::new(),
            unchanged_frames: 0,
            complete: Vec::new(),
            complete_frames: 0,
            shadowers: Vec::new(),
        }
    }
}

impl<L: Clone + PartialEq, S: PartialEq> MapChangeDetector<L, S> {
    /// Sets the lights of a frame. `objects_changed` is `true` if the content of the maps may
    /// differ from the last frame. Called once per frame.
    pub fn observe(&mut self, lights: &[L], objects_changed: bool) {
        self.unchanged_frames = match objects_changed || self.lights != lights {
            true => 0,
            false => self.unchanged_frames.saturating_add(1),
        };
        self.lights = lights.to_vec();
    }

    /// Returns `true` if the maps of `lights`, drawn now with these scenes, would give other
    /// virtual lights.
    #[must_use]
    pub fn changed(
        &self,
        lights: impl Iterator<Item = LightId>,
        shadowers: impl FnOnce() -> Vec<S>,
    ) -> bool {
        self.unchanged_frames < SETTLE_FRAMES
            || self.complete_frames < SETTLE_FRAMES
            || !lights.eq(self.complete.iter().copied())
            || self.shadowers != shadowers()
    }

    /// Starts a frame in which the maps of this number of lights are drawn.
    pub fn start_maps(&mut self, lights: usize) {
        let complete = self.unchanged_frames > 0 && self.complete.len() == lights;
        self.complete_frames = match complete {
            true => self.complete_frames.saturating_add(1),
            false => 0,
        };
        self.complete.clear();
        self.shadowers.clear();
    }

    /// Stores that all maps of a light were drawn. `complete` is `false` if a mesh may be missing.
    pub fn finish_light(&mut self, light: LightId, complete: bool, shadowers: Vec<S>) {
        if complete {
            self.complete.push(light);
        }
        self.shadowers = shadowers;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use meshless_gi::Channels;

    #[test]
    fn changed_settings_and_occluders_are_detected() {
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
        // Only forced channels count as a change.
        assert!(!changes.settings_changed(&one, GiColorMode::Auto, false));
        assert!(changes.settings_changed(&one, GiColorMode::Auto, true));
        // Unknown occluders are open.
        assert_eq!(changes.changed_occluders(&[1.0, 0.5]), 1);
        changes.transmittances = vec![1.0, 0.5];
        assert_eq!(changes.changed_occluders(&[1.0, 0.5]), 0);
        assert_eq!(changes.changed_occluders(&[0.0, 0.25]), 2);
        changes.reset();
        assert!(changes.solved.is_none() && changes.transmittances.is_empty());
    }

    #[test]
    fn changed_soft_lights_and_volumes_are_detected() {
        let bounds = Bounds {
            min: Vec3::ZERO,
            max: Vec3::ONE,
        };
        let at = |x: f32| SoftLight::sphere(Vec3::X * x, 0.1, Vec3::ONE, 10.0, 16);
        let mut changes = ChangeDetector::<u32, u32>::default();
        // Without results on the device, everything is a change, including no lights at all.
        assert!(changes.soft_lights_changed(&[], bounds) && changes.volume_changed(&3));
        (changes.soft_lights, changes.volume) = (Some(vec![at(0.5)]), Some(3));
        assert!(!changes.soft_lights_changed(&[at(0.5)], bounds));
        assert!(!changes.soft_lights_changed(&[at(0.5 + 1e-6)], bounds));
        assert!(changes.soft_lights_changed(&[at(0.51)], bounds));
        assert!(changes.soft_lights_changed(&[], bounds));
        assert!(!changes.volume_changed(&3) && changes.volume_changed(&4));
        changes.reset();
        assert!(changes.soft_lights_changed(&[at(0.5)], bounds) && changes.volume_changed(&3));
    }

    #[test]
    fn unchanged_maps_are_kept_after_complete_frames() {
        let id = LightId(5, 0);
        let mut maps = MapChangeDetector::<u32, u32>::default();
        let changed =
            |maps: &MapChangeDetector<u32, u32>| maps.changed([id].into_iter(), || vec![7]);
        let draw = |maps: &mut MapChangeDetector<u32, u32>, light, moved, complete| {
            maps.observe(&[light], moved);
            let drawn = changed(maps);
            if drawn {
                maps.start_maps(1);
                maps.finish_light(id, complete, vec![7]);
            }
            drawn
        };
        // Counts the frames until the maps rest. The change itself is in the first frame.
        let settle = |maps: &mut MapChangeDetector<u32, u32>| {
            (0..100).take_while(|_| draw(maps, 1, false, true)).count()
        };
        let first = settle(&mut maps);
        assert!((SETTLE_FRAMES as usize..20).contains(&first), "{first}");
        assert!(!draw(&mut maps, 1, false, true));
        // Another light, a moved object, an incomplete map, another scene.
        assert!(draw(&mut maps, 2, false, true) && settle(&mut maps) >= SETTLE_FRAMES as usize);
        assert!(draw(&mut maps, 1, true, true) && settle(&mut maps) >= SETTLE_FRAMES as usize);
        assert!(draw(&mut maps, 1, true, false) && settle(&mut maps) >= SETTLE_FRAMES as usize);
        assert!(maps.changed([id].into_iter(), || vec![8]));
        assert!(maps.changed([].into_iter(), || vec![7]));
    }
}
