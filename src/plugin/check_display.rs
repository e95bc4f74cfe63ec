//! Warns of a bake that no camera displays: no camera has [`GiCamera`], and no root has
//! [`GiIrradianceVolume`].

use super::asset::GiBakedScene;
use super::camera::GiCamera;
use super::rsm::GiRsmCamera;
use super::scene::GiScene;
use super::settings::GiSettings;
use super::validation::{GiWarning, GiWarnings, tell};
use super::volume::GiIrradianceVolume;
use bevy::asset::Assets;
use bevy::camera::visibility::RenderLayers;
use bevy::camera::{Camera, Camera3d};
use bevy::core_pipeline::prepass::DeferredPrepass;
use bevy::ecs::prelude::*;

/// Frames without a display that are waited for: cameras, volumes and bakes of a level that is
/// loading come in any order.
const PATIENCE: u32 = 16;

/// The game's cameras.
type Cameras<'w, 's> = Query<
    'w,
    's,
    (
        &'static Camera,
        Has<DeferredPrepass>,
        Option<&'static RenderLayers>,
    ),
    (With<Camera3d>, Without<GiRsmCamera>),
>;

/// Runs in [`GiSystems::Validate`](super::GiSystems::Validate).
#[expect(
    clippy::too_many_arguments,
    reason = "a system's parameters are its inputs"
)]
pub(crate) fn check_display(
    settings: Res<GiSettings>,
    roots: Query<(&GiScene, Option<&RenderLayers>)>,
    assets: Res<Assets<GiBakedScene>>,
    displays: Query<(), With<GiCamera>>,
    volumes: Query<(), With<GiIrradianceVolume>>,
    cameras: Cameras,
    mut frames: Local<u32>,
    mut findings: ResMut<GiWarnings>,
) {
    let shown = !displays.is_empty() || !volumes.is_empty();
    if !settings.warn_double_counting || shown {
        *frames = 0;
        return;
    }
    let layers = |own: Option<&RenderLayers>| own.cloned().unwrap_or_default();
    let baked: Vec<RenderLayers> = (roots.iter())
        .filter(|(gi, _)| assets.contains(&gi.0))
        .map(|(_, own)| layers(own))
        .collect();
    let sees = |own| {
        let own = layers(own);
        baked.iter().any(|root| root.intersects(&own))
    };
    let mut looking = (cameras.iter())
        .filter(|(camera, _, own)| camera.is_active && sees(*own))
        .map(|(_, deferred, _)| deferred)
        .peekable();
    if looking.peek().is_none() {
        *frames = 0;
        return;
    }
    *frames = frames.saturating_add(1);
    let told = [GiWarning::NoDisplay, GiWarning::NoDeferredDisplay];
    if *frames <= PATIENCE || findings.0.iter().any(|found| told.contains(found)) {
        return;
    }
    let all_deferred = looking.all(|deferred| deferred);
    tell(vec![told[usize::from(all_deferred)]], &mut findings);
}
