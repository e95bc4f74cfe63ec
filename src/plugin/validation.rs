//! Warnings about light that is counted twice and about settings without effect.
//!
//! Indirect light replaces Bevy's ambient light and diffuse light probes. If they are left on, they
//! are added and pictures become too bright and flat. Each warning is logged once.

use super::camera::GiCamera;
use super::effects::rsm::map_cameras::GiRsmCamera;
use super::effects::rsm::reflector::GiReflector;
use super::effects::volume::irradiance_volume::Voxels;
use super::extract::{GbufferComponents, draws_gbuffer};
use super::scene::GiScene;
use super::settings::GiSettings;
use bevy::asset::Assets;
use bevy::camera::Camera;
use bevy::ecs::prelude::*;
use bevy::ecs::system::SystemParam;
use bevy::light::{
    AmbientLight, EnvironmentMapLight, GlobalAmbientLight, IrradianceVolume, LightProbe,
};
use bevy::log::warn;
use bevy::material::{AlphaMode, OpaqueRendererMethod};
use bevy::pbr::{DefaultOpaqueRendererMethod, MeshMaterial3d, StandardMaterial};
use bevy::reflect::prelude::*;
use bevy::render::view::Msaa;

/// A warning about settings of the game.
#[derive(Reflect, Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[reflect(Clone, Debug, PartialEq, Hash)]
#[non_exhaustive]
pub enum GiWarning {
    /// `GlobalAmbientLight` lights a camera that shows indirect light.
    GlobalAmbient,
    /// A camera has `AmbientLight` and [`GiCamera`].
    CameraAmbient,
    /// The camera has an `EnvironmentMapLight` with diffuse light.
    EnvironmentMap,
    /// An `IrradianceVolume` of the game and a baked scene are both visible.
    IrradianceVolume,
    /// A light probe has an `EnvironmentMapLight` with diffuse light.
    LightProbe,
    /// A camera has [`GiCamera`], and a prepass was removed or MSAA is on.
    NoGbuffer,
    /// Opaque materials are drawn forward and get no indirect light.
    ForwardMaterials,
    /// A mesh has a forward material. It gets no indirect light and reflects none.
    ForwardMaterial,
    /// A mesh has a transparent material. It is drawn after the composite and gets no indirect
    /// light.
    TransparentMaterial,
    /// A light has [`GiSoftShadow`](super::GiSoftShadow), and a bake has no visibility data.
    NoVisibility,
    /// [`GiSoftShadow`](super::GiSoftShadow) is on an entity that casts no soft shadows.
    SoftShadowKind,
    /// A point light has both a shadow map and [`GiSoftShadow`](super::GiSoftShadow).
    SoftShadowTwice,
    /// The number of rectangle lights exceeds the number that Bevy draws.
    SoftShadowCount,
    /// A root has [`GiIrradianceVolume`](super::GiIrradianceVolume), and its bake has no probes.
    NoProbes,
    /// A camera's volumetric fog has ambient light, and [`GiVolumetricFog`](super::GiVolumetricFog)
    /// lights it too.
    FogAmbient,
    /// A material of [`GiDynamicMaterials`](super::GiDynamicMaterials) got another texture.
    DynamicMaterialTexture,
    /// Bevy's shader module for irradiance volumes is not the supported one.
    VolumeShader,
    /// An entity uses a bake whose scene, recipe or bake version has changed, see
    /// [`GiStaleBakes`](super::GiStaleBakes).
    StaleBake,
    /// No camera displays a bake, and some camera that shows its root is not deferred.
    NoDisplay,
    /// No camera displays a bake, and all cameras that show its root are deferred.
    NoDeferredDisplay,
}

impl GiWarning {
    /// Returns the problem and the remedy.
    #[must_use]
    pub fn message(self) -> &'static str {
        match self {
            Self::GlobalAmbient => {
                "`GlobalAmbientLight` is added to indirect light; insert \
                 `GlobalAmbientLight::NONE` (for light from the sky set `GiEnvironment::sky`)"
            }
            Self::CameraAmbient => {
                "a camera has `AmbientLight` and `GiCamera`, and both are added; set the \
                 `brightness` of `AmbientLight` to 0 (for light from the sky set \
                 `GiEnvironment::sky`)"
            }
            Self::EnvironmentMap => {
                "a camera has `EnvironmentMapLight` and `GiCamera`: the map's diffuse light is \
                 added to indirect light; set a black `diffuse_map`, which keeps the \
                 reflections"
            }
            Self::IrradianceVolume => {
                "an `IrradianceVolume` of the game and a baked scene are both visible: deferred \
                 pixels get both, unless a `GiIrradianceVolume` is in view; remove the volume, \
                 or set its `intensity` to 0"
            }
            Self::LightProbe => {
                "a light probe with an `EnvironmentMapLight` and a baked scene are both \
                 visible: the map's diffuse light is added to indirect light; set a black \
                 `diffuse_map`, which keeps the reflections"
            }
            Self::NoGbuffer => {
                "a camera with `GiCamera` shows no indirect light; keep the `Hdr`, \
                 `DepthPrepass`, `NormalPrepass`, `DeferredPrepass` and `Msaa::Off` that the \
                 component adds"
            }
            Self::ForwardMaterials => {
                "`DefaultOpaqueRendererMethod` is forward: only materials with \
                 `opaque_render_method: Deferred` receive indirect light; insert \
                 `DefaultOpaqueRendererMethod::deferred()`"
            }
            Self::ForwardMaterial => {
                "a material has `opaque_render_method: Forward`: its meshes get no indirect \
                 light, and below a `GiReflector` they reflect none; make it `Deferred` or \
                 `unlit`, or add `GiIrradianceVolume` to the root of the scene"
            }
            Self::TransparentMaterial => {
                "a material is transparent (`AlphaMode` other than `Opaque`, `Mask` and \
                 `AlphaToCoverage`, or `specular_transmission`): its meshes are drawn after the \
                 composite and get no indirect light; add `GiIrradianceVolume` to the root of \
                 the scene, or use `AlphaMode::Mask`"
            }
            Self::NoVisibility => {
                "a light has `GiSoftShadow`, and a bake has no visibility data: the light casts \
                 no soft shadows there; bake with `soft_shadows: ()` in the recipe, or with \
                 `--soft-shadows`"
            }
            Self::SoftShadowKind => {
                "`GiSoftShadow` is on an entity without `RectLight` and `PointLight` and has no \
                 effect; remove it (spot and directional lights have Bevy's shadow maps)"
            }
            Self::SoftShadowTwice => {
                "a `PointLight` has `shadow_maps_enabled` and `GiSoftShadow`: only the shadow \
                 map is used; set `shadow_maps_enabled` to false for soft shadows"
            }
            Self::SoftShadowCount => {
                "there are more than eight `RectLight`s, and Bevy draws eight of them: none \
                 casts soft shadows; hide distant ones"
            }
            Self::NoProbes => {
                "a root has `GiIrradianceVolume`, and its bake has no probes: forward cameras \
                 and transparent surfaces show no indirect light; bake with `probes: ()` in the \
                 recipe, or with `--probes`"
            }
            Self::FogAmbient => {
                "a camera's `VolumetricFog` has ambient light, and `GiVolumetricFog` lights the \
                 fog: both are added; set `ambient_intensity` to 0, or \
                 `GiVolumetricFog::intensity` to 0"
            }
            Self::DynamicMaterialTexture => {
                "a material of `GiDynamicMaterials` got another texture for its base color or \
                 its emission: indirect light keeps the baked one; change `base_color` or \
                 `emissive`, which multiply it, or bake the scene again"
            }
            Self::NoDisplay => {
                "no camera displays a baked scene; add `GiIrradianceVolume` to the root of the \
                 scene for forward cameras (the bake needs `probes: ()` in the recipe, or \
                 `--probes`), or add `GiCamera` to the camera, which makes it deferred"
            }
            Self::NoDeferredDisplay => {
                "no camera displays a baked scene; add `GiCamera` to the camera (for forward \
                 cameras add `GiIrradianceVolume` to the root of the scene; the bake needs \
                 `probes: ()` in the recipe, or `--probes`)"
            }
            Self::VolumeShader => {
                "the shader module `bevy_pbr::irradiance_volume` is not the one of the \
                 supported Bevy release, and is kept: `GiIrradianceVolume` leaks light through \
                 walls thinner than two voxels; use the Bevy release of the compatibility \
                 table, or smaller voxels"
            }
            Self::StaleBake => {
                "a bake is stale: its scene, recipe or bake version has changed (see the log); \
                 bake it again"
            }
        }
    }
}

/// Warnings so far. Each is logged once.
#[derive(Resource, Reflect, Clone, Debug, Default)]
#[reflect(Resource, Default, Clone, Debug)]
pub struct GiWarnings(pub Vec<GiWarning>);

/// Cameras with [`GiCamera`] and Bevy's lights that would be added to indirect light.
#[derive(SystemParam)]
#[allow(clippy::type_complexity, reason = "filters of queries")]
pub(crate) struct OtherLight<'w, 's> {
    cameras: Query<
        'w,
        's,
        (
            &'static Camera,
            &'static GiCamera,
            Option<&'static AmbientLight>,
            Option<&'static EnvironmentMapLight>,
            Option<&'static Msaa>,
            GbufferComponents,
        ),
        Without<GiRsmCamera>,
    >,
    probes: Query<'w, 's, &'static EnvironmentMapLight, With<LightProbe>>,
    ambient: Option<Res<'w, GlobalAmbientLight>>,
    volumes: Query<'w, 's, &'static IrradianceVolume, Without<Voxels>>,
    method: Option<Res<'w, DefaultOpaqueRendererMethod>>,
}

impl OtherLight<'_, '_> {
    fn has_display(&self) -> bool {
        let mut cameras = self.cameras.iter();
        cameras.any(|(c, gi, ..)| c.is_active && gi.enabled)
    }

    fn check(&self, found: &mut Vec<GiWarning>) {
        for (_, _, own, environment, msaa, gbuffer_components) in self
            .cameras
            .iter()
            .filter(|(c, gi, ..)| c.is_active && gi.enabled)
        {
            if !draws_gbuffer(gbuffer_components, msaa) {
                found.push(GiWarning::NoGbuffer);
                continue;
            }
            // A camera's own ambient light replaces the global one.
            match own {
                Some(own) if own.brightness > 0.0 => found.push(GiWarning::CameraAmbient),
                None if self.ambient.as_ref().is_some_and(|a| a.brightness > 0.0) => {
                    found.push(GiWarning::GlobalAmbient)
                }
                _ => {}
            }
            if environment.is_some_and(|e| e.intensity > 0.0) {
                found.push(GiWarning::EnvironmentMap);
            }
            if self.probes.iter().any(|e| e.intensity > 0.0) {
                found.push(GiWarning::LightProbe);
            }
            if self.volumes.iter().any(|v| v.intensity > 0.0) {
                found.push(GiWarning::IrradianceVolume);
            }
            if self.method.as_ref().is_some_and(|m| is_forward(m)) {
                found.push(GiWarning::ForwardMaterials);
            }
        }
    }
}

/// Materials of meshes.
#[derive(SystemParam)]
#[allow(clippy::type_complexity, reason = "filters of queries")]
pub(crate) struct MeshMaterials<'w, 's> {
    assets: Option<Res<'w, Assets<StandardMaterial>>>,
    meshes: Query<'w, 's, &'static MeshMaterial3d<StandardMaterial>>,
    changed: Query<'w, 's, (), Changed<MeshMaterial3d<StandardMaterial>>>,
}

impl MeshMaterials<'_, '_> {
    fn is_changed(&self) -> bool {
        self.assets.as_ref().is_some_and(|m| m.is_changed()) || !self.changed.is_empty()
    }
}

/// Warns about light that is counted twice and about materials without indirect light. Runs in
/// [`GiSystems::Validate`](super::GiSystems::Validate).
pub(crate) fn check(
    settings: Res<GiSettings>,
    scenes: Query<(), With<GiScene>>,
    reflectors: Query<(), With<GiReflector>>,
    gi_volumes: Query<(), With<Voxels>>,
    (other, materials): (OtherLight, MeshMaterials),
    mut materials_changed: Local<bool>,
    mut warnings: ResMut<GiWarnings>,
) {
    // A change in a frame without a check is checked later.
    *materials_changed |= materials.is_changed();
    if !settings.warn_double_counting || scenes.is_empty() && reflectors.is_empty() {
        return;
    }
    let mut found = Vec::new();
    if let (true, true, Some(assets)) = (
        other.has_display(),
        *materials_changed,
        materials.assets.as_ref(),
    ) {
        *materials_changed = false;
        // A volume lights surfaces that are in no G-buffer. Reflective shadow maps draw dynamic
        // objects from the G-buffer.
        let is_lit = |warning: &GiWarning| {
            !gi_volumes.is_empty()
                && (*warning == GiWarning::TransparentMaterial || reflectors.is_empty())
        };
        let dark = (materials.meshes.iter()).filter_map(|m| material_warning(assets.get(&m.0)?));
        found.extend(dark.filter(|warning| !is_lit(warning)));
    }
    // Without a baked scene nothing is counted twice.
    if !scenes.is_empty() {
        other.check(&mut found);
    }
    add_warnings(found, &mut warnings);
}

/// Logs and stores the warnings that are new.
pub(super) fn add_warnings(found: Vec<GiWarning>, warnings: &mut GiWarnings) {
    for warning in found {
        if !warnings.0.contains(&warning) {
            warn!("{}", warning.message());
            warnings.0.push(warning);
        }
    }
}

/// Reason that surfaces of this material get no indirect light. `None` if they get it or need none.
fn material_warning(material: &StandardMaterial) -> Option<GiWarning> {
    let solid = matches!(
        material.alpha_mode,
        AlphaMode::Opaque | AlphaMode::Mask(_) | AlphaMode::AlphaToCoverage
    );
    if material.unlit {
        None
    } else if !solid || material.specular_transmission > 0.0 {
        Some(GiWarning::TransparentMaterial)
    } else if material.opaque_render_method == OpaqueRendererMethod::Forward {
        Some(GiWarning::ForwardMaterial)
    } else {
        None
    }
}

/// Returns `true` for the forward method. The resource has no accessor, but its debug text has the
/// value.
fn is_forward(method: &DefaultOpaqueRendererMethod) -> bool {
    format!("{method:?}").contains("Forward")
}
