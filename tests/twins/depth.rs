//! Creation of depth textures from numbers, for tests and measurements.

use bevy_meshless_gi::gpu::HeadlessDevice;
use wgpu::{TextureFormat, TextureUsages};

/// Creates a depth texture with these texels.
pub fn depth_texture(harness: &HeadlessDevice, size: [u32; 2], depth: &[f32]) -> wgpu::Texture {
    depth_samples(harness, size, depth, 1)
}

/// Creates a depth texture with `samples` equal samples per pixel. A draw writes them, because
/// WebGPU has no copy to a 32-bit depth texture.
pub fn depth_samples(
    harness: &HeadlessDevice,
    size: [u32; 2],
    depth: &[f32],
    samples: u32,
) -> wgpu::Texture {
    let source = harness.texture(
        size,
        TextureFormat::R32Float,
        TextureUsages::TEXTURE_BINDING,
        Some(depth),
    );
    let target = harness.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: source.size(),
        mip_level_count: 1,
        sample_count: samples,
        dimension: wgpu::TextureDimension::D2,
        format: TextureFormat::Depth32Float,
        usage: TextureUsages::TEXTURE_BINDING | TextureUsages::RENDER_ATTACHMENT,
        view_formats: &[],
    });
    let module = harness
        .device
        .create_shader_module(wgpu::ShaderModuleDescriptor {
            label: None,
            source: wgpu::ShaderSource::Wgsl(
                "@group(0) @binding(0) var depths: texture_2d<f32>;
            @vertex fn corner(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
                return vec4f(vec2f(f32((i << 1u) & 2u), f32(i & 2u)) * 2.0 - 1.0, 0.0, 1.0);
            }
            @fragment fn depth(@builtin(position) p: vec4f) -> @builtin(frag_depth) f32 {
                return textureLoad(depths, vec2u(p.xy), 0).r;
            }"
                .into(),
            ),
        });
    let pipeline = harness
        .device
        .create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: None,
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: None,
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: Some(wgpu::DepthStencilState {
                format: TextureFormat::Depth32Float,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::Always),
                stencil: wgpu::StencilState::default(),
                bias: wgpu::DepthBiasState::default(),
            }),
            multisample: wgpu::MultisampleState {
                count: samples,
                ..wgpu::MultisampleState::default()
            },
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: None,
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: &[],
            }),
            multiview_mask: None,
            cache: None,
        });
    let bind = harness
        .device
        .create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::TextureView(
                    &source.create_view(&wgpu::TextureViewDescriptor::default()),
                ),
            }],
        });
    let view = target.create_view(&wgpu::TextureViewDescriptor::default());
    harness
        .run(|encoder| {
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                    view: &view,
                    depth_ops: Some(wgpu::Operations {
                        load: wgpu::LoadOp::Clear(0.0),
                        store: wgpu::StoreOp::Store,
                    }),
                    stencil_ops: None,
                }),
                ..wgpu::RenderPassDescriptor::default()
            });
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &bind, &[]);
            pass.draw(0..3, 0..1);
        })
        .unwrap();
    target
}
