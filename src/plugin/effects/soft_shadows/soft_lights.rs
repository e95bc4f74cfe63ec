//! Soft shadows of Bevy's rectangle and point lights: the component that enables them, and the
//! lights for the render world. The effects `soft_shadows` and `subtract_shadow` (in
//! [`crate::plugin::effects`]) compute and draw the shadows.
//!
//! Bevy draws such a light without shadows. The occluded part of its light is subtracted from the
//! picture, pixel by pixel. This replaces the light's own contribution and leaves all other light
//! unchanged.

use crate::plan::LightKind;
use crate::plugin::asset::GiBakedScene;
use crate::plugin::extract::{LightKey, LightParts, LightPartsItem};
use crate::plugin::scene::GiScene;
use crate::plugin::settings::GiSettings;
use crate::plugin::validation::{GiWarning, GiWarnings, add_warnings};
use bevy::asset::Assets;
use bevy::camera::visibility::{InheritedVisibility, RenderLayers};
use bevy::ecs::prelude::*;
use bevy::light::{DirectionalLight, PointLight, RectLight, SpotLight};
use bevy::pbr::{AreaLightLuts, MAX_RECT_LIGHTS};
use bevy::reflect::prelude::*;
use bevy::render::Extract;
use bevy::render::render_asset::RenderAssets;
use bevy::render::texture::GpuImage;
use meshless_gi::Light;
use meshless_gi::internals::frame::SoftLight;

/// Soft shadows of this light without a shadow map, on baked surfaces, from baked surfaces. Add it
/// to a [`RectLight`] or a [`PointLight`] whose `shadow_maps_enabled` is off. A point light is a
/// sphere of its `radius`. The bake needs the visibility of its points (recipe field
/// `soft_shadows`).
///
/// Occluded light that Bevy draws is subtracted: all light of a rectangle, and the diffuse light of
/// a point light. Highlights of a point light stay. Dynamic objects and surfaces that no basis
/// function reaches keep Bevy's light, without such a shadow. Indirect light has its own shadows,
/// with or without this component.
#[derive(Component, Reflect, Clone, Copy, Debug, PartialEq, Eq)]
#[reflect(Component, Default, Clone, Debug, PartialEq)]
pub struct GiSoftShadow {
    /// Approximate number of samples of the light, 1 to 256. Each sample costs two look-ups of
    /// every point's visibility, in frames in which the light moves.
    pub samples: u32,
}

impl Default for GiSoftShadow {
    fn default() -> Self {
        Self { samples: 25 }
    }
}

/// A light with soft shadows, in world space.
pub(crate) struct ExtractedSoftLight {
    key: LightKey,
    pub layers: RenderLayers,
    pub light: SoftLight,
}

/// All of them, always in the same order.
#[derive(Resource, Default)]
pub(crate) struct ExtractedSoft {
    pub lights: Vec<ExtractedSoftLight>,
    /// The tables by which Bevy draws rectangles.
    pub tables: Option<wgpu::TextureView>,
}

/// Returns the tables for Bevy's rectangle lights. `None` if Bevy draws no such light: without its
/// feature `area_light_luts` it holds a placeholder.
fn tables_of(
    luts: Option<&AreaLightLuts>,
    images: Option<&RenderAssets<GpuImage>>,
) -> Option<wgpu::TextureView> {
    let (luts, images) = luts.zip(images)?;
    let image = images.get(&luts.image)?;
    let there = image.texture_descriptor.size.width > 1;
    there.then(|| wgpu::TextureView::clone(&image.texture_view))
}

/// Runs in [`GiRenderSystems::Extract`](crate::plugin::GiRenderSystems::Extract).
pub(crate) fn extract_soft(
    mut out: ResMut<ExtractedSoft>,
    points: Extract<Query<(LightParts, &PointLight, &GiSoftShadow)>>,
    rects: Extract<Query<(LightParts, &RectLight, &GiSoftShadow)>>,
    all_rects: Extract<Query<&InheritedVisibility, With<RectLight>>>,
    luts: Option<Res<AreaLightLuts>>,
    images: Option<Res<RenderAssets<GpuImage>>>,
) {
    out.lights.clear();
    out.tables = match rects.is_empty() {
        true => None,
        false => tables_of(luts.as_deref(), images.as_deref()),
    };
    let drawn = out.tables.is_some();
    let mut push = |parts: &LightPartsItem, kind, light| {
        out.lights.push(ExtractedSoftLight {
            key: (parts.entity.to_bits(), kind),
            layers: parts.layers.cloned().unwrap_or_default(),
            light,
        });
    };
    for (parts, light, soft) in &points {
        if parts.is_visible() && !light.shadow_maps_enabled {
            let core = parts.point_times(light, 1.0);
            push(&parts, LightKind::Point, sphere(&core, light.radius, soft));
        }
    }
    // With more rectangles Bevy draws an unspecified part of them.
    let few = all_rects.iter().filter(|v| v.get()).count() <= MAX_RECT_LIGHTS;
    if few && drawn {
        for (parts, light, soft) in &rects {
            if let (true, Some(core)) = (parts.is_visible(), parts.rect_times(light, 1.0)) {
                let light = rectangle(&core, light.range, soft);
                push(&parts, LightKind::Rect, light);
            }
        }
    }
    out.lights.sort_unstable_by_key(|light| light.key);
}

fn sphere(light: &Light, radius: f32, soft: &GiSoftShadow) -> SoftLight {
    match *light {
        Light::Point {
            position,
            intensity,
            range,
        } => SoftLight::sphere(position, radius, intensity, range, soft.samples),
        _ => SoftLight::default(),
    }
}

fn rectangle(light: &Light, range: f32, soft: &GiSoftShadow) -> SoftLight {
    // Bevy's shortest range is a centimeter.
    SoftLight::from_light(light, soft.samples)
        .map_or_else(SoftLight::default, |l| l.with_range(range.max(0.01)))
}

/// Warns once about missing requirements of lights with [`GiSoftShadow`]. Runs in
/// [`GiSystems::Validate`](crate::plugin::GiSystems::Validate).
#[allow(
    clippy::type_complexity,
    reason = "a system's parameters are its inputs"
)]
pub(crate) fn check_soft(
    settings: Res<GiSettings>,
    light_sources: Query<
        (
            Option<&PointLight>,
            Has<RectLight>,
            Has<SpotLight>,
            Has<DirectionalLight>,
        ),
        With<GiSoftShadow>,
    >,
    rects: Query<&InheritedVisibility, With<RectLight>>,
    scenes: Query<&GiScene>,
    assets: Option<Res<Assets<GiBakedScene>>>,
    mut findings: ResMut<GiWarnings>,
) {
    if !settings.warn_double_counting || light_sources.is_empty() {
        return;
    }
    let mut found = Vec::new();
    for (point, rect, spot, directional) in &light_sources {
        if spot || directional || (point.is_none() && !rect) {
            found.push(GiWarning::SoftShadowKind);
        }
        if point.is_some_and(|light| light.shadow_maps_enabled) {
            found.push(GiWarning::SoftShadowTwice);
        }
    }
    if light_sources.iter().any(|(_, rect, ..)| rect)
        && rects.iter().filter(|v| v.get()).count() > MAX_RECT_LIGHTS
    {
        found.push(GiWarning::SoftShadowCount);
    }
    let forgetful = |gi: &GiScene| {
        let asset = assets.as_ref().and_then(|a| a.get(&gi.0));
        asset.is_some_and(|asset| asset.scene.data().visibility.is_none())
    };
    if scenes.iter().any(forgetful) {
        found.push(GiWarning::NoVisibility);
    }
    add_warnings(found, &mut findings);
}
