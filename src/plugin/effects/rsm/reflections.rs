//! Device data of the bounce from dynamic objects.

use super::EFFECT;
use crate::gpu::{
    GpuCounters, GpuError, RsmBuffers, RsmCapture, SceneBuffers, SplatTargets, VplShadows,
};
use crate::plan::{FrameState, LightId, MapChangeDetector, Pass, SceneId};
use crate::plugin::effect_states::{EffectState, EffectStates};
use crate::plugin::effects::display::splatting::ViewLights;
use crate::plugin::effects::rsm::map_cameras::RsmRequest;
use crate::plugin::effects::rsm::map_schedule::light_id;
use crate::plugin::extract::ExtractedGi;
use crate::plugin::observe::ExtractedWorld;
use crate::plugin::record::{MapOfLight, MapReadContext, MapsContext, ViewContext, ViewInput};
use crate::plugin::render_state::SceneRuntime;
use bevy::log::warn_once;
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
type MapChanges = MapChangeDetector<RsmRequest, Shadower>;

/// Stores in `state` whether the device holds the virtual lights of its lights, in their current
/// state.
pub(crate) fn observe(
    states: &mut EffectStates,
    world: &ExtractedWorld,
    scenes: &BTreeMap<SceneId, SceneRuntime>,
    state: &mut FrameState,
) {
    if state.bounces.is_empty() {
        return;
    }
    let changes = states.get_or_default::<MapChanges>();
    let maps = &world.maps.0;
    changes.observe(&maps.lights, maps.objects_changed);
    let bouncing = (state.bounces.iter()).filter(|light| state.maps_of(light).is_ok());
    let shadowers = || shadowers(&world.gi, scenes);
    state.virtual_lights_valid = !changes.changed(bouncing.map(|light| light.id), shadowers);
}

impl EffectState for MapChanges {
    fn size(&self) -> (u32, u64) {
        (0, 0)
    }

    fn is_used_by(&self, pass: &Pass) -> bool {
        pass.effect == EFFECT.name
    }
}

/// Returns the baked scenes that shadow reflected light.
fn shadowers(world: &ExtractedGi, scenes: &BTreeMap<SceneId, SceneRuntime>) -> Vec<Shadower> {
    let address = |id: &SceneId| (scenes.get(id)).map_or(0, |s| Arc::as_ptr(&s.bake) as usize);
    let transmittances = |id: &SceneId| {
        let scene = world.scenes.iter().find(|s| s.id == *id);
        scene.map_or_else(Vec::new, |s| s.transmittances.clone())
    };
    bakes(world, scenes)
        .map(|(id, local, _)| (id, address(&id), local, transmittances(&id)))
        .collect()
}

/// Threshold of shadow rays, where 1 is white: half a step of 12 bits. Virtual point lights that
/// together give a pixel less than this need no shadows.
const MIN_SHADOWED_RADIANCE: f32 = 1.0 / 8192.0;

impl Reflections {
    /// Reserves buffers for the maps of `passes`. Keeps none if they do not fit the device.
    pub(super) fn prepare(ctx: &mut MapsContext<'_>, passes: &[&Pass]) {
        let is_drawn = |l: &&RsmRequest| passes.iter().any(|p| p.light == Some(light_id(l.key)));
        let lights: Vec<&RsmRequest> = ctx.lights.iter().filter(is_drawn).collect();
        let changes = ctx.states.get_or_default::<MapChanges>();
        changes.start_maps(lights.len());
        let before = ctx.states.take::<Self>();
        let counted = before.as_ref().map(EffectState::counters);
        match Self::begin(before, &lights, ctx.device) {
            Ok(reflections) => ctx.states.insert(reflections),
            Err(error) => {
                warn_once!("dynamic objects reflect no light: {error}");
                ctx.states.take::<MapChanges>();
                ctx.counters.add(&counted.unwrap_or_default());
            }
        }
    }

    /// Begins a frame that draws the maps of `lights`.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], see [`RsmBuffers::begin`].
    fn begin(
        before: Option<Self>,
        lights: &[&RsmRequest],
        device: &wgpu::Device,
    ) -> Result<Self, GpuError> {
        let texels = |light: &&RsmRequest| {
            let side = light.settings.texels();
            light.maps.as_ref().map_or(0, |m| m.len() as u32) * side * side
        };
        let texels = lights.iter().map(texels).max().unwrap_or(0);
        let vpls = (lights.iter())
            .map(|l| l.settings.vpl_count.clamp(1, MAX_VPLS))
            .sum();
        let maps = match before {
            Some(Self { mut maps, .. }) => {
                maps.begin(device, texels, vpls)?;
                maps
            }
            None => RsmBuffers::new(device, texels, vpls)?,
        };
        let first = lights.first().and_then(|light| light.views.first());
        Ok(Self {
            maps,
            // Whole meters: rounding stays the same while a light moves a little.
            origin: first.map_or(Vec3::ZERO, |v| v.position.round()),
            light: None,
            visibility: lights.iter().any(|l| l.settings.trace_shadows),
        })
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
        let changes = ctx.states.get_or_default::<MapChanges>();
        changes.finish_light(id, ctx.complete, shadowers);
    }

    /// Adds the irradiance of the pixels of a view.
    pub(super) fn splat(ctx: &mut ViewContext<'_>, targets: &SplatTargets<'_>) -> Option<()> {
        let reflections = ctx.world_states.get_mut::<Self>()?;
        let (view, shadows) = reflections.view_params(ctx.input, ctx.scenes, &ctx.shown);
        let (maps, shadows) = (&mut reflections.maps, shadows.as_ref());
        maps.splat(ctx.kernels, ctx.queue, ctx.encoder, &view, shadows, targets);
        Some(())
    }

    /// Returns the parameters of the virtual lights in a view of the scenes `shown`, and their
    /// shadows there.
    fn view_params<'a>(
        &self,
        input: &'a ViewInput<'_>,
        scenes: &'a BTreeMap<SceneId, SceneRuntime>,
        shown: &[SceneId],
    ) -> (VplViewParams, Option<VplShadows<'a>>) {
        let surfaces = input.surfaces;
        let (world_from_view, clip_from_view) =
            (surfaces.world_from_view(), surfaces.clip_from_view());
        let (viewport, size) = (surfaces.viewport(), surfaces.size);
        let exposure = surfaces.camera.exposure;
        let bake = bakes(input.world, scenes)
            .find(|(id, ..)| shown.contains(id))
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

    /// Returns the virtual lights in a view of the scenes `shown`.
    pub fn view_lights<'a>(
        &'a self,
        input: &'a ViewInput<'_>,
        scenes: &'a BTreeMap<SceneId, SceneRuntime>,
        shown: &[SceneId],
    ) -> ViewLights<'a> {
        let (view, shadows) = self.view_params(input, scenes, shown);
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

    fn is_used_by(&self, pass: &Pass) -> bool {
        pass.effect == EFFECT.name
    }

    /// Makes the uniform buffers of the frame available for the next one. The virtual lights stay.
    fn finish_frame(&mut self) {
        self.maps.reuse_frame();
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
