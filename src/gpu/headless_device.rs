//! Device without a window, for tests and tools. It requests WebGPU's default limits and no
//! features, so that the kernels run on all devices.

use super::GpuError;
use bytemuck::{AnyBitPattern, NoUninit};
use std::pin::pin;
use std::task::{Context, Poll, Waker};

/// Device and its queue.
#[derive(Clone, Debug)]
pub struct HeadlessDevice {
    /// GPU device.
    pub device: wgpu::Device,
    /// Queue of the device.
    pub queue: wgpu::Queue,
    /// Name and driver of the adapter.
    pub adapter: String,
}

impl HeadlessDevice {
    /// Opens the first available adapter. It may be a software adapter.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`], [`GpuError::NoDevice`].
    pub fn new() -> Result<Self, GpuError> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let adapter = wait(instance.request_adapter(&wgpu::RequestAdapterOptions::default()))
            .map_err(|e| GpuError::NoAdapter(e.to_string()))?;
        let info = adapter.get_info();
        let (device, queue) = wait(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("meshless_gi"),
            ..wgpu::DeviceDescriptor::default()
        }))
        .map_err(|e| GpuError::NoDevice(e.to_string()))?;
        Ok(Self {
            device,
            queue,
            adapter: format!("{} ({:?}, {})", info.name, info.backend, info.driver_info),
        })
    }

    /// Records with `record`, submits, and waits for completion.
    ///
    /// # Errors
    /// [`GpuError::ReadBack`] if the device was lost.
    pub fn run(&self, record: impl FnOnce(&mut wgpu::CommandEncoder)) -> Result<(), GpuError> {
        let mut encoder = self
            .device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        record(&mut encoder);
        self.queue.submit([encoder.finish()]);
        self.finish()
    }

    /// Waits for all submitted work.
    ///
    /// # Errors
    /// [`GpuError::ReadBack`] if the device was lost.
    pub fn finish(&self) -> Result<(), GpuError> {
        self.device
            .poll(wgpu::PollType::wait_indefinitely())
            .map_err(|e| GpuError::ReadBack(e.to_string()))?;
        Ok(())
    }

    /// Reads the first `count` elements of a buffer.
    ///
    /// # Errors
    /// [`GpuError::ReadBack`].
    pub fn read<T: AnyBitPattern + NoUninit>(
        &self,
        buffer: &wgpu::Buffer,
        count: usize,
    ) -> Result<Vec<T>, GpuError> {
        let bytes = (size_of::<T>() * count) as u64;
        if bytes == 0 {
            return Ok(Vec::new());
        }
        let staging = self.staging(bytes);
        self.run(|encoder| encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, bytes))?;
        self.map(&staging, |all| bytemuck::pod_collect_to_vec(all))
    }

    /// Reads all texels of a texture, layer by layer and row by row, without padding. `T` is one
    /// texel.
    ///
    /// # Errors
    /// [`GpuError::ReadBack`].
    pub fn read_texture<T: AnyBitPattern + NoUninit>(
        &self,
        texture: &wgpu::Texture,
    ) -> Result<Vec<T>, GpuError> {
        let row = size_of::<T>() * texture.width() as usize;
        let stride = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as usize);
        let rows = texture.height() as usize * texture.depth_or_array_layers() as usize;
        let staging = self.staging((stride * rows) as u64);
        self.run(|encoder| {
            encoder.copy_texture_to_buffer(
                texture.as_image_copy(),
                wgpu::TexelCopyBufferInfo {
                    buffer: &staging,
                    layout: wgpu::TexelCopyBufferLayout {
                        offset: 0,
                        bytes_per_row: Some(stride as u32),
                        rows_per_image: Some(texture.height()),
                    },
                },
                texture.size(),
            );
        })?;
        self.map(&staging, |all| {
            all.chunks_exact(stride)
                .flat_map(|line| bytemuck::pod_collect_to_vec::<u8, T>(&line[..row]))
                .collect()
        })
    }

    /// Creates a texture with these texels, row by row.
    #[must_use]
    pub fn texture<T: NoUninit>(
        &self,
        size: [u32; 2],
        format: wgpu::TextureFormat,
        usage: wgpu::TextureUsages,
        texels: Option<&[T]>,
    ) -> wgpu::Texture {
        let texture = self.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d {
                width: size[0],
                height: size[1],
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: usage | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        if let Some(texels) = texels {
            self.queue.write_texture(
                texture.as_image_copy(),
                bytemuck::cast_slice(texels),
                wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(size[0] * size_of::<T>() as u32),
                    rows_per_image: None,
                },
                texture.size(),
            );
        }
        texture
    }

    fn staging(&self, bytes: u64) -> wgpu::Buffer {
        self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("read back"),
            size: bytes,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    }

    fn map<R>(&self, staging: &wgpu::Buffer, take: impl FnOnce(&[u8]) -> R) -> Result<R, GpuError> {
        let (sender, receiver) = std::sync::mpsc::channel();
        staging
            .slice(..)
            .map_async(wgpu::MapMode::Read, move |result| {
                // The receiver is dropped only if the caller is gone.
                let _ = sender.send(result);
            });
        self.finish()?;
        let mapped = receiver
            .recv()
            .map_err(|e| GpuError::ReadBack(e.to_string()))?;
        mapped.map_err(|e| GpuError::ReadBack(e.to_string()))?;
        let out = take(&staging.slice(..).get_mapped_range());
        staging.unmap();
        Ok(out)
    }
}

/// Waits for a future that needs no other thread of this crate. Futures of a native device are
/// ready immediately.
fn wait<F: Future>(future: F) -> F::Output {
    let mut future = pin!(future);
    let mut context = Context::from_waker(Waker::noop());
    loop {
        match future.as_mut().poll(&mut context) {
            Poll::Ready(out) => return out,
            Poll::Pending => std::thread::yield_now(),
        }
    }
}
