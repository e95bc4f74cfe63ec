//! Probes of a baked scene on the GPU: `apply` over their rows, and `probe` over the pixels of a
//! view. A scene without probes has no such buffers.

use super::buffer_factory::BufferFactory;
use super::dispatch::compute;
use super::frame::SplatTargets;
use super::links::split_links;
use super::pipelines::KernelPipelines;
use super::scene_buffers::ViewBuffers;
use super::spans::{SpanList, SpanTable, part_span};
use super::{EntryPoint, GpuError, GpuFrame};
use meshless_gi::internals::asset::Probes;
use meshless_gi::internals::frame::{GridShape, SplatParams, VectorIrradiance};

/// Probes of a baked scene.
#[derive(Debug)]
pub(super) struct ProbeBuffers {
    pub grid: GridShape,
    /// Spans of the rows of each chunk of links.
    pub parts: SpanList,
    pub links: Vec<wgpu::Buffer>,
    pub rows: wgpu::Buffer,
    pub order: wgpu::Buffer,
    pub points: wgpu::Buffer,
    pub planes: wgpu::Buffer,
    pub grid_slots: wgpu::Buffer,
    pub grid_entries: wgpu::Buffer,
    pub values: wgpu::Buffer,
}

impl ProbeBuffers {
    pub fn new(
        make: &BufferFactory<'_>,
        table: &mut SpanTable<'_>,
        probes: &Probes,
    ) -> Result<Self, GpuError> {
        let parts = split_links(&probes.rows, make.limit)?;
        let links = parts
            .iter()
            .map(|p| {
                let links = p.links.start as usize..p.links.end as usize;
                make.upload("probe links", &probes.links[links])
            })
            .collect::<Result<Vec<_>, _>>()?;
        let rows = probes.rows.len() as u32;
        let order: Vec<u32> = (0..rows).collect();
        Ok(Self {
            grid: (&probes.grid).into(),
            parts: table.list(parts.iter().map(|p| part_span(p, rows))),
            links,
            rows: make.upload("probe rows", &probes.rows)?,
            order: make.upload("probe row order", &order)?,
            points: make.upload("probes", &probes.points)?,
            planes: make.upload("probe planes", &probes.planes)?,
            grid_slots: make.upload("probe grid slots", &probes.grid.slots)?,
            grid_entries: make.upload("probe grid entries", &probes.grid.entries)?,
            values: make.empty::<VectorIrradiance>("probe values", u64::from(rows))?,
        })
    }

    /// Returns every buffer with its name.
    pub fn named_buffers(&self) -> impl Iterator<Item = (&'static str, &wgpu::Buffer)> {
        [
            ("probe rows", &self.rows),
            ("probe row order", &self.order),
            ("probes", &self.points),
            ("probe planes", &self.planes),
            ("probe grid slots", &self.grid_slots),
            ("probe grid entries", &self.grid_entries),
            ("probe values", &self.values),
        ]
        .into_iter()
        .chain(self.links.iter().map(|b| ("probe links", b)))
    }

    /// Returns the bindings of both entry points of `probe`. These include the view's parameters
    /// for the probes' grid, its depths and its G-buffer.
    pub fn resources<'a>(
        &'a self,
        params: &'a wgpu::Buffer,
        depth: &'a wgpu::TextureView,
        gbuffer: &'a wgpu::TextureView,
    ) -> Vec<(u32, wgpu::BindingResource<'a>)> {
        let texture = wgpu::BindingResource::TextureView;
        vec![
            (0, params.as_entire_binding()),
            (1, texture(depth)),
            (2, texture(gbuffer)),
            (3, self.points.as_entire_binding()),
            (4, self.planes.as_entire_binding()),
            (5, self.grid_slots.as_entire_binding()),
            (6, self.grid_entries.as_entire_binding()),
            (7, self.values.as_entire_binding()),
        ]
    }
}

impl GpuFrame {
    /// Returns `true` if the scene has probes.
    #[must_use]
    pub fn has_probes(&self) -> bool {
        self.buffers().probes.is_some()
    }

    /// Returns a view's [`SplatParams`] for the probes' grid. Returns `None` if the scene has no
    /// probes.
    #[must_use]
    pub fn probe_params(&self, view: &SplatParams) -> Option<SplatParams> {
        let probes = self.buffers().probes.as_ref()?;
        Some(view.with_grid(probes.grid))
    }

    /// Writes the irradiance of the pixels that no surface function covers. Call it after the
    /// `splat` of the view's last scene. Its output is `earlier`. Does nothing if the scene has no
    /// probes, or if the view's parameters for them were not set ([`ViewBuffers::write_probes`]).
    pub fn probe(
        &mut self,
        kernels: &KernelPipelines,
        encoder: &mut wgpu::CommandEncoder,
        view: &ViewBuffers,
        targets: &SplatTargets<'_>,
    ) {
        let [width, height] = view.size;
        let (Some(probes), Some(params), Some(earlier)) =
            (&self.buffers().probes, &view.probes, targets.earlier)
        else {
            return;
        };
        if width == 0 || height == 0 {
            return;
        }
        let mut resources = probes.resources(params, targets.depth, targets.gbuffer);
        resources.push((8, wgpu::BindingResource::TextureView(targets.output)));
        resources.push((9, wgpu::BindingResource::TextureView(earlier)));
        let bind = kernels.bind(EntryPoint::ProbeOver, &resources);
        let mut pass = compute(encoder, "meshless_gi probe");
        pass.set_pipeline(&kernels.compute_kernel(EntryPoint::ProbeOver).pipeline);
        pass.set_bind_group(0, &bind, &[]);
        pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
        drop(pass);
        self.count(EntryPoint::ProbeOver);
    }
}
