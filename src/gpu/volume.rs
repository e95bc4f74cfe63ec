//! Light in free space for what is drawn forward, on the device: the recording of kernel `volume` over a texture that an engine reads. A scene whose volume nobody asks for has neither
//! parameters nor a texture.

use super::frame::compute;
use super::pipelines::Kernels;
use super::scene_buffers::uniform;
use super::{GpuFrame, Pass};
use crate::frame::VolumeParams;

/// What a volume of a scene needs on the device beside its texture.
#[derive(Debug)]
pub struct VolumeBuffers {
    params: wgpu::Buffer,
}

impl VolumeBuffers {
    /// For one volume.
    #[must_use]
    pub fn new(device: &wgpu::Device) -> Self {
        let size = size_of::<VolumeParams>() as u64;
        Self {
            params: uniform(device, "volume", size),
        }
    }

    /// Bytes on the device, without the texture.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.params.size()
    }
}

impl GpuFrame {
    /// Writes every texel of `voxels`, a view of an `Rgba16Float` texture in three dimensions of [`VolumeParams::texels`] that may be stored to, from the probes' values as the last
    /// [`solve`](Self::solve) left them. Nothing for a scene without probes.
    pub fn volume(
        &mut self,
        kernels: &Kernels,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        buffers: &VolumeBuffers,
        params: &VolumeParams,
        voxels: &wgpu::TextureView,
    ) {
        let Some(probes) = &self.buffers().probes else {
            return;
        };
        queue.write_buffer(&buffers.params, 0, bytemuck::bytes_of(params));
        let bind = kernels.bind(
            Pass::Volume,
            &[
                (0, buffers.params.as_entire_binding()),
                (1, probes.points.as_entire_binding()),
                (2, probes.planes.as_entire_binding()),
                (3, probes.grid_slots.as_entire_binding()),
                (4, probes.grid_entries.as_entire_binding()),
                (5, probes.values.as_entire_binding()),
                (6, wgpu::BindingResource::TextureView(voxels)),
            ],
        );
        let mut pass = compute(encoder, "meshless_gi volume");
        pass.set_pipeline(&kernels.pass(Pass::Volume).pipeline);
        pass.set_bind_group(0, &bind, &[]);
        let [x, y, z] = params.texels().to_array().map(|n| n.div_ceil(4));
        pass.dispatch_workgroups(x, y, z);
        drop(pass);
        self.count(Pass::Volume);
    }
}
