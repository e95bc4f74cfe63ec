//! Fog that is lit by a level, on the device: parameters of what a view draws, and the draw of kernel `fog`. A view without such fog has none.

use super::frame::entry;
use super::kernels::{FOG, KERNELS};
use super::pipelines::{Draw, Kernels};
use super::scene_buffers::uniform;
use crate::frame::FogParams;

/// Parameters of the draws of one view, one for each fog volume before each level.
#[derive(Debug, Default)]
pub struct FogBuffers(Vec<wgpu::Buffer>);

impl FogBuffers {
    /// Room for what these say, no more and no less, with that in it.
    pub fn write(&mut self, device: &wgpu::Device, queue: &wgpu::Queue, all: &[FogParams]) {
        let size = size_of::<FogParams>() as u64;
        self.0
            .resize_with(all.len(), || uniform(device, "fog", size));
        for (buffer, params) in self.0.iter().zip(all) {
            queue.write_buffer(buffer, 0, bytemuck::bytes_of(params));
        }
    }

    /// How many buffers these are.
    #[must_use]
    pub fn count(&self) -> u32 {
        self.0.len() as u32
    }

    /// Their bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.0.iter().map(wgpu::Buffer::size).sum()
    }
}

/// What a draw of fog reads.
#[derive(Clone, Copy, Debug)]
pub struct FogTextures<'a> {
    /// The view's depth, reversed (0 is infinitely far), of the size of its target.
    pub depth: &'a wgpu::TextureView,
    /// It has several samples a pixel.
    pub sampled: bool,
    /// What kernel `volume` wrote.
    pub voxels: &'a wgpu::TextureView,
    /// Reads between its texels, and not across its edges.
    pub voxels_sampler: &'a wgpu::Sampler,
    /// The density, and what reads it: in three dimensions, of one texel where no texture says it.
    pub density: (&'a wgpu::TextureView, &'a wgpu::Sampler),
}

/// Adds the light of the draw `which` of a view to its picture, a target of `format` with one sample a pixel.
///
/// # Panics
/// Where `which` was not written.
pub fn draw_fog(
    kernels: &Kernels,
    pass: &mut wgpu::RenderPass<'_>,
    format: wgpu::TextureFormat,
    buffers: &FogBuffers,
    which: usize,
    textures: &FogTextures<'_>,
) {
    let (how, depth) = match textures.sampled {
        false => (Draw::Fog, 1),
        true => (Draw::FogSampled, 2),
    };
    let kernel = kernels.drawing(format, how);
    let bind = (kernels.device()).create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some(KERNELS[FOG].name),
        layout: &kernel.layout,
        entries: &[
            entry(0, buffers.0[which].as_entire_binding()),
            entry(depth, wgpu::BindingResource::TextureView(textures.depth)),
            entry(3, wgpu::BindingResource::TextureView(textures.voxels)),
            entry(4, wgpu::BindingResource::Sampler(textures.voxels_sampler)),
            entry(5, wgpu::BindingResource::TextureView(textures.density.0)),
            entry(6, wgpu::BindingResource::Sampler(textures.density.1)),
        ],
    });
    pass.set_pipeline(&kernel.pipeline);
    pass.set_bind_group(0, &bind, &[]);
    pass.draw(0..3, 0..1);
}
