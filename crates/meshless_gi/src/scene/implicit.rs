//! Analytic implicit surfaces as [`Geometry`]. They verify that basis and transport do not depend
//! on triangles ([L08] §5.1).
//!
//! A scene is a list of shapes. Each shape is the zero set of a function that is positive outside
//! and never exceeds the distance to the shape. Rays advance by this distance, which cannot step
//! over a surface. If the distance becomes small, or the ray starts next to a surface, steps of a
//! fixed minimum size search for a change of sign. Bisection then computes the root. A ray that
//! starts on a surface leaves it without a hit on that surface. For a grazing ray the sign decides.
//!
//! Limits: features thinner than [`ImplicitScene::tolerance`] can be missed. A ray that touches a
//! surface without passing through it counts as a miss.

use super::{Bounds, Geometry, Hit, Ray, Surface};
use core::f32::consts::PI;
use glam::{Vec2, Vec3};

/// Largest number of steps of a ray. A ray that exceeds it is a miss.
const MAX_STEPS: u32 = 4096;
/// Bisections of the interval that contains a change of sign. The result has `f32` precision.
const HALVINGS: u32 = 30;

/// Solid with an implicit function as its surface. Lengths in meters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// Sphere.
    Sphere {
        /// Center.
        center: Vec3,
        /// Radius.
        radius: f32,
    },
    /// Half-space behind a plane: points with n·x < offset.
    HalfSpace {
        /// Unit normal n, pointing out of the solid.
        normal: Vec3,
        /// Value of n·x on the plane.
        offset: f32,
    },
    /// Axis-aligned box.
    Cuboid {
        /// Center.
        center: Vec3,
        /// Half edge lengths.
        half: Vec3,
    },
    /// Axis-aligned room: everything outside the box is solid, and its surface faces inwards.
    Room {
        /// Center.
        center: Vec3,
        /// Half edge lengths.
        half: Vec3,
    },
    /// Spherical cavity: everything outside the sphere is solid.
    Cavity {
        /// Center.
        center: Vec3,
        /// Radius.
        radius: f32,
    },
    /// Torus.
    Torus {
        /// Center.
        center: Vec3,
        /// Unit axis.
        axis: Vec3,
        /// Distance from the center to the middle of the tube.
        major: f32,
        /// Radius of the tube.
        minor: f32,
    },
    /// Cylinder with flat ends. A low cylinder is a disk.
    Cylinder {
        /// Center, half-way between the ends.
        center: Vec3,
        /// Unit axis.
        axis: Vec3,
        /// Radius.
        radius: f32,
        /// Half the distance between the ends.
        half_height: f32,
    },
}

impl Shape {
    /// Returns a lower bound of the distance to the surface, exact near it. Negative inside.
    #[must_use]
    pub fn distance(&self, p: Vec3) -> f32 {
        match *self {
            Self::Sphere { center, radius } => (p - center).length() - radius,
            Self::Cavity { center, radius } => radius - (p - center).length(),
            Self::HalfSpace { normal, offset } => p.dot(normal) - offset,
            Self::Cuboid { center, half } => to_box(p - center, half),
            Self::Room { center, half } => -to_box(p - center, half),
            Self::Torus {
                center,
                axis,
                major,
                minor,
            } => {
                let q = p - center;
                let height = q.dot(axis);
                let ring = (q - axis * height).length() - major;
                (ring * ring + height * height).sqrt() - minor
            }
            Self::Cylinder {
                center,
                axis,
                radius,
                half_height,
            } => {
                let q = p - center;
                let height = q.dot(axis);
                let out = (q - axis * height).length() - radius;
                let above = height.abs() - half_height;
                let beyond = Vec2::new(out, above).max(Vec2::ZERO).length();
                beyond + out.max(above).min(0.0)
            }
        }
    }

    fn bounds(&self) -> Option<Bounds> {
        let around = |center: Vec3, half: Vec3| {
            Some(Bounds {
                min: center - half,
                max: center + half,
            })
        };
        match *self {
            Self::Sphere { center, radius } | Self::Cavity { center, radius } => {
                around(center, Vec3::splat(radius))
            }
            Self::Cuboid { center, half } | Self::Room { center, half } => around(center, half),
            Self::Torus {
                center,
                major,
                minor,
                ..
            } => around(center, Vec3::splat(major + minor)),
            Self::Cylinder {
                center,
                axis,
                radius,
                half_height,
            } => {
                let across = (Vec3::ONE - axis * axis).max(Vec3::ZERO);
                let across = Vec3::new(across.x.sqrt(), across.y.sqrt(), across.z.sqrt());
                around(center, axis.abs() * half_height + across * radius)
            }
            Self::HalfSpace { .. } => None,
        }
    }
}

fn to_box(p: Vec3, half: Vec3) -> f32 {
    let q = p.abs() - half;
    q.max(Vec3::ZERO).length() + q.max_element().min(0.0)
}

/// Shape with albedo and emission.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImplicitObject {
    /// Solid.
    pub shape: Shape,
    /// Diffuse reflectance, linear RGB in [0, 1].
    pub albedo: Vec3,
    /// Emitted radiance, W/(m² sr).
    pub radiance: Vec3,
}

/// Union of solids.
#[derive(Clone, Debug)]
pub struct ImplicitScene {
    objects: Vec<ImplicitObject>,
    bounds: Bounds,
    tolerance: f32,
}

impl ImplicitScene {
    /// Creates the union of `objects`. Half-spaces have no bounds of their own: they are bounded by
    /// the extent of the other shapes. Albedo is clamped to [0, 1].
    #[must_use]
    pub fn new(mut objects: Vec<ImplicitObject>) -> Self {
        for object in &mut objects {
            object.albedo = object.albedo.clamp(Vec3::ZERO, Vec3::ONE);
        }
        let bounds = objects
            .iter()
            .filter_map(|o| o.shape.bounds())
            .fold(Bounds::EMPTY, |b, s| b.join(s.min).join(s.max));
        let far = bounds.min.abs().max(bounds.max.abs()).max_element();
        let far = if far.is_finite() { far } else { 1.0 };
        Self {
            objects,
            bounds,
            // Sixteen roundings of the largest coordinate. Below this value the sign of a distance
            // is noise.
            tolerance: 16.0 * f32::EPSILON * far.max(1e-3),
        }
    }

    /// Returns the distance in meters below which two surfaces are not distinguished.
    #[must_use]
    pub fn tolerance(&self) -> f32 {
        self.tolerance
    }

    /// Returns the distance to the union and the index of the nearest object. Infinite without
    /// objects.
    #[must_use]
    pub fn distance(&self, p: Vec3) -> (f32, usize) {
        let mut best = (f32::INFINITY, 0);
        for (i, object) in self.objects.iter().enumerate() {
            let d = object.shape.distance(p);
            if d < best.0 {
                best = (d, i);
            }
        }
        best
    }

    /// Returns the distance along the ray of the first change of sign.
    fn march(&self, ray: &Ray) -> Option<f32> {
        let size = self.bounds.size().length();
        let center = self.bounds.center();
        let reach = if self.objects.is_empty() || !ray.origin.is_finite() {
            return None;
        } else if size > 0.0 {
            // Half-spaces may lie beyond the box. The scene ends at ten times the size of the box.
            (ray.origin - center).length() + 10.0 * size
        } else {
            1e6
        };
        let end = ray.max_t.min(reach);
        // The initial side is evaluated one step ahead, because the ray may start on a surface.
        let smallest = 8.0 * self.tolerance;
        let mut before = smallest;
        let mut d = self.distance(ray.at(before)).0;
        let inside = d < 0.0;
        for _ in 0..MAX_STEPS {
            if before >= end {
                return None;
            }
            let t = before + d.abs().max(smallest);
            let next = self.distance(ray.at(t)).0;
            if (next < 0.0) != inside {
                // Bisection: the sign changes between `before` and `t`.
                let (mut low, mut high) = (before, t);
                for _ in 0..HALVINGS {
                    let middle = 0.5 * (low + high);
                    if (self.distance(ray.at(middle)).0 < 0.0) == inside {
                        low = middle;
                    } else {
                        high = middle;
                    }
                }
                return (high > 0.0 && high < ray.max_t).then_some(high);
            }
            (before, d) = (t, next);
        }
        None
    }

    /// Returns the gradient of an object's distance by central differences.
    fn gradient(&self, object: usize, p: Vec3) -> Vec3 {
        let h = 64.0 * self.tolerance;
        let at = |q: Vec3| self.objects[object].shape.distance(q);
        let slope = |axis: Vec3| at(p + axis * h) - at(p - axis * h);
        Vec3::new(slope(Vec3::X), slope(Vec3::Y), slope(Vec3::Z)).normalize_or(Vec3::Y)
    }
}

impl Geometry for ImplicitScene {
    fn bounds(&self) -> Bounds {
        self.bounds
    }

    fn cast(&self, ray: &Ray) -> Option<Hit> {
        let t = self.march(ray)?;
        Some(Hit {
            t,
            primitive: self.distance(ray.at(t)).1 as u32,
            uv: [0.0; 2],
        })
    }

    fn is_occluded(&self, from: Vec3, to: Vec3) -> bool {
        let length = (to - from).length();
        length > 0.0
            && self
                .march(&Ray::segment(from, (to - from) / length, length))
                .is_some()
    }

    fn surface(&self, ray: &Ray, hit: &Hit) -> Surface {
        let position = ray.at(hit.t);
        let object = (hit.primitive as usize).min(self.objects.len().saturating_sub(1));
        let Some(&ImplicitObject {
            albedo, radiance, ..
        }) = self.objects.get(object)
        else {
            return Surface {
                position,
                normal: -ray.direction,
                albedo: Vec3::ZERO,
                emission: Vec3::ZERO,
                front: true,
            };
        };
        let outward = self.gradient(object, position);
        let front = outward.dot(ray.direction) <= 0.0;
        Surface {
            position,
            normal: if front { outward } else { -outward },
            albedo,
            emission: PI * radiance,
            front,
        }
    }

    fn ray_offset(&self, p: Vec3) -> f32 {
        let size = self.bounds.size().max_element().max(p.abs().max_element());
        (1e-5 * size).max(16.0 * self.tolerance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::{Random, uniform_sphere};

    fn object(shape: Shape) -> ImplicitObject {
        ImplicitObject {
            shape,
            albedo: Vec3::splat(0.5),
            radiance: Vec3::ZERO,
        }
    }

    fn ball(center: Vec3, radius: f32) -> ImplicitObject {
        object(Shape::Sphere { center, radius })
    }

    #[test]
    fn implicit_sphere_hit_matches_quadratic() {
        let center = Vec3::new(1.0, 2.0, -3.0);
        let scene = ImplicitScene::new(vec![ball(center, 1.5)]);
        let mut hits = 0;
        for k in 0..20_000 {
            let mut r = Random::new(1, 0, k);
            let origin = center + 4.0 * uniform_sphere(Vec2::new(r.unit(), r.unit()));
            let direction =
                (center + 1.8 * uniform_sphere(Vec2::new(r.unit(), r.unit())) - origin).normalize();
            let ray = Ray::new(origin, direction);
            let q = (origin - center).as_dvec3();
            let b = q.dot(direction.as_dvec3());
            let discriminant = b * b - q.length_squared() + 2.25;
            let found = scene.cast(&ray);
            if discriminant.abs() < 1e-3 {
                continue;
            }
            assert_eq!(found.is_some(), discriminant > 0.0, "ray {k}");
            if let Some(hit) = found {
                hits += 1;
                let t = -b - discriminant.sqrt();
                assert!(
                    (f64::from(hit.t) - t).abs() < 1e-3,
                    "ray {k}: {} and {t}",
                    hit.t
                );
                let surface = scene.surface(&ray, &hit);
                assert!(surface.front);
                assert!((surface.normal - (surface.position - center).normalize()).length() < 2e-2);
            }
        }
        assert!((5_000..19_000).contains(&hits), "{hits}");
    }

    #[test]
    fn implicit_surface_rays_leave_surface_and_stay_in_room() {
        let room = ImplicitScene::new(vec![
            object(Shape::Room {
                center: Vec3::ZERO,
                half: Vec3::new(2.0, 1.0, 3.0),
            }),
            ball(Vec3::new(0.5, -0.5, 0.0), 0.5),
            object(Shape::Torus {
                center: Vec3::new(-1.0, 0.2, 1.0),
                axis: Vec3::Y,
                major: 0.5,
                minor: 0.1,
            }),
        ]);
        let mut met = [0; 3];
        let mut ray = Ray::new(Vec3::new(0.0, 0.5, -1.0), Vec3::X);
        for k in 0..100_000 {
            let hit = room
                .cast(&ray)
                .unwrap_or_else(|| panic!("ray {k} left the room: {ray:?}"));
            met[hit.primitive as usize] += 1;
            let s = room.surface(&ray, &hit);
            assert!(room.distance(s.position).0.abs() < 1e-5);
            let start = s.position + s.normal * room.ray_offset(s.position);
            assert!(room.distance(start).0 > 0.0, "the ray origin is inside");
            assert!(
                room.is_occluded(start, start - s.normal * 0.01),
                "the surface does not block"
            );
            let mut r = Random::new(2, 0, k);
            let d = uniform_sphere(Vec2::new(r.unit(), r.unit()));
            ray = Ray::new(start, (d + s.normal * 1.001).normalize());
        }
        assert!(met.iter().all(|&m| m > 200), "{met:?}");
    }

    #[test]
    fn implicit_cylinder_has_caps_and_side() {
        let axis = Vec3::new(0.6, 0.8, 0.0);
        let center = Vec3::new(3.0, -1.0, 2.0);
        let shape = Shape::Cylinder {
            center,
            axis,
            radius: 2.0,
            half_height: 0.5,
        };
        let at = |height: f32, out: f32| shape.distance(center + axis * height + Vec3::Z * out);
        for (height, out, right) in [
            (0.0, 0.0, -0.5),
            (0.0, 1.75, -0.25),
            (0.75, 1.0, 0.25),
            (0.25, 3.0, 1.0),
            (3.5, 6.0, 5.0),
        ] {
            assert!((at(height, out) - right).abs() < 1e-5, "{height} {out}");
        }
        let scene = ImplicitScene::new(vec![object(shape)]);
        let bounds = scene.bounds();
        // The extent along x is the sum of the parts of half the axis and of the rim.
        assert!((bounds.max.x - center.x - (0.3 + 1.6)).abs() < 1e-5);
        assert!((bounds.max.z - center.z - 2.0).abs() < 1e-5);
        let down = Ray::new(center + axis * 4.0 + Vec3::Z, -axis);
        let hit = scene.cast(&down).expect("the end");
        let seen = scene.surface(&down, &hit);
        assert!((hit.t - 3.5).abs() < 1e-4 && (seen.normal - axis).length() < 1e-2);
        assert!(
            scene
                .cast(&Ray::new(center + axis * 4.0 + Vec3::Z * 2.1, -axis))
                .is_none()
        );
    }

    #[test]
    fn implicit_plane_blocks_segments_and_empty_shape_none() {
        let floor = ImplicitScene::new(vec![
            object(Shape::HalfSpace {
                normal: Vec3::Y,
                offset: 0.0,
            }),
            object(Shape::Cuboid {
                center: Vec3::new(0.0, 1.0, 0.0),
                half: Vec3::splat(0.25),
            }),
        ]);
        assert!(floor.is_occluded(Vec3::new(3.0, 1.0, 0.0), Vec3::new(3.0, -1.0, 0.0)));
        assert!(!floor.is_occluded(Vec3::new(3.0, 1.0, 0.0), Vec3::new(3.0, 0.1, 0.0)));
        assert!(floor.is_occluded(Vec3::new(-1.0, 1.0, 0.0), Vec3::new(1.0, 1.0, 0.0)));
        let hit = floor
            .cast(&Ray::new(Vec3::new(0.1, 2.0, 0.1), -Vec3::Y))
            .unwrap();
        assert!(hit.primitive == 1 && (hit.t - 0.75).abs() < 1e-5);
        let nothing = ImplicitScene::new(Vec::new());
        assert!(nothing.cast(&Ray::new(Vec3::ZERO, Vec3::X)).is_none());
        assert!(!nothing.is_occluded(Vec3::ZERO, Vec3::X));
    }
}
