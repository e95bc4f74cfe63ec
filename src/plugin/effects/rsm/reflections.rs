//! Device data of the bounce from dynamic objects.

use crate::gpu::{
    GpuCounters, GpuError, KernelPipelines, RsmBuffers, RsmCapture, SceneBuffers, SplatTargets,
    VplShadows,
};
use crate::plan::{LightId, MapChangeDetector, Plan, SceneId};
use crate::plugin::effect_states::EffectState;
use crate::plugin::extract::ExtractedGi;
use crate::plugin::record::{Layer, MapOfLight, MapReadContext, ViewInput};
use crate::plugin::render_state::SceneRuntime;
use crate::plugin::rsm::RsmRequest;
use crate::plugin::rsm_render::{LightMaps, light_id};
use crate::plugin::splatting::ViewLights;
use bevy::math::{DMat4, Mat4, Vec3};
use meshless_gi::internals::frame::rsm_layout::{MAX_VPLS, light_in_space, space_from_clip};
use meshless_gi::internals::frame::{RsmParams, VplViewParams};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Device data of the bounce from dynamic objects.
pub(crate) struct Reflections {
    maps: RsmBuffers,
    /// Origin of the space in which all maps and views are.
    origin: Vec3,
    /// The light whose maps are being read.
    light: Option<LightId>,
    /// `true` if the baked scenes shadow reflected light.
    visibility: bool,
}

/// Baked scene that casts shadows: (instance, address of the bake, local from world, transmittances
/// of its occluders).
pub(crate) type Shadower = (SceneId, usize, DMat4, Vec<f32>);
/// Values that the virtual lights were computed from.
pub(crate) type MapChanges = MapChangeDetector<RsmRequest, Shadower>;

/// Returns the baked scenes that shadow reflected light.
pub(crate) fn shadowers(
    world: &ExtractedGi,
    scenes: &BTreeMap<SceneId, SceneRuntime>,
) -> Vec<Shadower> {
    let address = |id: &SceneId| (scenes.get(id)).map_or(0, |s| Arc::as_ptr(&s.bake) as usize);
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
const MIN_SHADOWED_RADIANCE: f32 = 1.0 / 8192.0;

impl Reflections {
    /// Reserves space for a frame. Does nothing if the plan draws no map.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], see [`RsmBuffers::begin`].
    pub fn begin(
        before: Option<Self>,
        lights: &LightMaps,
        plan: &Plan,
        changes: &mut MapChanges,
        device: &wgpu::Device,
    ) -> Result<Option<Self>, GpuError> {
        let drawn = || (lights.0.lights.iter()).filter(|l| plan.bounces(light_id(l.key)));
        let Some(first) = drawn().next() else {
            return Ok(None);
        };
        let texels = |light: &RsmRequest| {
            let side = light.settings.texels();
            light.maps.as_ref().map_or(0, |m| m.len() as u32) * side * side
        };
        let texels = drawn().map(texels).max().unwrap_or(0);
        let vpls = drawn()
            .map(|l| l.settings.vpl_count.clamp(1, MAX_VPLS))
            .sum();
        let before = match before {
            Some(mut held) if !plan.resting.is_empty() => {
                held.maps.reuse_frame();
                return Ok(Some(held));
            }
            before => before,
        };
        changes.start_maps(drawn().count());
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
        }))
    }

    /// Records the texels of a map that was drawn, and after the last map of a light its virtual
    /// point lights. A mesh may be missing in a map that is not `complete`.
    pub(super) fn read_map(ctx: &mut MapReadContext<'_>) {
        let MapOfLight {
            light,
            index,
            count,
        } = ctx.map;
        let id = light_id(light.key);
        let Some(reflections) = ctx.states.get_mut::<Self>() else {
            return;
        };
        if reflections.light != Some(id) {
            reflections.maps.next_light();
            reflections.light = Some(id);
        }
        let origin = reflections.origin;
        let in_space = light_in_space(&light.light, origin);
        let world_from_view = ctx.view.world_from_view.to_matrix();
        let matrix = space_from_clip(&world_from_view, &ctx.view.clip_from_view, origin);
        let side = ctx.view.viewport.z;
        let map = RsmCapture {
            depth: ctx.depth,
            gbuffer: ctx.gbuffer,
            params: RsmParams::new(matrix, &in_space, side, 0),
        };
        let maps = &mut reflections.maps;
        maps.map(ctx.kernels, ctx.queue, ctx.encoder, &map);
        if index + 1 < count {
            return;
        }
        let scenes: Vec<_> = match light.settings.trace_shadows {
            true => bakes(ctx.world, ctx.scenes)
                .map(|(_, local, buffers)| (local_from_space(local, origin), buffers))
                .collect(),
            false => Vec::new(),
        };
        let vpls = light.settings.vpl_count.clamp(1, MAX_VPLS);
        maps.select_vpls(
            ctx.kernels,
            ctx.queue,
            ctx.encoder,
            &in_space,
            &scenes,
            vpls,
        );
        let shadowers = shadowers(ctx.world, ctx.scenes);
        ctx.changes.finish_light(id, ctx.complete, shadowers);
    }

    /// Adds the irradiance of the pixels of a view, see [`view_params`](Self::view_params).
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
    pub fn view_params<'a>(
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
        let share = MIN_SHADOWED_RADIANCE / self.maps.vpl_count().max(1) as f32;
        let dim = share * std::f32::consts::PI / exposure.max(1e-30);
        let shadows = (bake.filter(|_| self.visibility)).map(|(local, scene)| VplShadows {
            local_from_space: local_from_space(local, self.origin),
            scene,
            dim,
        });
        (view, shadows)
    }

    /// The virtual lights, as they light a view that shows `layers`.
    pub fn view_lights<'a>(
        &'a self,
        input: &'a ViewInput<'_>,
        scenes: &'a BTreeMap<SceneId, SceneRuntime>,
        layers: &[Layer],
    ) -> ViewLights<'a> {
        let (view, shadows) = self.view_params(input, scenes, layers);
        ViewLights {
            maps: &self.maps,
            view,
            lit: self.maps.params(shadows.as_ref()),
            shadows,
        }
    }
}

impl EffectState for Reflections {
    fn size(&self) -> (u32, u64) {
        (self.maps.buffers(), self.maps.bytes())
    }

    fn counters(&self) -> GpuCounters {
        self.maps.counters()
    }
}

/// Returns the transform from the space about `origin` to a bake's local space.
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
