//! Occluders on the GPU: the terms of links that cross them, and kernel `occlude` over these terms.
//! A scene without occluders has no such buffers.

use super::buffer_factory::BufferFactory;
use super::dispatch::{MAX_GROUPS, compute};
use super::links::split_links;
use super::pipelines::KernelPipelines;
use super::spans::{SpanList, SpanTable};
use super::{EntryPoint, GpuError, GpuFrame};
use meshless_gi::internals::asset::Occluders;
use meshless_gi::internals::frame::Span;
use meshless_gi::internals::frame::occlude::{
    occluder_set_transmittances, sanitize_transmittances,
};
use meshless_gi::internals::transport::{PackedLinkTerm, Row};
use meshless_gi::{BakedScene, Bvh};

/// Terms of the operator's links or of the probes' links.
#[derive(Debug)]
pub(super) struct OccludedLinkBuffers {
    /// Spans of the terms of each chunk of links. The base of a span is the first link of its
    /// chunk.
    parts: SpanList,
    terms: Vec<wgpu::Buffer>,
}

/// Occluders of a baked scene.
#[derive(Debug)]
pub(super) struct OccluderBuffers {
    links: OccludedLinkBuffers,
    probes: OccludedLinkBuffers,
    /// Transmittance of each set of occluders.
    set_transmittances: wgpu::Buffer,
}

impl OccludedLinkBuffers {
    /// Creates the buffers for rows in the order of their links.
    fn new(
        make: &BufferFactory<'_>,
        table: &mut SpanTable<'_>,
        rows: &[Row],
        terms: &[PackedLinkTerm],
    ) -> Result<Self, GpuError> {
        let (mut spans, mut buffers) = (Vec::new(), Vec::new());
        for part in split_links(rows, make.limit)? {
            let of = |link: u32| terms.partition_point(|p| p.link < link);
            let own = &terms[of(part.links.start)..of(part.links.end)];
            spans.push(Span {
                first: 0,
                count: own.len() as u32,
                base: part.links.start,
                pad: 0,
            });
            buffers.push(make.upload("occluded link terms", own)?);
        }
        Ok(Self {
            parts: table.list(spans),
            terms: buffers,
        })
    }
}

impl OccluderBuffers {
    /// Creates the buffers. `ordered` are the operator's rows in the order of their links.
    pub fn new(
        make: &BufferFactory<'_>,
        table: &mut SpanTable<'_>,
        scene: &BakedScene,
        occluders: &Occluders,
        ordered: &[Row],
    ) -> Result<Self, GpuError> {
        let rows = scene.data().probes.as_ref().map_or(&[][..], |p| &p.rows);
        Ok(Self {
            links: OccludedLinkBuffers::new(make, table, ordered, &occluders.links)?,
            probes: OccludedLinkBuffers::new(make, table, rows, &occluders.probes)?,
            set_transmittances: make
                .empty::<f32>("occluder transmittances", occluders.sets.len() as u64)?,
        })
    }

    /// Returns every buffer with its name.
    pub fn named_buffers(&self) -> impl Iterator<Item = (&'static str, &wgpu::Buffer)> {
        let terms = self.links.terms.iter().chain(&self.probes.terms);
        (terms.map(|b| ("occluded link terms", b))).chain(std::iter::once((
            "occluder transmittances",
            &self.set_transmittances,
        )))
    }
}

impl GpuFrame {
    /// Sets the transmittance of the occluders of `scene`, from which the frame was created, in [0,
    /// 1]. Missing values are 1. Rewrites the occluders' links, the senders' sky terms and the
    /// occluders of shadow rays. The new values apply to the frame that is submitted next. Call it
    /// at most once per submission. Returns the number of dispatches, 0 if the bake has no
    /// occluders. The lights' shadows change, so [`project`](Self::project) all slots afterwards.
    pub fn set_occluders(
        &mut self,
        kernels: &KernelPipelines,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        scene: &BakedScene,
        transmittances: &[f32],
    ) -> u64 {
        let Some(known) = &scene.data().occluders else {
            return 0;
        };
        let transmittances = sanitize_transmittances(known, transmittances);
        let set_transmittances = occluder_set_transmittances(known, &transmittances);
        let before = self.counters().dispatches_of(EntryPoint::Occlude);
        let buffers = self.buffers();
        if let Some(own) = &buffers.occluders {
            queue.write_buffer(
                &own.set_transmittances,
                0,
                bytemuck::cast_slice(&set_transmittances),
            );
            let first = scene.data().bvh.first_occluder();
            let mut moving = Bvh {
                nodes: Vec::new(),
                triangles: scene.data().bvh.triangles[first..].to_vec(),
            };
            moving.set_transmittances(&transmittances);
            let triangles: &[u8] = bytemuck::cast_slice(&moving.triangles);
            let size = size_of::<meshless_gi::internals::scene::BvhTriangle>();
            queue.write_buffer(&buffers.triangles, (first * size) as u64, triangles);
            let probe_links = buffers.probes.as_ref().map_or(&[][..], |p| &p.links);
            let link_terms = own.links.parts.at.iter().zip(&own.links.terms);
            let link_terms = link_terms.zip(&buffers.links);
            let probe_terms = own.probes.parts.at.iter().zip(&own.probes.terms);
            let mut dispatched = 0;
            let mut pass = compute(encoder, "meshless_gi occlude");
            pass.set_pipeline(&kernels.compute_kernel(EntryPoint::Occlude).pipeline);
            for ((&(offset, span), terms), links) in link_terms.chain(probe_terms.zip(probe_links))
            {
                if span.count == 0 {
                    continue;
                }
                let spans = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                    buffer: &buffers.spans,
                    offset: 0,
                    size: std::num::NonZeroU64::new(size_of::<Span>() as u64),
                });
                let bind = kernels.bind(
                    EntryPoint::Occlude,
                    &[
                        (1, spans),
                        (2, terms.as_entire_binding()),
                        (3, own.set_transmittances.as_entire_binding()),
                        (4, links.as_entire_binding()),
                    ],
                );
                pass.set_bind_group(0, &bind, &[offset]);
                let groups = span.count.div_ceil(64);
                pass.dispatch_workgroups(groups.min(MAX_GROUPS), groups.div_ceil(MAX_GROUPS), 1);
                dispatched += 1;
            }
            drop(pass);
            (0..dispatched).for_each(|_| self.count(EntryPoint::Occlude));
        }
        self.update_transmittances(queue, scene, set_transmittances);
        self.counters().dispatches_of(EntryPoint::Occlude) - before
    }
}
