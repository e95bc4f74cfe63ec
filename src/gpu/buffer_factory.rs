//! Creation of buffers within the limits of a device.

use super::GpuError;
use bytemuck::Pod;

/// Creates storage buffers that fit a binding of the device.
pub(super) struct BufferFactory<'a> {
    pub device: &'a wgpu::Device,
    pub queue: &'a wgpu::Queue,
    pub limit: u64,
}

impl<'a> BufferFactory<'a> {
    pub fn new(device: &'a wgpu::Device, queue: &'a wgpu::Queue) -> Self {
        Self {
            device,
            queue,
            limit: binding_limit(device),
        }
    }

    /// Creates a storage buffer with `data`. It is never empty.
    pub fn upload<T: Pod>(&self, what: &'static str, data: &[T]) -> Result<wgpu::Buffer, GpuError> {
        let buffer = self.empty::<T>(what, data.len() as u64)?;
        if !data.is_empty() {
            self.queue
                .write_buffer(&buffer, 0, bytemuck::cast_slice(data));
        }
        Ok(buffer)
    }

    /// Creates a storage buffer of zeros for `count` elements, at least one.
    pub fn empty<T>(&self, what: &'static str, count: u64) -> Result<wgpu::Buffer, GpuError> {
        let bytes = (size_of::<T>() as u64).saturating_mul(count.max(1));
        if bytes > self.limit {
            return Err(GpuError::TooLarge {
                what,
                bytes,
                limit: self.limit,
            });
        }
        Ok(self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(what),
            size: bytes,
            usage: wgpu::BufferUsages::STORAGE
                | wgpu::BufferUsages::COPY_DST
                | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        }))
    }
}

/// Returns the maximum size of a storage binding in bytes.
pub(super) fn binding_limit(device: &wgpu::Device) -> u64 {
    let limits = device.limits();
    limits
        .max_storage_buffer_binding_size
        .min(limits.max_buffer_size)
}

pub(super) fn uniform(device: &wgpu::Device, label: &str, size: u64) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size,
        usage: wgpu::BufferUsages::UNIFORM
            | wgpu::BufferUsages::COPY_DST
            | wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    })
}
