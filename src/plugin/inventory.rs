//! Takes the [inventory](crate::plan::Inventory) of the world. The main world collects materials
//! with a normal map, each after a change. Extraction collects everything else, after it has read
//! scenes and lights.

use super::camera::GiCamera;
use super::effects::rsm::map_cameras::{GiRsmCamera, RsmRequests};
use super::effects::rsm::reflector::GiReflector;
use super::extract::{
    ExtractedGi, ExtractedGiLight, ExtractedScene, GbufferComponents, LightKey, draws_gbuffer,
};
use super::render_state::bounds;
use crate::plan::{
    BounceSelector, Cameras, ColorModeSelector, InventoryTracker, SceneId, SceneSnapshot,
    WorldSnapshot, light_affects,
};
use bevy::asset::{AssetEvent, AssetId, Assets};
use bevy::camera::{Camera, Camera3d};
use bevy::ecs::prelude::*;
use bevy::light::FogVolume;
use bevy::pbr::StandardMaterial;
use bevy::platform::collections::HashSet;
use bevy::render::{Extract, view::Msaa};
use meshless_gi::FrameLight;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The materials with a normal map.
#[derive(Resource, Debug, Default)]
pub(crate) struct NormalMaps(HashSet<AssetId<StandardMaterial>>);

/// Updates the materials that were added, changed or removed in this frame.
pub(crate) fn update_normal_maps(
    mut found: ResMut<NormalMaps>,
    mut events: MessageReader<AssetEvent<StandardMaterial>>,
    materials: Res<Assets<StandardMaterial>>,
) {
    for event in events.read() {
        let (AssetEvent::Added { id }
        | AssetEvent::Modified { id }
        | AssetEvent::Removed { id }
        | AssetEvent::LoadedWithDependencies { id }) = event
        else {
            continue;
        };
        let mapped = (materials.get(*id)).is_some_and(|m| m.normal_map_texture.is_some());
        match mapped {
            true => found.0.insert(*id),
            false => found.0.remove(id),
        };
    }
}

type AnyCamera = (
    &'static Camera,
    Option<&'static GiCamera>,
    Option<&'static Msaa>,
    GbufferComponents,
);

/// Returns `true` if a light of the world may light a scene. It has to share a layer with the
/// scene, and its range has to reach the scene.
fn lights(light: &ExtractedGiLight, scene: &ExtractedScene) -> bool {
    let (Some(placement), Some(bake)) = (&scene.placement, &scene.bake) else {
        return true;
    };
    let local = placement.matrix();
    let arrives = |part: &FrameLight| light_affects(&part.to_local(&local), bounds(bake));
    light.layers.intersects(&scene.layers)
        && FrameLight::expand(&light.light, 1).iter().any(arrives)
}

/// Selectors of one scene.
#[derive(Default)]
pub(crate) struct SceneSelectors {
    channels: ColorModeSelector,
    bounces: BounceSelector,
    /// The bake that reflections are selected for.
    bake: usize,
}

/// Runs in [`GiRenderSystems::Extract`](super::GiRenderSystems::Extract), after scenes and lights
/// were read.
#[allow(
    clippy::type_complexity,
    reason = "a system's parameters are its inputs"
)]
pub(crate) fn take_inventory(
    mut world: ResMut<ExtractedGi>,
    mut tracker: Local<InventoryTracker<LightKey>>,
    mut selectors: Local<BTreeMap<SceneId, SceneSelectors>>,
    cameras: Extract<Query<AnyCamera, (With<Camera3d>, Without<GiRsmCamera>)>>,
    requests: Extract<Res<RsmRequests>>,
    maps: Extract<Res<NormalMaps>>,
    (reflectors, fogs): (
        Extract<Query<(), With<GiReflector>>>,
        Extract<Query<(), With<FogVolume>>>,
    ),
) {
    let mut counted = Cameras::default();
    for (camera, ours, msaa, gbuffer_components) in &cameras {
        if !camera.is_active {
            continue;
        }
        let Cameras {
            deferred: shown,
            forward,
            sampled,
            off,
        } = &mut counted;
        let one_sample = msaa.is_some_and(|m| *m == Msaa::Off);
        let kind = match ours {
            Some(camera) if !camera.enabled => off,
            Some(_) if draws_gbuffer(gbuffer_components, msaa) => shown,
            _ if one_sample => forward,
            _ => sampled,
        };
        *kind += 1;
    }
    let world = &mut *world;
    let found = WorldSnapshot {
        lights: world.lights.iter().map(|l| (l.key, &l.light)).collect(),
        scenes: (world.scenes.iter())
            .map(|scene| SceneSnapshot {
                id: scene.id,
                bake: scene.bake.as_ref(),
                transform: (scene.placement.as_ref())
                    .map_or([0.0; 12], |p| p.world_from_local.to_cols_array()),
                sky: scene.sky,
                emission: scene.emissive_luminance,
                materials: &scene.materials,
                transmittances: &scene.transmittances,
                unlit_by: (world.lights.iter().enumerate())
                    .filter(|(_, light)| !lights(light, scene))
                    .map(|(k, _)| k)
                    .collect(),
            })
            .collect(),
        cameras: counted,
        reflectors: reflectors.iter().count() as u32,
        bouncing_lights: requests.lights.len() as u32,
        normal_maps: maps.0.len() as u32,
        fogs: fogs.iter().count() as u32,
    };
    world.inventory = tracker.update(&found);
    selectors.retain(|id, _| world.scenes.iter().any(|s| s.id == *id));
    for scene in &mut world.scenes {
        let Some(bake) = &scene.bake else { continue };
        let selectors = selectors.entry(scene.id).or_default();
        let requested = scene.solver.color_mode;
        let colors = tracker.colors_of(scene.id);
        scene.channels = Some(selectors.channels.select(requested, colors));
        let which = Arc::as_ptr(bake) as usize;
        if selectors.bake != which {
            (selectors.bake, selectors.bounces) = (which, BounceSelector::new());
        }
        let requested = scene.solver.bounces;
        scene.bounces = selectors.bounces.select(requested, bake, &scene.materials);
    }
}
