//! Indirect light of a bake as displayed by a frame.

use super::BOUNCES;
use super::view_reference::ReferencePoint;
use glam::Vec3;
use meshless_gi::internals::scene::sum_sky_lights;
use meshless_gi::{BakedScene, CpuFrame, FrameLight, FrameSettings, Light, SkyRadiance};
use rayon::prelude::*;

/// Number of patches of a rectangle light.
const PATCHES: u32 = 64;

/// Indirect light of a bake after the solve of a frame.
pub struct DisplayedLight<'a> {
    scene: &'a BakedScene,
    /// Frames for lights and the sky, and for emissive surfaces. Emissive light takes one more
    /// sweep for the same number of reflections.
    frames: [CpuFrame; 2],
}

impl<'a> DisplayedLight<'a> {
    /// Solves `baked` under `lights`.
    #[must_use]
    pub fn new(baked: &'a BakedScene, lights: &[Light]) -> Self {
        let sky = sum_sky_lights(lights);
        let expanded: Vec<FrameLight> = lights
            .iter()
            .flat_map(|light| FrameLight::expand(light, PATCHES))
            .collect();
        let settings = FrameSettings {
            baked_bounces: false,
            ..FrameSettings::bounces(BOUNCES)
        };
        let solve = |lights: &[FrameLight], settings: FrameSettings| {
            let mut frame = CpuFrame::new(baked);
            frame.set_lights(baked, lights);
            frame.solve(baked, &settings);
            frame
        };
        let of_lights = FrameSettings {
            emission: 0.0,
            sky,
            ..settings
        };
        let of_emitters = FrameSettings {
            emission: 1.0,
            sky: SkyRadiance::BLACK,
            sweeps: settings.sweeps + 1,
            ..settings
        };
        Self {
            scene: baked,
            frames: [solve(&expanded, of_lights), solve(&[], of_emitters)],
        }
    }

    /// Returns the irradiance at the points, W/m². 0 at points that the bake does not cover.
    #[must_use]
    pub fn at(&self, points: &[ReferencePoint]) -> Vec<Vec3> {
        let at = |point: &ReferencePoint| -> Vec3 {
            let frames = self.frames.iter();
            let parts = frames
                .filter_map(|f| f.displayed_irradiance(self.scene, point.position, point.normal));
            parts.sum()
        };
        points.par_iter().map(at).collect()
    }
}
