//! Draws onto a view's image: irradiance, specular reflection and occluded light. The kernel
//! `composite` draws each over the whole screen.

use super::dispatch::entry;
use super::kernels::{COMPOSITE, KERNELS};
use super::pipelines::{Draw, KernelPipelines};
use super::scene_buffers::ViewBuffers;

/// Draws a texture of a view's size over its image with the blending of `how`: irradiance
/// ([`Draw::Add`], [`Draw::Replace`]), specular radiance ([`Draw::Specular`]), or radiance to
/// subtract ([`Draw::Shadow`]). `pass` has one target, of `format`. The textures are the one to
/// draw, the G-buffer and the lighting passes.
pub fn draw_over(
    kernels: &KernelPipelines,
    pass: &mut wgpu::RenderPass<'_>,
    format: wgpu::TextureFormat,
    how: Draw,
    view: &ViewBuffers,
    [irradiance, gbuffer, lighting_passes]: [&wgpu::TextureView; 3],
) {
    let kernel = kernels.render_kernel(format, how);
    let bind = kernels
        .device()
        .create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(KERNELS[COMPOSITE].name),
            layout: &kernel.layout,
            entries: &[
                entry(0, view.composite.as_entire_binding()),
                entry(1, wgpu::BindingResource::TextureView(irradiance)),
                entry(2, wgpu::BindingResource::TextureView(gbuffer)),
                entry(3, wgpu::BindingResource::TextureView(lighting_passes)),
            ],
        });
    pass.set_pipeline(&kernel.pipeline);
    pass.set_bind_group(0, &bind, &[]);
    pass.draw(0..3, 0..1);
}
