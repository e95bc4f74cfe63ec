//! Records a frame of one baked scene: the steps of [`SolveSchedule`], which the CPU's frame runs too, as
//! dispatches.

use super::draw::draw_over;
use super::pipelines::{Draw, KernelPipelines};
use super::scene_buffers::{SceneBuffers, ViewBuffers};
use super::spans::SpanList;
use super::{GpuCounters, GpuError, Pass};
use glam::Mat4;
use meshless_gi::internals::frame::materials::current_surfaces;
use meshless_gi::internals::frame::splat::SEAM;
use meshless_gi::internals::frame::{SolveSchedule, SplatParams};
use meshless_gi::{BakedScene, FrameLight, FrameSettings, MaterialFactors};

/// Most slots that one dispatch of `project` takes: a dimension has 65 535 groups, and the list of
/// slots is bound at a multiple of 256 bytes, the largest alignment of WebGPU.
const SLOTS_PER_DISPATCH: usize = 65_535 / 64 * 64;

/// The textures that `splat` reads and writes. All have the size of the view's target.
#[derive(Clone, Copy, Debug)]
pub struct SplatTargets<'a> {
    /// Depth, reversed (0 is infinitely far), one sample a pixel.
    pub depth: &'a wgpu::TextureView,
    /// Bevy's deferred G-buffer, `Rgba32Uint`.
    pub gbuffer: &'a wgpu::TextureView,
    /// What an earlier baked scene of the same view wrote; None for the first.
    pub earlier: Option<&'a wgpu::TextureView>,
    /// `Rgba16Float`, another texture than `earlier`.
    pub output: &'a wgpu::TextureView,
}

/// A baked scene on the device, and what is recorded of it.
#[derive(Debug)]
pub struct GpuFrame {
    buffers: SceneBuffers,
    lights: usize,
    /// What the device's surfaces are of: factors of the materials, and what passes each set of
    /// occluders; empty as baked.
    factors: Vec<MaterialFactors>,
    passing: Vec<f32>,
    counters: GpuCounters,
}

impl GpuFrame {
    /// Uploads `scene`, with room for `slots` light slots.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], see [`SceneBuffers::new`].
    pub fn new(
        kernels: &KernelPipelines,
        queue: &wgpu::Queue,
        scene: &BakedScene,
        slots: u32,
    ) -> Result<Self, GpuError> {
        let buffers = SceneBuffers::new(kernels.device(), queue, scene, slots)?;
        Ok(Self::with_buffers(queue, buffers))
    }

    /// A frame over buffers that are there.
    #[must_use]
    pub fn with_buffers(queue: &wgpu::Queue, buffers: SceneBuffers) -> Self {
        // What `project` reads of it does not change any more.
        let params = buffers.shape.params(&FrameSettings::default(), 0);
        queue.write_buffer(&buffers.params, 0, bytemuck::bytes_of(&params));
        Self {
            buffers,
            lights: 0,
            factors: Vec::new(),
            passing: Vec::new(),
            counters: GpuCounters::default(),
        }
    }

    /// The buffers.
    #[must_use]
    pub fn buffers(&self) -> &SceneBuffers {
        &self.buffers
    }

    /// What was recorded so far.
    #[must_use]
    pub fn counters(&self) -> GpuCounters {
        self.counters
    }

    /// Sets the lights, slot by slot, in the bake's local space, for the frame that is submitted
    /// next; makes room where there is too little. What was projected stays: say which slots are to
    /// be projected by [`GpuFrame::project`].
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] where so many slots do not fit a binding.
    pub fn set_lights(
        &mut self,
        kernels: &KernelPipelines,
        queue: &wgpu::Queue,
        lights: &[FrameLight],
    ) -> Result<(), GpuError> {
        self.buffers
            .grow(kernels.device(), queue, lights.len() as u32)?;
        if !lights.is_empty() {
            queue.write_buffer(&self.buffers.lights, 0, bytemuck::cast_slice(lights));
        }
        self.lights = lights.len();
        Ok(())
    }

    /// Sets the factors of the materials of `scene`, which the frame was made of, for the frame
    /// that is submitted next: one each, those that are missing are as baked. Sends the senders'
    /// surfaces to the device; says how many bytes those are, 0 where the bake knows no materials.
    pub fn set_materials(
        &mut self,
        queue: &wgpu::Queue,
        scene: &BakedScene,
        factors: &[MaterialFactors],
    ) -> u64 {
        if scene.materials.is_none() {
            return 0;
        }
        self.factors = factors.to_vec();
        self.paint(queue, scene)
    }

    /// Notes what passes each set of occluders, and sends what that changes of the senders'
    /// surfaces.
    pub(super) fn occluded(&mut self, queue: &wgpu::Queue, scene: &BakedScene, passing: Vec<f32>) {
        self.passing = passing;
        self.paint(queue, scene);
    }

    /// Sends the senders' surfaces as they are now; says how many bytes those are.
    fn paint(&mut self, queue: &wgpu::Queue, scene: &BakedScene) -> u64 {
        let (surfaces, seen) = current_surfaces(scene, &self.factors, &self.passing);
        let bytes: &[u8] = bytemuck::cast_slice(&surfaces);
        if !bytes.is_empty() {
            queue.write_buffer(&self.buffers.surfaces, 0, bytes);
        }
        if let (Some(sky), false) = (&self.buffers.sky, self.passing.is_empty()) {
            queue.write_buffer(sky, 0, bytemuck::cast_slice(&seen));
        }
        bytes.len() as u64
    }

    /// Projects the lights of `slots`, one dispatch for all (several for more than 65 472). At most
    /// once a submission. Slots without a light are left out.
    pub fn project(
        &mut self,
        kernels: &KernelPipelines,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        slots: &[u32],
    ) {
        let slots: Vec<u32> = slots
            .iter()
            .copied()
            .filter(|&s| (s as usize) < self.lights)
            .collect();
        let senders = self.buffers.shape.senders() as u32;
        if slots.is_empty() || senders == 0 {
            return;
        }
        let b = &self.buffers;
        queue.write_buffer(&b.changed, 0, bytemuck::cast_slice(&slots));
        let mut pass = compute(encoder, "meshless_gi project");
        pass.set_pipeline(&kernels.pass(Pass::Project).pipeline);
        for (i, part) in slots.chunks(SLOTS_PER_DISPATCH).enumerate() {
            let changed = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                buffer: &b.changed,
                offset: (i * SLOTS_PER_DISPATCH * size_of::<u32>()) as u64,
                size: None,
            });
            let bind = kernels.bind(
                Pass::Project,
                &[
                    (0, b.params.as_entire_binding()),
                    (2, b.lights.as_entire_binding()),
                    (3, changed),
                    (4, b.points.as_entire_binding()),
                    (5, b.nodes.as_entire_binding()),
                    (6, b.triangles.as_entire_binding()),
                    (7, b.projected.as_entire_binding()),
                    (8, b.places.as_entire_binding()),
                ],
            );
            pass.set_bind_group(0, &bind, &[]);
            // A binding holds fewer points than the groups of one dimension cover.
            pass.dispatch_workgroups(senders.div_ceil(64), part.len() as u32, 1);
            self.counters.dispatches[Pass::Project as usize] += 1;
        }
        self.counters.projected += slots.len() as u64;
    }

    /// Computes the irradiance of all points from the projected lights: [`pull_push`](Self::pull_push),
    /// [`apply`](Self::apply), [`flatten`](Self::flatten), [`apply_probes`](Self::apply_probes). At
    /// most once a submission.
    pub fn solve(
        &mut self,
        kernels: &KernelPipelines,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        settings: &FrameSettings,
    ) {
        self.pull_push(kernels, queue, encoder, settings);
        self.apply(kernels, encoder, settings);
        self.flatten(kernels, encoder, settings);
        self.apply_probes(kernels, encoder, settings);
    }

    /// Computes the radiosity of the senders, with all bounces but the last.
    pub fn pull_push(
        &mut self,
        kernels: &KernelPipelines,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        settings: &FrameSettings,
    ) {
        let params = self.buffers.shape.params(settings, self.lights);
        queue.write_buffer(&self.buffers.params, 0, bytemuck::bytes_of(&params));
        let steps = SolveSchedule::new(&self.buffers.shape, settings);
        let direct =
            (steps.baked || steps.sweeps > 0).then(|| self.buffers.ensure_direct(kernels.device()));
        let mut recorder = self.recorder(kernels);
        {
            let mut pass = compute(encoder, "meshless_gi pull");
            recorder.radiosity(&mut pass);
            recorder.pull(&mut pass, 0..steps.pull.len());
        }
        let Some(direct) = direct else { return };
        let senders = &recorder.b.senders;
        encoder.copy_buffer_to_buffer(senders, 0, &direct, 0, direct.size());
        let mut pass = compute(encoder, "meshless_gi bounces");
        if steps.baked {
            recorder.baked(&mut pass, &direct, steps.senders.len());
        }
        for _ in 0..steps.sweeps {
            recorder.apply_operator(&mut pass, &steps, params.tier, true);
            recorder.flatten(&mut pass, &steps, true);
            recorder.sweep(&mut pass, &direct);
            recorder.pull(&mut pass, 0..steps.pull.len());
        }
    }

    /// Applies the operator to the senders, for all points. After [`pull_push`](Self::pull_push).
    pub fn apply(
        &mut self,
        kernels: &KernelPipelines,
        encoder: &mut wgpu::CommandEncoder,
        settings: &FrameSettings,
    ) {
        let tier = self.buffers.shape.params(settings, self.lights).tier;
        let steps = SolveSchedule::new(&self.buffers.shape, settings);
        let mut pass = compute(encoder, "meshless_gi apply");
        self.recorder(kernels)
            .apply_operator(&mut pass, &steps, tier, false);
        self.counters.solves += 1;
    }

    /// Computes the values of all points. After [`apply`](Self::apply).
    pub fn flatten(
        &mut self,
        kernels: &KernelPipelines,
        encoder: &mut wgpu::CommandEncoder,
        settings: &FrameSettings,
    ) {
        let steps = SolveSchedule::new(&self.buffers.shape, settings);
        let mut pass = compute(encoder, "meshless_gi flatten");
        self.recorder(kernels).flatten(&mut pass, &steps, false);
    }

    /// Applies the rows of the probes; nothing for a bake without probes. After
    /// [`pull_push`](Self::pull_push).
    pub fn apply_probes(
        &mut self,
        kernels: &KernelPipelines,
        encoder: &mut wgpu::CommandEncoder,
        settings: &FrameSettings,
    ) {
        let steps = SolveSchedule::new(&self.buffers.shape, settings);
        let mut pass = compute(encoder, "meshless_gi probes");
        self.recorder(kernels).light_space(&mut pass, &steps);
    }

    fn recorder<'a>(&'a mut self, kernels: &'a KernelPipelines) -> Recorder<'a> {
        Recorder {
            kernels,
            b: &self.buffers,
            counters: &mut self.counters,
        }
    }

    /// Parameters of a view of this scene; see [`SplatParams`].
    #[must_use]
    pub fn splat_params(
        &self,
        world_from_clip: Mat4,
        local_from_world: Mat4,
        viewport: [f32; 4],
        size: [u32; 2],
        scale: f32,
    ) -> SplatParams {
        let params = SplatParams::new(
            world_from_clip,
            local_from_world,
            viewport,
            size,
            scale,
            self.buffers.grid,
        );
        SplatParams {
            seam: if self.has_probes() { SEAM } else { 0.0 },
            ..params
        }
    }

    /// Writes the irradiance of each pixel of a view.
    pub fn splat(
        &mut self,
        kernels: &KernelPipelines,
        encoder: &mut wgpu::CommandEncoder,
        view: &ViewBuffers,
        targets: &SplatTargets<'_>,
    ) {
        let which = if targets.earlier.is_some() {
            Pass::SplatOver
        } else {
            Pass::Splat
        };
        let [width, height] = view.size;
        if width == 0 || height == 0 {
            return;
        }
        let b = &self.buffers;
        let texture = wgpu::BindingResource::TextureView;
        let mut resources = vec![
            (0, view.splat.as_entire_binding()),
            (1, texture(targets.depth)),
            (2, texture(targets.gbuffer)),
            (3, b.points.as_entire_binding()),
            (4, b.planes.as_entire_binding()),
            (5, b.grid_slots.as_entire_binding()),
            (6, b.grid_entries.as_entire_binding()),
            (7, b.values.as_entire_binding()),
            (8, texture(targets.output)),
        ];
        if let Some(earlier) = targets.earlier {
            resources.push((9, texture(earlier)));
        }
        let bind = kernels.bind(which, &resources);
        let mut pass = compute(encoder, "meshless_gi splat");
        pass.set_pipeline(&kernels.pass(which).pipeline);
        pass.set_bind_group(0, &bind, &[]);
        pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
        self.counters.dispatches[which as usize] += 1;
    }

    /// One more dispatch of `pass`.
    pub(super) fn count(&mut self, pass: Pass) {
        self.counters.dispatches[pass as usize] += 1;
    }

    /// Draws a view's irradiance onto its picture, added to it or (`replace`) in its place: `pass`
    /// has one target, of `format`. Once a view, after the `splat` of its last scene.
    #[expect(
        clippy::too_many_arguments,
        reason = "three textures and what they are drawn with"
    )]
    pub fn composite(
        &mut self,
        kernels: &KernelPipelines,
        pass: &mut wgpu::RenderPass<'_>,
        format: wgpu::TextureFormat,
        replace: bool,
        view: &ViewBuffers,
        irradiance: &wgpu::TextureView,
        gbuffer: &wgpu::TextureView,
        lighting_passes: &wgpu::TextureView,
    ) {
        let textures = [irradiance, gbuffer, lighting_passes];
        let how = if replace { Draw::Replace } else { Draw::Add };
        draw_over(kernels, pass, format, how, view, textures);
        self.counters.composites += 1;
    }
}

impl KernelPipelines {
    /// A bind group for a pass.
    pub fn bind(
        &self,
        pass: Pass,
        resources: &[(u32, wgpu::BindingResource<'_>)],
    ) -> wgpu::BindGroup {
        let entries: Vec<_> = resources
            .iter()
            .map(|(at, r)| entry(*at, r.clone()))
            .collect();
        self.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(pass.entry().1.name),
            layout: &self.pass(pass).layout,
            entries: &entries,
        })
    }
}

/// Buffers of the operator's input and output in the form of its senders.
fn operands(b: &SceneBuffers) -> [&wgpu::Buffer; 2] {
    match (&b.differences, &b.components) {
        (Some([senders, receivers]), _) => [senders, receivers],
        (None, Some(c)) => [&c.components, &b.values],
        (None, None) => [&b.senders, &b.values],
    }
}

/// Records the steps of a solve. Each dispatch sees what the ones before it in the same pass wrote.
struct Recorder<'a> {
    kernels: &'a KernelPipelines,
    b: &'a SceneBuffers,
    counters: &'a mut GpuCounters,
}

impl Recorder<'_> {
    fn radiosity(&mut self, pass: &mut wgpu::ComputePass<'_>) {
        let b = self.b;
        let bind = self.kernels.bind(
            Pass::Radiosity,
            &[
                (0, b.params.as_entire_binding()),
                (2, b.lights.as_entire_binding()),
                (3, b.projected.as_entire_binding()),
                (4, b.points.as_entire_binding()),
                (5, b.surfaces.as_entire_binding()),
                (6, b.senders.as_entire_binding()),
                (7, b.seen().as_entire_binding()),
            ],
        );
        // The sky's coefficient is written even where there are no points.
        let senders = b.shape.senders().max(1) as u32;
        self.dispatch(pass, Pass::Radiosity, &bind, &[], senders);
    }

    /// Pulls the levels, the finest of them first.
    fn pull(&mut self, pass: &mut wgpu::ComputePass<'_>, levels: std::ops::Range<usize>) {
        if levels.is_empty() {
            return;
        }
        let b = self.b;
        let bind = self.kernels.bind(
            Pass::Pull,
            &[
                (1, self.span()),
                (2, b.pull_starts.as_entire_binding()),
                (3, b.pull_entries.as_entire_binding()),
                (4, b.senders.as_entire_binding()),
            ],
        );
        for level in levels.rev() {
            self.spans(pass, Pass::Pull, &bind, &b.levels, level..level + 1);
        }
    }

    /// Pushes or compresses the senders and applies the operator, or goes up and down the octree.
    /// `sweep`: for the senders' rows only.
    fn apply_operator(
        &mut self,
        pass: &mut wgpu::ComputePass<'_>,
        steps: &SolveSchedule,
        tier: u32,
        sweep: bool,
    ) {
        let b = self.b;
        if let Some(octree) = b.fmm.as_ref().filter(|_| steps.octree) {
            octree.up(self.kernels, pass, self.counters, &b.senders);
            let (from, to) = (&b.senders, &b.values);
            octree.down(self.kernels, pass, self.counters, from, to);
            return;
        }
        let [coefficients, applied] = operands(b);
        if steps.differences {
            self.push(pass, steps.senders.len(), coefficients);
        }
        if steps.components {
            self.compress(pass);
        }
        let lists = match sweep {
            true => &b.sender_parts,
            false => &b.tier_parts,
        };
        if let Some(list) = lists.get((tier as usize).wrapping_sub(1)) {
            let (rows, values) = ([&b.rows, &b.order], [coefficients, applied]);
            self.apply(pass, steps.one, rows, &b.links, list, values);
        }
    }

    /// Computes the points' values after [`apply_operator`](Self::apply_operator). `sweep`: of the
    /// senders only.
    fn flatten(&mut self, pass: &mut wgpu::ComputePass<'_>, steps: &SolveSchedule, sweep: bool) {
        let b = self.b;
        let (senders, all) = (steps.senders.len(), steps.levels.len());
        if steps.octree && b.fmm.is_some() {
            // Only points finer than senders take their parents' mean.
            let finer = if sweep { 0..0 } else { senders..all };
            self.averages(pass, finer);
        } else if steps.differences {
            let [_, applied] = operands(b);
            let bind = self.kernels.bind(
                Pass::Differences,
                &[
                    (1, self.span()),
                    (3, b.parent_starts.as_entire_binding()),
                    (4, b.parent_entries.as_entire_binding()),
                    (5, applied.as_entire_binding()),
                    (6, b.values.as_entire_binding()),
                ],
            );
            let list = usize::from(sweep);
            self.spans(pass, Pass::Differences, &bind, &b.whole, list..list + 1);
        } else {
            self.averages(pass, 0..if sweep { senders } else { all });
        }
    }

    /// The senders' light at the probes.
    fn light_space(&mut self, pass: &mut wgpu::ComputePass<'_>, steps: &SolveSchedule) {
        let b = self.b;
        let Some(probes) = &b.probes else { return };
        self.apply(
            pass,
            steps.one,
            [&probes.rows, &probes.order],
            &probes.links,
            &probes.parts,
            [&b.senders, &probes.values],
        );
    }

    /// The operator in all channels or in `one`: `rows` and their order, links part by part with
    /// the span of each, from the first to the second of `values`.
    fn apply(
        &mut self,
        pass: &mut wgpu::ComputePass<'_>,
        one: bool,
        rows: [&wgpu::Buffer; 2],
        links: &[wgpu::Buffer],
        list: &SpanList,
        values: [&wgpu::Buffer; 2],
    ) {
        let kernel = match one {
            true => Pass::ApplyOne,
            false => Pass::Apply,
        };
        for (part, links) in links.iter().enumerate() {
            let mut resources = vec![
                (1, self.span()),
                (2, rows[0].as_entire_binding()),
                (3, links.as_entire_binding()),
                (4, values[0].as_entire_binding()),
                (5, values[1].as_entire_binding()),
                (6, rows[1].as_entire_binding()),
            ];
            if one {
                resources.push((0, self.b.params.as_entire_binding()));
            }
            let bind = self.kernels.bind(kernel, &resources);
            self.spans(pass, kernel, &bind, list, part..part + 1);
        }
    }

    /// Points without a row that is used take their parents' mean, level after level.
    fn averages(&mut self, pass: &mut wgpu::ComputePass<'_>, levels: std::ops::Range<usize>) {
        if levels.is_empty() {
            return;
        }
        let b = self.b;
        let bind = self.kernels.bind(
            Pass::Averages,
            &[
                (0, b.params.as_entire_binding()),
                (1, self.span()),
                (2, b.rows.as_entire_binding()),
                (3, b.parent_starts.as_entire_binding()),
                (4, b.parent_entries.as_entire_binding()),
                (6, b.values.as_entire_binding()),
            ],
        );
        self.spans(pass, Pass::Averages, &bind, &b.levels, levels);
    }

    fn push(
        &mut self,
        pass: &mut wgpu::ComputePass<'_>,
        levels: usize,
        differences: &wgpu::Buffer,
    ) {
        let b = self.b;
        let bind = self.kernels.bind(
            Pass::Push,
            &[
                (0, b.params.as_entire_binding()),
                (1, self.span()),
                (2, b.parent_starts.as_entire_binding()),
                (3, b.parent_entries.as_entire_binding()),
                (4, b.senders.as_entire_binding()),
                (5, differences.as_entire_binding()),
            ],
        );
        self.spans(pass, Pass::Push, &bind, &b.levels, 0..levels);
    }

    fn compress(&mut self, pass: &mut wgpu::ComputePass<'_>) {
        let b = self.b;
        let Some(c) = &b.components else { return };
        let bind = self.kernels.bind(
            Pass::Compress,
            &[
                (2, c.columns.as_entire_binding()),
                (3, c.members.as_entire_binding()),
                (4, c.values.as_entire_binding()),
                (5, b.senders.as_entire_binding()),
                (6, c.components.as_entire_binding()),
            ],
        );
        self.dispatch(pass, Pass::Compress, &bind, &[], b.shape.columns as u32);
    }

    fn sweep(&mut self, pass: &mut wgpu::ComputePass<'_>, direct: &wgpu::Buffer) {
        let b = self.b;
        let bind = self.kernels.bind(
            Pass::Sweep,
            &[
                (0, b.params.as_entire_binding()),
                (2, b.points.as_entire_binding()),
                (3, b.surfaces.as_entire_binding()),
                (4, b.pull_starts.as_entire_binding()),
                (5, direct.as_entire_binding()),
                (6, b.values.as_entire_binding()),
                (7, b.senders.as_entire_binding()),
                (13, b.seen().as_entire_binding()),
            ],
        );
        self.dispatch(pass, Pass::Sweep, &bind, &[], b.shape.senders() as u32);
    }

    fn baked(&mut self, pass: &mut wgpu::ComputePass<'_>, direct: &wgpu::Buffer, levels: usize) {
        let b = self.b;
        let Some(bounces) = &b.bounces else { return };
        let further = &bounces.further;
        let bind = self.kernels.bind(
            Pass::Gather,
            &[
                (0, b.params.as_entire_binding()),
                (5, direct.as_entire_binding()),
                (8, bounces.starts.as_entire_binding()),
                (9, bounces.links.as_entire_binding()),
                (10, further.as_entire_binding()),
            ],
        );
        let coarsest = b.levels.at.first().map_or(0, |(_, span)| span.count);
        self.dispatch(pass, Pass::Gather, &bind, &[], coarsest);
        if levels > 1 {
            let bind = self.kernels.bind(
                Pass::Spread,
                &[
                    (0, b.params.as_entire_binding()),
                    (1, self.span()),
                    (10, further.as_entire_binding()),
                    (11, b.parent_starts.as_entire_binding()),
                    (12, b.parent_entries.as_entire_binding()),
                ],
            );
            self.spans(pass, Pass::Spread, &bind, &b.levels, 1..levels);
        }
        let bind = self.kernels.bind(
            Pass::Add,
            &[
                (0, b.params.as_entire_binding()),
                (5, direct.as_entire_binding()),
                (7, b.senders.as_entire_binding()),
                (10, further.as_entire_binding()),
            ],
        );
        self.dispatch(pass, Pass::Add, &bind, &[], b.shape.senders() as u32);
    }

    /// One dispatch for each of the spans `which` of a list.
    fn spans(
        &mut self,
        pass: &mut wgpu::ComputePass<'_>,
        kernel: Pass,
        bind: &wgpu::BindGroup,
        list: &SpanList,
        which: std::ops::Range<usize>,
    ) {
        for &(offset, span) in &list.at[which] {
            self.dispatch(pass, kernel, bind, &[offset], span.count);
        }
    }

    fn dispatch(
        &mut self,
        pass: &mut wgpu::ComputePass<'_>,
        kernel: Pass,
        bind: &wgpu::BindGroup,
        offsets: &[u32],
        items: u32,
    ) {
        if items == 0 {
            return;
        }
        let groups = items.div_ceil(kernel.entry().1.items);
        pass.set_pipeline(&self.kernels.pass(kernel).pipeline);
        pass.set_bind_group(0, bind, offsets);
        let (x, y) = (groups.min(MAX_GROUPS), groups.div_ceil(MAX_GROUPS));
        pass.dispatch_workgroups(x, y, 1);
        self.counters.dispatches[kernel as usize] += 1;
    }

    fn span(&self) -> wgpu::BindingResource<'_> {
        wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: &self.b.spans,
            offset: 0,
            size: std::num::NonZeroU64::new(size_of::<meshless_gi::internals::frame::Span>() as u64),
        })
    }
}

/// Workgroups of one dimension: WebGPU's limit.
pub(super) const MAX_GROUPS: u32 = 65_535;

pub(super) fn compute<'e>(
    encoder: &'e mut wgpu::CommandEncoder,
    label: &str,
) -> wgpu::ComputePass<'e> {
    encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
        label: Some(label),
        timestamp_writes: None,
    })
}

pub(super) fn entry(binding: u32, resource: wgpu::BindingResource<'_>) -> wgpu::BindGroupEntry<'_> {
    wgpu::BindGroupEntry { binding, resource }
}
