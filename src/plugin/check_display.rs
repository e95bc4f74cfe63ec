//! Warns of a bake that no camera displays: no camera has [`GiCamera`], and no root has
//! [`GiIrradianceVolume`].

use super::asset::GiBakedScene;
use super::camera::GiCamera;
use super::effects::rsm::map_cameras::GiRsmCamera;
use super::effects::volume::irradiance_volume::GiIrradianceVolume;
use super::scene::GiScene;
use super::settings::GiSettings;
use super::validation::{GiWarning, GiWarnings, add_warnings};
use bevy::asset::Assets;
use bevy::camera::visibility::RenderLayers;
use bevy::camera::{Camera, Camera3d};
use bevy::core_pipeline::prepass::DeferredPrepass;
use bevy::ecs::prelude::*;
use bevy::ecs::system::SystemParam;

/// Number of frames without a display before the warning. Cameras, volumes and bakes of a scene
/// that is loading appear in any order.
const GRACE_FRAMES: u32 = 16;

/// Baked scenes, and cameras and volumes that may display them.
#[derive(SystemParam)]
#[allow(clippy::type_complexity, reason = "filters of queries")]
pub(crate) struct Displays<'w, 's> {
    roots: Query<'w, 's, (&'static GiScene, Option<&'static RenderLayers>)>,
    bakes: Res<'w, Assets<GiBakedScene>>,
    displays: Query<'w, 's, (), With<GiCamera>>,
    volumes: Query<'w, 's, (), With<GiIrradianceVolume>>,
    cameras: Query<
        'w,
        's,
        (
            &'static Camera,
            Has<DeferredPrepass>,
            Option<&'static RenderLayers>,
        ),
        (With<Camera3d>, Without<GiRsmCamera>),
    >,
}

/// Warns once if no camera displays a bake. Runs in
/// [`GiSystems::Validate`](super::GiSystems::Validate).
pub(crate) fn check_display(
    settings: Res<GiSettings>,
    scene: Displays,
    mut frames: Local<u32>,
    mut warnings: ResMut<GiWarnings>,
) {
    let shown = !scene.displays.is_empty() || !scene.volumes.is_empty();
    if !settings.warn_double_counting || shown {
        *frames = 0;
        return;
    }
    let layers = |own: Option<&RenderLayers>| own.cloned().unwrap_or_default();
    let baked: Vec<RenderLayers> = (scene.roots.iter())
        .filter(|(gi, _)| scene.bakes.contains(&gi.0))
        .map(|(_, own)| layers(own))
        .collect();
    let sees = |own| {
        let own = layers(own);
        baked.iter().any(|root| root.intersects(&own))
    };
    let mut looking = (scene.cameras.iter())
        .filter(|(camera, _, own)| camera.is_active && sees(*own))
        .map(|(_, deferred, _)| deferred)
        .peekable();
    if looking.peek().is_none() {
        *frames = 0;
        return;
    }
    *frames = frames.saturating_add(1);
    let kinds = [GiWarning::NoDisplay, GiWarning::NoDeferredDisplay];
    if *frames <= GRACE_FRAMES || warnings.0.iter().any(|w| kinds.contains(w)) {
        return;
    }
    let all_deferred = looking.all(|deferred| deferred);
    add_warnings(vec![kinds[usize::from(all_deferred)]], &mut warnings);
}
