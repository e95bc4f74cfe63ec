//! State of the plugin in the render world: the device's buffers of scenes and views, and the plan.
//!
//! Buffers exist because a pass of a plan needs them: pipelines are created when a pass first
//! records, buffers when a scene comes into view. Pipelines go with the last scene's buffers.

use super::effect_states::EffectStates;
use super::effects::rsm::map_schedule::LightMaps;
use super::effects::volume::VolumeTarget;
use super::effects::volume::irradiance_volume::ExtractedVolume;
use super::effects::{EFFECTS, Effect};
use super::extract::{ExtractedScene, LightKey};
use super::record::{MapsContext, prepare_light_maps, release_unused};
use super::view_state::ViewRuntime;
use crate::gpu::{GpuCounters, GpuFrame, KernelPipelines};
use crate::plan::{ChangeDetector, Plan, SceneId, ViewId};
use bevy::ecs::prelude::*;
use bevy::math::Vec3;
use meshless_gi::{BakedScene, Bounds, Channels, FrameSettings};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Instance of a baked scene on the device.
pub(crate) struct SceneRuntime {
    pub bake: Arc<BakedScene>,
    /// Values that the results on the device were computed from.
    pub changes: ChangeDetector<LightKey, VolumeTarget>,
    /// Buffers of the bake. `None` before the upload.
    pub frame: Option<GpuFrame>,
    /// States of the effects.
    pub states: EffectStates,
    /// Tier of the solve that was recorded in this frame.
    pub solved_tier: Option<u32>,
    /// Frames since the scene was last in a view.
    pub idle_frames: u32,
    /// After a failed upload: bytes of the buffer that did not fit the device, and the number of
    /// light slots then.
    pub too_large: Option<(u64, usize)>,
}

impl SceneRuntime {
    /// Creates an instance without buffers.
    pub fn new(bake: Arc<BakedScene>) -> Self {
        Self {
            changes: ChangeDetector::new(&bake),
            bake,
            frame: None,
            states: EffectStates::default(),
            solved_tier: None,
            idle_frames: 0,
            too_large: None,
        }
    }

    /// The texture of this volume, if it holds light.
    pub fn volume_texture(&self, of: &ExtractedVolume) -> Option<&wgpu::TextureView> {
        let (_, texture) = self.changes.volume.as_ref()?;
        (*texture == of.texture).then_some(texture)
    }
}

/// State of the plugin in the render world.
#[derive(Resource)]
pub(crate) struct GiRender {
    /// Table of effects that plans are made with.
    pub effects: &'static [Effect],
    pub kernels: Option<KernelPipelines>,
    pub scenes: BTreeMap<SceneId, SceneRuntime>,
    pub views: BTreeMap<ViewId, ViewRuntime>,
    /// States of the effects in the post-processing of each view.
    pub post_process: BTreeMap<ViewId, EffectStates>,
    /// States of the effects that belong to no scene and no view.
    pub states: EffectStates,
    pub plan: Plan,
    /// Number of frames so far.
    pub frame: u64,
    /// Sum of all counters at the end of the last frame.
    pub counted: GpuCounters,
    /// Counters of released buffers, and of buffers that belong to no scene.
    pub retired: GpuCounters,
    /// The device lacks a requirement of the kernels.
    pub is_device_unsupported: bool,
}

impl Default for GiRender {
    fn default() -> Self {
        Self {
            effects: EFFECTS,
            kernels: None,
            scenes: BTreeMap::new(),
            views: BTreeMap::new(),
            post_process: BTreeMap::new(),
            states: EffectStates::default(),
            plan: Plan::default(),
            frame: 0,
            counted: GpuCounters::default(),
            retired: GpuCounters::default(),
            is_device_unsupported: false,
        }
    }
}

impl ExtractedScene {
    /// Settings of a solve of the scene.
    pub fn frame_settings(&self) -> FrameSettings {
        FrameSettings {
            tier: (self.tier.as_ref()).map_or(FrameSettings::ALL_TIERS, |selection| selection.tier),
            sky: self.sky,
            emission: self.emissive_luminance,
            channels: (self.channels).map_or(Channels::Three, |selection| selection.channels),
            ..FrameSettings::bounces(self.bounces.map_or(1, |selection| selection.bounces))
        }
    }
}

/// Bounds of a bake in its local space.
pub(crate) fn bounds(bake: &BakedScene) -> Bounds {
    let [min, max] = bake.info().bounds.map(Vec3::from_array);
    Bounds { min, max }
}

impl GiRender {
    /// Releases the buffers of a scene.
    pub fn release(&mut self, id: SceneId) {
        let Some(runtime) = self.scenes.get_mut(&id) else {
            return;
        };
        if let Some(frame) = runtime.frame.take() {
            self.retired.add(&frame.counters());
        }
        let states = std::mem::take(&mut runtime.states);
        self.retired.add(&states.counters());
        runtime.changes.reset();
        runtime.solved_tier = None;
    }

    /// Releases the buffers that the plan does not use, and reserves those of the maps that it
    /// draws.
    pub fn prepare(&mut self, lights: &LightMaps, device: &wgpu::Device) {
        for id in self.plan.release.clone() {
            self.release(id);
        }
        release_unused(self);
        let mut ctx = MapsContext {
            device,
            lights: &lights.0.lights,
            states: &mut self.states,
            counters: &mut self.retired,
        };
        prepare_light_maps(self.effects, &self.plan, &mut ctx);
    }
}
