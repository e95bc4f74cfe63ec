//! Soft shadows on the GPU: the buffers that kernel `soft_shadow` reads, and the recording of this
//! kernel and of `flatten`. A scene without visibility, or without lights that cast soft shadows,
//! has no such buffers.

use super::buffer_factory::uniform;
use super::dispatch::{MAX_GROUPS, compute};
use super::error::GpuError;
use super::pipelines::KernelPipelines;
use super::scene_buffers::SceneBuffers;
use super::{EntryPoint, GpuCounters};
use bytemuck::Pod;
use meshless_gi::internals::frame::{
    SoftLight, SoftShadowParams, SolveParams, Span, VectorIrradiance,
};
use meshless_gi::internals::transport::pca::Visibility;

/// Visibility of a baked scene on the GPU, its soft lights, and their occluded irradiance.
#[derive(Debug)]
pub struct SoftShadowBuffers {
    params: wgpu::Buffer,
    solve: wgpu::Buffer,
    spans: wgpu::Buffer,
    /// Levels after those with visibility, with the offsets of their spans.
    levels: Vec<(u32, u32)>,
    lights: wgpu::Buffer,
    room: usize,
    clusters: wgpu::Buffer,
    visible: wgpu::Buffer,
    basis: wgpu::Buffer,
    scales: wgpu::Buffer,
    coefficients: wgpu::Buffer,
    occluded_irradiances: wgpu::Buffer,
    shape: SoftShadowParams,
    counters: GpuCounters,
}

fn upload<T: Pod>(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    what: &'static str,
    data: &[T],
    count: usize,
) -> Result<wgpu::Buffer, GpuError> {
    let bytes = (size_of::<T>() as u64).saturating_mul(count.max(1) as u64);
    let limit = device.limits().max_storage_buffer_binding_size;
    if bytes > limit {
        return Err(GpuError::TooLarge { what, bytes, limit });
    }
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(what),
        size: bytes,
        usage: wgpu::BufferUsages::STORAGE
            | wgpu::BufferUsages::COPY_DST
            | wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    });
    if !data.is_empty() {
        queue.write_buffer(&buffer, 0, bytemuck::cast_slice(data));
    }
    Ok(buffer)
}

impl SoftShadowBuffers {
    /// Uploads the visibility of the scene in `scene`, with capacity for `lights` soft lights.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] if a buffer does not fit a binding of the device.
    pub fn new(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        scene: &SceneBuffers,
        visibility: &Visibility,
        lights: usize,
    ) -> Result<Self, GpuError> {
        let shape = scene.shape();
        let align = device.limits().min_uniform_buffer_offset_alignment as usize;
        let stride = size_of::<Span>().next_multiple_of(align.max(1));
        let mut bytes = Vec::new();
        let mut levels = Vec::new();
        for level in (0..shape.levels()).map(|l| shape.level(l)) {
            if level.start < visibility.points.len() {
                continue;
            }
            let span = Span {
                first: level.start as u32,
                count: level.len() as u32,
                ..Span::default()
            };
            levels.push((bytes.len() as u32, span.count));
            bytes.extend_from_slice(bytemuck::bytes_of(&span));
            bytes.resize(levels.len() * stride, 0);
        }
        bytes.resize(bytes.len().max(stride), 0);
        let spans = uniform(device, "soft_shadow spans", bytes.len() as u64);
        queue.write_buffer(&spans, 0, &bytes);
        // Rows of tier 0 do not exist: every point takes the mean of its parents.
        let solve = uniform(device, "soft_shadow solve", size_of::<SolveParams>() as u64);
        queue.write_buffer(&solve, 0, bytemuck::bytes_of(&SolveParams::default()));
        Ok(Self {
            params: uniform(
                device,
                "soft_shadow params",
                size_of::<SoftShadowParams>() as u64,
            ),
            solve,
            spans,
            levels,
            lights: upload::<SoftLight>(device, queue, "soft lights", &[], lights)?,
            room: lights.max(1),
            clusters: upload(
                device,
                queue,
                "visibility clusters",
                &visibility.clusters,
                visibility.clusters.len(),
            )?,
            visible: upload(
                device,
                queue,
                "visibility points",
                &visibility.points,
                visibility.points.len(),
            )?,
            basis: upload(
                device,
                queue,
                "visibility basis",
                &visibility.basis,
                visibility.basis.len(),
            )?,
            scales: upload(
                device,
                queue,
                "visibility scales",
                &visibility.scales,
                visibility.scales.len(),
            )?,
            coefficients: upload(
                device,
                queue,
                "visibility coefficients",
                &visibility.coefficients,
                visibility.coefficients.len(),
            )?,
            occluded_irradiances: upload::<VectorIrradiance>(
                device,
                queue,
                "occluded_irradiances",
                &[],
                shape.points(),
            )?,
            shape: SoftShadowParams::new(visibility, shape.extent, 0),
            counters: GpuCounters::default(),
        })
    }

    /// Records the occluded irradiance of `lights` at all points of `scene`, for which the buffers
    /// were created. Call it only after a light changed.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] if the lights do not fit a binding of the device.
    pub fn record(
        &mut self,
        kernels: &KernelPipelines,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        scene: &SceneBuffers,
        lights: &[SoftLight],
    ) -> Result<(), GpuError> {
        if lights.len() > self.room {
            self.lights = upload(kernels.device(), queue, "soft lights", lights, lights.len())?;
            self.room = lights.len();
        } else if !lights.is_empty() {
            queue.write_buffer(&self.lights, 0, bytemuck::cast_slice(lights));
        }
        let params = SoftShadowParams {
            lights: lights.len() as u32,
            ..self.shape
        };
        queue.write_buffer(&self.params, 0, bytemuck::bytes_of(&params));
        let mut pass = compute(encoder, "soft shadows");
        let soft = kernels.bind(
            EntryPoint::SoftShadow,
            &[
                (0, self.params.as_entire_binding()),
                (1, self.lights.as_entire_binding()),
                (2, scene.points.as_entire_binding()),
                (3, self.clusters.as_entire_binding()),
                (4, self.visible.as_entire_binding()),
                (5, self.basis.as_entire_binding()),
                (6, self.scales.as_entire_binding()),
                (7, self.coefficients.as_entire_binding()),
                (8, self.occluded_irradiances.as_entire_binding()),
            ],
        );
        self.dispatch(
            kernels,
            &mut pass,
            EntryPoint::SoftShadow,
            &soft,
            &[],
            params.points,
        );
        let span = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: &self.spans,
            offset: 0,
            size: std::num::NonZeroU64::new(size_of::<Span>() as u64),
        });
        let averages = kernels.bind(
            EntryPoint::Averages,
            &[
                (0, self.solve.as_entire_binding()),
                (1, span),
                (2, scene.rows.as_entire_binding()),
                (3, scene.parent_starts.as_entire_binding()),
                (4, scene.parent_entries.as_entire_binding()),
                (6, self.occluded_irradiances.as_entire_binding()),
            ],
        );
        for (offset, count) in self.levels.clone() {
            self.dispatch(
                kernels,
                &mut pass,
                EntryPoint::Averages,
                &averages,
                &[offset],
                count,
            );
        }
        Ok(())
    }

    fn dispatch(
        &mut self,
        kernels: &KernelPipelines,
        pass: &mut wgpu::ComputePass<'_>,
        entry_point: EntryPoint,
        bind: &wgpu::BindGroup,
        offsets: &[u32],
        items: u32,
    ) {
        if items == 0 {
            return;
        }
        let groups = items.div_ceil(entry_point.entry().1.items);
        pass.set_pipeline(&kernels.compute_kernel(entry_point).pipeline);
        pass.set_bind_group(0, bind, offsets);
        pass.dispatch_workgroups(groups.min(MAX_GROUPS), groups.div_ceil(MAX_GROUPS), 1);
        self.counters.dispatches[entry_point as usize] += 1;
    }

    /// Returns the buffer of occluded and unoccluded irradiance of every point, W/m². Kernel
    /// `subtract_shadow` reads it.
    #[must_use]
    pub fn occluded_irradiances(&self) -> &wgpu::Buffer {
        &self.occluded_irradiances
    }

    /// Returns its buffers.
    fn buffers(&self) -> [&wgpu::Buffer; 10] {
        [
            &self.params,
            &self.solve,
            &self.spans,
            &self.lights,
            &self.clusters,
            &self.visible,
            &self.basis,
            &self.scales,
            &self.coefficients,
            &self.occluded_irradiances,
        ]
    }

    /// Returns the number of buffers.
    #[must_use]
    pub fn count(&self) -> u32 {
        self.buffers().len() as u32
    }

    /// Returns the size of its buffers in bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.buffers().into_iter().map(wgpu::Buffer::size).sum()
    }

    /// Returns the dispatches recorded so far.
    #[must_use]
    pub fn counters(&self) -> GpuCounters {
        self.counters
    }
}
