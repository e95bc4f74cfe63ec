//! Helpers for recording that all kernels share: bind groups and compute passes.

use super::EntryPoint;
use super::pipelines::KernelPipelines;

/// Maximum number of workgroups along one dimension in WebGPU.
pub(super) const MAX_GROUPS: u32 = 65_535;

pub(super) fn compute<'e>(
    encoder: &'e mut wgpu::CommandEncoder,
    label: &str,
) -> wgpu::ComputePass<'e> {
    encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
        label: Some(label),
        timestamp_writes: None,
    })
}

pub(super) fn entry(binding: u32, resource: wgpu::BindingResource<'_>) -> wgpu::BindGroupEntry<'_> {
    wgpu::BindGroupEntry { binding, resource }
}

impl KernelPipelines {
    /// Creates a bind group of an entry point.
    pub fn bind(
        &self,
        entry_point: EntryPoint,
        resources: &[(u32, wgpu::BindingResource<'_>)],
    ) -> wgpu::BindGroup {
        let entries: Vec<_> = resources
            .iter()
            .map(|(at, r)| entry(*at, r.clone()))
            .collect();
        self.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(entry_point.entry().1.name),
            layout: &self.compute_kernel(entry_point).layout,
            entries: &entries,
        })
    }
}
