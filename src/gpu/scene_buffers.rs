//! Baked scene on the GPU: its arrays, uploaded once, and the arrays that a solve fills.

use super::EntryPoint;
use super::GpuError;
use super::buffer_factory::{BufferFactory, binding_limit, uniform};
use super::fmm::GpuFmm;
use super::link_tables::LinkTables;
use super::occlude::OccluderBuffers;
use super::probes::ProbeBuffers;
use super::spans::{SpanList, SpanTable, span};
use meshless_gi::internals::frame::{
    CompositeParams, GridShape, SceneDimensions, SolveParams, SplatParams, VectorIrradiance,
};
use meshless_gi::internals::transport::pca::Compression;
use meshless_gi::internals::transport::{BounceOperator, SenderForm};
use meshless_gi::{BakedScene, FrameLight};

/// Baked bounces on the GPU.
#[derive(Debug)]
pub(super) struct BounceBuffers {
    pub starts: wgpu::Buffer,
    pub links: wgpu::Buffer,
    pub further: wgpu::Buffer,
}

/// Matrix of an operator of components on the GPU, and its product with the senders.
#[derive(Debug)]
pub(super) struct ComponentBuffers {
    pub columns: wgpu::Buffer,
    pub members: wgpu::Buffer,
    pub values: wgpu::Buffer,
    pub components: wgpu::Buffer,
}

/// Buffers of a baked scene.
#[derive(Debug)]
pub struct SceneBuffers {
    pub(super) shape: SceneDimensions,
    pub(super) grid: GridShape,
    pub(super) params: wgpu::Buffer,
    pub(super) spans: wgpu::Buffer,
    /// Spans of the levels, one per level.
    pub(super) levels: SpanList,
    /// Span of all points, then the span of the senders.
    pub(super) whole: SpanList,
    /// Rows of each tier and chunk of links, as a range of `order`. The count is 0 if the tier uses
    /// no row of the chunk.
    pub(super) tier_parts: Vec<SpanList>,
    /// The same ranges of the senders' rows alone.
    pub(super) sender_parts: Vec<SpanList>,
    pub(super) links: Vec<wgpu::Buffer>,
    pub(super) points: wgpu::Buffer,
    pub(super) light_samples: wgpu::Buffer,
    pub(super) surfaces: wgpu::Buffer,
    pub(super) rows: wgpu::Buffer,
    /// Rows in the order of their links, followed by the senders' rows alone.
    pub(super) order: wgpu::Buffer,
    pub(super) pull_starts: wgpu::Buffer,
    pub(super) pull_entries: wgpu::Buffer,
    pub(super) parent_starts: wgpu::Buffer,
    pub(super) parent_entries: wgpu::Buffer,
    pub(super) planes: wgpu::Buffer,
    pub(super) grid_slots: wgpu::Buffer,
    pub(super) grid_entries: wgpu::Buffer,
    pub(super) nodes: wgpu::Buffer,
    pub(super) triangles: wgpu::Buffer,
    pub(super) bounces: Option<BounceBuffers>,
    pub(super) lights: wgpu::Buffer,
    pub(super) changed: wgpu::Buffer,
    pub(super) projected: wgpu::Buffer,
    pub(super) senders: wgpu::Buffer,
    /// Visible part of the sky's terms for each sender. `None` if the bake has no such data.
    pub(super) sky: Option<wgpu::Buffer>,
    /// Direct coefficients, kept while further bounces are added. Created by the first solve that
    /// has further bounces.
    pub(super) direct: Option<wgpu::Buffer>,
    /// Differences of the senders, and the operator's product with them. `None` if the operator has
    /// another form.
    pub(super) differences: Option<[wgpu::Buffer; 2]>,
    /// Operator in the form of components. `None` if it has another form.
    pub(super) components: Option<ComponentBuffers>,
    /// Octree that carries the light. `None` if there is no octree.
    pub(super) fmm: Option<GpuFmm>,
    pub(super) values: wgpu::Buffer,
    /// Probes. `None` if the bake has no probes.
    pub(super) probes: Option<ProbeBuffers>,
    /// Occluders. `None` if the bake has no occluders.
    pub(super) occluders: Option<OccluderBuffers>,
    pub(super) slots: u32,
}

impl BounceBuffers {
    fn new(
        make: &BufferFactory<'_>,
        bounces: &BounceOperator,
        coefficients: u64,
    ) -> Result<Self, GpuError> {
        Ok(Self {
            starts: make.upload("bounce rows", &bounces.starts)?,
            links: make.upload("bounce links", &bounces.links)?,
            further: make.empty::<[f32; 4]>("further radiosity", coefficients)?,
        })
    }
}

impl ComponentBuffers {
    fn new(make: &BufferFactory<'_>, compression: &Compression) -> Result<Self, GpuError> {
        Ok(Self {
            columns: make.upload("columns", &compression.columns)?,
            members: make.upload("column senders", &compression.members)?,
            values: make.upload("column values", &compression.values)?,
            components: make.empty::<[f32; 4]>("components", compression.columns.len() as u64)?,
        })
    }
}

impl SceneBuffers {
    /// Uploads `scene`, with capacity for `slots` light slots.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] if an array does not fit a binding of the device. Only the links are
    /// split into chunks. An octree that exceeds the limits is left out if the scene has links.
    /// Without links it is an error (for its order, [`GpuError::Limit`]).
    pub fn new(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        scene: &BakedScene,
        slots: u32,
    ) -> Result<Self, GpuError> {
        Self::with_limit(device, queue, scene, slots, binding_limit(device))
    }

    /// Uploads `scene` as [`SceneBuffers::new`] does, for bindings of at most `limit` bytes. For
    /// tests of the chunks.
    ///
    /// # Errors
    /// See [`SceneBuffers::new`].
    pub fn with_limit(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        scene: &BakedScene,
        slots: u32,
        limit: u64,
    ) -> Result<Self, GpuError> {
        let make = BufferFactory {
            device,
            queue,
            limit,
        };
        let mut shape = SceneDimensions::new(scene.data());
        let slots = slots.max(1);
        let (points, senders) = (shape.points() as u64, shape.senders() as u64);

        let octree = scene
            .data()
            .fmm
            .as_ref()
            .map(|octree| GpuFmm::with_limit(device, queue, octree, senders as u32, limit));
        let fmm = match octree {
            Some(Err(_)) if shape.link_tiers > 0 => None,
            other => other.transpose()?,
        };
        shape.octree = fmm.is_some();
        let mut table = SpanTable::new(device);
        let levels = table.list((0..shape.levels()).map(|l| span(shape.level(l))));
        let whole = table.list([span(0..shape.points()), span(0..shape.senders())]);
        let LinkTables {
            ordered,
            order,
            links,
            tier_parts,
            sender_parts,
        } = LinkTables::new(&make, &mut table, scene, &shape)?;

        let probes = (scene.data().probes.as_ref())
            .map(|probes| ProbeBuffers::new(&make, &mut table, probes))
            .transpose()?;
        let occluders = (scene.data().occluders.as_ref())
            .map(|known| OccluderBuffers::new(&make, &mut table, scene, known, &ordered))
            .transpose()?;
        let coefficients = |what| make.empty::<[f32; 4]>(what, shape.coefficients() as u64);
        let sky = (scene.data().sky.as_ref()).map(|s| make.upload("sky terms", &s.senders));
        let bounces = (scene.data().bounces.as_ref())
            .map(|b| BounceBuffers::new(&make, b, shape.coefficients() as u64))
            .transpose()?;
        let differences = match shape.form {
            SenderForm::Averages | SenderForm::Components => None,
            SenderForm::Differences => Some([
                coefficients("sender differences")?,
                make.empty::<VectorIrradiance>("receiver differences", points)?,
            ]),
        };
        let components = (scene.data().operator.compression.as_ref())
            .map(|c| ComponentBuffers::new(&make, c))
            .transpose()?;
        Ok(Self {
            grid: (&scene.data().display.grid).into(),
            params: uniform(device, "solve", size_of::<SolveParams>() as u64),
            spans: table.upload(queue),
            levels,
            whole,
            tier_parts,
            sender_parts,
            links,
            points: make.upload("points", &scene.data().points)?,
            light_samples: make.upload("light samples", &scene.data().light_samples.list)?,
            surfaces: make.upload("surfaces", &scene.data().surfaces)?,
            rows: make.upload("rows", &scene.data().operator.rows)?,
            order: make.upload("row order", &order)?,
            pull_starts: make.upload("pull rows", &scene.data().pull.starts)?,
            pull_entries: make.upload("pull weights", &scene.data().pull.entries)?,
            parent_starts: make.upload("parent rows", &scene.data().parents.starts)?,
            parent_entries: make.upload("parent weights", &scene.data().parents.entries)?,
            planes: make.upload("clip planes", &scene.data().display.planes)?,
            grid_slots: make.upload("grid slots", &scene.data().display.grid.slots)?,
            grid_entries: make.upload("grid entries", &scene.data().display.grid.entries)?,
            nodes: make.upload("BVH nodes", &scene.data().bvh.nodes)?,
            triangles: make.upload("BVH triangles", &scene.data().bvh.triangles)?,
            bounces,
            lights: make.empty::<FrameLight>("lights", u64::from(slots))?,
            changed: make.empty::<u32>("changed lights", u64::from(slots))?,
            projected: make.empty::<f32>("projected light", u64::from(slots) * senders)?,
            senders: coefficients("senders")?,
            sky: sky.transpose()?,
            direct: None,
            differences,
            components,
            fmm,
            values: make.empty::<VectorIrradiance>("vector irradiance", points)?,
            probes,
            occluders,
            slots,
            shape,
        })
    }

    /// Returns the buffer that kernels bind as the sky's terms. If the bake has none, it returns
    /// the buffer of surfaces as a valid stand-in.
    pub(super) fn sky_visibility(&self) -> &wgpu::Buffer {
        self.sky.as_ref().unwrap_or(&self.surfaces)
    }

    /// Returns the number of light slots that fit the buffers.
    #[must_use]
    pub fn slots(&self) -> u32 {
        self.slots
    }

    /// Returns the sizes of the scene.
    #[must_use]
    pub fn shape(&self) -> &SceneDimensions {
        &self.shape
    }

    /// Reserves `slots` light slots. Existing projections stay. Do not call it between
    /// recording a frame and its submission.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] if the projections of the lights do not fit a binding.
    pub fn reserve_slots(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        slots: u32,
    ) -> Result<(), GpuError> {
        if slots <= self.slots {
            return Ok(());
        }
        let make = BufferFactory::new(device, queue);
        // Reserves 50 % more, so that lights that are added one by one do not copy the buffer each
        // time. Reserves only the required size if more would exceed the limit.
        let senders = self.shape.senders() as u64;
        let with_reserve = slots.max(self.slots + self.slots / 2);
        let projected = |slots: u32| {
            make.empty::<f32>("projected light", u64::from(slots) * senders)
                .map(|buffer| (slots, buffer))
        };
        let (slots, projected) = projected(with_reserve).or_else(|_| projected(slots))?;
        let lights = make.empty::<FrameLight>("lights", u64::from(slots))?;
        let changed = make.empty::<u32>("changed lights", u64::from(slots))?;
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(&self.projected, 0, &projected, 0, self.projected.size());
        encoder.copy_buffer_to_buffer(&self.lights, 0, &lights, 0, self.lights.size());
        queue.submit([encoder.finish()]);
        (self.projected, self.lights, self.changed, self.slots) =
            (projected, lights, changed, slots);
        Ok(())
    }

    /// Returns the buffer of direct coefficients. The first call creates it.
    pub(super) fn ensure_direct(&mut self, device: &wgpu::Device) -> wgpu::Buffer {
        self.direct
            .get_or_insert_with(|| {
                device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some("direct senders"),
                    size: self.senders.size(),
                    usage: self.senders.usage(),
                    mapped_at_creation: false,
                })
            })
            .clone()
    }

    /// Returns the number of buffers on the device.
    #[must_use]
    pub fn count(&self) -> usize {
        self.named_buffers().count()
    }

    /// Returns the size of its buffers in bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.named_buffers().map(|(_, b)| b.size()).sum()
    }

    /// Returns the buffer that an entry point fills, for tests and tools.
    #[must_use]
    pub fn output(&self, entry_point: EntryPoint) -> Option<&wgpu::Buffer> {
        match entry_point {
            EntryPoint::Project => Some(&self.projected),
            EntryPoint::Radiosity | EntryPoint::Pull | EntryPoint::Sweep | EntryPoint::Add => {
                Some(&self.senders)
            }
            // The first chunk, if there are several.
            EntryPoint::Occlude => self.links.first(),
            EntryPoint::Compress => self.components.as_ref().map(|c| &c.components),
            EntryPoint::Push => self.differences.as_ref().map(|d| &d[0]),
            EntryPoint::Apply => self
                .differences
                .as_ref()
                .map_or(Some(&self.values), |d| Some(&d[1])),
            EntryPoint::Gather | EntryPoint::Interpolate => {
                self.bounces.as_ref().map(|b| &b.further)
            }
            EntryPoint::Averages | EntryPoint::Differences | EntryPoint::FmmEvaluate => {
                Some(&self.values)
            }
            EntryPoint::FmmUp => self.fmm.as_ref().map(|f| f.expansions()[0]),
            EntryPoint::FmmReceive => self.fmm.as_ref().map(|f| f.expansions()[1]),
            EntryPoint::ProbeNodes | EntryPoint::ProbeOver | EntryPoint::Volume => {
                self.probes.as_ref().map(|p| &p.values)
            }
            // Buffers of views and of lights' maps are not part of a scene.
            _ => None,
        }
    }

    /// Returns every buffer with its name.
    pub(super) fn named_buffers(&self) -> impl Iterator<Item = (&'static str, &wgpu::Buffer)> {
        let own = [
            ("params", &self.params),
            ("spans", &self.spans),
            ("points", &self.points),
            ("light samples", &self.light_samples),
            ("surfaces", &self.surfaces),
            ("rows", &self.rows),
            ("row order", &self.order),
            ("pull rows", &self.pull_starts),
            ("pull weights", &self.pull_entries),
            ("parent rows", &self.parent_starts),
            ("parent weights", &self.parent_entries),
            ("clip planes", &self.planes),
            ("grid slots", &self.grid_slots),
            ("grid entries", &self.grid_entries),
            ("BVH nodes", &self.nodes),
            ("BVH triangles", &self.triangles),
            ("lights", &self.lights),
            ("changed lights", &self.changed),
            ("projected light", &self.projected),
            ("senders", &self.senders),
            ("vector irradiance", &self.values),
        ];
        let bounces = self.bounces.iter().flat_map(|b| {
            [
                ("bounce rows", &b.starts),
                ("bounce links", &b.links),
                ("further radiosity", &b.further),
            ]
        });
        let differences = self
            .differences
            .iter()
            .flat_map(|[s, r]| [("sender differences", s), ("receiver differences", r)]);
        let components = self.components.iter().flat_map(|c| {
            [
                ("columns", &c.columns),
                ("column senders", &c.members),
                ("column values", &c.values),
                ("components", &c.components),
            ]
        });
        own.into_iter()
            .chain(self.links.iter().map(|b| ("links", b)))
            .chain(bounces)
            .chain(self.direct.iter().map(|b| ("direct senders", b)))
            .chain(self.sky.iter().map(|b| ("sky terms", b)))
            .chain(differences)
            .chain(components)
            .chain(self.fmm.iter().flat_map(GpuFmm::named_buffers))
            .chain(self.probes.iter().flat_map(ProbeBuffers::named_buffers))
            .chain(
                self.occluders
                    .iter()
                    .flat_map(OccluderBuffers::named_buffers),
            )
    }
}

/// Buffers of one baked scene in one view: parameters of `splat` and `composite`.
#[derive(Debug)]
pub struct ViewBuffers {
    pub(super) splat: wgpu::Buffer,
    pub(super) composite: wgpu::Buffer,
    /// Parameters of `probe`. `None` if the scene has no probes.
    pub(super) probes: Option<wgpu::Buffer>,
    pub(super) size: [u32; 2],
}

impl ViewBuffers {
    /// Creates the buffers for the parameters of a view.
    #[must_use]
    pub fn new(device: &wgpu::Device) -> Self {
        Self {
            splat: uniform(device, "splat", size_of::<SplatParams>() as u64),
            composite: uniform(device, "composite", size_of::<CompositeParams>() as u64),
            probes: None,
            size: [0; 2],
        }
    }

    /// Sets the parameters for the frame that is submitted next.
    pub fn write(&mut self, queue: &wgpu::Queue, splat: &SplatParams, composite: &CompositeParams) {
        queue.write_buffer(&self.splat, 0, bytemuck::bytes_of(splat));
        queue.write_buffer(&self.composite, 0, bytemuck::bytes_of(composite));
        self.size = splat.size;
    }

    /// Sets the parameters of `probe` ([`GpuFrame::probe_params`](super::GpuFrame::probe_params))
    /// for the frame that is submitted next. `None` if the scene has no probes.
    pub fn write_probes(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        params: Option<&SplatParams>,
    ) {
        let Some(params) = params else {
            self.probes = None;
            return;
        };
        let size = size_of::<SplatParams>() as u64;
        let buffer = (self.probes).get_or_insert_with(|| uniform(device, "probe", size));
        queue.write_buffer(buffer, 0, bytemuck::bytes_of(params));
    }

    /// Returns the size of its buffers in bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let all = [&self.splat, &self.composite].into_iter();
        all.chain(&self.probes).map(wgpu::Buffer::size).sum()
    }

    /// Returns the number of buffers.
    #[must_use]
    pub fn count(&self) -> u32 {
        2 + u32::from(self.probes.is_some())
    }
}
