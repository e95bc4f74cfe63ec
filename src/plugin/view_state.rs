//! State of a view on the device.

use super::effect_states::EffectStates;
use crate::gpu::{GpuError, ViewBuffers};
use crate::plan::{FrameStage, SceneId, ViewId};
use bevy::log::warn;
use std::collections::{BTreeMap, BTreeSet};

/// Buffers and textures of a view: the irradiance of its pixels (two textures for several layers),
/// parameters, and the states of its effects.
pub(crate) struct ViewRuntime {
    pub(super) size: [u32; 2],
    pub(super) irradiance: [Option<wgpu::TextureView>; 2],
    pub(super) buffers: BTreeMap<SceneId, ViewBuffers>,
    pub(super) states: EffectStates,
    /// Stages whose buffers the device cannot hold at this size.
    pub(super) refused: BTreeSet<FrameStage>,
}

impl ViewRuntime {
    /// Finds the state of a view, and creates a new one if its size changed.
    pub fn of_size(views: &mut BTreeMap<ViewId, Self>, id: ViewId, size: [u32; 2]) -> &mut Self {
        let view = views.entry(id).or_insert_with(|| Self::new(size));
        if view.size != size {
            *view = Self::new(size);
        }
        view
    }

    fn new(size: [u32; 2]) -> Self {
        Self {
            size,
            irradiance: [None, None],
            buffers: BTreeMap::new(),
            states: EffectStates::default(),
            refused: BTreeSet::new(),
        }
    }

    /// Excludes a stage from later frames of this size, and warns. `effect` states what the view
    /// does without it.
    pub fn refuse(&mut self, stage: FrameStage, effect: &str, error: &GpuError) {
        if self.refused.insert(stage) {
            warn!("a view {effect}: {error}");
        }
    }

    /// Number of buffers.
    pub fn buffer_count(&self) -> u32 {
        let own: u32 = self.buffers.values().map(ViewBuffers::count).sum();
        own + self.states.size().0
    }

    /// Bytes of parameters and textures.
    pub fn bytes(&self) -> u64 {
        let textures = self.irradiance.iter().flatten().count() as u64
            * u64::from(self.size[0])
            * u64::from(self.size[1])
            * 8;
        let parameters: u64 = self.buffers.values().map(ViewBuffers::bytes).sum();
        textures + parameters + self.states.size().1
    }

    pub(super) fn irradiance(&mut self, index: usize, device: &wgpu::Device) -> wgpu::TextureView {
        let size = self.size;
        self.irradiance[index]
            .get_or_insert_with(|| screen_texture(device, "meshless_gi irradiance", size))
            .clone()
    }
}

/// Creates a texture of half floats of a view's size, for a kernel to write.
pub(crate) fn screen_texture(
    device: &wgpu::Device,
    label: &'static str,
    [width, height]: [u32; 2],
) -> wgpu::TextureView {
    device
        .create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba16Float,
            usage: wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        })
        .create_view(&wgpu::TextureViewDescriptor::default())
}
