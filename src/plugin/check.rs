//! Says what would be counted twice, and what would show nothing.
//!
//! Indirect light replaces Bevy's ambient light and diffuse light probes. Left on, they are added on top: pictures become
//! too bright and flat. Each finding is told once, with what to set.

use super::components::{MeshlessGi, MeshlessGiCamera, MeshlessGiSettings};
use bevy::camera::Camera;
use bevy::ecs::prelude::*;
use bevy::light::{AmbientLight, EnvironmentMapLight, GlobalAmbientLight, IrradianceVolume};
use bevy::log::warn;
use bevy::pbr::DefaultOpaqueRendererMethod;

/// What a check may find. Kept as data so that tests read it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
pub enum MeshlessGiFinding {
    /// `GlobalAmbientLight` shines in a camera that shows indirect light.
    GlobalAmbient,
    /// The camera's own `AmbientLight` shines.
    CameraAmbient,
    /// The camera has an `EnvironmentMapLight` with diffuse light.
    EnvironmentMap,
    /// An `IrradianceVolume` shines beside a baked scene.
    IrradianceVolume,
    /// Opaque materials are drawn forward, where the composite cannot reach them.
    ForwardMaterials,
}

impl MeshlessGiFinding {
    /// What is wrong and what to set.
    #[must_use]
    pub fn advice(self) -> &'static str {
        match self {
            Self::GlobalAmbient => {
                "Bevy's ambient light is added to indirect light: insert `GlobalAmbientLight::NONE` \
                 (for light from the sky set `MeshlessGiLighting::sky`, which knows where the walls are)."
            }
            Self::CameraAmbient => {
                "A camera has both `AmbientLight` and `MeshlessGiCamera`: set the former's `brightness` to 0 \
                 (for light from the sky set `MeshlessGiLighting::sky`)."
            }
            Self::EnvironmentMap => {
                "A camera has both `EnvironmentMapLight` and `MeshlessGiCamera`: its diffuse part is added to indirect light. \
                 Give it a black `diffuse_map` and keep its reflections."
            }
            Self::IrradianceVolume => {
                "An `IrradianceVolume` and a baked scene are both visible: deferred pixels get both. Remove the volume, or set its \
                 `intensity` to 0."
            }
            Self::ForwardMaterials => {
                "`DefaultOpaqueRendererMethod` is forward: only materials with `opaque_render_method: Deferred` receive indirect \
                 light. Insert `DefaultOpaqueRendererMethod::deferred()`."
            }
        }
    }
}

/// What the check found so far; each finding is told once in the log.
#[derive(Resource, Clone, Debug, Default)]
pub struct MeshlessGiFindings(pub Vec<MeshlessGiFinding>);

/// Runs in [`MeshlessGiSystems::Check`](super::MeshlessGiSystems::Check).
#[allow(
    clippy::too_many_arguments,
    clippy::type_complexity,
    reason = "a system's parameters are its inputs"
)]
pub(crate) fn check(
    settings: Res<MeshlessGiSettings>,
    scenes: Query<(), With<MeshlessGi>>,
    cameras: Query<(
        &Camera,
        &MeshlessGiCamera,
        Option<&AmbientLight>,
        Option<&EnvironmentMapLight>,
    )>,
    ambient: Option<Res<GlobalAmbientLight>>,
    volumes: Query<&IrradianceVolume>,
    method: Option<Res<DefaultOpaqueRendererMethod>>,
    mut findings: ResMut<MeshlessGiFindings>,
) {
    if !settings.warn_double_counting || scenes.is_empty() {
        return;
    }
    let mut found = Vec::new();
    for (_, _, own, environment) in cameras
        .iter()
        .filter(|(c, gi, ..)| c.is_active && gi.enabled)
    {
        // A camera's own ambient light takes the place of the global one.
        match own {
            Some(own) if own.brightness > 0.0 => found.push(MeshlessGiFinding::CameraAmbient),
            None if ambient.as_ref().is_some_and(|a| a.brightness > 0.0) => {
                found.push(MeshlessGiFinding::GlobalAmbient)
            }
            _ => {}
        }
        if environment.is_some_and(|e| e.intensity > 0.0) {
            found.push(MeshlessGiFinding::EnvironmentMap);
        }
        if volumes.iter().any(|v| v.intensity > 0.0) {
            found.push(MeshlessGiFinding::IrradianceVolume);
        }
        if method.as_ref().is_some_and(|m| is_forward(m)) {
            found.push(MeshlessGiFinding::ForwardMaterials);
        }
    }
    for finding in found {
        if !findings.0.contains(&finding) {
            warn!("{}", finding.advice());
            findings.0.push(finding);
        }
    }
}

/// The resource hides its value; its debug text does not.
fn is_forward(method: &DefaultOpaqueRendererMethod) -> bool {
    format!("{method:?}").contains("Forward")
}
