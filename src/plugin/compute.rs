//! The passes that all cameras share: makes the [plan](crate::plan) of the frame, and records what
//! it lists, before any camera draws.
//!
//! What exists on the device exists because a plan asked for it: pipelines are made when a pass
//! first needs them, buffers when a scene comes into view. When the last scene's buffers go, the
//! pipelines go too.

use super::camera::GiDebugView;
use super::composite::ViewRuntime;
use super::diagnostics::{FrameStats, GiFrameStats};
use super::extract::{ExtractedGi, ExtractedGiLight, ExtractedScene, LightKey};
use super::fog::ExtractedFogs;
use super::gpu_timings::{DeviceCosts, span};
use super::quality::span_name;
use super::readback::{CoefficientReadback, SharedCoefficients};
use super::rsm_render::{LightMaps, Reflections};
use super::soft_shadow::{ExtractedSoft, SceneSoft};
use super::splatting::GiSplatting;
use super::stages::stage_of;
use super::volume::{ExtractedVolumes, SceneVolume};
use crate::gpu::{FogBuffers, GpuCounters, GpuError, GpuFrame, KernelPipelines, Pass};
use crate::plan::{
    DisplayUse, FrameStage, FrameState, GiColorMode, Plan, SceneId, SceneState, SkyUse, SlotTable,
    Slots, ViewId, ViewState, falls_back,
};
use bevy::ecs::prelude::*;
use bevy::log::{error, warn, warn_once};
use bevy::math::Vec3;
use bevy::render::diagnostic::RecordDiagnostics;
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue};
use meshless_gi::{BakedScene, Bounds, Channels, FrameLight, FrameSettings, MaterialFactors};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A baked scene's instance: its lights' slots, and what the device holds of it.
pub(crate) struct SceneRuntime {
    pub bake: Arc<BakedScene>,
    pub slots: SlotTable<LightKey>,
    pub frame: Option<GpuFrame>,
    pub soft: SceneSoft,
    pub volume: SceneVolume,
    /// What the device's last solve simulated.
    solved: Option<FrameSettings>,
    /// The channels that the level asked for then.
    asked: GiColorMode,
    /// The factors of the materials that the device's surfaces are of; none for those of the bake.
    painted: Vec<MaterialFactors>,
    /// What passes the occluders in what the device has; none for all open.
    gains: Vec<f32>,
    idle_frames: u32,
    /// From a failed upload: bytes of a buffer that did not fit the device, and how many slots
    /// there were.
    too_large: Option<(u64, usize)>,
    read_back: Option<CoefficientReadback>,
}

/// The plugin's state in the render world.
#[derive(Resource, Default)]
pub(crate) struct GiRender {
    pub kernels: Option<KernelPipelines>,
    pub scenes: BTreeMap<SceneId, SceneRuntime>,
    pub views: BTreeMap<ViewId, ViewRuntime>,
    pub reflections: Option<Reflections>,
    /// Parameters of the fog that views see.
    pub fogs: BTreeMap<ViewId, FogBuffers>,
    pub plan: Plan,
    frame: u64,
    /// What the scenes' counters, those that are gone included, added up to at the end of the last
    /// frame.
    counted: GpuCounters,
    /// Counters of what is gone, and of pictures without a scene.
    pub retired: GpuCounters,
    /// This device lacks what the kernels need.
    unable: bool,
}

/// Whether the device has what the kernels need.
pub(crate) fn device_able(device: &RenderDevice) -> Result<(), GpuError> {
    KernelPipelines::new(device.wgpu_device()).map(drop)
}

/// The settings of a solve.
fn frame_settings(scene: &ExtractedScene) -> FrameSettings {
    FrameSettings {
        tier: (scene.tier.as_ref()).map_or(FrameSettings::ALL_TIERS, |picked| picked.tier),
        sky: scene.sky,
        emission: scene.emissive_luminance,
        channels: (scene.channels).map_or(Channels::Three, |picked| picked.channels),
        ..FrameSettings::bounces(scene.bounces.map_or(1, |picked| picked.bounces))
    }
}

pub(super) fn bounds(bake: &BakedScene) -> Bounds {
    let [min, max] = bake.info.bounds.map(Vec3::from_array);
    Bounds { min, max }
}

impl GiRender {
    /// Follows scenes that came, went or were baked again, and describes the frame for the plan.
    #[expect(
        clippy::too_many_arguments,
        reason = "all that the frame is described from"
    )]
    fn observe(
        &mut self,
        world: &ExtractedGi,
        soft: &ExtractedSoft,
        volumes: &ExtractedVolumes,
        fogs: &ExtractedFogs,
        maps: &LightMaps,
        largest_binding: u64,
        coefficients: &SharedCoefficients,
    ) -> FrameState {
        let mut state = FrameState {
            device_able: !self.unable,
            largest_binding,
            unload_after_frames: world.unload_after_frames,
            scenes: Vec::with_capacity(world.scenes.len()),
            views: Vec::with_capacity(world.views.len()),
            bounces: maps.describe(world),
            bounces_held: false,
            fogs: fogs.describe(),
            inventory: world.inventory.clone(),
        };
        let here = |id: &SceneId| world.scenes.iter().any(|s| s.id == *id && s.bake.is_some());
        let gone: Vec<SceneId> = self.scenes.keys().filter(|id| !here(id)).copied().collect();
        for id in gone {
            self.release(id);
            self.scenes.remove(&id);
            coefficients.forget(id.0);
        }
        for view in &world.views {
            state.views.push(ViewState {
                id: view.id,
                gloss: view.gloss.is_some(),
                // Soft shadows are taken from the picture of a deferred camera.
                lit: view.settings.debug_view == GiDebugView::Final && !view.forward,
                enabled: view.settings.enabled,
                has_gbuffer: view.has_gbuffer,
                pixels: view.pixels,
                display: match view.display {
                    GiSplatting::PerPixel => DisplayUse::Full,
                    _ if self.views.get(&view.id).is_some_and(|v| v.too_large) => {
                        DisplayUse::NoRoom
                    }
                    GiSplatting::Multiresolution(_) => DisplayUse::Subsplats,
                },
                sees: view.sees.clone(),
            });
        }
        for scene in &world.scenes {
            let seen = scene.shown
                && scene.placement.is_some()
                && world
                    .views
                    .iter()
                    .any(|v| v.settings.enabled && v.has_gbuffer && v.sees.contains(&scene.id));
            let placed = scene.shown && scene.placement.is_some();
            let seen = seen || placed && SceneVolume::seen(volumes, scene.id);
            let mut described =
                self.observe_scene(scene, &world.lights, soft, volumes, seen, world.read_back);
            described.no_octree =
                (scene.bake.as_ref()).and_then(|b| falls_back(b, largest_binding));
            state.scenes.push(described);
        }
        state.bounces_held =
            (self.reflections.as_ref()).is_some_and(|r| r.hold(&state, maps, world, &self.scenes));
        state
    }

    fn observe_scene(
        &mut self,
        scene: &ExtractedScene,
        lights: &[ExtractedGiLight],
        soft: &ExtractedSoft,
        volumes: &ExtractedVolumes,
        seen: bool,
        read_back: bool,
    ) -> SceneState {
        let mut state = SceneState {
            loaded: scene.bake.is_some(),
            shown: scene.shown && scene.placement.is_some(),
            read_back,
            probes: scene.bake.as_ref().is_some_and(|b| b.probes.is_some()),
            probe_links: (scene.bake.as_ref())
                .and_then(|b| b.probes.as_ref())
                .map_or(0, |p| p.links.len() as u64),
            tier: scene.tier.clone(),
            channels: scene.channels,
            bounces: scene.bounces,
            rays: scene.bake.as_ref().map_or(0, |b| b.rays_per_slot()),
            passages: (scene.bake.as_ref().and_then(|b| b.occluders.as_ref()))
                .map_or(0, |o| (o.links.len() + o.probes.len()) as u64),
            sky: match (&scene.bake, scene.sky.is_uniform()) {
                (_, true) | (None, _) => SkyUse::Uniform,
                (Some(bake), false) if bake.sky.is_some() => SkyUse::Terms,
                (Some(_), false) => SkyUse::Mean,
            },
            ..SceneState::new(scene.id)
        };
        let Some(bake) = &scene.bake else {
            return state;
        };
        if self
            .scenes
            .get(&scene.id)
            .is_some_and(|r| !Arc::ptr_eq(&r.bake, bake))
        {
            // Baked again: nothing on the device is of use any more.
            self.release(scene.id);
            self.scenes.remove(&scene.id);
        }
        let runtime = self.scenes.entry(scene.id).or_insert_with(|| SceneRuntime {
            bake: bake.clone(),
            slots: SlotTable::new(),
            frame: None,
            soft: SceneSoft::default(),
            volume: SceneVolume::default(),
            solved: None,
            asked: GiColorMode::Auto,
            painted: Vec::new(),
            gains: Vec::new(),
            idle_frames: 0,
            too_large: None,
            read_back: None,
        });
        runtime.idle_frames = if seen {
            0
        } else {
            runtime.idle_frames.saturating_add(1)
        };
        if seen && let Some(placement) = &scene.placement {
            let local_from_world = placement.matrix();
            let lights: Vec<(LightKey, Vec<FrameLight>)> = lights
                .iter()
                .filter(|l| l.layers.intersects(&scene.layers))
                .map(|l| {
                    let parts = FrameLight::expand(&l.light, l.area_samples);
                    (
                        l.key,
                        parts
                            .iter()
                            .map(|p| p.to_local(&local_from_world))
                            .collect(),
                    )
                })
                .collect();
            state.occluders_changed = runtime.moved(scene);
            if state.occluders_changed > 0 {
                // No shadow is where it was.
                runtime.slots.unproject();
            }
            let Slots { changes, stale } = runtime.slots.update(&lights, bounds(bake));
            state.slots = changes;
            state.stale = stale;
            let bounds = bounds(bake);
            state.soft = (runtime.soft).observe(soft, bake, bounds, &scene.layers, placement);
            state.volume = (runtime.volume).observe(volumes, scene.id, &local_from_world);
            if !runtime.soft.asked()
                && let Some(counted) = runtime.soft.release()
            {
                self.retired.add(&counted);
            }
        }
        state.resident = runtime.frame.is_some();
        state.materials_changed = runtime.painted(scene);
        let now = frame_settings(scene);
        // Channels that the plan picks are how a solve is done, and not what it says; those that a
        // setting forces are.
        let forced = scene.channels.is_some_and(|picked| picked.forced);
        let before = runtime.solved.map(|solved| match forced {
            true => solved,
            false => FrameSettings {
                channels: now.channels,
                ..solved
            },
        });
        let asks_anew = runtime.asked != scene.solver.color_mode;
        state.settings_changed = before != Some(now) || asks_anew;
        state.idle_frames = runtime.idle_frames;
        // Fewer lights need less.
        runtime.too_large = runtime
            .too_large
            .filter(|(_, slots)| runtime.slots.len() >= *slots);
        state.largest_buffer = runtime.too_large.map_or(0, |(bytes, _)| bytes);
        state
    }

    /// Frees what the device holds of a scene.
    fn release(&mut self, id: SceneId) {
        let Some(runtime) = self.scenes.get_mut(&id) else {
            return;
        };
        if let Some(frame) = runtime.frame.take() {
            self.retired.add(&frame.counters());
        }
        if let Some(counted) = runtime.soft.release() {
            self.retired.add(&counted);
        }
        runtime.volume = SceneVolume::default();
        runtime.slots.forget();
        runtime.solved = None;
        runtime.painted.clear();
        runtime.gains.clear();
        runtime.read_back = None;
    }

    /// Makes room for the maps that the plan draws; gives it back where it draws none.
    fn begin_reflections(&mut self, lights: &LightMaps, plan: &Plan, device: &RenderDevice) {
        let before = self.reflections.take();
        let counted = before.as_ref().map(Reflections::counters);
        match Reflections::begin(before, lights, plan, device.wgpu_device()) {
            Ok(reflections) => self.reflections = reflections,
            Err(why) => warn_once!("what moves reflects nothing: {why}"),
        }
        if let (None, Some(counted)) = (&self.reflections, counted) {
            self.retired.add(&counted);
        }
    }

    /// The scenes that the frame solved, and with which tier.
    fn solved(&self) -> BTreeMap<u64, u32> {
        let solved = self
            .plan
            .passes
            .iter()
            .filter(|p| p.stage == FrameStage::APPLY);
        solved
            .filter_map(|p| {
                let runtime = self.scenes.get(&p.scene)?;
                runtime.solved.map(|settings| (p.scene.0, settings.tier))
            })
            .collect()
    }

    /// Everything that exists on the device, and what ran since the last call.
    fn count(&mut self) -> FrameStats {
        let mut total = self.retired;
        let mut counters = FrameStats {
            frame: self.frame,
            pipelines: self.kernels.as_ref().map_or(0, KernelPipelines::created),
            active_scenes: self.plan.active_scenes().len() as u32,
            plan: self.plan.clone(),
            solved: self.solved(),
            ..FrameStats::default()
        };
        for (id, runtime) in &self.scenes {
            let mut of_scene = 0;
            if let Some(frame) = &runtime.frame {
                total.add(&frame.counters());
                counters.buffers += frame.buffers().count() as u32;
                of_scene += frame.buffers().bytes();
            }
            if let Some((counted, buffers, bytes)) = runtime.soft.size() {
                total.add(&counted);
                counters.buffers += buffers;
                of_scene += bytes;
            }
            let (buffers, bytes) = runtime.volume.size();
            counters.buffers += buffers;
            of_scene += bytes;
            if let Some(read_back) = &runtime.read_back {
                counters.buffers += 1;
                of_scene += read_back.bytes();
            }
            counters.bytes += of_scene;
            if runtime.frame.is_some() {
                counters.scene_bytes.insert(id.0, of_scene);
                let bake = Arc::as_ptr(&runtime.bake) as usize;
                counters.scene_bakes.insert(id.0, bake);
            }
        }
        if let Some(reflections) = &self.reflections {
            total.add(&reflections.counters());
            let (buffers, bytes) = reflections.size();
            counters.buffers += buffers;
            counters.bytes += bytes;
        }
        for (id, view) in &mut self.views {
            if let Some(counts) = view.subsplats().and_then(|s| s.counts()) {
                counters.subsplats.insert(id.0, counts);
            }
            counters.buffers += view.buffer_count();
            counters.bytes += view.bytes();
        }
        for buffers in self.fogs.values() {
            counters.buffers += buffers.count();
            counters.bytes += buffers.bytes();
        }
        let mut dispatched = |stage, count: u64| {
            if count > 0 {
                *counters.dispatches.entry(stage).or_insert(0) += count as u32;
            }
        };
        for pass in Pass::ALL {
            dispatched(stage_of(pass), total.of(pass) - self.counted.of(pass));
        }
        dispatched(
            FrameStage::COMPOSITE,
            total.composites - self.counted.composites,
        );
        dispatched(FrameStage::FOG, total.fogs - self.counted.fogs);
        dispatched(
            FrameStage::UPLOAD,
            self.plan.count(FrameStage::UPLOAD) as u64,
        );
        dispatched(
            FrameStage::MATERIALS,
            self.plan.count(FrameStage::MATERIALS) as u64,
        );
        dispatched(
            FrameStage::READ_BACK,
            self.plan.count(FrameStage::READ_BACK) as u64,
        );
        counters.projected_slots = (total.projected - self.counted.projected) as u32;
        self.counted = total;
        counters
    }
}

/// Runs in [`GiRenderSystems::Solve`](super::GiRenderSystems::Solve).
#[allow(
    clippy::too_many_arguments,
    reason = "a system's parameters are its inputs"
)]
pub(crate) fn compute(
    world: Res<ExtractedGi>,
    soft: Res<ExtractedSoft>,
    volumes: Res<ExtractedVolumes>,
    fogs: Res<ExtractedFogs>,
    maps: Res<LightMaps>,
    mut render: ResMut<GiRender>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
    coefficients: Res<SharedCoefficients>,
    costs: Res<DeviceCosts>,
    mut ctx: RenderContext,
) {
    let render = &mut *render;
    if device.is_changed() {
        // A new device after the loss of one: nothing of the old one is of use.
        costs.forget();
        *render = GiRender {
            frame: render.frame,
            ..GiRender::default()
        };
    }
    render.frame += 1;
    let largest = largest_binding(&device);
    let state = render.observe(
        &world,
        &soft,
        &volumes,
        &fogs,
        &maps,
        largest,
        &coefficients,
    );
    let mut plan = Plan::new(&state);
    costs.price(&mut plan);
    for &id in &plan.release {
        render.release(id);
        coefficients.forget(id.0);
    }
    let shows = |id: &ViewId| {
        plan.passes
            .iter()
            .any(|p| p.stage == FrameStage::COMPOSITE && p.view == Some(*id))
    };
    render.views.retain(|id, _| shows(id));
    let fogged = |id: &ViewId| {
        (plan.passes.iter()).any(|p| p.stage == FrameStage::FOG && p.view == Some(*id))
    };
    render.fogs.retain(|id, _| fogged(id));
    render.begin_reflections(&maps, &plan, &device);
    if plan.is_empty() {
        if render.scenes.values().all(|s| s.frame.is_none()) {
            render.kernels = None;
        }
        render.plan = plan;
        return;
    }
    if render.kernels.is_none() {
        match KernelPipelines::new(device.wgpu_device()) {
            Ok(kernels) => render.kernels = Some(kernels),
            Err(why) => {
                // `finish` has checked this device; a new one after a loss may differ.
                render.unable = true;
                error!("indirect light stays off: {why}");
                render.plan = Plan::default();
                return;
            }
        }
    }
    let Some(kernels) = &render.kernels else {
        return;
    };
    let recorder = ctx.diagnostic_recorder();
    let recorder = recorder.as_deref();
    let whole = recorder.time_span(ctx.command_encoder(), "meshless_gi_compute");
    let mut failed = Vec::new();
    for scene in &world.scenes {
        let Some(runtime) = render.scenes.get_mut(&scene.id) else {
            continue;
        };
        let settings = frame_settings(scene);
        if plan.find(FrameStage::READ_BACK, scene.id).is_none()
            && runtime.read_back.take().is_some()
        {
            coefficients.forget(scene.id.0);
        }
        if let Err(why) = runtime.record(
            scene.id,
            &plan,
            &settings,
            scene,
            kernels,
            &queue,
            &recorder,
            ctx.command_encoder(),
        ) {
            let root = Entity::from_bits(scene.id.0);
            warn!("baked scene {root}: indirect light is off: {why}");
            let bytes = match why {
                GpuError::TooLarge { bytes, .. } => bytes,
                _ => u64::MAX,
            };
            runtime.too_large = Some((bytes, runtime.slots.len()));
            failed.push(scene.id);
        } else if let (Some(_), Some(placement), Some(frame)) = (
            plan.find(FrameStage::VOLUME, scene.id),
            &scene.placement,
            &mut runtime.frame,
        ) {
            let timed =
                recorder.time_span(ctx.command_encoder(), span(FrameStage::VOLUME, scene.id));
            runtime.volume.record(
                &volumes,
                scene.id,
                &runtime.bake,
                &placement.matrix(),
                frame,
                kernels,
                &queue,
                ctx.command_encoder(),
            );
            timed.end(ctx.command_encoder());
        } else if plan.find(FrameStage::APPLY, scene.id).is_some() {
            // Nobody saw the volume while the light changed.
            runtime.volume.forget();
        }
    }
    whole.end(ctx.command_encoder());
    for id in failed {
        render.release(id);
    }
    render.plan = plan;
}

impl SceneRuntime {
    /// Whether the device's surfaces are not those of the materials.
    fn painted(&self, scene: &ExtractedScene) -> bool {
        let Some(live) = &self.bake.materials else {
            return false;
        };
        let has = match self.painted.is_empty() {
            true => &live.factors,
            false => &self.painted,
        };
        *has != scene.materials
    }

    /// How many occluders do not stand as the device has them.
    fn moved(&self, scene: &ExtractedScene) -> usize {
        let has = |k: usize| self.gains.get(k).copied().unwrap_or(1.0);
        let now = scene.transmittances.iter().enumerate();
        now.filter(|&(k, &gain)| gain != has(k)).count()
    }

    /// Uploads, projects and solves, as far as the plan says so for this scene.
    #[expect(
        clippy::too_many_arguments,
        reason = "the plan, and all that it is recorded with"
    )]
    fn record(
        &mut self,
        id: SceneId,
        plan: &Plan,
        settings: &FrameSettings,
        scene: &ExtractedScene,
        kernels: &KernelPipelines,
        queue: &RenderQueue,
        recorder: &impl RecordDiagnostics,
        encoder: &mut bevy::render::render_resource::CommandEncoder,
    ) -> Result<(), GpuError> {
        if plan.find(FrameStage::UPLOAD, id).is_some() {
            self.frame = Some(GpuFrame::new(
                kernels,
                queue,
                &self.bake,
                self.slots.len() as u32,
            )?);
        }
        let Some(frame) = &mut self.frame else {
            return Ok(());
        };
        if plan.find(FrameStage::MATERIALS, id).is_some() {
            frame.set_materials(queue, &self.bake, &scene.materials);
            self.painted.clone_from(&scene.materials);
        }
        if plan.find(FrameStage::OCCLUDE, id).is_some() {
            let timed = recorder.time_span(encoder, span(FrameStage::OCCLUDE, id));
            frame.set_occluders(kernels, queue, encoder, &self.bake, &scene.transmittances);
            timed.end(encoder);
            self.gains.clone_from(&scene.transmittances);
        }
        if plan.find(FrameStage::APPLY, id).is_some() {
            frame.set_lights(kernels, queue, &self.slots.lights())?;
            let solve = recorder.time_span(encoder, span_name(id.0));
            if let Some(pass) = plan.find(FrameStage::PROJECT, id) {
                let timed = recorder.time_span(encoder, span(FrameStage::PROJECT, id));
                frame.project(kernels, queue, encoder, &pass.slots);
                timed.end(encoder);
                self.slots.mark_projected(&pass.slots);
            }
            let timed = recorder.time_span(encoder, span(FrameStage::APPLY, id));
            frame.solve(kernels, queue, encoder, settings);
            timed.end(encoder);
            solve.end(encoder);
            self.slots.mark_applied();
            self.solved = Some(*settings);
            self.asked = scene.solver.color_mode;
        }
        if plan.find(FrameStage::SOFT_SHADOW, id).is_some() {
            let timed = recorder.time_span(encoder, span(FrameStage::SOFT_SHADOW, id));
            let recorded = (self.soft).record(kernels, queue, encoder, frame.buffers(), &self.bake);
            timed.end(encoder);
            if let Err(why) = recorded {
                let root = Entity::from_bits(id.0);
                warn!("baked scene {root}: lights cast no soft shadows: {why}");
            }
        }
        if plan.find(FrameStage::READ_BACK, id).is_some()
            && let Some(values) = frame.buffers().output(Pass::Apply)
        {
            self.read_back
                .get_or_insert_with(|| CoefficientReadback::new(kernels.device(), values.size()))
                .copy(encoder, values);
        }
        Ok(())
    }
}

/// After everything was submitted: tells the main world what the frame did, and fetches
/// coefficients.
pub(crate) fn publish(
    mut render: ResMut<GiRender>,
    status: Res<GiFrameStats>,
    coefficients: Res<SharedCoefficients>,
) {
    status.set(render.count());
    for (id, runtime) in &mut render.scenes {
        if let Some(read_back) = &mut runtime.read_back {
            read_back.fetch(id.0, &coefficients);
        }
    }
    for view in render.views.values_mut() {
        if let Some(subsplats) = view.subsplats() {
            subsplats.fetch();
        }
    }
}

/// Bytes of the largest storage buffer that the device binds.
pub(super) fn largest_binding(device: &RenderDevice) -> u64 {
    let limits = device.limits();
    (limits.max_storage_buffer_binding_size).min(limits.max_buffer_size)
}
