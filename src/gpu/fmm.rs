//! The fast multipole method on a device: `fmm_up` and `fmm_down` over the buffers of one [`Fmm`]. Tree and lists come from the CPU, as in \[G08\] §3.

use super::Pass;
use super::frame::{MOST_GROUPS, compute};
use super::pipelines::Kernels;
use super::{GpuCounters, GpuError};
use crate::frame::Span;
use crate::frame::fmm_layout::{FmmArrays, FmmParams, MOST_FMM_ORDER};
use crate::transport::fmm::Fmm;
use bytemuck::NoUninit;
use glam::Vec3;

/// Buffers of one tree, and what is recorded of it.
#[derive(Debug)]
pub struct GpuFmm {
    params: wgpu::Buffer,
    spans: wgpu::Buffer,
    stride: u32,
    /// Nodes of each level, then of all.
    counts: Vec<u32>,
    nodes: wgpu::Buffer,
    places: wgpu::Buffer,
    terms: wgpu::Buffer,
    entries: wgpu::Buffer,
    radiosity: wgpu::Buffer,
    expansions: wgpu::Buffer,
    locals: wgpu::Buffer,
    irradiance: wgpu::Buffer,
    /// Indices of the points in the tree's order.
    order: Vec<u32>,
    counters: GpuCounters,
}

impl GpuFmm {
    /// Uploads tree, lists and tables.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] where the device binds no such buffer (most often the expansions: larger leaves or a lower order make them smaller), [`GpuError::Limit`]
    /// where the order is more than [`MOST_FMM_ORDER`].
    pub fn new(kernels: &Kernels, queue: &wgpu::Queue, fmm: &Fmm) -> Result<Self, GpuError> {
        let order = fmm.settings().order;
        if order > MOST_FMM_ORDER {
            return Err(GpuError::Limit {
                limit: "order of the fast multipole method",
                have: MOST_FMM_ORDER as u64,
                need: order as u64,
            });
        }
        let device = kernels.device();
        let arrays = FmmArrays::new(fmm);
        let terms = arrays.terms.len();
        let buffer = |what: &'static str, bytes: u64, usage: wgpu::BufferUsages| {
            let limit = device.limits().max_storage_buffer_binding_size;
            if bytes > limit {
                return Err(GpuError::TooLarge { what, bytes, limit });
            }
            Ok(device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(what),
                // A binding holds at least one element.
                size: bytes.max(64),
                usage: usage | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            }))
        };
        let storage = |what, bytes: usize| buffer(what, bytes as u64, wgpu::BufferUsages::STORAGE);
        let expansions = 48 * terms * arrays.nodes.len();
        let points = 16 * arrays.places.len();
        let align = device.limits().min_uniform_buffer_offset_alignment;
        let stride = (size_of::<Span>() as u32).next_multiple_of(align.max(1));
        let tree = fmm.tree();
        let mut spans: Vec<Span> = (0..tree.levels())
            .map(|l| tree.level(l))
            .map(|level| Span {
                first: level.start as u32,
                count: level.len() as u32,
                ..Span::default()
            })
            .collect();
        spans.push(Span {
            count: arrays.nodes.len() as u32,
            ..Span::default()
        });
        let uniform = wgpu::BufferUsages::UNIFORM;
        let own = Self {
            params: buffer("fmm parameters", size_of::<FmmParams>() as u64, uniform)?,
            spans: buffer(
                "fmm levels",
                u64::from(stride) * spans.len() as u64,
                uniform,
            )?,
            stride,
            counts: spans.iter().map(|s| s.count).collect(),
            nodes: storage("fmm nodes", size_of_val(&arrays.nodes[..]))?,
            places: storage("fmm points", size_of_val(&arrays.places[..]))?,
            terms: storage("fmm terms", size_of_val(&arrays.terms[..]))?,
            entries: storage("fmm lists", size_of_val(&arrays.entries[..]))?,
            radiosity: storage("fmm radiosity", points)?,
            expansions: storage("fmm S-expansions", expansions)?,
            locals: storage("fmm R-expansions", expansions)?,
            irradiance: storage("fmm irradiance", points)?,
            order: tree.order.clone(),
            counters: GpuCounters::default(),
        };
        let put = |buffer: &wgpu::Buffer, bytes: &[u8]| queue.write_buffer(buffer, 0, bytes);
        put(&own.params, bytemuck::bytes_of(&arrays.params));
        for (k, span) in spans.iter().enumerate() {
            let at = u64::from(stride) * k as u64;
            queue.write_buffer(&own.spans, at, bytemuck::bytes_of(span));
        }
        put(&own.nodes, bytes_of(&arrays.nodes));
        put(&own.places, bytes_of(&arrays.places));
        put(&own.terms, bytes_of(&arrays.terms));
        put(&own.entries, bytes_of(&arrays.entries));
        Ok(own)
    }

    /// Sets the radiosity of every point, W/m², in the order of the points.
    ///
    /// # Panics
    /// Where there are fewer radiosities than points.
    pub fn set_radiosity(&self, queue: &wgpu::Queue, radiosity: &[Vec3]) {
        let sorted = self
            .order
            .iter()
            .map(|&i| radiosity[i as usize].extend(0.0));
        let sorted: Vec<[f32; 4]> = sorted.map(|b| b.to_array()).collect();
        queue.write_buffer(&self.radiosity, 0, bytes_of(&sorted));
    }

    /// Records the upward pass.
    pub fn up(&mut self, kernels: &Kernels, encoder: &mut wgpu::CommandEncoder) {
        let levels = self.counts.len() - 1;
        let which: Vec<_> = (0..levels).rev().collect();
        self.record(kernels, encoder, Pass::FmmUp, &which);
    }

    /// Records the downward pass and the evaluation.
    pub fn down(&mut self, kernels: &Kernels, encoder: &mut wgpu::CommandEncoder) {
        let levels = self.counts.len() - 1;
        let which: Vec<_> = (0..levels).collect();
        self.record(kernels, encoder, Pass::FmmReceive, &which);
        self.record(kernels, encoder, Pass::FmmEvaluate, &[levels]);
    }

    /// Irradiance in the tree's order, and the expansions, for tests and tools: what `up`, `receive` and `evaluate` wrote.
    #[must_use]
    pub fn outputs(&self) -> [&wgpu::Buffer; 3] {
        [&self.expansions, &self.locals, &self.irradiance]
    }

    /// What `evaluate` wrote, read back, in the order of `points` points.
    #[must_use]
    pub fn sorted(&self, irradiance: &[[f32; 4]], points: usize) -> Vec<Vec3> {
        let mut out = vec![Vec3::ZERO; points];
        for (e, &i) in irradiance.iter().zip(&self.order) {
            out[i as usize] = Vec3::new(e[0], e[1], e[2]);
        }
        out
    }

    /// What was recorded so far.
    #[must_use]
    pub fn counters(&self) -> GpuCounters {
        self.counters
    }

    /// Bytes on the device.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let all = [
            &self.params,
            &self.spans,
            &self.nodes,
            &self.places,
            &self.terms,
            &self.entries,
            &self.radiosity,
            &self.expansions,
            &self.locals,
            &self.irradiance,
        ];
        all.into_iter().map(wgpu::Buffer::size).sum()
    }

    fn record(
        &mut self,
        kernels: &Kernels,
        encoder: &mut wgpu::CommandEncoder,
        which: Pass,
        spans: &[usize],
    ) {
        let span = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: &self.spans,
            offset: 0,
            size: std::num::NonZeroU64::new(size_of::<Span>() as u64),
        });
        let shared = [
            (0, self.params.as_entire_binding()),
            (1, span),
            (2, self.nodes.as_entire_binding()),
            (3, self.places.as_entire_binding()),
            (4, self.terms.as_entire_binding()),
            (5, self.radiosity.as_entire_binding()),
            (6, self.expansions.as_entire_binding()),
            (7, self.locals.as_entire_binding()),
            (8, self.entries.as_entire_binding()),
            (9, self.irradiance.as_entire_binding()),
        ];
        let used: Vec<_> = shared
            .into_iter()
            .filter(|(at, _)| which.entry().1.bindings.contains(at))
            .collect();
        let bind = kernels.bind(which, &used);
        let mut pass = compute(encoder, which.entry().1.name);
        pass.set_pipeline(&kernels.pass(which).pipeline);
        for &k in spans {
            let [x, y] = groups(self.counts[k]);
            if x == 0 {
                continue;
            }
            pass.set_bind_group(0, &bind, &[self.stride * k as u32]);
            pass.dispatch_workgroups(x, y, 1);
            self.counters.dispatches[which as usize] += 1;
        }
    }
}

/// Workgroups in two dimensions, a node each.
fn groups(count: u32) -> [u32; 2] {
    [count.min(MOST_GROUPS), count.div_ceil(MOST_GROUPS)]
}

fn bytes_of<T: NoUninit>(values: &[T]) -> &[u8] {
    bytemuck::cast_slice(values)
}
