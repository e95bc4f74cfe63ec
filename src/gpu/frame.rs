//! Recording of a frame of one baked scene. The dispatches follow the steps of [`SolveSchedule`],
//! as on the CPU.

use super::dispatch::compute;
use super::draw::draw_over;
use super::pipelines::{Draw, KernelPipelines};
use super::scene_buffers::{SceneBuffers, ViewBuffers};
use super::solve_recorder::SolveRecorder;
use super::{EntryPoint, GpuCounters, GpuError};
use glam::Mat4;
use meshless_gi::internals::frame::materials::current_surfaces;
use meshless_gi::internals::frame::splat::FULL_COVER;
use meshless_gi::internals::frame::{SolveSchedule, SplatParams};
use meshless_gi::{BakedScene, FrameLight, FrameSettings, MaterialFactors};

/// Maximum number of slots in one dispatch of `project`. A dimension has 65 535 groups, and the
/// list of slots is bound at a multiple of 256 bytes, the largest alignment of WebGPU.
const SLOTS_PER_DISPATCH: usize = 65_535 / 64 * 64;

/// Textures that `splat` reads and writes. All have the size of the view's target.
#[derive(Clone, Copy, Debug)]
pub struct SplatTargets<'a> {
    /// Depth, reversed (0 is infinitely far), one sample per pixel.
    pub depth: &'a wgpu::TextureView,
    /// Bevy's deferred G-buffer, `Rgba32Uint`.
    pub gbuffer: &'a wgpu::TextureView,
    /// Output of an earlier baked scene of the same view. `None` for the first scene.
    pub earlier: Option<&'a wgpu::TextureView>,
    /// Output texture, `Rgba16Float`. It differs from `earlier`.
    pub output: &'a wgpu::TextureView,
}

/// Baked scene on the GPU, and its recording.
#[derive(Debug)]
pub struct GpuFrame {
    buffers: SceneBuffers,
    lights: usize,
    /// Inputs of the senders' surfaces on the GPU: factors of the materials, and the transmittance
    /// of each set of occluders. Empty for the values of the bake.
    factors: Vec<MaterialFactors>,
    set_transmittances: Vec<f32>,
    counters: GpuCounters,
}

impl GpuFrame {
    /// Uploads `scene`, with capacity for `slots` light slots.
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

    /// Creates a frame from existing buffers.
    #[must_use]
    pub fn with_buffers(queue: &wgpu::Queue, buffers: SceneBuffers) -> Self {
        // The parameters that `project` reads do not change later.
        let params = buffers.shape.params(&FrameSettings::default(), 0);
        queue.write_buffer(&buffers.params, 0, bytemuck::bytes_of(&params));
        Self {
            buffers,
            lights: 0,
            factors: Vec::new(),
            set_transmittances: Vec::new(),
            counters: GpuCounters::default(),
        }
    }

    /// Returns the buffers.
    #[must_use]
    pub fn buffers(&self) -> &SceneBuffers {
        &self.buffers
    }

    /// Returns the work recorded so far.
    #[must_use]
    pub fn counters(&self) -> GpuCounters {
        self.counters
    }

    /// Sets the lights, one per slot, in the bake's local space, for the frame that is submitted
    /// next. Grows the buffers if needed. Existing projections stay. Call [`GpuFrame::project`]
    /// with the slots to project.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] if the slots do not fit a binding.
    pub fn set_lights(
        &mut self,
        kernels: &KernelPipelines,
        queue: &wgpu::Queue,
        lights: &[FrameLight],
    ) -> Result<(), GpuError> {
        self.buffers
            .reserve_slots(kernels.device(), queue, lights.len() as u32)?;
        if !lights.is_empty() {
            queue.write_buffer(&self.buffers.lights, 0, bytemuck::cast_slice(lights));
        }
        self.lights = lights.len();
        Ok(())
    }

    /// Sets the factors of the materials of `scene`, from which the frame was created, for the
    /// frame that is submitted next. Missing factors keep the baked values. Uploads the senders'
    /// surfaces. Returns their size in bytes, 0 if the bake has no materials.
    pub fn set_materials(
        &mut self,
        queue: &wgpu::Queue,
        scene: &BakedScene,
        factors: &[MaterialFactors],
    ) -> u64 {
        if scene.data().materials.is_none() {
            return 0;
        }
        self.factors = factors.to_vec();
        self.upload_surfaces(queue, scene)
    }

    /// Stores the transmittance of each set of occluders, and uploads the senders' surfaces that it
    /// changes.
    pub(super) fn update_transmittances(
        &mut self,
        queue: &wgpu::Queue,
        scene: &BakedScene,
        set_transmittances: Vec<f32>,
    ) {
        self.set_transmittances = set_transmittances;
        self.upload_surfaces(queue, scene);
    }

    /// Uploads the current surfaces of the senders and returns their size in bytes.
    fn upload_surfaces(&mut self, queue: &wgpu::Queue, scene: &BakedScene) -> u64 {
        let (surfaces, seen) =
            current_surfaces(scene.data(), &self.factors, &self.set_transmittances);
        let bytes: &[u8] = bytemuck::cast_slice(&surfaces);
        if !bytes.is_empty() {
            queue.write_buffer(&self.buffers.surfaces, 0, bytes);
        }
        if let (Some(sky), false) = (&self.buffers.sky, self.set_transmittances.is_empty()) {
            queue.write_buffer(sky, 0, bytemuck::cast_slice(&seen));
        }
        bytes.len() as u64
    }

    /// Projects the lights of `slots` in one dispatch (several for more than 65 472). Call it at
    /// most once per submission. Slots without a light are left out.
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
        pass.set_pipeline(&kernels.compute_kernel(EntryPoint::Project).pipeline);
        for (i, part) in slots.chunks(SLOTS_PER_DISPATCH).enumerate() {
            let changed = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                buffer: &b.changed,
                offset: (i * SLOTS_PER_DISPATCH * size_of::<u32>()) as u64,
                size: None,
            });
            let bind = kernels.bind(
                EntryPoint::Project,
                &[
                    (0, b.params.as_entire_binding()),
                    (2, b.lights.as_entire_binding()),
                    (3, changed),
                    (4, b.points.as_entire_binding()),
                    (5, b.nodes.as_entire_binding()),
                    (6, b.triangles.as_entire_binding()),
                    (7, b.projected.as_entire_binding()),
                    (8, b.light_samples.as_entire_binding()),
                ],
            );
            pass.set_bind_group(0, &bind, &[]);
            // A binding holds fewer points than the groups of one dimension cover.
            pass.dispatch_workgroups(senders.div_ceil(64), part.len() as u32, 1);
            self.counters.dispatches[EntryPoint::Project as usize] += 1;
        }
        self.counters.projected += slots.len() as u64;
    }

    /// Computes the irradiance of all points from the projected lights:
    /// [`pull_push`](Self::pull_push), [`apply`](Self::apply), [`flatten`](Self::flatten),
    /// [`apply_probes`](Self::apply_probes). Call it at most once per submission.
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

    /// Applies the operator to the senders, for all points. Call it after
    /// [`pull_push`](Self::pull_push).
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

    /// Computes the values of all points. Call it after [`apply`](Self::apply).
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

    /// Applies the rows of the probes. Call it after [`pull_push`](Self::pull_push). Does nothing
    /// if the bake has no probes.
    pub fn apply_probes(
        &mut self,
        kernels: &KernelPipelines,
        encoder: &mut wgpu::CommandEncoder,
        settings: &FrameSettings,
    ) {
        let steps = SolveSchedule::new(&self.buffers.shape, settings);
        let mut pass = compute(encoder, "meshless_gi probes");
        self.recorder(kernels).apply_probes(&mut pass, &steps);
    }

    fn recorder<'a>(&'a mut self, kernels: &'a KernelPipelines) -> SolveRecorder<'a> {
        SolveRecorder {
            kernels,
            b: &self.buffers,
            counters: &mut self.counters,
        }
    }

    /// Returns the parameters of a view of this scene, see [`SplatParams`].
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
            seam: if self.has_probes() { FULL_COVER } else { 0.0 },
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
        let entry_point = if targets.earlier.is_some() {
            EntryPoint::SplatOver
        } else {
            EntryPoint::Splat
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
        let bind = kernels.bind(entry_point, &resources);
        let mut pass = compute(encoder, "meshless_gi splat");
        pass.set_pipeline(&kernels.compute_kernel(entry_point).pipeline);
        pass.set_bind_group(0, &bind, &[]);
        pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
        self.counters.dispatches[entry_point as usize] += 1;
    }

    /// Counts one more dispatch of `entry_point`.
    pub(super) fn count(&mut self, entry_point: EntryPoint) {
        self.counters.dispatches[entry_point as usize] += 1;
    }

    /// Draws a view's irradiance onto its image. It is added, or replaces the image if `replace` is
    /// set. `pass` has one target, of `format`. Call it once per view, after the `splat` of its
    /// last scene. `textures` are irradiance, G-buffer and lighting passes.
    pub fn composite(
        &mut self,
        kernels: &KernelPipelines,
        pass: &mut wgpu::RenderPass<'_>,
        format: wgpu::TextureFormat,
        replace: bool,
        view: &ViewBuffers,
        textures: [&wgpu::TextureView; 3],
    ) {
        let how = if replace { Draw::Replace } else { Draw::Add };
        draw_over(kernels, pass, format, how, view, textures);
        self.counters.composites += 1;
    }
}
