//! Helpers for recording that all kernels share: bind groups and compute passes.

use super::Pass;
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
    /// Creates a bind group for a pass.
    pub fn bind(
        &self,
        pass: Pass,
        resources: &[(u32, wgpu::BindingResource<'_>)],
    ) -> wgpu::BindGroup {
        let entries: Vec<_> = resources
            .iter()
            .map(|(at, r)| entry(*at, r.clone()))
            .collect();
        self.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(pass.entry().1.name),
            layout: &self.pass(pass).layout,
            entries: &entries,
        })
    }
}
