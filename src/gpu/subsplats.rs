//! Recording of a view's subsplats: the kernels `pyramid`, `refine`, `splat` (nodes), `vpl` (nodes)
//! and `upsample`. Their order is that of [`meshless_gi::internals::frame::subsplats`]. The GPU
//! selects the cells to evaluate, by lists that grow by atomics and by indirect dispatches. Nothing
//! is read back.

use super::EntryPoint;
use super::buffer_factory::{binding_limit, uniform};
use super::dispatch::{MAX_GROUPS, compute};
use super::pipelines::KernelPipelines;
use super::rsm::{RsmBuffers, VplShadows};
use super::scene_buffers::{SceneBuffers, ViewBuffers};
use super::{GpuCounters, GpuError};
use meshless_gi::internals::frame::pyramid::CellRange;
use meshless_gi::internals::frame::subsplat::LEVELS;
use meshless_gi::internals::frame::{Span, SubsplatLevels, SubsplatNode, SubsplatParams};

/// Number of words of a count: an indirect dispatch, the number of items, the number of cells
/// divided for them, and unused words.
const COUNT: u64 = 8;

/// Textures that a view's subsplats read and write. All have the size of the view's target.
#[derive(Clone, Copy, Debug)]
pub struct SubsplatTargets<'a> {
    /// Depth, reversed (0 is infinitely far), one sample per pixel.
    pub depth: &'a wgpu::TextureView,
    /// Bevy's deferred G-buffer, `Rgba32Uint`.
    pub gbuffer: &'a wgpu::TextureView,
    /// Output texture, `Rgba16Float`.
    pub output: &'a wgpu::TextureView,
}

/// Virtual point lights that light a view's subsplats.
#[derive(Clone, Copy, Debug)]
pub struct NodeLights<'a> {
    /// Buffers of the lights.
    pub maps: &'a RsmBuffers,
    /// Uniform buffer with [`VplViewParams`](meshless_gi::internals::frame::VplViewParams).
    pub view: &'a wgpu::Buffer,
    /// Uniform buffer with [`VplParams`](meshless_gi::internals::frame::VplParams).
    pub lit: &'a wgpu::Buffer,
    /// Baked scene that shadows the virtual point lights, if there is one.
    pub shadows: Option<VplShadows<'a>>,
}

/// Buffers of a view, and its recording.
#[derive(Debug)]
pub struct SubsplatBuffers {
    levels: SubsplatLevels,
    finest: u32,
    params: wgpu::Buffer,
    /// Spans of the levels: index of the level, and the capacity of its list in items.
    spans: wgpu::Buffer,
    stride: u32,
    cells: wgpu::Buffer,
    nodes: wgpu::Buffer,
    lists: wgpu::Buffer,
    /// Counts, one buffer per level. A dispatch cannot write the buffer of its own indirect
    /// arguments.
    counts: Vec<wgpu::Buffer>,
    /// Count of zero items.
    none: wgpu::Buffer,
    counters: GpuCounters,
}

impl SubsplatBuffers {
    /// Creates buffers for views of these levels.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] if a buffer does not fit a binding of the device. Evaluate every
    /// pixel of the view in this case.
    pub fn new(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        levels: SubsplatLevels,
    ) -> Result<Self, GpuError> {
        let limit = binding_limit(device);
        let storage = |what: &'static str, bytes: u64, extra: wgpu::BufferUsages| {
            if bytes > limit {
                return Err(GpuError::TooLarge { what, bytes, limit });
            }
            Ok(device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(what),
                size: bytes,
                usage: wgpu::BufferUsages::STORAGE
                    | wgpu::BufferUsages::COPY_DST
                    | wgpu::BufferUsages::COPY_SRC
                    | extra,
                mapped_at_creation: false,
            }))
        };
        let none = wgpu::BufferUsages::empty();
        let total = u64::from(levels.total());
        let align = device.limits().min_uniform_buffer_offset_alignment;
        let stride = (size_of::<Span>() as u32).next_multiple_of(align.max(1));
        let spans = uniform(device, "subsplat levels", u64::from(stride) * LEVELS as u64);
        for k in 0..=levels.coarsest_level {
            let span = Span {
                first: k,
                count: levels.cells(k),
                ..Span::default()
            };
            queue.write_buffer(&spans, u64::from(stride * k), bytemuck::bytes_of(&span));
        }
        let counts = (0..=levels.coarsest_level)
            .map(|_| storage("subsplat count", 4 * COUNT, wgpu::BufferUsages::INDIRECT))
            .collect::<Result<_, _>>()?;
        let zero = storage("no subsplats", 4 * COUNT, none)?;
        queue.write_buffer(&zero, 0, bytemuck::cast_slice(&[0u32, 1, 1, 0, 0, 0, 0, 0]));
        Ok(Self {
            levels,
            finest: 1,
            params: uniform(device, "subsplat view", size_of::<SubsplatParams>() as u64),
            spans,
            stride,
            cells: storage(
                "subsplat cells",
                u64::from(levels.starts[0]) * size_of::<CellRange>() as u64,
                none,
            )?,
            nodes: storage(
                "subsplat nodes",
                total * size_of::<SubsplatNode>() as u64,
                none,
            )?,
            lists: storage("subsplat lists", total * 4, none)?,
            counts,
            none: zero,
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
        6 + self.counts.len() as u32
    }

    /// Returns the size of its buffers in bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let own = [
            &self.params,
            &self.spans,
            &self.cells,
            &self.nodes,
            &self.lists,
            &self.none,
        ];
        let all = own.into_iter().chain(&self.counts);
        all.map(wgpu::Buffer::size).sum()
    }

    /// Returns the work recorded so far.
    #[must_use]
    pub fn counters(&self) -> GpuCounters {
        self.counters
    }

    /// Returns the nodes of all levels, for tests and tools.
    #[must_use]
    pub fn nodes(&self) -> &wgpu::Buffer {
        &self.nodes
    }

    /// Returns the cells of the pyramid, for tests and tools.
    #[must_use]
    pub fn cells(&self) -> &wgpu::Buffer {
        &self.cells
    }

    /// Returns the lists of all levels, for tests and tools.
    #[must_use]
    pub fn lists(&self) -> &wgpu::Buffer {
        &self.lists
    }

    /// Returns the count of level `k`. Word 3 is the number of its items, word 4 the number of
    /// cells divided for them.
    #[must_use]
    pub fn count_of(&self, k: u32) -> &wgpu::Buffer {
        &self.counts[k as usize]
    }

    /// Sets the parameters for the frame that is submitted next. Their levels are
    /// [`SubsplatBuffers::levels`].
    pub fn write(&mut self, queue: &wgpu::Queue, params: &SubsplatParams) {
        debug_assert_eq!(params.levels(), self.levels);
        self.finest = params.finest_level;
        queue.write_buffer(&self.params, 0, bytemuck::bytes_of(params));
    }

    /// Records all dispatches between the G-buffer and the irradiance of every pixel. `scenes` are
    /// evaluated in their order. `lights` are added.
    pub fn record(
        &mut self,
        kernels: &KernelPipelines,
        encoder: &mut wgpu::CommandEncoder,
        targets: &SubsplatTargets<'_>,
        scenes: &[(&SceneBuffers, &ViewBuffers)],
        lights: Option<&NodeLights<'_>>,
    ) {
        let [width, height] = self.levels.size;
        if width == 0 || height == 0 {
            return;
        }
        let coarsest = self.levels.coarsest_level;
        for count in &self.counts {
            encoder.copy_buffer_to_buffer(&self.none, 0, count, 0, 4 * COUNT);
        }
        // No node has been evaluated yet.
        let node = size_of::<SubsplatNode>() as u64;
        let start = u64::from(self.levels.starts[coarsest as usize]) * node;
        encoder.clear_buffer(
            &self.nodes,
            start,
            Some(u64::from(self.levels.cells(coarsest)) * node),
        );
        let mut recorder = SubsplatRecorder {
            kernels,
            b: self,
            targets,
            pass: compute(encoder, "meshless_gi subsplats"),
            counters: GpuCounters::default(),
        };
        recorder.pyramid();
        recorder.start();
        for k in (1..=coarsest).rev() {
            if k < coarsest {
                recorder.upsample(k);
            }
            if k >= recorder.b.finest {
                recorder.evaluate(k, scenes, lights);
            }
            if k > recorder.b.finest {
                recorder.refine(k);
            }
        }
        recorder.resolve();
        recorder.evaluate(0, scenes, lights);
        recorder.fill();
        let counted = recorder.counters;
        drop(recorder);
        self.counters.add(&counted);
    }
}

/// Records dispatches into one pass. Each dispatch reads the output of earlier ones.
struct SubsplatRecorder<'a> {
    kernels: &'a KernelPipelines,
    b: &'a SubsplatBuffers,
    targets: &'a SubsplatTargets<'a>,
    pass: wgpu::ComputePass<'a>,
    counters: GpuCounters,
}

/// Number of workgroups of a dispatch.
enum Groups<'a> {
    Direct([u32; 2]),
    From(&'a wgpu::Buffer),
}

impl SubsplatRecorder<'_> {
    /// Binds and dispatches an entry point. `level` is its span, if it has one.
    fn run(
        &mut self,
        entry_point: EntryPoint,
        resources: &[(u32, wgpu::BindingResource<'_>)],
        level: Option<u32>,
        groups: &Groups<'_>,
    ) {
        let bind = self.kernels.bind(entry_point, resources);
        self.pass
            .set_pipeline(&self.kernels.compute_kernel(entry_point).pipeline);
        match level {
            Some(k) => self.pass.set_bind_group(0, &bind, &[k * self.b.stride]),
            None => self.pass.set_bind_group(0, &bind, &[]),
        }
        match groups {
            Groups::Direct([x, y]) => self.pass.dispatch_workgroups(*x, *y, 1),
            Groups::From(buffer) => self.pass.dispatch_workgroups_indirect(buffer, 0),
        }
        self.counters.dispatches[entry_point as usize] += 1;
    }

    fn pyramid(&mut self) {
        let b = self.b;
        self.run(
            EntryPoint::PyramidBase,
            &[
                (0, b.params.as_entire_binding()),
                (2, texture(self.targets.depth)),
                (3, texture(self.targets.gbuffer)),
                (4, b.cells.as_entire_binding()),
            ],
            None,
            &tiles(b.levels.grid(1)),
        );
        for k in 2..=b.levels.coarsest_level {
            self.run(
                EntryPoint::PyramidReduce,
                &[
                    (0, b.params.as_entire_binding()),
                    (1, b.span()),
                    (4, b.cells.as_entire_binding()),
                ],
                Some(k),
                &tiles(b.levels.grid(k)),
            );
        }
    }

    fn start(&mut self) {
        let b = self.b;
        let coarsest = b.levels.coarsest_level;
        let groups = b.levels.cells(coarsest).div_ceil(64);
        self.run(
            EntryPoint::RefineStart,
            &[
                (0, b.params.as_entire_binding()),
                (6, b.lists.as_entire_binding()),
                (8, b.counts[coarsest as usize].as_entire_binding()),
            ],
            None,
            &Groups::Direct([groups.min(MAX_GROUPS), groups.div_ceil(MAX_GROUPS)]),
        );
    }

    fn upsample(&mut self, k: u32) {
        let b = self.b;
        self.run(
            EntryPoint::Upsample,
            &[
                (0, b.params.as_entire_binding()),
                (1, b.span()),
                (2, texture(self.targets.depth)),
                (3, texture(self.targets.gbuffer)),
                (4, b.nodes.as_entire_binding()),
            ],
            Some(k),
            &tiles(b.levels.grid(k)),
        );
    }

    /// Evaluates the light of the items in the list of level `k`.
    fn evaluate(
        &mut self,
        k: u32,
        scenes: &[(&SceneBuffers, &ViewBuffers)],
        lights: Option<&NodeLights<'_>>,
    ) {
        let b = self.b;
        let count = &b.counts[k as usize];
        for (scene, view) in scenes {
            self.run(
                EntryPoint::SplatNodes,
                &[
                    (0, view.splat.as_entire_binding()),
                    (1, texture(self.targets.depth)),
                    (2, texture(self.targets.gbuffer)),
                    (3, scene.points.as_entire_binding()),
                    (4, scene.planes.as_entire_binding()),
                    (5, scene.grid_slots.as_entire_binding()),
                    (6, scene.grid_entries.as_entire_binding()),
                    (7, scene.values.as_entire_binding()),
                    (10, b.params.as_entire_binding()),
                    (11, b.span()),
                    (12, b.nodes.as_entire_binding()),
                    (13, b.lists.as_entire_binding()),
                    (14, count.as_entire_binding()),
                ],
                Some(k),
                &Groups::From(count),
            );
        }
        // Probes light the nodes that no surface function covers, such as those of dynamic objects.
        for (scene, view) in scenes {
            let (Some(probes), Some(params)) = (&scene.probes, &view.probes) else {
                continue;
            };
            let mut resources = probes.resources(params, self.targets.depth, self.targets.gbuffer);
            resources.extend([
                (10, b.params.as_entire_binding()),
                (11, b.span()),
                (12, b.nodes.as_entire_binding()),
                (13, b.lists.as_entire_binding()),
                (14, count.as_entire_binding()),
            ]);
            let from = Groups::From(count);
            self.run(EntryPoint::ProbeNodes, &resources, Some(k), &from);
        }
        if let Some(lights) = lights {
            let [nodes, triangles] = lights.maps.tree(lights.shadows.as_ref());
            self.run(
                EntryPoint::VplNodes,
                &[
                    (0, lights.view.as_entire_binding()),
                    (1, texture(self.targets.depth)),
                    (2, texture(self.targets.gbuffer)),
                    (3, lights.lit.as_entire_binding()),
                    (4, lights.maps.vpls().as_entire_binding()),
                    (5, nodes.as_entire_binding()),
                    (6, triangles.as_entire_binding()),
                    (10, b.params.as_entire_binding()),
                    (11, b.span()),
                    (12, b.nodes.as_entire_binding()),
                    (13, b.lists.as_entire_binding()),
                    (14, count.as_entire_binding()),
                ],
                Some(k),
                &Groups::From(count),
            );
        }
    }

    fn refine(&mut self, k: u32) {
        let b = self.b;
        let [count, next] = [k, k - 1].map(|k| &b.counts[k as usize]);
        self.run(
            EntryPoint::Refine,
            &[
                (0, b.params.as_entire_binding()),
                (1, b.span()),
                (3, texture(self.targets.gbuffer)),
                (4, b.cells.as_entire_binding()),
                (5, b.nodes.as_entire_binding()),
                (6, b.lists.as_entire_binding()),
                (7, count.as_entire_binding()),
                (8, next.as_entire_binding()),
            ],
            Some(k),
            &Groups::From(count),
        );
    }

    fn resolve(&mut self) {
        let b = self.b;
        self.run(
            EntryPoint::Resolve,
            &[
                (0, b.params.as_entire_binding()),
                (2, texture(self.targets.depth)),
                (3, texture(self.targets.gbuffer)),
                (4, b.nodes.as_entire_binding()),
                (5, b.lists.as_entire_binding()),
                (6, b.counts[0].as_entire_binding()),
                (7, texture(self.targets.output)),
            ],
            None,
            &tiles(b.levels.size),
        );
    }

    fn fill(&mut self) {
        let b = self.b;
        self.run(
            EntryPoint::Fill,
            &[
                (0, b.params.as_entire_binding()),
                (2, texture(self.targets.depth)),
                (3, texture(self.targets.gbuffer)),
                (4, b.nodes.as_entire_binding()),
                (5, b.lists.as_entire_binding()),
                (7, texture(self.targets.output)),
                (8, b.counts[0].as_entire_binding()),
            ],
            None,
            &Groups::From(&b.counts[0]),
        );
    }
}

impl SubsplatBuffers {
    /// Returns the binding of the spans, for a dynamic offset per level.
    fn span(&self) -> wgpu::BindingResource<'_> {
        wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: &self.spans,
            offset: 0,
            size: wgpu::BufferSize::new(size_of::<Span>() as u64),
        })
    }
}

fn texture(view: &wgpu::TextureView) -> wgpu::BindingResource<'_> {
    wgpu::BindingResource::TextureView(view)
}

/// Returns groups of 8 × 8 pixels.
fn tiles([width, height]: [u32; 2]) -> Groups<'static> {
    Groups::Direct([width.div_ceil(8), height.div_ceil(8)])
}
