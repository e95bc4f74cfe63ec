//! Description of a frame for the plan: the extracted world, compared with the device's state.

use super::camera::GiDebugView;
use super::effects::display::splatting::GiSplatting;
use super::effects::fog::fog_volumes::ExtractedFogs;
use super::effects::rsm::map_schedule::LightMaps;
use super::effects::soft_shadows::soft_lights::ExtractedSoft;
use super::effects::volume::irradiance_volume::ExtractedVolumes;
use super::effects::{rsm, soft_shadows, volume};
use super::extract::{ExtractedGi, ExtractedGiLight, ExtractedGiView, ExtractedScene, LightKey};
use super::render_state::{GiRender, SceneRuntime, bounds};
use super::transform::SimilarityTransform;
use crate::plan::{
    DisplayUse, FrameStage, FrameState, SceneId, SceneState, SkyUse, Slots, ViewState,
    fmm_fallback_reason,
};
use bevy::ecs::prelude::*;
use meshless_gi::FrameLight;
use std::collections::BTreeSet;

/// Resources of [`ExtractedWorld`], as the parameter of a system.
pub(crate) type ExtractedResources<'w> = (
    Res<'w, ExtractedGi>,
    Res<'w, ExtractedSoft>,
    Res<'w, ExtractedVolumes>,
    Res<'w, ExtractedFogs>,
    Res<'w, LightMaps>,
);

/// The world as extracted for this frame.
///
/// No `SystemParam`: for each derive, the compiler would prove again that the types of wgpu inside
/// are `Send` and `Sync`, which takes long (docs/DECISIONS.md D28).
pub(crate) struct ExtractedWorld<'w> {
    pub gi: Res<'w, ExtractedGi>,
    pub soft: Res<'w, ExtractedSoft>,
    pub volumes: Res<'w, ExtractedVolumes>,
    pub fogs: Res<'w, ExtractedFogs>,
    pub maps: Res<'w, LightMaps>,
}

impl<'w> From<ExtractedResources<'w>> for ExtractedWorld<'w> {
    fn from((gi, soft, volumes, fogs, maps): ExtractedResources<'w>) -> Self {
        Self {
            gi,
            soft,
            volumes,
            fogs,
            maps,
        }
    }
}

/// Describes a view.
fn describe_view(view: &ExtractedGiView, refused: BTreeSet<FrameStage>) -> ViewState {
    let settings = &view.settings;
    let too_large = refused.contains(&FrameStage::SPLAT);
    ViewState {
        id: view.id,
        // Irradiance is shown for a white, rough surface.
        specular: view.specular.is_some()
            && !view.forward
            && !too_large
            && settings.debug_view != GiDebugView::Irradiance,
        // Soft shadows are subtracted from the picture of a deferred camera.
        lit: settings.debug_view == GiDebugView::Final && !view.forward,
        enabled: settings.enabled,
        has_gbuffer: view.has_gbuffer,
        has_picture: !view.forward,
        pixels: view.pixels,
        display: match view.display {
            GiSplatting::PerPixel => DisplayUse::Full,
            GiSplatting::Multiresolution(_) if too_large => DisplayUse::BuffersTooLarge,
            GiSplatting::Multiresolution(_) => DisplayUse::Subsplats,
        },
        refused,
        sees: view.sees.clone(),
    }
}

/// Describes a scene, as far as its bake and settings do.
fn describe_scene(scene: &ExtractedScene, largest_binding: u64, read_back: bool) -> SceneState {
    let bake = scene.bake.as_deref();
    let probes = bake.and_then(|b| b.data().probes.as_ref());
    let occluders = bake.and_then(|b| b.data().occluders.as_ref());
    SceneState {
        loaded: bake.is_some(),
        shown: scene.shown && scene.placement.is_some(),
        read_back,
        probes: probes.is_some(),
        probe_links: probes.map_or(0, |p| p.links.len() as u64),
        tier: scene.tier.clone(),
        channels: scene.channels,
        bounces: scene.bounces,
        rays: bake.map_or(0, |bake| bake.data().rays_per_slot()),
        occluded_link_terms: occluders.map_or(0, |o| (o.links.len() + o.probes.len()) as u64),
        sky: match (bake, scene.sky.is_uniform()) {
            (_, true) | (None, _) => SkyUse::Uniform,
            (Some(bake), false) if bake.data().sky.is_some() => SkyUse::Terms,
            (Some(_), false) => SkyUse::Mean,
        },
        no_octree: bake.and_then(|b| fmm_fallback_reason(b, largest_binding)),
        ..SceneState::new(scene.id)
    }
}

impl GiRender {
    /// Removes scenes that are gone, and describes the frame for the plan.
    pub fn observe(&mut self, world: &ExtractedWorld, largest_binding: u64) -> FrameState {
        self.remove_gone(&world.gi);
        let refused = |id| (self.views.get(id)).map_or_else(BTreeSet::new, |v| v.refused.clone());
        let views = (world.gi.views.iter())
            .map(|view| describe_view(view, refused(&view.id)))
            .collect();
        let mut state = FrameState {
            is_device_supported: !self.is_device_unsupported,
            largest_binding,
            unload_after_frames: world.gi.unload_after_frames,
            scenes: Vec::with_capacity(world.gi.scenes.len()),
            views,
            bounces: world.maps.describe(&world.gi),
            virtual_lights_valid: false,
            fogs: world.fogs.describe(),
            inventory: world.gi.inventory.clone(),
        };
        for scene in &world.gi.scenes {
            let shown = state.is_shown(scene.id);
            let described = self.observe_scene(scene, world, shown, largest_binding);
            state.scenes.push(described);
        }
        rsm::observe(&mut self.states, world, &self.scenes, &mut state);
        state
    }

    /// Releases scenes that left the world or lost their bake.
    fn remove_gone(&mut self, world: &ExtractedGi) {
        let here = |id: &SceneId| world.scenes.iter().any(|s| s.id == *id && s.bake.is_some());
        let gone: Vec<SceneId> = self.scenes.keys().filter(|id| !here(id)).copied().collect();
        for id in gone {
            self.release(id);
            self.scenes.remove(&id);
        }
    }

    /// Describes a scene, with its changes since the device last computed it. `shown` is `true` if
    /// a view shows it.
    fn observe_scene(
        &mut self,
        scene: &ExtractedScene,
        world: &ExtractedWorld,
        shown: bool,
        largest_binding: u64,
    ) -> SceneState {
        let mut state = describe_scene(scene, largest_binding, world.gi.read_back);
        let Some(bake) = &scene.bake else {
            return state;
        };
        let rebaked = |r: &SceneRuntime| r.changes.bake_changed(bake);
        if self.scenes.get(&scene.id).is_some_and(rebaked) {
            self.release(scene.id);
            self.scenes.remove(&scene.id);
        }
        let runtime =
            (self.scenes.entry(scene.id)).or_insert_with(|| SceneRuntime::new(bake.clone()));
        runtime.solved_tier = None;
        let is_visible = state.shown && (shown || volume::is_visible(&world.volumes, scene.id));
        runtime.idle_frames = match is_visible {
            true => 0,
            false => runtime.idle_frames.saturating_add(1),
        };
        if is_visible && let Some(placement) = &scene.placement {
            observe_lights(runtime, scene, placement, world, &mut state);
            let counted = soft_shadows::observe(runtime, scene, placement, world, &mut state);
            self.retired.add(&counted);
            volume::observe(runtime, scene, placement, world, &mut state);
        }
        let forced = scene.channels.is_some_and(|selection| selection.forced);
        let (now, mode) = (scene.frame_settings(), scene.solver.color_mode);
        state.resident = runtime.frame.is_some();
        state.materials_changed = (runtime.changes).materials_changed(bake, &scene.materials);
        state.settings_changed = runtime.changes.settings_changed(&now, mode, forced);
        state.idle_frames = runtime.idle_frames;
        // Fewer lights need less memory.
        let slots = runtime.changes.slots.len();
        runtime.too_large = runtime.too_large.filter(|(_, then)| slots >= *then);
        state.largest_buffer = runtime.too_large.map_or(0, |(bytes, _)| bytes);
        state
    }
}

/// Describes the lights and occluders of a scene in view.
fn observe_lights(
    runtime: &mut SceneRuntime,
    scene: &ExtractedScene,
    placement: &SimilarityTransform,
    world: &ExtractedWorld,
    state: &mut SceneState,
) {
    let local_from_world = placement.matrix();
    let local = |light: &ExtractedGiLight| -> (LightKey, Vec<FrameLight>) {
        let parts = FrameLight::expand(&light.light, light.area_samples);
        let parts = parts.iter().map(|p| p.to_local(&local_from_world));
        (light.key, parts.collect())
    };
    let lights: Vec<_> = (world.gi.lights.iter())
        .filter(|l| l.layers.intersects(&scene.layers))
        .map(local)
        .collect();
    state.occluders_changed = runtime.changes.changed_occluders(&scene.transmittances);
    if state.occluders_changed > 0 {
        // All shadows may have changed.
        runtime.changes.slots.unproject();
    }
    let bounds = bounds(&runtime.bake);
    let Slots { changes, stale } = runtime.changes.slots.update(&lights, bounds);
    (state.slots, state.stale) = (changes, stale);
}
