//! Reads lights out of the main world.
//!
//! Lights are read from their own components. Bevy's extracted lights lack every light outside of
//! all views. A light that `InheritedVisibility` hides is off. Units follow bevy_pbr: point and
//! spot lights give lumens / (4π) in every direction, directional lights their lux, rectangles
//! lumens / (π · area).

use super::gi_light::GiLight;
use crate::plan::LightKind;
use bevy::camera::visibility::{InheritedVisibility, RenderLayers};
use bevy::color::{Color, LinearRgba};
use bevy::ecs::prelude::*;
use bevy::ecs::query::QueryData;
use bevy::ecs::system::SystemParam;
use bevy::light::{DirectionalLight, PointLight, RectLight, SpotLight};
use bevy::math::Vec3;
use bevy::transform::components::GlobalTransform;
use meshless_gi::Light;
use std::f32::consts::{FRAC_PI_2, PI};

/// A light of the main world, in world space.
pub(crate) struct ExtractedGiLight {
    /// Entity and kind: an entity may have one light of each kind.
    pub key: LightKey,
    pub layers: RenderLayers,
    pub light: Light,
    /// Approximate number of samples of a rectangle light.
    pub area_samples: u32,
}

/// Identity of a light.
pub(crate) type LightKey = (u64, LightKind);

/// Lights of the main world.
#[derive(SystemParam)]
pub(crate) struct LightSources<'w, 's> {
    points: Query<'w, 's, (LightParts, &'static PointLight), Without<SpotLight>>,
    spots: Query<'w, 's, (LightParts, &'static SpotLight)>,
    directionals: Query<'w, 's, (LightParts, &'static DirectionalLight)>,
    rects: Query<'w, 's, (LightParts, &'static RectLight)>,
}

impl LightSources<'_, '_> {
    /// Appends all lights to `out`.
    pub fn extract(&self, out: &mut Vec<ExtractedGiLight>) {
        let mut push = |parts: &LightPartsItem, kind, light| {
            out.push(ExtractedGiLight {
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
        for (parts, light) in &self.points {
            push(&parts, LightKind::Point, parts.point(light));
        }
        for (parts, light) in &self.spots {
            push(&parts, LightKind::Spot, parts.spot(light));
        }
        for (parts, light) in &self.directionals {
            push(&parts, LightKind::Directional, parts.directional(light));
        }
        for (parts, light) in &self.rects {
            if let Some(light) = parts.rect(light) {
                push(&parts, LightKind::Rect, light);
            }
        }
    }
}

/// Components that every kind of light has.
#[derive(QueryData)]
pub(crate) struct LightParts {
    pub entity: Entity,
    pub transform: &'static GlobalTransform,
    visibility: &'static InheritedVisibility,
    pub layers: Option<&'static RenderLayers>,
    gi: Option<&'static GiLight>,
}

impl LightPartsItem<'_, '_> {
    /// Direction of the light. Zero, which lights nothing, if the transform has no direction.
    /// Bevy's own method panics there.
    fn forward(&self) -> Vec3 {
        let back = Vec3::from(self.transform.affine().matrix3.z_axis);
        -back.normalize_or_zero()
    }

    /// Factor on the light, 0 if it is off.
    fn factor(&self) -> f32 {
        match (self.visibility.get(), self.gi) {
            (false, _) => 0.0,
            (true, None) => 1.0,
            (true, Some(gi)) if gi.enabled => gi.intensity.max(0.0),
            _ => 0.0,
        }
    }

    /// Returns `true` if Bevy draws the light.
    pub fn is_visible(&self) -> bool {
        self.visibility.get()
    }

    /// Returns a point light as a type of the core, for indirect light.
    pub fn point(&self, light: &PointLight) -> Light {
        self.point_times(light, self.factor())
    }

    /// Returns a point light as a type of the core, times a factor.
    pub fn point_times(&self, light: &PointLight, factor: f32) -> Light {
        Light::Point {
            position: self.transform.translation(),
            intensity: rgb(light.color) * (factor * light.intensity / (4.0 * PI)),
            range: light.range,
        }
    }

    /// Returns a rectangle light as a type of the core, for indirect light. `None` without area.
    fn rect(&self, light: &RectLight) -> Option<Light> {
        self.rect_times(light, self.factor())
    }

    /// Returns a rectangle light as a type of the core, times a factor. `None` without area.
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

    /// Returns a spot light as a type of the core.
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

    /// Returns a directional light as a type of the core.
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

/// Half angles as Bevy clamps them: the outer one below 90°, the inner one at most the outer one.
fn cone(light: &SpotLight) -> (f32, f32) {
    let outer = if light.outer_angle >= FRAC_PI_2 {
        FRAC_PI_2 - 1e-4
    } else {
        light.outer_angle
    };
    (light.inner_angle.min(outer), outer)
}
