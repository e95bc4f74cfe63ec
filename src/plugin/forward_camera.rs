//! [`GiForwardCamera`]: the display of a camera that is not deferred.

use super::camera::GiCamera;
use super::extract::{ExtractedGiView, ExtractedScene, in_view};
use super::rsm::GiRsmCamera;
use super::splatting::GiSplatting;
use crate::plan::ViewId;
use bevy::camera::visibility::RenderLayers;
use bevy::camera::{Camera, primitives::Frustum};
use bevy::core_pipeline::prepass::{DeferredPrepass, DepthPrepass, NormalPrepass};
use bevy::ecs::prelude::*;
use bevy::ecs::query::QueryData;
use bevy::reflect::prelude::*;

/// Displays the whole bake on a camera that draws forward, with one sample a pixel, with and
/// without [`Hdr`](bevy::camera::Hdr). Brings the depth and normal prepasses that the display
/// reads.
///
/// Needs [`GiIrradianceVolume`](super::GiIrradianceVolume) on the scene's root, and so a bake with
/// light in free space: Bevy's forward shader asks for the light of an irradiance volume, and the
/// module that answers for our volumes reads the display where the pixel shows the surface that is
/// drawn. What the prepasses do not hold, transparent surfaces among them, is lit by the volume as
/// before. Edges of surfaces that several samples share may be, too.
///
/// Soft shadows, gloss and the views of [`GiDebugView`](super::GiDebugView) are for deferred
/// cameras. Has no effect beside [`GiCamera`](super::GiCamera).
#[derive(Component, Reflect, Clone, Debug, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
#[require(DepthPrepass, NormalPrepass, GiSplatting)]
pub struct GiForwardCamera {
    /// Off, the camera is lit by the volume alone.
    pub enabled: bool,
    /// Multiplies the indirect light of the display. 1 is what physics says.
    pub intensity: f32,
}

impl Default for GiForwardCamera {
    fn default() -> Self {
        Self {
            enabled: true,
            intensity: 1.0,
        }
    }
}

/// What a display of a camera that is not deferred hangs on.
#[derive(QueryData)]
pub(crate) struct ForwardParts {
    pub camera: &'static Camera,
    settings: &'static GiForwardCamera,
    display: &'static GiSplatting,
    frustum: &'static Frustum,
    layers: Option<&'static RenderLayers>,
    depth: Has<DepthPrepass>,
    normal: Has<NormalPrepass>,
    deferred: Has<DeferredPrepass>,
}

/// All of them.
pub(crate) type ForwardDisplays<'w, 's> =
    Query<'w, 's, (Entity, ForwardParts), (Without<GiCamera>, Without<GiRsmCamera>)>;

impl ForwardPartsItem<'_, '_> {
    /// The view, as the render world needs it. It sees the scenes that have a volume: without one
    /// no surface asks for their light.
    pub fn view(
        &self,
        entity: Entity,
        scenes: &[ExtractedScene],
        has_volume: impl Fn(Entity) -> bool,
    ) -> ExtractedGiView {
        let layers = self.layers.cloned().unwrap_or_default();
        let sees = |scene: &&ExtractedScene| {
            has_volume(Entity::from_bits(scene.id.0)) && in_view(scene, self.frustum, &layers)
        };
        let pixels = self.camera.physical_viewport_size();
        ExtractedGiView {
            id: ViewId(entity.to_bits()),
            settings: GiCamera {
                enabled: self.settings.enabled,
                intensity: self.settings.intensity,
                ..GiCamera::default()
            },
            display: *self.display,
            gloss: None,
            has_gbuffer: self.depth && self.normal && !self.deferred,
            forward: true,
            pixels: pixels.map_or(0, |size| u64::from(size.x) * u64::from(size.y)),
            sees: scenes.iter().filter(sees).map(|s| s.id).collect(),
            layers,
        }
    }
}
