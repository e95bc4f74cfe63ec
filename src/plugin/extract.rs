//! Reads scenes, cameras and lights out of the main world, once a frame.
//!
//! Lights are read from their own components, not from Bevy's extracted lights: those lack every
//! light that no camera sees. A light that `InheritedVisibility` hides is off. A light takes part
//! in a baked scene, and a camera shows one, where their `RenderLayers` meet those of the scene's
//! root. Units follow bevy_pbr: point and spot lights give lumens / (4π) in every direction,
//! directional lights their lux, rectangles lumens / (π · area).

use super::asset::GiBakedScene;
use super::camera::GiCamera;
use super::environment::GiEnvironment;
use super::forward_camera::ForwardDisplays;
use super::gizmos::{GiGizmos, wants_coefficients};
use super::light::GiLight;
use super::materials::{GiDynamicMaterials, ResolvedMaterials};
use super::occluders::{GiOccluder, gains};
use super::quality::GiActiveTier;
use super::rsm::GiRsmCamera;
use super::scene::GiScene;
use super::settings::GiSettings;
use super::sky::GiSky;
use super::solver::GiSolver;
use super::splatting::GiSplatting;
use super::transform::SimilarityTransform;
use super::volume::GiIrradianceVolume;
use super::vpl_specular::GiSpecular;
use crate::plan::{BounceSelection, ColorModeSelection, Inventory, SceneId, TierSelection, ViewId};
use bevy::asset::Assets;
use bevy::camera::visibility::{InheritedVisibility, RenderLayers};
use bevy::camera::{Camera, Hdr, primitives::Aabb, primitives::Frustum};
use bevy::color::{Color, LinearRgba};
use bevy::core_pipeline::prepass::{DeferredPrepass, DepthPrepass, NormalPrepass};
use bevy::ecs::prelude::*;
use bevy::ecs::query::QueryData;
use bevy::gizmos::config::GizmoConfigStore;
use bevy::light::{DirectionalLight, PointLight, RectLight, SpotLight};
use bevy::log::warn;
use bevy::math::{Mat3, Vec3};
use bevy::pbr::StandardMaterial;
use bevy::platform::collections::{HashMap, HashSet};
use bevy::reflect::prelude::*;
use bevy::render::{Extract, view::Msaa};
use bevy::transform::components::GlobalTransform;
use meshless_gi::{BakedScene, Light, MaterialFactors, SkyRadiance};
use std::f32::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

/// A baked scene of the main world, as the render world needs it.
pub(crate) struct ExtractedScene {
    pub id: SceneId,
    /// The bake; `None` while it loads.
    pub bake: Option<Arc<BakedScene>>,
    pub placement: Option<SimilarityTransform>,
    pub shown: bool,
    pub layers: RenderLayers,
    pub solver: GiSolver,
    /// Luminance of a baked emissive value of 1, cd/m²; not negative.
    pub emissive_luminance: f32,
    /// The sky's radiance in the bake's local space.
    pub sky: SkyRadiance,
    /// The factors of its materials, where they may change.
    pub materials: Vec<MaterialFactors>,
    /// What passes its occluders, where it knows any.
    pub gains: Vec<f32>,
    /// The tier and why; none while the bake loads.
    pub tier: Option<TierSelection>,
    /// In how many channels links are applied, and why; the inventory says so, none while the bake
    /// loads.
    pub channels: Option<ColorModeSelection>,
    /// With how many reflections, and why; the inventory says so, none while the bake loads or
    /// where it holds them.
    pub bounces: Option<BounceSelection>,
}

/// A camera with display settings.
pub(crate) struct ExtractedGiView {
    pub id: ViewId,
    pub layers: RenderLayers,
    pub settings: GiCamera,
    pub display: GiSplatting,
    pub gloss: Option<GiSpecular>,
    pub has_gbuffer: bool,
    /// Its surfaces read the display while they are drawn ([`super::forward_display`]).
    pub forward: bool,
    /// How many it draws.
    pub pixels: u64,
    pub sees: Vec<SceneId>,
}

/// A light of the main world, in world space, and how many area_samples it is worth.
pub(crate) struct ExtractedGiLight {
    /// The entity, and which of its lights: it may have one of each kind.
    pub key: LightKey,
    pub layers: RenderLayers,
    pub light: Light,
    pub area_samples: u32,
}

/// What a light is known by.
pub(crate) type LightKey = (u64, LightKind);

/// Bevy's kinds of lights.
#[derive(Reflect, Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum LightKind {
    Point,
    Spot,
    Directional,
    Rect,
}

/// All that the frame knows.
#[derive(Resource, Default)]
pub(crate) struct ExtractedGi {
    pub scenes: Vec<ExtractedScene>,
    pub views: Vec<ExtractedGiView>,
    pub lights: Vec<ExtractedGiLight>,
    pub unload_after_frames: u32,
    pub read_back: bool,
    /// What there is of all that, and what changed.
    pub inventory: Inventory,
}

type Scenes<'w, 's> = Query<
    'w,
    's,
    (
        Entity,
        &'static GiScene,
        &'static GiEnvironment,
        &'static GiSolver,
        &'static GiActiveTier,
        &'static GlobalTransform,
        &'static InheritedVisibility,
        Option<&'static RenderLayers>,
        Option<&'static GiDynamicMaterials>,
    ),
>;

type Cameras<'w, 's> = Query<
    'w,
    's,
    (
        Entity,
        &'static Camera,
        &'static GiCamera,
        &'static GiSplatting,
        Option<&'static GiSpecular>,
        &'static Frustum,
        Option<&'static Msaa>,
        Option<&'static RenderLayers>,
        Brought,
    ),
    Without<GiRsmCamera>,
>;

/// What every kind of light has beside itself.
#[derive(QueryData)]
pub(crate) struct LightParts {
    pub entity: Entity,
    pub transform: &'static GlobalTransform,
    visibility: &'static InheritedVisibility,
    pub layers: Option<&'static RenderLayers>,
    gi: Option<&'static GiLight>,
}

impl LightPartsItem<'_, '_> {
    /// Where the light points. Zero, which lights nothing, where its transform has no direction;
    /// Bevy's own method panics there.
    fn forward(&self) -> Vec3 {
        let back = Vec3::from(self.transform.affine().matrix3.z_axis);
        -back.normalize_or_zero()
    }

    /// What multiplies the light: 0 for one that is off.
    fn factor(&self) -> f32 {
        match (self.visibility.get(), self.gi) {
            (false, _) => 0.0,
            (true, None) => 1.0,
            (true, Some(gi)) if gi.enabled => gi.intensity.max(0.0),
            _ => 0.0,
        }
    }

    /// Whether Bevy draws the light.
    pub fn shines(&self) -> bool {
        self.visibility.get()
    }

    /// A point light in the core's terms, for indirect light.
    pub fn point(&self, light: &PointLight) -> Light {
        self.point_times(light, self.factor())
    }

    /// A point light in the core's terms, times a factor.
    pub fn point_times(&self, light: &PointLight, factor: f32) -> Light {
        Light::Point {
            position: self.transform.translation(),
            intensity: rgb(light.color) * (factor * light.intensity / (4.0 * PI)),
            range: light.range,
        }
    }

    /// A rectangle light in the core's terms, for indirect light; none without area.
    fn rect(&self, light: &RectLight) -> Option<Light> {
        self.rect_times(light, self.factor())
    }

    /// A rectangle light in the core's terms, times a factor; none without area.
    pub fn rect_times(&self, light: &RectLight, factor: f32) -> Option<Light> {
        let affine = self.transform.affine();
        // In its plane; it emits along -Z, and X × (-Y) = -Z.
        let (u, v) = (
            0.5 * light.width * affine.matrix3.x_axis,
            -0.5 * light.height * affine.matrix3.y_axis,
        );
        let area = 4.0 * u.length() * v.length();
        (area > 0.0).then(|| Light::Rect {
            center: self.transform.translation(),
            u: u.into(),
            v: v.into(),
            radiance: rgb(light.color) * (factor * light.intensity / (area * PI)),
        })
    }

    /// A spot light in the core's terms.
    pub fn spot(&self, light: &SpotLight) -> Light {
        let (inner, outer) = cone(light);
        Light::Spot {
            position: self.transform.translation(),
            direction: self.forward(),
            intensity: rgb(light.color) * (self.factor() * light.intensity / (4.0 * PI)),
            inner,
            outer,
            range: light.range,
        }
    }

    /// A directional light in the core's terms.
    pub fn directional(&self, light: &DirectionalLight) -> Light {
        Light::Directional {
            direction: self.forward(),
            irradiance: rgb(light.color) * (self.factor() * light.illuminance),
        }
    }
}

fn rgb(color: Color) -> Vec3 {
    let LinearRgba {
        red, green, blue, ..
    } = LinearRgba::from(color);
    Vec3::new(red, green, blue)
}

/// Half angles as Bevy takes them: the outer one below 90°, the inner one no larger.
fn cone(light: &SpotLight) -> (f32, f32) {
    let outer = if light.outer_angle >= FRAC_PI_2 {
        FRAC_PI_2 - 1e-4
    } else {
        light.outer_angle
    };
    (light.inner_angle.min(outer), outer)
}

/// Whether a camera with this frustum and these layers sees a scene's box.
pub(crate) fn in_view(scene: &ExtractedScene, frustum: &Frustum, layers: &RenderLayers) -> bool {
    let (Some(bake), Some(placement)) = (&scene.bake, &scene.placement) else {
        return false;
    };
    let [min, max] = bake.info.bounds.map(Vec3::from_array);
    let bounds = Aabb::from_min_max(min, max);
    layers.intersects(&scene.layers)
        && frustum.intersects_obb(&bounds, &placement.world_from_local, true, true)
}

/// All that the sky sheds, in the local space of a bake.
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
    radiance.turned(rotation)
}

/// What [`GiCamera`] brings to its camera, beside one sample a pixel.
pub(crate) type Brought = (
    Has<Hdr>,
    Has<DepthPrepass>,
    Has<NormalPrepass>,
    Has<DeferredPrepass>,
);

/// Whether a camera has all that [`GiCamera`] brought.
pub(crate) fn draws_gbuffer(
    (hdr, depth, normal, deferred): (bool, bool, bool, bool),
    msaa: Option<&Msaa>,
) -> bool {
    hdr && depth && normal && deferred && msaa.is_none_or(|m| *m == Msaa::Off)
}

/// What was said of roots and occluders; each is told once.
#[derive(Default)]
pub(crate) struct Told {
    /// Roots that are scaled differently along their axes.
    distorted: HashSet<Entity>,
    /// Roots whose bake knows less of a sky than there is.
    flat: HashSet<Entity>,
    /// What names something that no bake knows.
    strange: HashSet<Entity>,
}

#[allow(
    clippy::too_many_arguments,
    clippy::type_complexity,
    reason = "a system's parameters are its inputs"
)]
pub(crate) fn extract(
    mut out: ResMut<ExtractedGi>,
    settings: Extract<Res<GiSettings>>,
    assets: Extract<Res<Assets<GiBakedScene>>>,
    gizmos: Extract<Option<Res<GizmoConfigStore>>>,
    scenes: Extract<Scenes>,
    cameras: Extract<Cameras>,
    forward: Extract<ForwardDisplays>,
    points: Extract<Query<(LightParts, &PointLight), Without<SpotLight>>>,
    spots: Extract<Query<(LightParts, &SpotLight)>>,
    directionals: Extract<Query<(LightParts, &DirectionalLight)>>,
    rects: Extract<Query<(LightParts, &RectLight)>>,
    volumes: Extract<Query<(), With<GiIrradianceVolume>>>,
    mut told: Local<Told>,
    standard: Extract<Option<Res<Assets<StandardMaterial>>>>,
    mut resolved: Local<HashMap<Entity, ResolvedMaterials>>,
    occluders: Extract<Query<(Entity, &GiOccluder)>>,
) {
    out.unload_after_frames = settings.unload_after_frames;
    out.read_back = gizmos
        .as_ref()
        .and_then(|store| store.get_config::<GiGizmos>())
        .is_some_and(wants_coefficients);
    let standard = standard.as_deref();
    resolved.retain(|entity, _| scenes.contains(*entity));
    out.scenes.clear();
    out.views.clear();
    out.lights.clear();
    for (entity, gi, environment, solver, tier, transform, visibility, layers, materials) in &scenes
    {
        let placement = SimilarityTransform::new(transform);
        if placement.is_some_and(|p| p.distorted) && told.distorted.insert(entity) {
            warn!(
                "The root {entity} of a baked scene is scaled differently along its axes (or sheared). Indirect light follows \
                 the mean scale; bake the level in its final shape instead."
            );
        }
        let bake = assets.get(&gi.0).map(|asset| asset.scene.clone());
        let sky = sky_of(&environment.sky, placement.as_ref());
        if !sky.is_uniform()
            && (bake.as_ref()).is_some_and(|b| b.sky.is_none())
            && told.flat.insert(entity)
        {
            warn!(
                "`GiSky` varies, and the bake of {entity} knows a uniform sky only: its mean is used. Bake with `sky: Harmonics` in \
                 the recipe, or with `--sky harmonics`."
            );
        }
        let mut factors = Vec::new();
        if let Some(bake) = &bake {
            let resolved = resolved.entry(entity).or_default();
            let names;
            (factors, names) = resolved.factors(bake, materials, standard);
            if !names.is_empty() && told.strange.insert(entity) {
                warn!(
                    "`GiDynamicMaterials` of {entity} names what its bake does not know: {names:?}. Names are those of the level's file, and the bake \
                     needs `live_materials: true` in the recipe, or `--live-materials`."
                );
            }
        }
        out.scenes.push(ExtractedScene {
            id: SceneId(entity.to_bits()),
            materials: factors,
            gains: (bake.as_ref().and_then(|b| b.occluders.as_ref()))
                .map_or_else(Vec::new, |known| {
                    gains(known, occluders.iter().map(|o| o.1))
                }),
            bake,
            sky,
            placement,
            shown: visibility.get(),
            layers: layers.cloned().unwrap_or_default(),
            solver: solver.clone(),
            emissive_luminance: environment.emissive_luminance.max(0.0),
            tier: tier.picked(),
            channels: None,
            bounces: None,
        });
    }
    let whole = !out.scenes.is_empty() && out.scenes.iter().all(|s| s.bake.is_some());
    for (entity, occluder) in occluders.iter().filter(|_| whole) {
        let knows = |scene: &ExtractedScene| {
            let known = scene.bake.as_ref().and_then(|b| b.occluders.as_ref());
            known.is_some_and(|o| o.names.contains(&occluder.name))
        };
        if !out.scenes.iter().any(knows) && told.strange.insert(entity) {
            warn!(
                "`GiOccluder` of {entity} names what no bake knows: `{}`. Name it in the recipe (`occluders: [(name: \"{}\")]`), or with `--occluder`.",
                occluder.name, occluder.name
            );
        }
    }
    // Where bakes overlap the first of them shows: always the same one, whatever order the world
    // keeps its entities in.
    out.scenes.sort_unstable_by_key(|scene| scene.id);
    for (entity, camera, settings, display, gloss, frustum, msaa, layers, brought) in &cameras {
        if !camera.is_active {
            continue;
        }
        let layers = layers.cloned().unwrap_or_default();
        let sees = |scene: &&ExtractedScene| in_view(scene, frustum, &layers);
        let view = ExtractedGiView {
            id: ViewId(entity.to_bits()),
            settings: settings.clone(),
            display: *display,
            gloss: gloss.copied(),
            has_gbuffer: draws_gbuffer(brought, msaa),
            forward: false,
            pixels: (camera.physical_viewport_size())
                .map_or(0, |size| u64::from(size.x) * u64::from(size.y)),
            sees: out.scenes.iter().filter(sees).map(|s| s.id).collect(),
            layers,
        };
        out.views.push(view);
    }
    for (entity, parts) in &forward {
        if parts.camera.is_active {
            let view = parts.view(entity, &out.scenes, |id| volumes.contains(id));
            out.views.push(view);
        }
    }
    // Nothing reads the lights of a frame that shows no baked scene.
    if out.scenes.is_empty() || out.views.is_empty() && volumes.is_empty() {
        return;
    }
    let mut push = |parts: &LightPartsItem, kind, light| {
        out.lights.push(ExtractedGiLight {
            key: (parts.entity.to_bits(), kind),
            layers: parts.layers.cloned().unwrap_or_default(),
            light,
            area_samples: parts
                .gi
                .map_or_else(GiLight::default, Clone::clone)
                .area_samples
                .clamp(1, 1024),
        });
    };
    for (parts, light) in &points {
        push(&parts, LightKind::Point, parts.point(light));
    }
    for (parts, light) in &spots {
        push(&parts, LightKind::Spot, parts.spot(light));
    }
    for (parts, light) in &directionals {
        push(&parts, LightKind::Directional, parts.directional(light));
    }
    for (parts, light) in &rects {
        if let Some(light) = parts.rect(light) {
            push(&parts, LightKind::Rect, light);
        }
    }
}
