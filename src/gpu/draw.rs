//! What is drawn onto a view's picture: irradiance, gloss, and the light that does not get there,
//! each over the whole screen by the kernel `composite`.

use super::frame::entry;
use super::kernels::{COMPOSITE, KERNELS};
use super::pipelines::{Draw, KernelPipelines};
use super::scene_buffers::ViewBuffers;

/// Draws a view's irradiance onto its picture, as
/// [`GpuFrame::composite`](super::GpuFrame::composite) does, for views without a baked scene.
/// `textures`: irradiance, G-buffer and lighting passes.
pub fn draw_composite(
    kernels: &KernelPipelines,
    pass: &mut wgpu::RenderPass<'_>,
    format: wgpu::TextureFormat,
    replace: bool,
    view: &ViewBuffers,
    textures: [&wgpu::TextureView; 3],
) {
    let how = if replace { Draw::Replace } else { Draw::Add };
    draw(kernels, pass, format, how, view, textures);
}

/// Adds a view's gloss to its picture, in a draw of its own after that of the irradiance.
/// `textures`: what [`SpecularBuffers::record`](super::SpecularBuffers::record) wrote, G-buffer and
/// lighting passes.
pub fn draw_specular(
    kernels: &KernelPipelines,
    pass: &mut wgpu::RenderPass<'_>,
    format: wgpu::TextureFormat,
    view: &ViewBuffers,
    textures: [&wgpu::TextureView; 3],
) {
    draw(kernels, pass, format, Draw::Specular, view, textures);
}

/// Takes from a view's picture the light of lamps with soft shadows that does not get there.
/// `textures`: what [`SubtractShadowBuffers::record`](super::SubtractShadowBuffers::record) wrote, G-buffer and
/// lighting passes.
pub fn draw_shadow(
    kernels: &KernelPipelines,
    pass: &mut wgpu::RenderPass<'_>,
    format: wgpu::TextureFormat,
    view: &ViewBuffers,
    textures: [&wgpu::TextureView; 3],
) {
    draw(kernels, pass, format, Draw::Shadow, view, textures);
}

fn draw(
    kernels: &KernelPipelines,
    pass: &mut wgpu::RenderPass<'_>,
    format: wgpu::TextureFormat,
    how: Draw,
    view: &ViewBuffers,
    [irradiance, gbuffer, lighting_passes]: [&wgpu::TextureView; 3],
) {
    let kernel = kernels.drawing(format, how);
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
