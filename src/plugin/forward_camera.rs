//! [`GiForwardCamera`]: the display of a camera that is not deferred.

use super::camera::GiCamera;
use super::effects::display::splatting::GiSplatting;
use super::effects::rsm::map_cameras::GiRsmCamera;
use super::extract::{ExtractedGiView, ExtractedScene, in_view};
use crate::plan::ViewId;
use bevy::camera::visibility::RenderLayers;
use bevy::camera::{Camera, primitives::Frustum};
use bevy::core_pipeline::prepass::{DeferredPrepass, DepthPrepass, NormalPrepass};
use bevy::ecs::prelude::*;
use bevy::ecs::query::QueryData;
use bevy::reflect::prelude::*;

/// Indirect light in a forward camera with one sample per pixel, with or without
/// [`Hdr`](bevy::camera::Hdr). The component adds the depth and normal prepasses that the display
/// reads.
///
/// The root of the scene needs [`GiIrradianceVolume`](super::GiIrradianceVolume), and the bake
/// needs probes. Bevy's forward shader reads the light of an irradiance volume. The shader module
/// of the plugin reads the display instead, where the pixel shows the surface that is drawn.
/// Surfaces that are not in the prepasses, transparent ones for example, are lit by the volume.
///
/// Soft shadows, specular reflections and [`GiDebugView`](super::GiDebugView) need a deferred
/// camera. The component has no effect next to [`GiCamera`](super::GiCamera).
#[derive(Component, Reflect, Clone, Debug, PartialEq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
#[require(DepthPrepass, NormalPrepass, GiSplatting)]
pub struct GiForwardCamera {
    /// Shows the display. `false` leaves the light of the volume only. Default: `true`.
    pub enabled: bool,
    /// Factor on the indirect light of the display, 0 or more. Default: 1, the physical value.
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

/// Components of a forward camera with a display.
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

/// All forward cameras with a display.
pub(crate) type ForwardDisplays<'w, 's> =
    Query<'w, 's, (Entity, ForwardParts), (Without<GiCamera>, Without<GiRsmCamera>)>;

impl ForwardPartsItem<'_, '_> {
    /// Returns the view for the render world. It has only scenes with a volume, because surfaces
    /// read their light through the volume.
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
            specular: None,
            has_gbuffer: self.depth && self.normal && !self.deferred,
            forward: true,
            pixels: pixels.map_or(0, |size| u64::from(size.x) * u64::from(size.y)),
            sees: scenes.iter().filter(sees).map(|s| s.id).collect(),
            layers,
        }
    }
}
