//! Warns of a bake that no camera displays: no camera has [`MeshlessGiCamera`], and no root has [`MeshlessGiVolume`].

use super::asset::MeshlessGiAsset;
use super::check::{MeshlessGiFinding, MeshlessGiFindings, tell};
use super::components::{MeshlessGi, MeshlessGiCamera, MeshlessGiSettings};
use super::reflective::MeshlessGiCapture;
use super::volume::MeshlessGiVolume;
use bevy::asset::Assets;
use bevy::camera::visibility::RenderLayers;
use bevy::camera::{Camera, Camera3d};
use bevy::core_pipeline::prepass::DeferredPrepass;
use bevy::ecs::prelude::*;

/// Frames without a display that are waited for: cameras, volumes and bakes of a level that is loading come in any order.
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
    (With<Camera3d>, Without<MeshlessGiCapture>),
>;

/// Runs in [`MeshlessGiSystems::Check`](super::MeshlessGiSystems::Check).
#[expect(
    clippy::too_many_arguments,
    reason = "a system's parameters are its inputs"
)]
pub(crate) fn check_display(
    settings: Res<MeshlessGiSettings>,
    roots: Query<(&MeshlessGi, Option<&RenderLayers>)>,
    assets: Res<Assets<MeshlessGiAsset>>,
    displays: Query<(), With<MeshlessGiCamera>>,
    volumes: Query<(), With<MeshlessGiVolume>>,
    cameras: Cameras,
    mut frames: Local<u32>,
    mut findings: ResMut<MeshlessGiFindings>,
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
    let told = [
        MeshlessGiFinding::NoDisplay,
        MeshlessGiFinding::NoDeferredDisplay,
    ];
    if *frames <= PATIENCE || findings.0.iter().any(|found| told.contains(found)) {
        return;
    }
    let all_deferred = looking.all(|deferred| deferred);
    tell(vec![told[usize::from(all_deferred)]], &mut findings);
}
