//! Debug drawings of a bake, off by default.
//!
//! Turn them on with `GizmoConfigStore`: `store.config_mut::<GiGizmos>().0.enabled = true`, and
//! select the drawn data in the group. Points come from the baked asset. The green dots of [L08]
//! Figure 1, the non-zero coefficients, are those that the device computed for this frame's lights:
//! while they are on, the vector irradiances are read back, some frames late.

use super::effects::inspection::coefficients::SharedCoefficients;
use super::scene::GiScene;
use super::transform::SimilarityTransform;
use super::{asset::GiBakedScene, sets::GiSystems};
use bevy::app::{App, Last};
use bevy::asset::Assets;
use bevy::camera::visibility::InheritedVisibility;
use bevy::color::Color;
use bevy::ecs::prelude::*;
use bevy::gizmos::config::{GizmoConfig, GizmoConfigGroup};
use bevy::gizmos::gizmos::Gizmos;
use bevy::gizmos::{AppGizmoBuilder, GizmoAsset};
use bevy::math::{Isometry3d, Quat, Vec3};
use bevy::reflect::prelude::*;
use bevy::transform::components::GlobalTransform;

/// Gizmos of baked scenes. The group is off by default.
#[derive(GizmoConfigGroup, Reflect, Clone, Debug, PartialEq)]
#[reflect(Default, Clone, Debug, PartialEq)]
pub struct GiGizmos {
    /// Cross at every point. The color shows the level, from red (coarsest) to blue (finest).
    pub points: bool,
    /// Line along the normal of every point.
    pub normals: bool,
    /// Circle of the display radius of every point.
    pub radii: bool,
    /// Green cross at every point whose coefficient is not zero, which are the rows that carry
    /// light in this frame.
    pub coefficients: bool,
    /// Fraction of the largest coefficient below which a coefficient counts as zero. Default: 0.01.
    pub threshold: f32,
    /// Drawn level. `None` (default) draws all levels.
    pub level: Option<u32>,
    /// Length of a cross as a fraction of the point's radius. Default: 0.1.
    pub size: f32,
}

impl Default for GiGizmos {
    fn default() -> Self {
        Self {
            points: true,
            normals: false,
            radii: false,
            coefficients: false,
            threshold: 0.01,
            level: None,
            size: 0.1,
        }
    }
}

/// Returns `true` if the frame must read back coefficients.
pub(crate) fn requests_coefficients((config, group): (&GizmoConfig, &GiGizmos)) -> bool {
    config.enabled && group.coefficients
}

/// Registers the gizmos' group and the system that draws them.
pub(crate) fn register(app: &mut App) {
    // Without Bevy's gizmos there is nothing to draw with.
    if !app.world().contains_resource::<Assets<GizmoAsset>>() {
        return;
    }
    let off = GizmoConfig {
        enabled: false,
        depth_bias: -0.01,
        ..GizmoConfig::default()
    };
    app.insert_gizmo_config(GiGizmos::default(), off)
        .add_systems(Last, draw.in_set(GiSystems::Validate));
}

/// Red for the coarsest level, blue for the finest.
fn level_color(level: usize, levels: usize) -> Color {
    let t = if levels > 1 {
        level as f32 / (levels - 1) as f32
    } else {
        0.0
    };
    Color::hsl(240.0 * t, 1.0, 0.5)
}

fn draw(
    mut gizmos: Gizmos<GiGizmos>,
    scenes: Query<(Entity, &GiScene, &GlobalTransform, &InheritedVisibility)>,
    assets: Res<Assets<GiBakedScene>>,
    coefficients: Res<SharedCoefficients>,
) {
    if !gizmos.config.enabled {
        return;
    }
    let group = gizmos.config_ext.clone();
    for (entity, gi, transform, visibility) in &scenes {
        let (Some(asset), Some(transform)) =
            (assets.get(&gi.0), SimilarityTransform::new(transform))
        else {
            continue;
        };
        if !visibility.get() {
            continue;
        }
        let scene = &asset.scene;
        let lit = coefficients
            .get(entity)
            .filter(|c| c.len() == scene.data().points.len());
        let largest = lit
            .as_ref()
            .map_or(0.0, |c| c.iter().copied().fold(0.0, f32::max));
        for level in
            (0..scene.levels()).filter(|l| group.level.is_none_or(|only| only as usize == *l))
        {
            let color = level_color(level, scene.levels());
            for i in scene.data().level(level) {
                let point = &scene.data().points[i];
                let at = transform.world_from_local.transform_point3(point.x());
                let normal = transform
                    .world_from_local
                    .transform_vector3(point.n())
                    .normalize_or(Vec3::Y);
                let radius = point.radius * transform.scale;
                if group.points {
                    gizmos.cross(at, group.size * radius, color);
                }
                if group.normals {
                    gizmos.ray(at, normal * (0.5 * radius), color);
                }
                if group.radii {
                    let flat = Isometry3d::new(at, Quat::from_rotation_arc(Vec3::Z, normal));
                    gizmos.circle(flat, radius, color).resolution(24);
                }
                let shines = lit
                    .as_ref()
                    .is_some_and(|c| c[i] > group.threshold * largest);
                if group.coefficients && scene.data().operator.rows[i].tier != 0 && shines {
                    gizmos.cross(at, 2.0 * group.size * radius, Color::srgb(0.0, 1.0, 0.0));
                }
            }
        }
    }
}
