//! Probe light for forward rendering, on the GPU: the recording of kernel `volume` over a texture
//! that an engine reads. A scene without a visible volume has no parameters, weights or texture.

use super::buffer_factory::{BufferFactory, uniform};
use super::dispatch::compute;
use super::pipelines::KernelPipelines;
use super::{EntryPoint, GpuError, GpuFrame};
use meshless_gi::internals::frame::volume_weights::{VoxelGrid, VoxelWeights};
use meshless_gi::internals::frame::{VolumeParams, WallSample};

/// GPU data of a scene's volume without its texture. Each voxel has weights of its probes, weights
/// of its walls, and distances to the nearest walls.
#[derive(Debug)]
pub struct VolumeBuffers {
    shape: VoxelGrid,
    params: wgpu::Buffer,
    starts: wgpu::Buffer,
    weights: wgpu::Buffer,
    wall_starts: wgpu::Buffer,
    wall_samples: wgpu::Buffer,
    wall_weights: wgpu::Buffer,
    wall_distances: wgpu::Buffer,
}

impl VolumeBuffers {
    /// Creates the buffers of one volume with complete weights.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] if the weights do not fit a binding. Within WebGPU's default limits
    /// they always fit.
    ///
    /// # Panics
    /// Panics if the weights of the voxels are incomplete.
    pub fn new(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        weights: &VoxelWeights,
    ) -> Result<Self, GpuError> {
        assert!(
            weights.is_whole(),
            "the voxel weights of the volume are incomplete"
        );
        let make = BufferFactory::new(device, queue);
        let found = weights.wall_samples();
        let wall_starts: Vec<u32> = [0].into_iter().chain(found.ends.iter().copied()).collect();
        // An additional element marks the end of the last wall sample's weights.
        let mut wall_samples = found.wall_samples.clone();
        wall_samples.push(WallSample {
            start: found.weights.len() as u32,
            ..WallSample::default()
        });
        Ok(Self {
            shape: *weights.shape(),
            params: uniform(device, "volume", size_of::<VolumeParams>() as u64),
            starts: make.upload("volume weight starts", weights.starts())?,
            weights: make.upload("volume weights", weights.weights())?,
            wall_starts: make.upload("volume wall sample starts", &wall_starts)?,
            wall_samples: make.upload("volume wall samples", &wall_samples)?,
            wall_weights: make.upload("volume wall weights", &found.weights)?,
            wall_distances: make.upload("volume wall distances", weights.wall_distances())?,
        })
    }

    /// Returns the grid of the volume.
    #[must_use]
    pub fn shape(&self) -> &VoxelGrid {
        &self.shape
    }

    /// Returns the number of buffers.
    #[must_use]
    pub fn count(&self) -> u32 {
        self.buffers().len() as u32
    }

    /// Returns the size of its buffers in bytes, without the texture.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.buffers().iter().map(|b| b.size()).sum()
    }

    fn buffers(&self) -> [&wgpu::Buffer; 7] {
        [
            &self.params,
            &self.starts,
            &self.weights,
            &self.wall_starts,
            &self.wall_samples,
            &self.wall_weights,
            &self.wall_distances,
        ]
    }
}

impl GpuFrame {
    /// Writes every texel of `voxels` from the values of probes and points after the last
    /// [`solve`](Self::solve). `voxels` is a view of a three-dimensional `Rgba16Float` texture of
    /// [`VoxelGrid::texels`] with storage usage. `params` have the shape of `buffers`, whose
    /// weights were computed in this scene. Does nothing for a scene without probes.
    pub fn volume(
        &mut self,
        kernels: &KernelPipelines,
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
            EntryPoint::Volume,
            &[
                (0, buffers.params.as_entire_binding()),
                (1, buffers.starts.as_entire_binding()),
                (2, buffers.weights.as_entire_binding()),
                (3, probes.values.as_entire_binding()),
                (4, buffers.wall_starts.as_entire_binding()),
                (5, buffers.wall_samples.as_entire_binding()),
                (6, buffers.wall_weights.as_entire_binding()),
                (7, self.buffers().values.as_entire_binding()),
                (8, buffers.wall_distances.as_entire_binding()),
                (9, wgpu::BindingResource::TextureView(voxels)),
            ],
        );
        let mut pass = compute(encoder, "meshless_gi volume");
        pass.set_pipeline(&kernels.compute_kernel(EntryPoint::Volume).pipeline);
        pass.set_bind_group(0, &bind, &[]);
        let [x, y, z] = buffers.shape.size().to_array().map(|n| n.div_ceil(4));
        pass.dispatch_workgroups(x, y, z);
        drop(pass);
        self.count(EntryPoint::Volume);
    }
}
