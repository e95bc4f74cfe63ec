//! Says what would be counted twice, and what would show nothing.
//!
//! Indirect light replaces Bevy's ambient light and diffuse light probes. Left on, they are added
//! on top: pictures become too bright and flat. Each finding is told once, with what to set.

use super::camera::GiCamera;
use super::extract::{Brought, draws_gbuffer};
use super::rsm::{GiReflector, GiRsmCamera};
use super::scene::GiScene;
use super::settings::GiSettings;
use super::volume::Voxels;
use bevy::asset::Assets;
use bevy::camera::Camera;
use bevy::ecs::prelude::*;
use bevy::light::{
    AmbientLight, EnvironmentMapLight, GlobalAmbientLight, IrradianceVolume, LightProbe,
};
use bevy::log::warn;
use bevy::material::{AlphaMode, OpaqueRendererMethod};
use bevy::pbr::{DefaultOpaqueRendererMethod, MeshMaterial3d, StandardMaterial};
use bevy::reflect::prelude::*;
use bevy::render::view::Msaa;

/// What a check may find. Kept as data so that tests read it.
#[derive(Reflect, Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[reflect(Clone, Debug, PartialEq, Hash)]
#[non_exhaustive]
pub enum GiWarning {
    /// `GlobalAmbientLight` shines in a camera that shows indirect light.
    GlobalAmbient,
    /// The camera's own `AmbientLight` shines.
    CameraAmbient,
    /// The camera has an `EnvironmentMapLight` with diffuse light.
    EnvironmentMap,
    /// An `IrradianceVolume` shines beside a baked scene.
    IrradianceVolume,
    /// A light probe has an `EnvironmentMapLight` with diffuse light.
    LightProbe,
    /// A camera has [`GiCamera`] but not what that brought: a prepass is gone, or it takes several
    /// samples a pixel.
    NoGbuffer,
    /// Opaque materials are drawn forward, where the composite cannot reach them.
    ForwardMaterials,
    /// A mesh has a material that is asked to be drawn forward: it gets no indirect light, and
    /// reflects none.
    ForwardMaterial,
    /// A mesh has a material that lets light through: it is drawn over the picture that indirect
    /// light is in, and gets none itself.
    TransparentMaterial,
    /// A lamp casts soft shadows, and a bake does not remember what its points see.
    NoVisibility,
    /// [`GiSoftShadow`](super::GiSoftShadow) is on something that casts no soft shadows.
    SoftShadowKind,
    /// A point light has both a shadow map and [`GiSoftShadow`](super::GiSoftShadow).
    SoftShadowTwice,
    /// There are more rectangle lights than Bevy draws.
    SoftShadowCount,
    /// A scene is to have a volume for forward cameras, and its bake knows no light in free space.
    NoFreeSpace,
    /// The camera's volumetric fog has ambient light, and a level lights it.
    FogAmbient,
    /// A material of [`GiDynamicMaterials`](super::GiDynamicMaterials) got another texture.
    LiveTexture,
    /// Bevy's shader module for irradiance volumes is not the one that ours takes the place of.
    VolumeShader,
    /// An entity uses a bake whose level, recipe or bake version has changed since, see
    /// [`GiStaleBakes`](super::GiStaleBakes).
    StaleBake,
    /// No camera displays a bake, and some camera that sees its root is not deferred.
    NoDisplay,
    /// No camera displays a bake, and all cameras that see its root are deferred.
    NoDeferredDisplay,
}

impl GiWarning {
    /// What is wrong and what to set.
    #[must_use]
    pub fn advice(self) -> &'static str {
        match self {
            Self::GlobalAmbient => {
                "Bevy's ambient light is added to indirect light: insert `GlobalAmbientLight::NONE` \
                 (for light from the sky set `GiEnvironment::sky`, which knows where the walls are)."
            }
            Self::CameraAmbient => {
                "A camera has both `AmbientLight` and `GiCamera`: set the former's `brightness` to 0 \
                 (for light from the sky set `GiEnvironment::sky`)."
            }
            Self::EnvironmentMap => {
                "A camera has both `EnvironmentMapLight` and `GiCamera`: its diffuse part is added to indirect light. \
                 Give it a black `diffuse_map` and keep its reflections."
            }
            Self::IrradianceVolume => {
                "An `IrradianceVolume` of the game's and a baked scene are both visible: deferred pixels get both, unless a `GiIrradianceVolume` is in view. Remove the volume, or set its \
                 `intensity` to 0."
            }
            Self::LightProbe => {
                "A light probe with an `EnvironmentMapLight` and a baked scene are both visible: its diffuse part is added to \
                 indirect light. Give it a black `diffuse_map` and keep its reflections."
            }
            Self::NoGbuffer => {
                "A camera with `GiCamera` shows no indirect light: it must keep the `Hdr`, `DepthPrepass`, `NormalPrepass`, \
                 `DeferredPrepass` and `Msaa::Off` that the component brings."
            }
            Self::ForwardMaterials => {
                "`DefaultOpaqueRendererMethod` is forward: only materials with `opaque_render_method: Deferred` receive indirect \
                 light. Insert `DefaultOpaqueRendererMethod::deferred()`."
            }
            Self::ForwardMaterial => {
                "A mesh's material has `opaque_render_method: Forward`: it is not in the G-buffer, so it gets no indirect light, and below a \
                 `GiReflector` it reflects none. Make it `Deferred`, or `unlit`, or light it by a `GiIrradianceVolume` on the level's root."
            }
            Self::TransparentMaterial => {
                "A mesh's material is transparent (`AlphaMode` other than `Opaque`, `Mask` and `AlphaToCoverage`, or `specular_transmission`): it is drawn \
                 after indirect light was added, over the surfaces behind it, and gets none itself. Put a `GiIrradianceVolume` on the level's root, which lights it; `AlphaMode::Mask` needs none."
            }
            Self::NoVisibility => {
                "A light has `GiSoftShadow`, and a bake holds no visibility: it casts no soft shadows there, and Bevy's light stays as it is. \
                 Bake the level with `soft_shadows: ()` in its recipe, or with `--soft-shadows`."
            }
            Self::SoftShadowKind => {
                "`GiSoftShadow` is on what is neither a `RectLight` nor a `PointLight`: nothing is done. Spot and directional lights have Bevy's \
                 shadow maps."
            }
            Self::SoftShadowTwice => {
                "A `PointLight` has both `shadow_maps_enabled` and `GiSoftShadow`: only its shadow map is used. Set `shadow_maps_enabled` to false \
                 for soft shadows."
            }
            Self::SoftShadowCount => {
                "There are more than eight `RectLight`s, of which Bevy draws eight: which ones is not known, so none of them casts soft shadows. Hide those \
                 that are far away."
            }
            Self::NoFreeSpace => {
                "A root has `GiIrradianceVolume`, and its bake knows no light in free space: forward cameras and transparent surfaces show none. Bake the level with `probes: ()` in its \
                 recipe, or with `--probes`."
            }
            Self::FogAmbient => {
                "A camera's `VolumetricFog` has ambient light, and a `GiIrradianceVolume` lights the fog: both are added. Set `ambient_intensity` to 0, or the volume's `fog` to 0."
            }
            Self::LiveTexture => {
                "A material that `GiDynamicMaterials` names got another texture for its base color or its emission: indirect light keeps that of the bake. Change `base_color` or \
                 `emissive`, which multiply it, or bake the level again."
            }
            Self::NoDisplay => {
                "No camera displays a baked scene, so there is no indirect light in the picture. Put `GiIrradianceVolume` on the scene's root, which lights \
                 cameras that are not deferred (the bake needs `probes: ()` in its recipe, or `--probes`), or add `GiCamera` to the camera, which makes \
                 it deferred and displays the whole bake."
            }
            Self::NoDeferredDisplay => {
                "No camera displays a baked scene, so there is no indirect light in the picture. Add `GiCamera` to the camera, which displays the whole \
                 bake. For cameras that are not deferred, put `GiIrradianceVolume` on the scene's root (the bake needs `probes: ()` in its recipe, or `--probes`)."
            }
            Self::VolumeShader => {
                "The shader module `bevy_pbr::irradiance_volume` is not that of the Bevy release that this plugin was written for, and stays as it is: a `GiIrradianceVolume` lets light of the next \
                 room through walls thinner than two voxels. Use the Bevy release that the plugin's documentation names, or smaller voxels."
            }
            Self::StaleBake => {
                "A bake is stale: its level, its recipe or the bake version has changed since. The log names it. Bake it again."
            }
        }
    }
}

/// What the check found so far; each finding is told once in the log.
#[derive(Resource, Reflect, Clone, Debug, Default)]
#[reflect(Resource, Default, Clone, Debug)]
pub struct GiWarnings(pub Vec<GiWarning>);

/// Runs in [`GiSystems::Validate`](super::GiSystems::Validate).
#[allow(
    clippy::too_many_arguments,
    clippy::type_complexity,
    reason = "a system's parameters are its inputs"
)]
pub(crate) fn check(
    settings: Res<GiSettings>,
    scenes: Query<(), With<GiScene>>,
    cameras: Query<
        (
            &Camera,
            &GiCamera,
            Option<&AmbientLight>,
            Option<&EnvironmentMapLight>,
            Option<&Msaa>,
            Brought,
        ),
        Without<GiRsmCamera>,
    >,
    probes: Query<&EnvironmentMapLight, With<LightProbe>>,
    ambient: Option<Res<GlobalAmbientLight>>,
    volumes: Query<&IrradianceVolume, Without<Voxels>>,
    ours: Query<(), With<Voxels>>,
    method: Option<Res<DefaultOpaqueRendererMethod>>,
    bouncers: Query<(), With<GiReflector>>,
    materials: Option<Res<Assets<StandardMaterial>>>,
    meshes: Query<&MeshMaterial3d<StandardMaterial>>,
    changed: Query<(), Changed<MeshMaterial3d<StandardMaterial>>>,
    mut look: Local<bool>,
    mut findings: ResMut<GiWarnings>,
) {
    // What changed while nothing was asked of it is looked at later.
    *look |= materials.as_ref().is_some_and(|m| m.is_changed()) || !changed.is_empty();
    if !settings.warn_double_counting || scenes.is_empty() && bouncers.is_empty() {
        return;
    }
    let mut found = Vec::new();
    let shows = cameras.iter().any(|(c, gi, ..)| c.is_active && gi.enabled);
    if let (true, true, Some(materials)) = (shows, *look, materials) {
        *look = false;
        // A volume lights what no G-buffer holds; what moves is drawn by lamps as it is in the
        // G-buffer.
        let lit = |finding: &GiWarning| {
            !ours.is_empty() && (*finding == GiWarning::TransparentMaterial || bouncers.is_empty())
        };
        let dark = meshes
            .iter()
            .filter_map(|m| without_light(materials.get(&m.0)?));
        found.extend(dark.filter(|finding| !lit(finding)));
    }
    if scenes.is_empty() {
        // Nothing to count twice: what moves bounces light once, and ambient light may stand for
        // the rest.
        tell(found, &mut findings);
        return;
    }
    for (_, _, own, environment, msaa, brought) in cameras
        .iter()
        .filter(|(c, gi, ..)| c.is_active && gi.enabled)
    {
        if !draws_gbuffer(brought, msaa) {
            found.push(GiWarning::NoGbuffer);
            continue;
        }
        // A camera's own ambient light takes the place of the global one.
        match own {
            Some(own) if own.brightness > 0.0 => found.push(GiWarning::CameraAmbient),
            None if ambient.as_ref().is_some_and(|a| a.brightness > 0.0) => {
                found.push(GiWarning::GlobalAmbient)
            }
            _ => {}
        }
        if environment.is_some_and(|e| e.intensity > 0.0) {
            found.push(GiWarning::EnvironmentMap);
        }
        if probes.iter().any(|e| e.intensity > 0.0) {
            found.push(GiWarning::LightProbe);
        }
        if volumes.iter().any(|v| v.intensity > 0.0) {
            found.push(GiWarning::IrradianceVolume);
        }
        if method.as_ref().is_some_and(|m| is_forward(m)) {
            found.push(GiWarning::ForwardMaterials);
        }
    }
    tell(found, &mut findings);
}

/// Keeps and tells what was not found before.
pub(super) fn tell(found: Vec<GiWarning>, findings: &mut GiWarnings) {
    for finding in found {
        if !findings.0.contains(&finding) {
            warn!("{}", finding.advice());
            findings.0.push(finding);
        }
    }
}

/// Why surfaces of this material get no indirect light, if they do not and should.
fn without_light(material: &StandardMaterial) -> Option<GiWarning> {
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

/// The resource hides its value; its debug text does not.
fn is_forward(method: &DefaultOpaqueRendererMethod) -> bool {
    format!("{method:?}").contains("Forward")
}
