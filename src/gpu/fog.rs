//! Fog lit by a scene, on the GPU: parameters of a view's draws, and the recording of the kernels
//! `fog_inscatter` and `fog`. A view without such fog has no buffers.

use super::buffer_factory::uniform;
use super::dispatch::{compute, entry};
use super::kernels::{FOG, KERNELS};
use super::pipelines::{Draw, KernelPipelines};
use super::{EntryPoint, GpuCounters};
use meshless_gi::internals::frame::{FogInscatterParams, FogParams};

/// Light of a scene that fog of one asymmetry scatters to the eye.
#[derive(Debug)]
struct FogLight {
    params: wgpu::Buffer,
    size: [u32; 3],
    texture: wgpu::TextureView,
}

impl FogLight {
    fn new(device: &wgpu::Device, size: [u32; 3]) -> Self {
        let [width, height, depth_or_array_layers] = size;
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("light in fog"),
            size: wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D3,
            format: wgpu::TextureFormat::Rgba16Float,
            usage: wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        });
        Self {
            params: uniform(
                device,
                "light in fog",
                size_of::<FogInscatterParams>() as u64,
            ),
            size,
            texture: texture.create_view(&wgpu::TextureViewDescriptor::default()),
        }
    }
}

/// GPU data of one view: the light of each scene for fog of each asymmetry, and parameters of the
/// draws. Each fog volume is drawn once per scene behind it.
#[derive(Debug, Default)]
pub struct FogBuffers {
    lights: Vec<FogLight>,
    draws: Vec<wgpu::Buffer>,
}

impl FogBuffers {
    /// Writes these parameters into buffers of exactly the required size.
    pub fn write(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        lights: &[FogInscatterParams],
        draws: &[FogParams],
    ) {
        self.lights.truncate(lights.len());
        for (k, params) in lights.iter().enumerate() {
            match self.lights.get_mut(k) {
                Some(light) if light.size == params.size => {}
                Some(light) => *light = FogLight::new(device, params.size),
                None => self.lights.push(FogLight::new(device, params.size)),
            }
            queue.write_buffer(&self.lights[k].params, 0, bytemuck::bytes_of(params));
        }
        let size = size_of::<FogParams>() as u64;
        self.draws
            .resize_with(draws.len(), || uniform(device, "fog", size));
        for (buffer, params) in self.draws.iter().zip(draws) {
            queue.write_buffer(buffer, 0, bytemuck::bytes_of(params));
        }
    }

    /// Records kernel `fog_inscatter` for each of the lights. It reads the volumes of their scenes,
    /// the output of kernel `volume`.
    #[must_use]
    pub fn record(
        &self,
        kernels: &KernelPipelines,
        encoder: &mut wgpu::CommandEncoder,
        volumes: &[&wgpu::TextureView],
    ) -> GpuCounters {
        let mut counters = GpuCounters::default();
        for (light, volume) in self.lights.iter().zip(volumes) {
            let bind = kernels.bind(
                EntryPoint::FogInscatter,
                &[
                    (0, light.params.as_entire_binding()),
                    (1, wgpu::BindingResource::TextureView(volume)),
                    (2, wgpu::BindingResource::TextureView(&light.texture)),
                ],
            );
            let mut pass = compute(encoder, "meshless_gi fog_inscatter");
            pass.set_pipeline(&kernels.compute_kernel(EntryPoint::FogInscatter).pipeline);
            pass.set_bind_group(0, &bind, &[]);
            let [x, y, z] = light.size.map(|n| n.div_ceil(4));
            pass.dispatch_workgroups(x, y, z);
            counters.dispatches[EntryPoint::FogInscatter as usize] += 1;
        }
        counters
    }

    /// Returns the number of buffers.
    #[must_use]
    pub fn count(&self) -> u32 {
        (self.lights.len() + self.draws.len()) as u32
    }

    /// Returns the size of the buffers and textures in bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let texture =
            |light: &FogLight| 8 * light.size.iter().map(|n| u64::from(*n)).product::<u64>();
        let lights: u64 = (self.lights.iter().map(|l| l.params.size() + texture(l))).sum();
        lights + self.draws.iter().map(wgpu::Buffer::size).sum::<u64>()
    }
}

/// Textures that a draw of fog reads in addition to its light.
#[derive(Clone, Copy, Debug)]
pub struct FogTextures<'a> {
    /// The view's depth, reversed (0 is infinitely far), of the size of its target.
    pub depth: &'a wgpu::TextureView,
    /// `true` if the depth has several samples per pixel.
    pub sampled: bool,
    /// Voxels that kernel `volume` wrote for the scene.
    pub voxels: &'a wgpu::TextureView,
    /// Sampler with linear filtering that clamps to the edges.
    pub between: &'a wgpu::Sampler,
    /// Three-dimensional texture of the density, and its sampler. The texture has one texel if the
    /// fog has no density texture.
    pub density: (&'a wgpu::TextureView, &'a wgpu::Sampler),
}

/// Adds the light of the draw `which` of a view to its image. The target has this `format` and one
/// sample per pixel. `light` is the index of the scene's light. Both indices refer to the arguments
/// of [`FogBuffers::write`].
///
/// # Panics
/// Panics if one of them was not written.
pub fn draw_fog(
    kernels: &KernelPipelines,
    pass: &mut wgpu::RenderPass<'_>,
    format: wgpu::TextureFormat,
    buffers: &FogBuffers,
    which: usize,
    light: usize,
    textures: &FogTextures<'_>,
) {
    let (how, depth) = match textures.sampled {
        false => (Draw::Fog, 1),
        true => (Draw::FogSampled, 2),
    };
    let kernel = kernels.render_kernel(format, how);
    let light = &buffers.lights[light].texture;
    let bind = (kernels.device()).create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some(KERNELS[FOG].name),
        layout: &kernel.layout,
        entries: &[
            entry(0, buffers.draws[which].as_entire_binding()),
            entry(depth, wgpu::BindingResource::TextureView(textures.depth)),
            entry(3, wgpu::BindingResource::TextureView(textures.voxels)),
            entry(4, wgpu::BindingResource::TextureView(light)),
            entry(5, wgpu::BindingResource::Sampler(textures.between)),
            entry(6, wgpu::BindingResource::TextureView(textures.density.0)),
            entry(7, wgpu::BindingResource::Sampler(textures.density.1)),
        ],
    });
    pass.set_pipeline(&kernel.pipeline);
    pass.set_bind_group(0, &bind, &[]);
    pass.draw(0..3, 0..1);
}
