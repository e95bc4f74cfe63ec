//! Recording of specular reflection of virtual point lights in a view: the kernel `vpl_specular`,
//! level by level, and its pixels. The order is that of
//! [`SpecularView::run`](meshless_gi::internals::frame::vpl_specular::SpecularView::run). The GPU
//! selects the lights of each node. Nothing is read back.

use super::EntryPoint;
use super::buffer_factory::{binding_limit, uniform};
use super::dispatch::compute;
use super::pipelines::KernelPipelines;
use super::subsplats::{NodeLights, SubsplatTargets};
use super::{GpuCounters, GpuError};
use meshless_gi::internals::frame::subsplat::LEVELS;
use meshless_gi::internals::frame::{
    Span, SpecularNode, SpecularParams, SubsplatLevels, SubsplatParams,
};

/// Buffers of a view, and its recording. They have 16 bytes per node of the levels from 1, and the
/// same for those from 2: about 6.6 bytes per pixel.
#[derive(Debug)]
pub struct SpecularBuffers {
    levels: SubsplatLevels,
    screen: wgpu::Buffer,
    specular_params: wgpu::Buffer,
    /// Spans of the levels.
    spans: wgpu::Buffer,
    stride: u32,
    nodes: wgpu::Buffer,
    refine_masks: wgpu::Buffer,
    counters: GpuCounters,
}

impl SpecularBuffers {
    /// Creates buffers for views of these levels: [`SubsplatParams::levels`] of the parameters from
    /// [`SpecularSettings::params`](meshless_gi::SpecularSettings::params).
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] if a buffer does not fit a binding of the device. The view then has
    /// no specular reflection.
    pub fn new(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        levels: SubsplatLevels,
    ) -> Result<Self, GpuError> {
        let limit = binding_limit(device);
        let storage = |what: &'static str, count: u32| {
            let bytes = 16 * u64::from(count.max(1));
            if bytes > limit {
                return Err(GpuError::TooLarge { what, bytes, limit });
            }
            Ok(device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(what),
                size: bytes,
                usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            }))
        };
        const _: () = assert!(size_of::<SpecularNode>() == 16 && size_of::<[u32; 4]>() == 16);
        let align = device.limits().min_uniform_buffer_offset_alignment;
        let stride = (size_of::<Span>() as u32).next_multiple_of(align.max(1));
        let spans = uniform(
            device,
            "vpl_specular levels",
            u64::from(stride) * LEVELS as u64,
        );
        for k in 0..=levels.coarsest_level {
            let span = Span {
                first: k,
                ..Span::default()
            };
            queue.write_buffer(&spans, u64::from(stride * k), bytemuck::bytes_of(&span));
        }
        Ok(Self {
            levels,
            screen: uniform(
                device,
                "vpl_specular view",
                size_of::<SubsplatParams>() as u64,
            ),
            specular_params: uniform(
                device,
                "vpl_specular settings",
                size_of::<SpecularParams>() as u64,
            ),
            spans,
            stride,
            nodes: storage("vpl_specular nodes", levels.starts[0])?,
            refine_masks: storage(
                "vpl_specular refine masks",
                levels.starts[0] - levels.starts[2],
            )?,
            counters: GpuCounters::default(),
        })
    }

    /// Returns the levels that fit the buffers.
    #[must_use]
    pub fn levels(&self) -> SubsplatLevels {
        self.levels
    }

    /// Returns the number of buffers.
    #[must_use]
    pub fn count(&self) -> u32 {
        5
    }

    /// Returns the size of its buffers in bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let own = [
            &self.screen,
            &self.specular_params,
            &self.spans,
            &self.nodes,
            &self.refine_masks,
        ];
        own.into_iter().map(wgpu::Buffer::size).sum()
    }

    /// Returns the work recorded so far.
    #[must_use]
    pub fn counters(&self) -> GpuCounters {
        self.counters
    }

    /// Returns the nodes of the levels from 1, for tests and tools.
    #[must_use]
    pub fn nodes(&self) -> &wgpu::Buffer {
        &self.nodes
    }

    /// Returns the refine masks of the nodes of the levels from 2, for tests and tools.
    #[must_use]
    pub fn refine_masks(&self) -> &wgpu::Buffer {
        &self.refine_masks
    }

    /// Sets the parameters for the frame that is submitted next. Their levels are
    /// [`SpecularBuffers::levels`].
    pub fn write(
        &mut self,
        queue: &wgpu::Queue,
        screen: &SubsplatParams,
        specular_params: &SpecularParams,
    ) {
        debug_assert_eq!(screen.levels(), self.levels);
        queue.write_buffer(&self.screen, 0, bytemuck::bytes_of(screen));
        queue.write_buffer(
            &self.specular_params,
            0,
            bytemuck::bytes_of(specular_params),
        );
    }

    /// Records all dispatches between the G-buffer and the radiance of every pixel, for
    /// [`draw_over`](super::draw_over). Writes all of `targets.output`. The lights are those that
    /// [`SubsplatBuffers::record`](super::SubsplatBuffers::record) takes.
    pub fn record(
        &mut self,
        kernels: &KernelPipelines,
        encoder: &mut wgpu::CommandEncoder,
        targets: &SubsplatTargets<'_>,
        lights: &NodeLights<'_>,
    ) {
        let [width, height] = self.levels.size;
        if width == 0 || height == 0 {
            return;
        }
        let [nodes, triangles] = lights.maps.tree(lights.shadows.as_ref());
        let texture = wgpu::BindingResource::TextureView;
        let common = [
            (0, lights.view.as_entire_binding()),
            (1, texture(targets.depth)),
            (2, texture(targets.gbuffer)),
            (3, lights.lit.as_entire_binding()),
            (4, lights.maps.vpls().as_entire_binding()),
            (5, nodes.as_entire_binding()),
            (6, triangles.as_entire_binding()),
            (8, self.screen.as_entire_binding()),
            (10, self.specular_params.as_entire_binding()),
            (11, self.nodes.as_entire_binding()),
        ];
        let with = |more: &[(u32, wgpu::BindingResource<'_>)], which| {
            let all: Vec<_> = common.iter().chain(more).cloned().collect();
            kernels.bind(which, &all)
        };
        let span = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: &self.spans,
            offset: 0,
            size: std::num::NonZeroU64::new(size_of::<Span>() as u64),
        });
        let level = with(
            &[(9, span), (12, self.refine_masks.as_entire_binding())],
            EntryPoint::VplSpecular,
        );
        let pixels = with(
            &[(7, texture(targets.output))],
            EntryPoint::VplSpecularPixels,
        );
        let mut pass = compute(encoder, "meshless_gi vpl_specular");
        pass.set_pipeline(&kernels.compute_kernel(EntryPoint::VplSpecular).pipeline);
        for k in (1..=self.levels.coarsest_level).rev() {
            let [w, h] = self.levels.grid(k);
            pass.set_bind_group(0, &level, &[k * self.stride]);
            pass.dispatch_workgroups(w.div_ceil(8), h.div_ceil(8), 1);
        }
        pass.set_pipeline(
            &kernels
                .compute_kernel(EntryPoint::VplSpecularPixels)
                .pipeline,
        );
        pass.set_bind_group(0, &pixels, &[]);
        pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
        self.counters.dispatches[EntryPoint::VplSpecular as usize] +=
            u64::from(self.levels.coarsest_level);
        self.counters.dispatches[EntryPoint::VplSpecularPixels as usize] += 1;
    }
}
