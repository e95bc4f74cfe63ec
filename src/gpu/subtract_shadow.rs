//! Recording of the light that soft shadows subtract from a view: the kernel `subtract_shadow`, for
//! one baked scene in one view. A view without soft shadows has no such buffers.

use super::buffer_factory::{binding_limit, uniform};
use super::dispatch::compute;
use super::error::GpuError;
use super::frame::SplatTargets;
use super::pipelines::KernelPipelines;
use super::scene_buffers::{SceneBuffers, ViewBuffers};
use super::soft_shadow::SoftShadowBuffers;
use super::{EntryPoint, GpuCounters};
use meshless_gi::internals::frame::{SoftLight, SubtractShadowParams};

/// Lights of one scene in one view.
#[derive(Debug)]
pub struct SubtractShadowBuffers {
    params: wgpu::Buffer,
    lights: wgpu::Buffer,
    room: usize,
    /// Texture that is bound without tables.
    placeholder: wgpu::TextureView,
    counters: GpuCounters,
}

/// Creates a storage buffer for `count` lights.
fn create_light_buffer(device: &wgpu::Device, count: usize) -> Result<wgpu::Buffer, GpuError> {
    let bytes = (size_of::<SoftLight>() as u64).saturating_mul(count.max(1) as u64);
    let limit = binding_limit(device);
    if bytes > limit {
        return Err(GpuError::TooLarge {
            what: "soft lights of a view",
            bytes,
            limit,
        });
    }
    Ok(device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("soft lights of a view"),
        size: bytes,
        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    }))
}

/// Creates a texture of two layers of one texel.
fn placeholder(device: &wgpu::Device) -> wgpu::TextureView {
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("no tables"),
        size: wgpu::Extent3d {
            width: 1,
            height: 1,
            depth_or_array_layers: 2,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba16Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING,
        view_formats: &[],
    });
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..wgpu::TextureViewDescriptor::default()
    })
}

impl SubtractShadowBuffers {
    /// Creates buffers for `lights` lights.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] if the lights do not fit a binding of the device.
    pub fn new(device: &wgpu::Device, lights: usize) -> Result<Self, GpuError> {
        Ok(Self {
            params: uniform(
                device,
                "subtract_shadow",
                size_of::<SubtractShadowParams>() as u64,
            ),
            lights: create_light_buffer(device, lights)?,
            room: lights.max(1),
            placeholder: placeholder(device),
            counters: GpuCounters::default(),
        })
    }

    /// Sets the lights that the view was rendered with, in the scene's local space, for the frame
    /// that is submitted next. [`SoftShadowBuffers::record`] computes their occluded irradiance.
    /// Set `gloss` if rectangles were rendered with specular reflection.
    /// [`SubtractShadowBuffers::record`] then needs the tables.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] if the lights do not fit a binding of the device.
    pub fn write(
        &mut self,
        kernels: &KernelPipelines,
        queue: &wgpu::Queue,
        scene: &SceneBuffers,
        lights: &[SoftLight],
        gloss: bool,
    ) -> Result<(), GpuError> {
        if lights.len() > self.room {
            self.lights = create_light_buffer(kernels.device(), lights.len())?;
            self.room = lights.len();
        }
        if !lights.is_empty() {
            queue.write_buffer(&self.lights, 0, bytemuck::cast_slice(lights));
        }
        let params = SubtractShadowParams {
            lights: lights.len() as u32,
            extent: scene.shape().extent,
            gloss: u32::from(gloss),
            ..SubtractShadowParams::default()
        };
        queue.write_buffer(&self.params, 0, bytemuck::bytes_of(&params));
        Ok(())
    }

    /// Writes the occluded radiance of each pixel, for [`draw_over`](super::draw_over). `tables`
    /// are two layers, see
    /// [`LtcTables`](meshless_gi::internals::frame::subtract_shadow::LtcTables).
    pub fn record(
        &mut self,
        kernels: &KernelPipelines,
        encoder: &mut wgpu::CommandEncoder,
        (scene, soft): (&SceneBuffers, &SoftShadowBuffers),
        view: &ViewBuffers,
        targets: &SplatTargets<'_>,
        tables: Option<&wgpu::TextureView>,
    ) {
        let entry_point = match targets.earlier {
            Some(_) => EntryPoint::SubtractShadowOver,
            None => EntryPoint::SubtractShadow,
        };
        let [width, height] = view.size;
        if width == 0 || height == 0 {
            return;
        }
        let texture = wgpu::BindingResource::TextureView;
        let mut resources = vec![
            (0, view.splat.as_entire_binding()),
            (1, texture(targets.depth)),
            (2, texture(targets.gbuffer)),
            (3, scene.points.as_entire_binding()),
            (4, scene.planes.as_entire_binding()),
            (5, scene.grid_slots.as_entire_binding()),
            (6, scene.grid_entries.as_entire_binding()),
            (7, soft.occluded_irradiances().as_entire_binding()),
            (8, texture(targets.output)),
            (10, self.params.as_entire_binding()),
            (11, self.lights.as_entire_binding()),
            (12, texture(tables.unwrap_or(&self.placeholder))),
        ];
        if let Some(earlier) = targets.earlier {
            resources.push((9, texture(earlier)));
        }
        let bind = kernels.bind(entry_point, &resources);
        let mut pass = compute(encoder, "meshless_gi subtract_shadow");
        pass.set_pipeline(&kernels.compute_kernel(entry_point).pipeline);
        pass.set_bind_group(0, &bind, &[]);
        pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
        self.counters.dispatches[entry_point as usize] += 1;
    }

    /// Returns the number of buffers.
    #[must_use]
    pub fn count(&self) -> u32 {
        2
    }

    /// Returns the size of its buffers in bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.params.size() + self.lights.size()
    }

    /// Returns the work recorded so far.
    #[must_use]
    pub fn counters(&self) -> GpuCounters {
        self.counters
    }
}
