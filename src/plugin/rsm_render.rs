//! One bounce from dynamic objects, in the render world: draws the maps, creates virtual point
//! lights from them, and lights the views.
//!
//! Each map is a Bevy camera with its own schedule [`RsmSchedule`] instead of `Core3d`. The
//! schedule has the meshes' transforms, and one pass that draws the deferred G-buffer. It has no
//! shadow maps, lighting, tonemapping or picture. Bevy's deferred prepass is not public. Ours has
//! the same bindings (format of Bevy 0.19).
//!
//! Cameras whose targets have the same size share their textures (Bevy keys them by target).
//! Therefore a map is read before the next one is drawn, in the same schedule.

use super::extract::{ExtractedGi, LightKey, LightKind};
use super::record::{Layer, ViewInput};
use super::render_state::{GiRender, SceneRuntime};
use super::rsm::{AskingLight, AskingLights};
use super::splatting::ViewLights;
use crate::gpu::{
    GpuCounters, GpuError, KernelPipelines, RsmBuffers, RsmCapture, SceneBuffers, SplatTargets,
    VplShadows,
};
use crate::plan::{BounceState, FrameState, LightId, Plan, SceneId};
use bevy::core_pipeline::deferred::{AlphaMask3dDeferred, Opaque3dDeferred};
use bevy::core_pipeline::prepass::ViewPrepassTextures;
use bevy::ecs::prelude::*;
use bevy::ecs::schedule::{Schedule, ScheduleBuildSettings, ScheduleLabel};
use bevy::log::error;
use bevy::math::{DMat4, Mat4, Vec3};
use bevy::pbr::early_gpu_preprocess;
use bevy::render::Extract;
use bevy::render::diagnostic::RecordDiagnostics;
use bevy::render::render_phase::ViewBinnedRenderPhases;
use bevy::render::render_resource::{PipelineCache, RenderPassDescriptor, StoreOp};
use bevy::render::renderer::{RenderContext, RenderQueue, ViewQuery};
use bevy::render::view::{ExtractedView, ViewDepthTexture};
use meshless_gi::internals::frame::rsm_layout::{MAX_VPLS, light_in_space, space_from_clip};
use meshless_gi::internals::frame::{RsmParams, VplViewParams};
use std::collections::BTreeMap;

/// Schedule that a camera of a map runs instead of `Core3d`.
#[derive(ScheduleLabel, Clone, Debug, PartialEq, Eq, Hash, Default)]
pub struct RsmSchedule;

/// Creates the schedule: Bevy's transforms of the meshes, our pass, and the systems that read its
/// output.
pub(crate) fn schedule() -> Schedule {
    let mut schedule = Schedule::new(RsmSchedule);
    schedule.set_build_settings(ScheduleBuildSettings {
        auto_insert_apply_deferred: false,
        ..ScheduleBuildSettings::default()
    });
    schedule.add_systems((early_gpu_preprocess, draw, read).chain());
    schedule
}

/// Lights that bounce from dynamic objects in the frame that is drawn.
#[derive(Resource, Default)]
pub(crate) struct LightMaps(pub AskingLights);

/// Number of frames without a change in which maps are still drawn. Meshes and textures reach the
/// device a few frames after they changed.
const SETTLED: u32 = 8;

/// A light's name in the plan.
pub(crate) fn light_id(key: LightKey) -> LightId {
    let kind = match key.1 {
        LightKind::Point => 0,
        LightKind::Spot => 1,
        LightKind::Directional => 2,
        LightKind::Rect => 3,
    };
    LightId(key.0, kind)
}

/// Extracts the maps of lights. Runs in the same schedule as `extract`.
pub(crate) fn extract_maps(mut maps: ResMut<LightMaps>, asking: Extract<Res<AskingLights>>) {
    maps.0.clone_from(&asking);
}

impl LightMaps {
    /// Describes the lights for the plan.
    pub fn describe(&self, world: &ExtractedGi) -> Vec<BounceState> {
        let lights = &self.0.lights;
        let state = |light: &AskingLight| BounceState {
            id: light_id(light.key),
            maps: light.maps.as_ref().map(|m| m.len() as u32).map_err(|w| *w),
            views: (world.views.iter())
                .filter(|v| v.layers.intersects(&light.layers))
                .map(|v| v.id)
                .collect(),
        };
        lights.iter().map(state).collect()
    }
}

type View = (
    &'static ExtractedView,
    &'static ViewDepthTexture,
    &'static ViewPrepassTextures,
);

/// Returns the light of this camera's map, the index of the map, and the number of the light's
/// maps.
fn light_of(lights: &LightMaps, camera: Entity) -> Option<(&AskingLight, usize, usize)> {
    lights.0.lights.iter().find_map(|light| {
        let maps = light.maps.as_ref().ok()?;
        let at = maps.iter().position(|map| *map == camera)?;
        Some((light, at, maps.len()))
    })
}

/// Draws the deferred meshes in the camera's view, if the plan has this map.
fn draw(
    world: &World,
    view: ViewQuery<View>,
    lights: Res<LightMaps>,
    render: Res<GiRender>,
    opaque: Res<ViewBinnedRenderPhases<Opaque3dDeferred>>,
    masked: Res<ViewBinnedRenderPhases<AlphaMask3dDeferred>>,
    mut ctx: RenderContext,
) {
    let entity = view.entity();
    let (extracted, depth, textures) = view.into_inner();
    let camera = extracted.retained_view_entity.main_entity.id();
    let planned = light_of(&lights, camera)
        .is_some_and(|(light, ..)| render.plan.find_light(light_id(light.key)).is_some());
    if !planned {
        return;
    }
    let id = &extracted.retained_view_entity;
    let (Some(opaque), Some(masked)) = (opaque.get(id), masked.get(id)) else {
        return;
    };
    let recorder = ctx.diagnostic_recorder();
    let recorder = recorder.as_deref();
    let mut pass = ctx.begin_tracked_render_pass(RenderPassDescriptor {
        label: Some("meshless_gi reflective shadow map"),
        color_attachments: &[
            (textures.normal.as_ref()).map(|t| t.get_attachment()),
            (textures.motion_vectors.as_ref()).map(|t| t.get_attachment()),
            (textures.deferred.as_ref()).map(|t| t.get_attachment()),
            (textures.deferred_lighting_pass_id.as_ref()).map(|t| t.get_attachment()),
        ],
        depth_stencil_attachment: Some(depth.get_attachment(StoreOp::Store)),
        timestamp_writes: None,
        occlusion_query_set: None,
        multiview_mask: None,
    });
    let span = recorder.pass_span(&mut pass, "meshless_gi_rsm");
    if let Err(why) = opaque.render(&mut pass, world, entity) {
        error!("a reflective shadow map lacks its opaque meshes: {why:?}");
    }
    if let Err(why) = masked.render(&mut pass, world, entity) {
        error!("a reflective shadow map lacks its masked meshes: {why:?}");
    }
    span.end(&mut pass);
}

/// Device data of the bounce from dynamic objects.
pub(crate) struct Reflections {
    maps: RsmBuffers,
    /// Origin of the space in which all maps and views are.
    origin: Vec3,
    /// The light whose maps are being read.
    light: Option<LightId>,
    /// `true` if the baked scenes shadow reflected light.
    visibility: bool,
    /// The lights whose virtual lights the buffer holds, and the bakes that shadowed them.
    holds: Vec<LightId>,
    /// Number of frames since the last change in which all maps were drawn completely.
    frames: u32,
    shadowed_by: Vec<Shadower>,
}

/// Baked scene that casts shadows: (instance, address of the bake, local from world, transmittances
/// of its occluders).
type Shadower = (SceneId, usize, DMat4, Vec<f32>);

fn shadowers(world: &ExtractedGi, scenes: &BTreeMap<SceneId, SceneRuntime>) -> Vec<Shadower> {
    let address =
        |id: &SceneId| (scenes.get(id)).map_or(0, |s| std::sync::Arc::as_ptr(&s.bake) as usize);
    let gains = |id: &SceneId| {
        let scene = world.scenes.iter().find(|s| s.id == *id);
        scene.map_or_else(Vec::new, |s| s.transmittances.clone())
    };
    bakes(world, scenes)
        .map(|(id, local, _)| (id, address(&id), local, gains(&id)))
        .collect()
}

/// Threshold of shadow rays, where 1 is white: half a step of 12 bits. Virtual point lights that
/// together give a pixel less than this need no shadows.
const DIM: f32 = 1.0 / 8192.0;

impl Reflections {
    /// Reserves space for a frame. Does nothing if the plan draws no map.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], see [`RsmBuffers::begin`].
    pub fn begin(
        before: Option<Self>,
        lights: &LightMaps,
        plan: &Plan,
        device: &wgpu::Device,
    ) -> Result<Option<Self>, GpuError> {
        let drawn = || (lights.0.lights.iter()).filter(|l| plan.bounces(light_id(l.key)));
        let Some(first) = drawn().next() else {
            return Ok(None);
        };
        let texels = |light: &AskingLight| {
            let side = light.settings.texels();
            light.maps.as_ref().map_or(0, |m| m.len() as u32) * side * side
        };
        let texels = drawn().map(texels).max().unwrap_or(0);
        let vpls = drawn()
            .map(|l| l.settings.vpl_count.clamp(1, MAX_VPLS))
            .sum();
        let before = match before {
            Some(mut held) if !plan.resting.is_empty() => {
                held.maps.rest();
                return Ok(Some(held));
            }
            before => before,
        };
        let number = drawn().count();
        let frames = (before.as_ref())
            .filter(|b| lights.0.still > 0 && b.holds.len() == number)
            .map_or(0, |b| b.frames.saturating_add(1));
        let maps = match before {
            Some(Self { mut maps, .. }) => {
                maps.begin(device, texels, vpls)?;
                maps
            }
            None => RsmBuffers::new(device, texels, vpls)?,
        };
        Ok(Some(Self {
            maps,
            // Whole meters: rounding stays the same while a light moves a little.
            origin: first
                .views
                .first()
                .map_or(Vec3::ZERO, |v| v.position.round()),
            light: None,
            visibility: drawn().any(|l| l.settings.trace_shadows),
            holds: Vec::new(),
            frames,
            shadowed_by: Vec::new(),
        }))
    }

    /// Returns `true` if maps that are drawn now would give the same virtual lights. Only lights
    /// that bounce in `state` count.
    pub fn hold(
        &self,
        state: &FrameState,
        lights: &LightMaps,
        world: &ExtractedGi,
        scenes: &BTreeMap<SceneId, SceneRuntime>,
    ) -> bool {
        let bounce = (state.bounces.iter()).filter(|l| state.maps_of(l).is_ok());
        lights.0.still >= SETTLED
            && self.frames >= SETTLED
            && bounce.map(|l| l.id).eq(self.holds.iter().copied())
            && self.shadowed_by == shadowers(world, scenes)
    }

    /// Returns the work recorded so far.
    pub fn counters(&self) -> GpuCounters {
        self.maps.counters()
    }

    /// Buffers, and bytes of them.
    pub fn size(&self) -> (u32, u64) {
        (self.maps.buffers(), self.maps.bytes())
    }

    /// Adds the irradiance of the pixels of a view, see [`in_view`](Self::in_view).
    pub fn light_view(
        &mut self,
        kernels: &KernelPipelines,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        lights: &(VplViewParams, Option<VplShadows<'_>>),
        targets: &SplatTargets<'_>,
    ) {
        let (view, shadows) = lights;
        self.maps
            .splat(kernels, queue, encoder, view, shadows.as_ref(), targets);
    }

    /// Returns the parameters of the virtual lights in a view that shows `layers`, and their
    /// shadows there.
    pub fn in_view<'a>(
        &self,
        input: &'a ViewInput<'_>,
        scenes: &'a BTreeMap<SceneId, SceneRuntime>,
        layers: &[Layer],
    ) -> (VplViewParams, Option<VplShadows<'a>>) {
        let surfaces = input.surfaces;
        let (world_from_view, clip_from_view) =
            (surfaces.world_from_view(), surfaces.clip_from_view());
        let (viewport, size) = (surfaces.viewport(), surfaces.size);
        let exposure = surfaces.camera.exposure;
        let bake = bakes(input.world, scenes)
            .find(|(id, ..)| layers.contains(&Layer::Scene(*id)))
            .map(|(_, local, buffers)| (local, buffers));
        let view = VplViewParams {
            space_from_clip: space_from_clip(&world_from_view, &clip_from_view, self.origin)
                .to_cols_array_2d(),
            viewport,
            size,
            scale: exposure,
            pad: 0,
        };
        // An even share for each, as the irradiance of a white surface.
        let share = DIM / self.maps.used().max(1) as f32;
        let dim = share * std::f32::consts::PI / exposure.max(1e-30);
        let shadows = (bake.filter(|_| self.visibility)).map(|(local, scene)| VplShadows {
            local_from_space: local_from_space(local, self.origin),
            scene,
            dim,
        });
        (view, shadows)
    }
}

impl Reflections {
    /// The virtual lights, as they light a view that shows `layers`.
    pub fn view_lights<'a>(
        &'a self,
        input: &'a ViewInput<'_>,
        scenes: &'a BTreeMap<SceneId, SceneRuntime>,
        layers: &[Layer],
    ) -> ViewLights<'a> {
        let (view, shadows) = self.in_view(input, scenes, layers);
        ViewLights {
            maps: &self.maps,
            view,
            lit: self.maps.params(shadows.as_ref()),
            shadows,
        }
    }
}

/// From the space about `origin` to a bake's local space.
fn local_from_space(local_from_world: DMat4, origin: Vec3) -> Mat4 {
    (local_from_world * DMat4::from_translation(origin.as_dvec3())).as_mat4()
}

/// The bakes on the device, and how to get into their local spaces.
pub(crate) fn bakes<'a>(
    world: &'a ExtractedGi,
    scenes: &'a BTreeMap<SceneId, SceneRuntime>,
) -> impl Iterator<Item = (SceneId, DMat4, &'a SceneBuffers)> {
    world.scenes.iter().filter(|s| s.shown).filter_map(|scene| {
        let placement = scene.placement?;
        let frame = scenes.get(&scene.id)?.frame.as_ref()?;
        let local_from_world = Mat4::from(placement.world_from_local).as_dmat4().inverse();
        Some((scene.id, local_from_world, frame.buffers()))
    })
}

/// Makes texels of the map that was just drawn, and after the last of a light its virtual point
/// lights.
fn read(
    view: ViewQuery<View>,
    lights: Res<LightMaps>,
    world: Res<ExtractedGi>,
    mut render: ResMut<GiRender>,
    (queue, pipelines): (Res<RenderQueue>, Res<PipelineCache>),
    (opaque, masked): (
        Res<ViewBinnedRenderPhases<Opaque3dDeferred>>,
        Res<ViewBinnedRenderPhases<AlphaMask3dDeferred>>,
    ),
    mut ctx: RenderContext,
) {
    let (extracted, depth, textures) = view.into_inner();
    let phases = &extracted.retained_view_entity;
    if !opaque.contains_key(phases) || !masked.contains_key(phases) {
        // Nothing was drawn: the texture holds another map.
        return;
    }
    let camera = extracted.retained_view_entity.main_entity.id();
    let Some((light, at, maps)) = light_of(&lights, camera) else {
        return;
    };
    let id = light_id(light.key);
    let render = &mut *render;
    let (Some(kernels), Some(reflections), Some(gbuffer)) = (
        &render.kernels,
        &mut render.reflections,
        textures.deferred_view(),
    ) else {
        return;
    };
    if render.plan.find_light(id).is_none() {
        return;
    }
    if reflections.light != Some(id) {
        reflections.maps.next_light();
        reflections.light = Some(id);
    }
    let origin = reflections.origin;
    let in_space = light_in_space(&light.light, origin);
    let world_from_view = extracted.world_from_view.to_matrix();
    let matrix = space_from_clip(&world_from_view, &extracted.clip_from_view, origin);
    let side = extracted.viewport.z;
    let map = RsmCapture {
        depth: depth.view(),
        gbuffer,
        params: RsmParams::new(matrix, &in_space, side, 0),
    };
    let encoder = ctx.command_encoder();
    reflections.maps.map(kernels, &queue, encoder, &map);
    if at + 1 == maps {
        let scenes: Vec<_> = match light.settings.trace_shadows {
            true => bakes(&world, &render.scenes)
                .map(|(_, local, buffers)| (local_from_space(local, origin), buffers))
                .collect(),
            false => Vec::new(),
        };
        let vpls = light.settings.vpl_count.clamp(1, MAX_VPLS);
        reflections
            .maps
            .choose(kernels, &queue, encoder, &in_space, &scenes, vpls);
        drop(scenes);
        // A mesh whose pipeline is still made was left out.
        if pipelines.waiting_pipelines().next().is_none() {
            reflections.holds.push(id);
        }
        reflections.shadowed_by = shadowers(&world, &render.scenes);
    }
}
