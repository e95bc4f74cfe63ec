//! Fast multipole method on the GPU: `fmm_up` and `fmm_down` over the buffers of one octree. The
//! CPU builds tree and lists, as in \[G08\] §3.

use super::EntryPoint;
use super::buffer_factory::binding_limit;
use super::dispatch::MAX_GROUPS;
use super::pipelines::KernelPipelines;
use super::{GpuCounters, GpuError};
use crate::plan::{FmmLimit, octree_fits};
use bytemuck::NoUninit;
use meshless_gi::internals::frame::Span;
use meshless_gi::internals::frame::fmm_layout::{FmmParams, fmm_terms};
use meshless_gi::internals::transport::fmm::FmmOperator;

/// Octree on the GPU, and its recording.
#[derive(Debug)]
pub struct GpuFmm {
    params: wgpu::Buffer,
    spans: wgpu::Buffer,
    stride: u32,
    /// Number of nodes of each level, then of all.
    counts: Vec<u32>,
    nodes: wgpu::Buffer,
    points: wgpu::Buffer,
    terms: wgpu::Buffer,
    entries: wgpu::Buffer,
    expansions: wgpu::Buffer,
    locals: wgpu::Buffer,
}

impl GpuFmm {
    /// Uploads an octree over points. `senders` is the number of senders with a radiosity. The
    /// sky's coefficient follows theirs.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], or [`GpuError::Limit`] for the order, if it exceeds a limit of the
    /// device. See [`octree_fits`].
    pub fn new(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        operator: &FmmOperator,
        senders: u32,
    ) -> Result<Self, GpuError> {
        Self::with_limit(device, queue, operator, senders, binding_limit(device))
    }

    /// Creates the buffers as [`GpuFmm::new`] does, for bindings of at most `limit` bytes.
    pub(super) fn with_limit(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        operator: &FmmOperator,
        senders: u32,
        limit: u64,
    ) -> Result<Self, GpuError> {
        octree_fits(operator, limit).map_err(|error| match error {
            FmmLimit::Order { have, need } => GpuError::Limit {
                limit: "order of the fast multipole method",
                have,
                need,
            },
            FmmLimit::TooLarge { what, needs, has } => GpuError::TooLarge {
                what,
                bytes: needs,
                limit: has,
            },
        })?;
        let buffer = |what: &'static str, bytes: u64, usage: wgpu::BufferUsages| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(what),
                // A binding holds at least one element.
                size: bytes.max(64),
                usage: usage | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            })
        };
        let storage = |what, bytes: usize| buffer(what, bytes as u64, wgpu::BufferUsages::STORAGE);
        let terms = fmm_terms(operator);
        let expansions = operator.expansion_bytes() as usize;
        let align = device.limits().min_uniform_buffer_offset_alignment;
        let stride = (size_of::<Span>() as u32).next_multiple_of(align.max(1));
        let levels = (0..operator.levels()).map(|l| operator.level(l));
        let mut spans: Vec<Span> = levels
            .map(|level| Span {
                first: level.start as u32,
                count: level.len() as u32,
                ..Span::default()
            })
            .collect();
        spans.push(Span {
            count: operator.nodes.len() as u32,
            ..Span::default()
        });
        let uniform = wgpu::BufferUsages::UNIFORM;
        let own = Self {
            params: buffer("fmm parameters", size_of::<FmmParams>() as u64, uniform),
            spans: buffer(
                "fmm levels",
                u64::from(stride) * spans.len() as u64,
                uniform,
            ),
            stride,
            counts: spans.iter().map(|s| s.count).collect(),
            nodes: storage("fmm nodes", size_of_val(&operator.nodes[..])),
            points: storage("fmm points", size_of_val(&operator.points[..])),
            terms: storage("fmm terms", size_of_val(&terms[..])),
            entries: storage("fmm lists", size_of_val(&operator.entries[..])),
            expansions: storage("fmm S-expansions", expansions),
            locals: storage("fmm R-expansions", expansions),
        };
        let put = |buffer: &wgpu::Buffer, bytes: &[u8]| queue.write_buffer(buffer, 0, bytes);
        let params = FmmParams::new(operator, senders);
        put(&own.params, bytemuck::bytes_of(&params));
        for (k, span) in spans.iter().enumerate() {
            let at = u64::from(stride) * k as u64;
            queue.write_buffer(&own.spans, at, bytemuck::bytes_of(span));
        }
        put(&own.nodes, bytes_of(&operator.nodes));
        put(&own.points, bytes_of(&operator.points));
        put(&own.terms, bytes_of(&terms));
        put(&own.entries, bytes_of(&operator.entries));
        Ok(own)
    }

    /// Records the upward pass from the `radiosity` of the senders and the sky.
    pub fn record_upward(
        &self,
        kernels: &KernelPipelines,
        pass: &mut wgpu::ComputePass<'_>,
        counters: &mut GpuCounters,
        radiosity: &wgpu::Buffer,
    ) {
        let levels = self.counts.len() - 1;
        let bind = self.bind(kernels, EntryPoint::FmmUp, radiosity, None);
        for level in (0..levels).rev() {
            self.dispatch(kernels, pass, counters, EntryPoint::FmmUp, &bind, level);
        }
    }

    /// Records the downward pass and the evaluation. They write the vector irradiance of the points
    /// that receive.
    pub fn record_downward(
        &self,
        kernels: &KernelPipelines,
        pass: &mut wgpu::ComputePass<'_>,
        counters: &mut GpuCounters,
        radiosity: &wgpu::Buffer,
        values: &wgpu::Buffer,
    ) {
        let levels = self.counts.len() - 1;
        let bind = self.bind(kernels, EntryPoint::FmmReceive, radiosity, None);
        for level in 0..levels {
            self.dispatch(
                kernels,
                pass,
                counters,
                EntryPoint::FmmReceive,
                &bind,
                level,
            );
        }
        let bind = self.bind(kernels, EntryPoint::FmmEvaluate, radiosity, Some(values));
        self.dispatch(
            kernels,
            pass,
            counters,
            EntryPoint::FmmEvaluate,
            &bind,
            levels,
        );
    }

    /// Returns the S-expansions and R-expansions that `up` and `receive` wrote, for tests and
    /// tools.
    #[must_use]
    pub fn expansions(&self) -> [&wgpu::Buffer; 2] {
        [&self.expansions, &self.locals]
    }

    /// Returns its buffers with their names.
    pub(super) fn named_buffers(&self) -> [(&'static str, &wgpu::Buffer); 8] {
        [
            ("fmm parameters", &self.params),
            ("fmm levels", &self.spans),
            ("fmm nodes", &self.nodes),
            ("fmm points", &self.points),
            ("fmm terms", &self.terms),
            ("fmm lists", &self.entries),
            ("fmm S-expansions", &self.expansions),
            ("fmm R-expansions", &self.locals),
        ]
    }

    /// Returns the size of its buffers in bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.named_buffers()
            .iter()
            .map(|(_, buffer)| buffer.size())
            .sum()
    }

    fn bind(
        &self,
        kernels: &KernelPipelines,
        entry_point: EntryPoint,
        radiosity: &wgpu::Buffer,
        values: Option<&wgpu::Buffer>,
    ) -> wgpu::BindGroup {
        let span = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: &self.spans,
            offset: 0,
            size: std::num::NonZeroU64::new(size_of::<Span>() as u64),
        });
        let mut shared = vec![
            (0, self.params.as_entire_binding()),
            (1, span),
            (2, self.nodes.as_entire_binding()),
            (3, self.points.as_entire_binding()),
            (4, self.terms.as_entire_binding()),
            (5, radiosity.as_entire_binding()),
            (6, self.expansions.as_entire_binding()),
            (7, self.locals.as_entire_binding()),
            (8, self.entries.as_entire_binding()),
        ];
        shared.extend(values.map(|values| (9, values.as_entire_binding())));
        shared.retain(|(at, _)| entry_point.entry().1.bindings.contains(at));
        kernels.bind(entry_point, &shared)
    }

    fn dispatch(
        &self,
        kernels: &KernelPipelines,
        pass: &mut wgpu::ComputePass<'_>,
        counters: &mut GpuCounters,
        entry_point: EntryPoint,
        bind: &wgpu::BindGroup,
        span: usize,
    ) {
        let [x, y] = groups(self.counts[span]);
        if x == 0 {
            return;
        }
        pass.set_pipeline(&kernels.compute_kernel(entry_point).pipeline);
        pass.set_bind_group(0, bind, &[self.stride * span as u32]);
        pass.dispatch_workgroups(x, y, 1);
        counters.dispatches[entry_point as usize] += 1;
    }
}

/// Returns the workgroups in two dimensions, one per node.
fn groups(count: u32) -> [u32; 2] {
    [count.min(MAX_GROUPS), count.div_ceil(MAX_GROUPS)]
}

fn bytes_of<T: NoUninit>(values: &[T]) -> &[u8] {
    bytemuck::cast_slice(values)
}
