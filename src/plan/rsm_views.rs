//! Views of a light's reflective shadow maps: the fewest that show all dynamic objects in its
//! reach.
//!
//! The plugin requests the views of each light, draws them, and describes the result to the
//! [plan](super). \[N09\] §3 draws one map per light with the light's own frustum. Here, the map is
//! aimed at the dynamic objects, because nothing else is drawn into it. The same texels thus show
//! more of the object.
//!
//! | light | maps |
//! |---|---|
//! | directional | one, orthographic, around the boxes of all that moves; it moves by whole texels, so that nothing that stands still flickers |
//! | point, spot | one, perspective, where all that moves fits a cone of [`MAX_RSM_HALF_ANGLE`]; else those faces of a cube that show some of it |
//!
//! Sizes and angles change in steps of [`RSM_SIZE_STEP`], so a map keeps its scale during small
//! moves.

use super::SkipReason;
use super::light_slots::light_affects;
use glam::{Mat3, Quat, Vec3};
use meshless_gi::{Bounds, FrameLight};
use std::f32::consts::{FRAC_PI_2, PI};

/// Largest half angle of an aimed map, radians: 50°. A wider map would spend most texels near its
/// edges.
pub const MAX_RSM_HALF_ANGLE: f32 = 50.0 * PI / 180.0;

/// Ratio of consecutive map sizes and angles.
pub const RSM_SIZE_STEP: f32 = 1.189_207_1; // the fourth root of two

/// Distance of the near plane of a point or spot light, meters.
pub const RSM_NEAR_PLANE: f32 = 1e-3;

/// Projection of a map. Depth is reversed and the picture is square.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lens {
    /// Perspective projection.
    Perspective {
        /// Full angle of view, radians.
        fov: f32,
        /// Distance of the near plane, meters.
        near: f32,
        /// Distance of the farthest object, meters.
        far: f32,
    },
    /// Orthographic projection.
    Orthographic {
        /// Edge of the picture, meters.
        size: f32,
        /// Depth of the box, meters.
        far: f32,
    },
}

/// View from a light, in world space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapView {
    /// Position of the view, meters.
    pub position: Vec3,
    /// Rotation from −Z to the view direction, and from +Y to the upper edge.
    pub rotation: Quat,
    /// Projection of the view.
    pub lens: Lens,
}

/// Returns the views that show all dynamic objects in the reach of `light`. The light and the boxes
/// of the objects are in world space. `resolution` is the edge of a map in texels. Boxes that are
/// empty or not finite are ignored.
///
/// # Errors
/// Returns the reason why there is no view: [`SkipReason::LightDark`],
/// [`SkipReason::NothingMoves`], [`SkipReason::OutOfReach`], [`SkipReason::NoMaps`].
pub fn map_views(
    light: &FrameLight,
    reflectors: &[Bounds],
    resolution: u32,
) -> Result<Vec<MapView>, SkipReason> {
    if light.kind == FrameLight::NONE || light.color.iter().all(|c| *c <= 0.0) {
        return Err(SkipReason::LightDark);
    }
    let real = |b: &&Bounds| b.min.is_finite() && b.max.is_finite() && b.min.cmple(b.max).all();
    let moving: Vec<Bounds> = reflectors.iter().filter(real).copied().collect();
    if moving.is_empty() {
        return Err(SkipReason::NothingMoves);
    }
    let views = match light.kind {
        FrameLight::DIRECTIONAL => directional(light, &moving, resolution),
        FrameLight::POINT | FrameLight::SPOT => local(light, &moving),
        _ => return Err(SkipReason::NoMaps),
    };
    if views.is_empty() {
        return Err(SkipReason::OutOfReach);
    }
    Ok(views)
}

/// Returns the smallest power of [`RSM_SIZE_STEP`] that is not below `value`.
fn round_to_step(value: f32) -> f32 {
    let exponent = (libm::logf(value.clamp(1e-12, 1e12)) / libm::logf(RSM_SIZE_STEP)).ceil();
    libm::powf(RSM_SIZE_STEP, exponent).max(value)
}

/// Returns the axes of a view along `forward`.
fn view_rotation(forward: Vec3) -> Mat3 {
    let up = if forward.y.abs() < 0.99 {
        Vec3::Y
    } else {
        Vec3::X
    };
    let z = -forward;
    let x = up.cross(z).normalize();
    Mat3::from_cols(x, z.cross(x), z)
}

fn directional(light: &FrameLight, moving: &[Bounds], resolution: u32) -> Vec<MapView> {
    let forward = Vec3::from_array(light.direction);
    if forward == Vec3::ZERO {
        return Vec::new();
    }
    let axes = view_rotation(forward);
    let turned = axes.transpose();
    let spread = Mat3::from_cols(
        turned.x_axis.abs(),
        turned.y_axis.abs(),
        turned.z_axis.abs(),
    );
    let joint = moving.iter().fold(Bounds::EMPTY, |all, b| {
        let middle = turned * (0.5 * (b.min + b.max));
        let half = spread * (0.5 * (b.max - b.min));
        Bounds {
            min: all.min.min(middle - half),
            max: all.max.max(middle + half),
        }
    });
    let extent = joint.max - joint.min;
    // One texel on each side, because the view moves by whole texels.
    let texels = resolution.max(4) as f32;
    let size = round_to_step(extent.x.max(extent.y).max(RSM_NEAR_PLANE) * texels / (texels - 2.0));
    let texel = size / texels;
    let snap = |v: f32| (v / texel).round() * texel;
    let margin = 0.01 * extent.z + RSM_NEAR_PLANE;
    let light_position = Vec3::new(
        snap(0.5 * (joint.min.x + joint.max.x)),
        snap(0.5 * (joint.min.y + joint.max.y)),
        joint.max.z + margin,
    );
    vec![MapView {
        position: axes * light_position,
        rotation: Quat::from_mat3(&axes),
        lens: Lens::Orthographic {
            size,
            far: extent.z + 2.0 * margin,
        },
    }]
}

/// Bounding sphere of a box, relative to a point or spot light.
struct BoundingSphere {
    /// Vector from the light to the center, meters.
    to: Vec3,
    radius: f32,
    /// Half of the angle that the sphere subtends, radians. π if the light is inside.
    half: f32,
}

impl BoundingSphere {
    fn new(from: Vec3, b: &Bounds) -> Self {
        let to = 0.5 * (b.min + b.max) - from;
        let radius = 0.5 * (b.max - b.min).length();
        let distance = to.length();
        let half = if distance > radius {
            libm::asinf(radius / distance)
        } else {
            PI
        };
        Self { to, radius, half }
    }

    /// Returns the angle from `axis` to the farthest part of the sphere, radians.
    fn angle(&self, axis: Vec3) -> f32 {
        if self.half == PI {
            return PI;
        }
        angle_between(axis, self.to) + self.half
    }
}

fn angle_between(unit: Vec3, v: Vec3) -> f32 {
    let cosine = unit.dot(v) / v.length().max(f32::MIN_POSITIVE);
    libm::acosf(cosine.clamp(-1.0, 1.0))
}

fn local(light: &FrameLight, moving: &[Bounds]) -> Vec<MapView> {
    let position = Vec3::from_array(light.position);
    let along = Vec3::from_array(light.direction);
    // Half angle of a spot's cone. A point light shines in all directions.
    let cone = match light.kind {
        FrameLight::SPOT => {
            libm::acosf((-light.spot_offset / light.spot_scale).clamp(-1.0, 1.0)).min(FRAC_PI_2)
        }
        _ => PI,
    };
    let lit = |s: &BoundingSphere| {
        cone >= PI || s.half == PI || angle_between(along, s.to) <= cone + s.half
    };
    let seen: Vec<BoundingSphere> = moving
        .iter()
        .filter(|b| light_affects(light, **b))
        .map(|b| BoundingSphere::new(position, b))
        .filter(lit)
        .collect();
    if seen.is_empty() {
        return Vec::new();
    }
    let far = 1.01 * (seen.iter().map(|s| s.to.length() + s.radius)).fold(RSM_NEAR_PLANE, f32::max);
    let nearest = (seen.iter())
        .map(|s| (s.to.length() - s.radius).max(0.0))
        .fold(f32::INFINITY, f32::min);
    let view = |axes: Mat3, half: f32| MapView {
        position,
        rotation: Quat::from_mat3(&axes),
        lens: Lens::Perspective {
            fov: 2.0 * half,
            // The nearest part may be at a corner of the picture.
            near: (0.9 * nearest * libm::cosf(half) / 2f32.sqrt()).max(RSM_NEAR_PLANE),
            far: far.max(2.0 * RSM_NEAR_PLANE),
        },
    };
    let axis = (seen.iter().map(|s| s.to.normalize_or_zero()))
        .sum::<Vec3>()
        .normalize_or_zero();
    let half = seen.iter().map(|s| s.angle(axis)).fold(0.0, f32::max);
    let aimed = round_to_step(half);
    if axis != Vec3::ZERO && aimed <= cone.min(MAX_RSM_HALF_ANGLE) {
        return vec![view(view_rotation(axis), aimed)];
    }
    if cone <= MAX_RSM_HALF_ANGLE {
        return vec![view(view_rotation(along), cone.max(1e-3))];
    }
    if axis != Vec3::ZERO && half <= MAX_RSM_HALF_ANGLE {
        return vec![view(view_rotation(axis), MAX_RSM_HALF_ANGLE)];
    }
    let faces = [
        Vec3::X,
        Vec3::NEG_X,
        Vec3::Y,
        Vec3::NEG_Y,
        Vec3::Z,
        Vec3::NEG_Z,
    ];
    (faces.into_iter().map(view_rotation))
        .filter(|axes| {
            seen.iter()
                .any(|s| is_in_face(&(axes.transpose() * s.to), s))
        })
        .map(|axes| view(axes, FRAC_PI_2 / 2.0))
        .collect()
}

/// Returns `true` if a sphere meets the 90° pyramid of a view. `to` is its center in view space.
fn is_in_face(to: &Vec3, seen: &BoundingSphere) -> bool {
    let reach = seen.radius * 2f32.sqrt();
    -to.z + reach >= to.x.abs().max(to.y.abs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Mat4;

    fn cube(at: Vec3, half: f32) -> Bounds {
        Bounds {
            min: at - half,
            max: at + half,
        }
    }

    fn corners(b: &Bounds) -> impl Iterator<Item = Vec3> {
        let (min, max) = (b.min, b.max);
        (0..8).map(move |i| {
            let pick = |bit: u32, low, high| if i >> bit & 1 == 0 { low } else { high };
            Vec3::new(
                pick(0, min.x, max.x),
                pick(1, min.y, max.y),
                pick(2, min.z, max.z),
            )
        })
    }

    /// Returns the position of a point in a map, from −1 to 1, and `true` if it is between the
    /// planes.
    fn project(view: &MapView, p: Vec3) -> (Vec3, bool) {
        let at = Mat4::from_rotation_translation(view.rotation, view.position)
            .inverse()
            .transform_point3(p);
        match view.lens {
            Lens::Perspective { fov, near, far } => {
                let scale = 1.0 / ((0.5 * fov).tan() * -at.z);
                let between = -at.z >= near && -at.z <= far;
                (Vec3::new(at.x * scale, at.y * scale, at.z), between)
            }
            Lens::Orthographic { size, far } => (
                Vec3::new(2.0 * at.x / size, 2.0 * at.y / size, at.z),
                -at.z >= 0.0 && -at.z <= far,
            ),
        }
    }

    fn shows(view: &MapView, p: Vec3) -> bool {
        let (at, between) = project(view, p);
        between && at.x.abs() <= 1.0001 && at.y.abs() <= 1.0001
    }

    fn point(at: Vec3) -> FrameLight {
        FrameLight::point(at, Vec3::ONE, 20.0)
    }

    fn spot(at: Vec3, to: Vec3, outer: f32) -> FrameLight {
        FrameLight::spot(at, to, Vec3::ONE, 0.8 * outer, outer, 20.0)
    }

    fn sun(to: Vec3) -> FrameLight {
        FrameLight::directional(to, Vec3::ONE)
    }

    #[test]
    fn rsm_views_contain_reflector_bounds_tightly() {
        let positions = [
            Vec3::new(0.3, -1.0, 0.2),
            Vec3::new(1.5, 0.0, -2.0),
            Vec3::new(-3.0, 1.0, 0.0),
        ];
        for at in positions {
            let b = cube(at, 0.25);
            for light in [
                point(Vec3::ZERO),
                spot(Vec3::ZERO, at, 0.8),
                sun(Vec3::new(0.2, -1.0, 0.1)),
                sun(Vec3::NEG_Y),
            ] {
                let views = map_views(&light, &[b], 64).unwrap();
                assert_eq!(views.len(), 1);
                let mut widest = 0f32;
                for corner in corners(&b) {
                    assert!(shows(&views[0], corner), "{light:?} {corner}: {views:?}");
                    let (at, _) = project(&views[0], corner);
                    widest = widest.max(at.x.abs()).max(at.y.abs());
                }
                assert!(widest > 0.35, "{light:?}: {widest}");
            }
        }
    }

    #[test]
    fn point_light_uses_rsm_faces_with_reflectors() {
        let light = point(Vec3::ZERO);
        let (left, right) = (cube(Vec3::X * -2.0, 0.2), cube(Vec3::X * 2.0, 0.2));
        let views = map_views(&light, &[left, right], 64).unwrap();
        assert_eq!(views.len(), 2, "{views:?}");
        for b in [left, right] {
            for corner in corners(&b) {
                assert_eq!(
                    views.iter().filter(|v| shows(v, corner)).count(),
                    1,
                    "{corner}"
                );
            }
        }
        // A light within the dynamic object takes all faces, and only parts that touch it are cut
        // off.
        let views = map_views(&light, &[cube(Vec3::ZERO, 1.0)], 64).unwrap();
        assert_eq!(views.len(), 6);
        for corner in corners(&cube(Vec3::ZERO, 1.0)) {
            assert!(views.iter().any(|v| shows(v, corner * 0.999)));
        }
        // Each view is a proper rotation.
        for v in views {
            assert!((v.rotation.length() - 1.0).abs() < 1e-5);
        }
    }

    #[test]
    fn spot_light_rsm_is_limited_to_cone() {
        // A long object across a narrow cone.
        let wall = Bounds {
            min: Vec3::new(-5.0, -0.1, -3.2),
            max: Vec3::new(5.0, 0.1, -3.0),
        };
        let views = map_views(&spot(Vec3::ZERO, Vec3::NEG_Z, 0.4), &[wall], 64).unwrap();
        let Lens::Perspective { fov, .. } = views[0].lens else {
            panic!("a spot has a perspective lens");
        };
        assert!((fov - 0.8).abs() < 1e-3);
        // Objects outside the cone, behind it, and out of its range.
        for b in [
            cube(Vec3::new(3.0, 0.0, -3.0), 0.2),
            cube(Vec3::Z * 2.0, 0.2),
            cube(Vec3::Z * -30.0, 0.2),
        ] {
            let none = map_views(&spot(Vec3::ZERO, Vec3::NEG_Z, 0.4), &[b], 64);
            assert_eq!(none, Err(SkipReason::OutOfReach));
        }
        // A cone of nearly 180° over objects on both sides.
        let both = [
            cube(Vec3::new(3.0, 0.0, -0.4), 0.2),
            cube(Vec3::new(-3.0, 0.0, -0.4), 0.2),
        ];
        let views = map_views(&spot(Vec3::ZERO, Vec3::NEG_Z, 1.57), &both, 64).unwrap();
        assert_eq!(views.len(), 2);
    }

    #[test]
    fn rsm_views_without_reflectors_state_reason() {
        let b = [cube(Vec3::X, 0.1)];
        let reason = |light: &FrameLight, b: &[Bounds]| map_views(light, b, 64).unwrap_err();
        assert_eq!(reason(&point(Vec3::ZERO), &[]), SkipReason::NothingMoves);
        assert_eq!(
            reason(&point(Vec3::ZERO), &[Bounds::EMPTY, cube(Vec3::NAN, 1.0)]),
            SkipReason::NothingMoves
        );
        assert_eq!(reason(&FrameLight::default(), &b), SkipReason::LightDark);
        let black = FrameLight::point(Vec3::ZERO, Vec3::ZERO, 1.0);
        assert_eq!(reason(&black, &b), SkipReason::LightDark);
        assert_eq!(reason(&point(Vec3::X * 100.0), &b), SkipReason::OutOfReach);
        assert_eq!(reason(&sun(Vec3::ZERO), &b), SkipReason::OutOfReach);
        let patch = FrameLight::patch(Vec3::ZERO, Vec3::X, Vec3::ONE);
        assert_eq!(reason(&patch, &b), SkipReason::NoMaps);
    }

    #[test]
    fn directional_rsm_moves_by_texels_and_keeps_size() {
        let light = sun(Vec3::new(0.3, -1.0, 0.5));
        let still = Vec3::new(0.123, 0.456, -0.789);
        let texel_of = |shift: f32| {
            let b = cube(Vec3::new(shift, 0.5, 0.3 * shift), 0.9);
            let view = map_views(&light, &[b], 64).unwrap()[0];
            let (at, _) = project(&view, still);
            (view.lens, (at * 32.0).fract())
        };
        let (first, at) = texel_of(0.0);
        for i in 1..50 {
            let (lens, now) = texel_of(0.013 * i as f32);
            let (Lens::Orthographic { size: a, .. }, Lens::Orthographic { size: b, .. }) =
                (first, lens)
            else {
                panic!("parallel rays");
            };
            assert_eq!(a, b);
            let apart = |x: f32, y: f32| ((x - y).rem_euclid(1.0) + 0.5).rem_euclid(1.0) - 0.5;
            assert!(apart(at.x, now.x).abs() < 0.01 && apart(at.y, now.y).abs() < 0.01);
        }
    }

    #[test]
    fn rsm_size_steps_contain_requested_size() {
        for i in 1..2000 {
            let v = 0.001 * i as f32;
            let s = round_to_step(v);
            assert!(s >= v && s <= v * RSM_SIZE_STEP * 1.0001, "{v}: {s}");
        }
        assert!(round_to_step(f32::INFINITY).is_infinite() && round_to_step(0.0) > 0.0);
    }

    #[test]
    fn rsm_views_far_from_origin_are_exact() {
        let far = Vec3::new(1e5, 0.0, -1e5);
        let b = cube(far + Vec3::new(1.0, -2.0, 0.5), 0.3);
        for light in [point(far), sun(Vec3::new(0.1, -1.0, 0.2))] {
            let views = map_views(&light, &[b], 64).unwrap();
            assert_eq!(views.len(), 1);
            assert!(corners(&b).all(|c| {
                let (at, _) = project(&views[0], c);
                at.x.abs() < 1.05 && at.y.abs() < 1.05
            }));
        }
    }
}
