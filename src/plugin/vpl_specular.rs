//! What glossy surfaces of a view show of virtual lights: the component that asks for it, and what
//! a view holds for it on the device. The kernel is [`vpl_specular`](meshless_gi::internals::frame::vpl_specular).

use super::splatting::ViewLights;
use crate::gpu::{
    GpuCounters, GpuError, KernelPipelines, NodeLights, SpecularBuffers, SubsplatTargets,
};
use bevy::ecs::prelude::*;
use bevy::math::Mat4;
use bevy::reflect::prelude::*;
use meshless_gi::SpecularSettings;
use meshless_gi::internals::frame::{VplParams, VplViewParams};

/// Specular reflections of dynamic objects' light in a camera: smooth and metallic surfaces show
/// highlights of the virtual lights of
/// [`GiReflectiveShadowMap`](super::GiReflectiveShadowMap)s. Goes next to
/// [`GiCamera`](super::GiCamera).
///
/// Each virtual light is evaluated where it changes on the screen, and interpolated elsewhere
/// (\[N09\] §3.3.1). It costs nothing if no virtual light is in view.
#[derive(Component, Reflect, Clone, Copy, Debug, Default, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
pub struct GiSpecular(pub SpecularSettings);

/// What a view holds for its gloss.
pub(crate) struct ViewSpecular {
    buffers: SpecularBuffers,
    view: wgpu::Buffer,
    lit: wgpu::Buffer,
    /// Radiance of every pixel.
    radiance: wgpu::TextureView,
    size: [u32; 2],
}

/// A view, as its gloss needs it.
pub(crate) struct SpecularView<'a> {
    pub settings: SpecularSettings,
    pub view_from_clip: Mat4,
    pub view_from_world: Mat4,
    pub viewport: [f32; 4],
    pub size: [u32; 2],
    pub depth: &'a wgpu::TextureView,
    pub gbuffer: &'a wgpu::TextureView,
}

impl ViewSpecular {
    /// Records the radiance of every pixel, with room made where there is none. Answers with what
    /// was recorded.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], see [`SpecularBuffers::new`].
    pub fn record(
        held: &mut Option<Self>,
        kernels: &KernelPipelines,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        on: &SpecularView<'_>,
        lights: &ViewLights<'_>,
    ) -> Result<GpuCounters, GpuError> {
        let (screen, wanted) =
            (on.settings).params(on.view_from_clip, on.view_from_world, on.viewport, on.size);
        let device = kernels.device();
        let levels = screen.levels();
        let gloss = match held.take() {
            Some(gloss) if gloss.buffers.levels() == levels => held.insert(gloss),
            _ => {
                let uniform = |bytes: usize| {
                    device.create_buffer(&wgpu::BufferDescriptor {
                        label: Some("meshless_gi vpl_specular of a view"),
                        size: bytes as u64,
                        usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                        mapped_at_creation: false,
                    })
                };
                held.insert(Self {
                    buffers: SpecularBuffers::new(device, queue, levels)?,
                    view: uniform(size_of::<VplViewParams>()),
                    lit: uniform(size_of::<VplParams>()),
                    radiance: super::composite::screen_texture(
                        device,
                        "meshless_gi vpl_specular",
                        on.size,
                    ),
                    size: on.size,
                })
            }
        };
        queue.write_buffer(&gloss.view, 0, bytemuck::bytes_of(&lights.view));
        queue.write_buffer(&gloss.lit, 0, bytemuck::bytes_of(&lights.lit));
        let before = gloss.buffers.counters();
        gloss.buffers.write(queue, &screen, &wanted);
        gloss.buffers.record(
            kernels,
            encoder,
            &SubsplatTargets {
                depth: on.depth,
                gbuffer: on.gbuffer,
                output: &gloss.radiance,
            },
            &NodeLights {
                maps: lights.maps,
                view: &gloss.view,
                lit: &gloss.lit,
                shadows: lights.shadows,
            },
        );
        Ok(gloss.buffers.counters().since(&before))
    }

    /// What was recorded last.
    pub fn radiance(&self) -> &wgpu::TextureView {
        &self.radiance
    }

    /// Buffers, and bytes of them and the texture.
    pub fn footprint(&self) -> (u32, u64) {
        let texture = 8 * u64::from(self.size[0]) * u64::from(self.size[1]);
        let own = self.view.size() + self.lit.size();
        (
            self.buffers.count() + 2,
            self.buffers.bytes() + own + texture,
        )
    }
}
