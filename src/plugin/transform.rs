//! Transforms from the world to the local space of a bake. Lights and pixels are transformed, and
//! irradiance is not.
//!
//! With a uniform scale s the local space is the world divided by s: lengths / s, intensities
//! (W/sr) / s², irradiance and radiance unchanged
//! ([`FrameLight::to_local`](meshless_gi::FrameLight::to_local)).

use bevy::math::{Affine3A, DMat4, Mat3A, Mat4};
use bevy::transform::components::GlobalTransform;

/// Placement of a bake: translation, rotation (perhaps with a reflection) and one scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimilarityTransform {
    /// Transform from local to world, meters. Its linear part is `scale` times an orthogonal
    /// matrix.
    pub world_from_local: Affine3A,
    /// World meters per local meter.
    pub scale: f32,
    /// The transform that it came from was not such a one.
    pub has_non_uniform_scale: bool,
}

impl SimilarityTransform {
    /// Returns the placement nearest to a transform. `None` for a transform that has no volume or
    /// is not finite.
    #[must_use]
    pub fn new(transform: &GlobalTransform) -> Option<Self> {
        let affine = transform.affine();
        let m = affine.matrix3;
        let determinant = m.determinant();
        if !affine.is_finite() || determinant == 0.0 {
            return None;
        }
        let lengths = [m.x_axis.length(), m.y_axis.length(), m.z_axis.length()];
        let scale = (lengths[0] + lengths[1] + lengths[2]) / 3.0;
        // Orthonormalize: exact where the transform was a similarity, the nearest guess along x,
        // then y, elsewhere.
        let x = m.x_axis.normalize();
        let y = (m.y_axis - x * x.dot(m.y_axis)).normalize();
        let z = x.cross(y) * determinant.signum();
        let linear = Mat3A::from_cols(x, y, z) * scale;
        if !linear.is_finite() || scale <= 0.0 {
            return None;
        }
        let off = [
            m.x_axis - linear.x_axis,
            m.y_axis - linear.y_axis,
            m.z_axis - linear.z_axis,
        ];
        Some(Self {
            world_from_local: Affine3A {
                matrix3: linear,
                translation: affine.translation,
            },
            scale,
            has_non_uniform_scale: off.iter().any(|d| d.length() > 1e-3 * scale),
        })
    }

    /// World to local.
    #[must_use]
    pub fn local_from_world(&self) -> Affine3A {
        // The linear part is a scaled orthogonal matrix: its inverse is its transpose over s².
        let matrix3 = self.world_from_local.matrix3.transpose() * (1.0 / (self.scale * self.scale));
        Affine3A {
            matrix3,
            translation: -(matrix3 * self.world_from_local.translation),
        }
    }

    /// Returns the matrix from world to local, for
    /// [`FrameLight::to_local`](meshless_gi::FrameLight::to_local).
    #[must_use]
    pub fn matrix(&self) -> Mat4 {
        self.local_from_world().into()
    }

    /// The matrix from a view's clip space to local space, multiplied in double precision: worlds
    /// are large, bakes are small.
    #[must_use]
    pub fn local_from_clip(&self, clip_from_view: Mat4, world_from_view: Mat4) -> Mat4 {
        let local_from_world: Mat4 = self.local_from_world().into();
        // The inverse of the placement in doubles, from the doubles of its own matrix, so that
        // large translations cancel.
        let world_from_local: DMat4 = Mat4::from(self.world_from_local).as_dmat4();
        let exact = world_from_local.inverse();
        let local_from_world = if exact.is_finite() {
            exact
        } else {
            local_from_world.as_dmat4()
        };
        (local_from_world * world_from_view.as_dmat4() * clip_from_view.as_dmat4().inverse())
            .as_mat4()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::math::{Quat, Vec3};
    use bevy::transform::components::Transform;
    use meshless_gi::FrameLight;
    use meshless_gi::internals::frame::project::unshadowed;

    fn placement(transform: Transform) -> SimilarityTransform {
        SimilarityTransform::new(&GlobalTransform::from(transform)).unwrap()
    }

    #[test]
    fn irradiance_is_equal_in_local_and_world_space() {
        let at = placement(Transform {
            translation: Vec3::new(5.0, -2.0, 7.0),
            rotation: Quat::from_euler(bevy::math::EulerRot::XYZ, 0.3, 1.1, -0.7),
            scale: Vec3::splat(2.5),
        });
        assert!(!at.has_non_uniform_scale);
        let light = FrameLight::point(Vec3::new(6.0, 0.0, 9.0), Vec3::splat(30.0), 12.0);
        let (p, n) = (Vec3::new(5.5, -3.0, 8.0), Vec3::new(0.36, 0.8, 0.48));
        let inverse = at.local_from_world();
        let local_n = inverse.transform_vector3(n).normalize();
        let local_light = light.to_local(&at.matrix());
        let world = light.color[0] * unshadowed(&light, p, n);
        let local =
            local_light.color[0] * unshadowed(&local_light, inverse.transform_point3(p), local_n);
        assert!(
            world > 0.1 && (world - local).abs() < 1e-4 * world,
            "{world} in the world, {local} in the bake"
        );
    }

    #[test]
    fn non_uniform_scale_is_detected_and_averaged() {
        let at = placement(Transform::from_scale(Vec3::new(1.0, 2.0, 3.0)));
        assert!(at.has_non_uniform_scale);
        assert_eq!(at.scale, 2.0);
        let mirror = placement(Transform::from_scale(Vec3::new(-2.0, 2.0, 2.0)));
        assert!(
            !mirror.has_non_uniform_scale,
            "a reflection is not a distortion"
        );
        assert!(
            SimilarityTransform::new(&GlobalTransform::from(Transform::from_scale(Vec3::new(
                1.0, 0.0, 1.0
            ))))
            .is_none()
        );
        assert!(
            SimilarityTransform::new(&GlobalTransform::from(Transform::from_xyz(
                f32::NAN,
                0.0,
                0.0
            )))
            .is_none()
        );
    }

    #[test]
    fn clip_space_far_from_origin_round_trips() {
        let at =
            placement(Transform::from_xyz(10_000.0, 0.0, 10_000.0).with_scale(Vec3::splat(3.0)));
        let world_from_view = Mat4::from_rotation_translation(
            Quat::from_rotation_y(0.4),
            Vec3::new(10_003.0, 1.0, 10_009.0),
        );
        let clip_from_view = Mat4::perspective_infinite_reverse_rh(1.0, 1.5, 0.1);
        let view = Vec3::new(0.3, -0.2, -4.0);
        let clip = clip_from_view * view.extend(1.0);
        let back = at
            .local_from_clip(clip_from_view, world_from_view)
            .project_point3(clip.truncate() / clip.w);
        let expected = at
            .world_from_local
            .as_daffine3()
            .inverse()
            .transform_point3(world_from_view.as_dmat4().transform_point3(view.as_dvec3()));
        assert!(
            (back.as_dvec3() - expected).length() < 1e-4,
            "{back} is not {expected}"
        );
    }
}
