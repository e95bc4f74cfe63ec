//! Reads scenes, cameras and lights out of the main world, once per frame.
//!
//! A light contributes to a baked scene, and a camera shows one, if their `RenderLayers` intersect
//! those of the scene's root.

use super::asset::GiBakedScene;
use super::camera::GiCamera;
use super::effects::display::splatting::GiSplatting;
use super::effects::materials::dynamic_materials::{GiDynamicMaterials, ResolvedMaterials};
use super::effects::occluders::occluder::{GiOccluder, transmittances};
use super::effects::rsm::map_cameras::GiRsmCamera;
use super::effects::volume::irradiance_volume::GiIrradianceVolume;
use super::effects::vpl_specular::specular::GiSpecular;
use super::environment::GiEnvironment;
pub(crate) use super::extract_lights::{
    ExtractedGiLight, LightKey, LightParts, LightPartsItem, LightSources,
};
use super::forward_camera::ForwardDisplays;
use super::gizmos::{GiGizmos, requests_coefficients};
use super::quality::GiActiveTier;
use super::scene::GiScene;
use super::settings::GiSettings;
use super::sky::GiSky;
use super::solver::GiSolver;
use super::transform::SimilarityTransform;
use crate::plan::{BounceSelection, ColorModeSelection, Inventory, SceneId, TierSelection, ViewId};
use bevy::asset::Assets;
use bevy::camera::visibility::{InheritedVisibility, RenderLayers};
use bevy::camera::{Camera, Hdr, primitives::Aabb, primitives::Frustum};
use bevy::core_pipeline::prepass::{DeferredPrepass, DepthPrepass, NormalPrepass};
use bevy::ecs::prelude::*;
use bevy::ecs::query::QueryData;
use bevy::ecs::system::SystemParam;
use bevy::gizmos::config::GizmoConfigStore;
use bevy::log::warn;
use bevy::math::{Mat3, Vec3};
use bevy::pbr::StandardMaterial;
use bevy::platform::collections::{HashMap, HashSet};
use bevy::render::{Extract, view::Msaa};
use bevy::transform::components::GlobalTransform;
use meshless_gi::{BakedScene, MaterialFactors, SkyRadiance};
use std::sync::Arc;

/// A baked scene of the main world, extracted for the render world.
pub(crate) struct ExtractedScene {
    pub id: SceneId,
    /// Bake of the scene. `None` while it loads.
    pub bake: Option<Arc<BakedScene>>,
    pub placement: Option<SimilarityTransform>,
    pub shown: bool,
    pub layers: RenderLayers,
    pub solver: GiSolver,
    /// Luminance of a baked emissive value of 1, cd/m². It is not negative.
    pub emissive_luminance: f32,
    /// The sky's radiance in the bake's local space.
    pub sky: SkyRadiance,
    /// Factors of dynamic materials. Empty if the bake has none.
    pub materials: Vec<MaterialFactors>,
    /// Transmittances of the bake's occluders. Empty if it has none.
    pub transmittances: Vec<f32>,
    /// Selected tier and reason. `None` while the bake loads.
    pub tier: Option<TierSelection>,
    /// Color mode of the solve and reason, set with the inventory. `None` while the bake loads.
    pub channels: Option<ColorModeSelection>,
    /// Number of bounces and reason, set with the inventory. `None` while the bake loads and if the
    /// bake stores its bounces.
    pub bounces: Option<BounceSelection>,
}

/// A camera with display settings.
pub(crate) struct ExtractedGiView {
    pub id: ViewId,
    pub layers: RenderLayers,
    pub settings: GiCamera,
    pub display: GiSplatting,
    pub specular: Option<GiSpecular>,
    pub has_gbuffer: bool,
    /// Surfaces read the display while they are drawn ([`super::forward_display`]).
    pub forward: bool,
    /// Number of pixels that it draws.
    pub pixels: u64,
    pub sees: Vec<SceneId>,
}

/// World state of a frame.
#[derive(Resource, Default)]
pub(crate) struct ExtractedGi {
    pub scenes: Vec<ExtractedScene>,
    pub views: Vec<ExtractedGiView>,
    pub lights: Vec<ExtractedGiLight>,
    pub unload_after_frames: u32,
    pub read_back: bool,
    /// Counts of the world state and of its changes.
    pub inventory: Inventory,
}

/// Components of a scene's root.
#[derive(QueryData)]
pub(crate) struct Root {
    entity: Entity,
    scene: &'static GiScene,
    environment: &'static GiEnvironment,
    solver: &'static GiSolver,
    tier: &'static GiActiveTier,
    transform: &'static GlobalTransform,
    visibility: &'static InheritedVisibility,
    layers: Option<&'static RenderLayers>,
    materials: Option<&'static GiDynamicMaterials>,
}

/// Components of a camera with [`GiCamera`].
#[derive(QueryData)]
pub(crate) struct View {
    entity: Entity,
    camera: &'static Camera,
    settings: &'static GiCamera,
    display: &'static GiSplatting,
    specular: Option<&'static GiSpecular>,
    frustum: &'static Frustum,
    msaa: Option<&'static Msaa>,
    layers: Option<&'static RenderLayers>,
    gbuffer_components: GbufferComponents,
}

/// Returns `true` if the scene's bounds intersect the frustum and the layers of a camera.
pub(crate) fn in_view(scene: &ExtractedScene, frustum: &Frustum, layers: &RenderLayers) -> bool {
    let (Some(bake), Some(placement)) = (&scene.bake, &scene.placement) else {
        return false;
    };
    let [min, max] = bake.info().bounds.map(Vec3::from_array);
    let bounds = Aabb::from_min_max(min, max);
    layers.intersects(&scene.layers)
        && frustum.intersects_obb(&bounds, &placement.world_from_local, true, true)
}

/// Radiance of the sky in the local space of a bake.
fn sky_of(sky: &GiSky, placement: Option<&SimilarityTransform>) -> SkyRadiance {
    let radiance = sky.radiance();
    if !matches!(sky, GiSky::Harmonics(_)) {
        return radiance;
    }
    let Some(placement) = placement.filter(|_| radiance.is_finite()) else {
        return SkyRadiance::from(Vec3::ZERO);
    };
    // Its linear part is a rotation over the scale.
    let rotation = Mat3::from(placement.local_from_world().matrix3) * placement.scale;
    radiance.rotate(rotation)
}

/// Components that [`GiCamera`] adds to its camera, in addition to one sample per pixel.
pub(crate) type GbufferComponents = (
    Has<Hdr>,
    Has<DepthPrepass>,
    Has<NormalPrepass>,
    Has<DeferredPrepass>,
);

/// Returns `true` if a camera still has all that [`GiCamera`] added.
pub(crate) fn draws_gbuffer(
    (hdr, depth, normal, deferred): (bool, bool, bool, bool),
    msaa: Option<&Msaa>,
) -> bool {
    hdr && depth && normal && deferred && msaa.is_none_or(|m| *m == Msaa::Off)
}

/// Entities that were warned about. Each gets one warning of a kind.
#[derive(Default)]
struct IssuedWarnings {
    /// Roots with a non-uniform scale.
    non_uniform_scale: HashSet<Entity>,
    /// Roots whose bake supports only a uniform sky.
    sky_unsupported: HashSet<Entity>,
    /// Entities with a name that no bake has.
    unknown_names: HashSet<Entity>,
}

impl IssuedWarnings {
    fn check_scale(&mut self, root: Entity, placement: Option<&SimilarityTransform>) {
        if placement.is_some_and(|p| p.has_non_uniform_scale) && self.non_uniform_scale.insert(root)
        {
            warn!(
                "baked scene {root}: non-uniform scale or shear; indirect light uses the mean \
                 scale, bake the scene in its final shape"
            );
        }
    }

    fn check_sky(&mut self, root: Entity, sky: &SkyRadiance, bake: Option<&BakedScene>) {
        if !sky.is_uniform()
            && bake.is_some_and(|b| b.data().sky.is_none())
            && self.sky_unsupported.insert(root)
        {
            warn!(
                "baked scene {root}: the bake supports only a uniform sky, the mean of \
                 `GiSky::Harmonics` is used; bake with `sky: Harmonics` in the recipe, or with \
                 `--sky harmonics`"
            );
        }
    }

    fn check_materials(&mut self, root: Entity, names: &[String]) {
        if !names.is_empty() && self.unknown_names.insert(root) {
            warn!(
                "`GiDynamicMaterials` of {root}: the bake has no materials {names:?}; use the names \
                 of the scene's file, and bake with `dynamic_materials: true` in the recipe, or \
                 with `--dynamic-materials`"
            );
        }
    }

    fn check_occluder(&mut self, entity: Entity, name: &str, scenes: &[ExtractedScene]) {
        let has_name = |scene: &ExtractedScene| {
            let occluders = scene
                .bake
                .as_ref()
                .and_then(|b| b.data().occluders.as_ref());
            occluders.is_some_and(|o| o.names.iter().any(|known| known == name))
        };
        if !scenes.iter().any(has_name) && self.unknown_names.insert(entity) {
            warn!(
                "`GiOccluder` of {entity}: no bake has an occluder `{name}`; add it to the recipe \
                 (`occluders: [(name: \"{name}\")]`), or bake with `--occluder`"
            );
        }
    }
}

/// State that [`extract`] keeps between frames.
#[derive(Default)]
pub(crate) struct ExtractState {
    warned: IssuedWarnings,
    /// Materials of the roots that have dynamic ones.
    materials: HashMap<Entity, ResolvedMaterials>,
}

/// Baked scenes of the main world.
#[derive(SystemParam)]
pub(crate) struct SceneSources<'w, 's> {
    roots: Query<'w, 's, Root>,
    bakes: Res<'w, Assets<GiBakedScene>>,
    materials: Option<Res<'w, Assets<StandardMaterial>>>,
    occluders: Query<'w, 's, (Entity, &'static GiOccluder)>,
}

impl SceneSources<'_, '_> {
    /// Appends all scenes to `out`, in the order of their entities.
    fn extract(&self, state: &mut ExtractState, out: &mut Vec<ExtractedScene>) {
        state.materials.retain(|root, _| self.roots.contains(*root));
        out.extend(self.roots.iter().map(|root| self.scene(&root, state)));
        if !out.is_empty() && out.iter().all(|s| s.bake.is_some()) {
            for (entity, occluder) in &self.occluders {
                state.warned.check_occluder(entity, &occluder.name, out);
            }
        }
        // If bakes overlap, the first one is displayed. The order of the world's entities varies.
        out.sort_unstable_by_key(|scene| scene.id);
    }

    fn scene(&self, root: &RootItem, state: &mut ExtractState) -> ExtractedScene {
        let entity = root.entity;
        let warned = &mut state.warned;
        let placement = SimilarityTransform::new(root.transform);
        warned.check_scale(entity, placement.as_ref());
        let bake = self.bakes.get(&root.scene.0).map(|a| a.scene.clone());
        let sky = sky_of(&root.environment.sky, placement.as_ref());
        warned.check_sky(entity, &sky, bake.as_deref());
        let mut factors = Vec::new();
        if let Some(bake) = &bake {
            let resolved = state.materials.entry(entity).or_default();
            let names;
            (factors, names) = resolved.factors(bake, root.materials, self.materials.as_deref());
            warned.check_materials(entity, names);
        }
        let occluders = bake.as_ref().and_then(|b| b.data().occluders.as_ref());
        let transmittances = occluders.map_or_else(Vec::new, |occluders| {
            transmittances(occluders, self.occluders.iter().map(|o| o.1))
        });
        ExtractedScene {
            id: SceneId(entity.to_bits()),
            materials: factors,
            transmittances,
            bake,
            sky,
            placement,
            shown: root.visibility.get(),
            layers: root.layers.cloned().unwrap_or_default(),
            solver: root.solver.clone(),
            emissive_luminance: root.environment.emissive_luminance.max(0.0),
            tier: root.tier.selection(),
            channels: None,
            bounces: None,
        }
    }
}

/// Cameras of the main world that show indirect light.
#[derive(SystemParam)]
pub(crate) struct ViewSources<'w, 's> {
    cameras: Query<'w, 's, View, Without<GiRsmCamera>>,
    forward: ForwardDisplays<'w, 's>,
    volumes: Query<'w, 's, (), With<GiIrradianceVolume>>,
}

impl ViewSources<'_, '_> {
    /// Appends the views of all active cameras to `out`.
    fn extract(&self, scenes: &[ExtractedScene], out: &mut Vec<ExtractedGiView>) {
        for view in self.cameras.iter().filter(|view| view.camera.is_active) {
            let layers = view.layers.cloned().unwrap_or_default();
            let sees = |scene: &&ExtractedScene| in_view(scene, view.frustum, &layers);
            let size = view.camera.physical_viewport_size();
            out.push(ExtractedGiView {
                id: ViewId(view.entity.to_bits()),
                settings: view.settings.clone(),
                display: *view.display,
                specular: view.specular.copied(),
                has_gbuffer: draws_gbuffer(view.gbuffer_components, view.msaa),
                forward: false,
                pixels: size.map_or(0, |size| u64::from(size.x) * u64::from(size.y)),
                sees: scenes.iter().filter(sees).map(|s| s.id).collect(),
                layers,
            });
        }
        for (entity, parts) in &self.forward {
            if parts.camera.is_active {
                out.push(parts.view(entity, scenes, |id| self.volumes.contains(id)));
            }
        }
    }
}

/// Runs in [`GiRenderSystems::Extract`](super::GiRenderSystems::Extract).
pub(crate) fn extract(
    mut out: ResMut<ExtractedGi>,
    settings: Extract<Res<GiSettings>>,
    gizmos: Extract<Option<Res<GizmoConfigStore>>>,
    scenes: Extract<SceneSources>,
    views: Extract<ViewSources>,
    lights: Extract<LightSources>,
    mut state: Local<ExtractState>,
) {
    let out = &mut *out;
    out.unload_after_frames = settings.unload_after_frames;
    out.read_back = gizmos
        .as_ref()
        .and_then(|store| store.get_config::<GiGizmos>())
        .is_some_and(requests_coefficients);
    out.scenes.clear();
    out.views.clear();
    out.lights.clear();
    scenes.extract(&mut state, &mut out.scenes);
    views.extract(&out.scenes, &mut out.views);
    // Nothing reads the lights of a frame that shows no baked scene.
    if !(out.scenes.is_empty() || out.views.is_empty() && views.volumes.is_empty()) {
        lights.extract(&mut out.lights);
    }
}
