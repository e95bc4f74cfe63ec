//! Evaluation of indirect light in a camera: by subsplats (\[N09\]), which evaluate the baked basis
//! and virtual lights at a fraction of the pixels, or at every pixel.

use crate::gpu::{
    GpuCounters, GpuError, KernelPipelines, NodeLights, RsmBuffers, SceneBuffers, SubsplatBuffers,
    SubsplatTargets, ViewBuffers, VplShadows,
};
use crate::plugin::effect_states::EffectState;
use bevy::ecs::prelude::*;
use bevy::reflect::prelude::*;
use meshless_gi::SubsplatSettings;
use meshless_gi::internals::frame::subsplat::LEVELS;
use meshless_gi::internals::frame::{
    SubsplatCounts, SubsplatLevels, SubsplatParams, VplParams, VplViewParams,
};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Pixels at which a camera evaluates indirect light. Goes next to [`GiCamera`](crate::GiCamera),
/// which adds the default.
#[derive(Component, Reflect, Clone, Copy, Debug, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum GiSplatting {
    /// Evaluates a fraction of the pixels and interpolates within surfaces (\[N09\],
    /// multiresolution splatting). The default.
    Multiresolution(SubsplatSettings),
    /// Evaluates every pixel. This is the reference. It costs several times more.
    PerPixel,
}

impl Default for GiSplatting {
    fn default() -> Self {
        Self::Multiresolution(SubsplatSettings::default())
    }
}

/// Virtual lights of the frame for a view.
pub(crate) struct ViewLights<'a> {
    pub maps: &'a RsmBuffers,
    pub view: VplViewParams,
    pub lit: VplParams,
    pub shadows: Option<VplShadows<'a>>,
}

/// Inputs of a view's subsplats.
pub(crate) struct SubsplatView<'a> {
    pub params: &'a SubsplatParams,
    pub targets: &'a SubsplatTargets<'a>,
    pub scenes: &'a [(&'a SceneBuffers, &'a ViewBuffers)],
    /// Virtual lights of the frame, if it has any.
    pub lights: Option<&'a ViewLights<'a>>,
}

/// GPU resources of a view's subsplats.
pub(crate) struct ViewSubsplats {
    buffers: SubsplatBuffers,
    /// Parameters of virtual lights: of the view, and of the lights. `None` without virtual lights.
    lights: Option<[wgpu::Buffer; 2]>,
    counted: CountReadback,
}

impl ViewSubsplats {
    /// Returns `before` if it has the right size, and creates new buffers otherwise.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], see [`SubsplatBuffers::new`].
    pub fn fit(
        before: Option<Self>,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        levels: SubsplatLevels,
    ) -> Result<Self, GpuError> {
        match before {
            Some(before) if before.buffers.levels() == levels => Ok(before),
            _ => Ok(Self {
                buffers: SubsplatBuffers::new(device, queue, levels)?,
                lights: None,
                counted: CountReadback::new(device, levels),
            }),
        }
    }

    /// Counts of subsplats of a recent frame.
    pub fn counts(&self) -> Option<SubsplatCounts> {
        self.counted.latest_counts()
    }

    /// Records the view and returns the counters of the recorded work.
    pub fn record(
        &mut self,
        kernels: &KernelPipelines,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        view: &SubsplatView<'_>,
    ) -> GpuCounters {
        let SubsplatView {
            params,
            targets,
            scenes,
            lights,
        } = *view;
        let before = self.buffers.counters();
        self.buffers.write(queue, params);
        if lights.is_none() {
            self.lights = None;
        }
        let lit = lights.map(|lights| {
            let uniforms = self.lights.get_or_insert_with(|| {
                [size_of::<VplViewParams>(), size_of::<VplParams>()].map(|bytes| {
                    kernels.device().create_buffer(&wgpu::BufferDescriptor {
                        label: Some("virtual lights of a view"),
                        size: bytes as u64,
                        usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                        mapped_at_creation: false,
                    })
                })
            });
            queue.write_buffer(&uniforms[0], 0, bytemuck::bytes_of(&lights.view));
            queue.write_buffer(&uniforms[1], 0, bytemuck::bytes_of(&lights.lit));
            NodeLights {
                maps: lights.maps,
                view: &uniforms[0],
                lit: &uniforms[1],
                shadows: lights.shadows,
            }
        });
        self.buffers
            .record(kernels, encoder, targets, scenes, lit.as_ref());
        self.counted.copy(encoder, &self.buffers);
        self.buffers.counters().difference_from(&before)
    }
}

impl EffectState for ViewSubsplats {
    fn size(&self) -> (u32, u64) {
        let lights = self.lights.iter().flatten();
        let own = lights.chain([&self.counted.staging]);
        let (count, bytes) = own.fold((0, 0), |(n, b), buffer| (n + 1, b + buffer.size()));
        (self.buffers.count() + count, self.buffers.bytes() + bytes)
    }

    /// Maps the counts.
    fn finish_frame(&mut self) {
        self.counted.fetch();
    }
}

/// Bytes of a level's count in the readback.
const COUNT: u64 = 32;

/// Asynchronous readback of subsplat counts, one copy at a time.
struct CountReadback {
    staging: wgpu::Buffer,
    levels: SubsplatLevels,
    busy: Arc<AtomicBool>,
    recorded: bool,
    latest: Arc<Mutex<Option<SubsplatCounts>>>,
}

impl CountReadback {
    fn new(device: &wgpu::Device, levels: SubsplatLevels) -> Self {
        Self {
            staging: device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("subsplat counts"),
                size: COUNT * u64::from(levels.coarsest_level + 1),
                usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
                mapped_at_creation: false,
            }),
            levels,
            busy: Arc::default(),
            recorded: false,
            latest: Arc::default(),
        }
    }

    fn latest_counts(&self) -> Option<SubsplatCounts> {
        *self.latest.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn copy(&mut self, encoder: &mut wgpu::CommandEncoder, of: &SubsplatBuffers) {
        if self.busy.swap(true, Ordering::AcqRel) {
            return;
        }
        for k in 0..=self.levels.coarsest_level {
            let at = COUNT * u64::from(k);
            encoder.copy_buffer_to_buffer(of.count_of(k), 0, &self.staging, at, COUNT);
        }
        self.recorded = true;
    }

    fn fetch(&mut self) {
        if !std::mem::take(&mut self.recorded) {
            return;
        }
        let (staging, busy, latest) =
            (self.staging.clone(), self.busy.clone(), self.latest.clone());
        let levels = self.levels;
        self.staging
            .map_async(wgpu::MapMode::Read, .., move |mapped| {
                if mapped.is_ok() {
                    let words: Vec<u32> = {
                        let bytes = staging.get_mapped_range(..);
                        bytemuck::pod_collect_to_vec(&bytes)
                    };
                    staging.unmap();
                    let counts = counts(&levels, &words);
                    *latest.lock().unwrap_or_else(PoisonError::into_inner) = Some(counts);
                }
                busy.store(false, Ordering::Release);
            });
    }
}

/// Number of evaluations from the counts of all levels. Each divided cell lists one child that uses
/// the cell's own node.
fn counts(levels: &SubsplatLevels, words: &[u32]) -> SubsplatCounts {
    let mut evaluated = [0; LEVELS];
    for (k, count) in words.chunks_exact(COUNT as usize / 4).enumerate() {
        let (items, divided) = (count[3].min(levels.cells(k as u32)), count[4]);
        evaluated[k] = items - divided.min(items);
    }
    SubsplatCounts {
        evaluated,
        pixels: levels.size[0] * levels.size[1],
    }
}
