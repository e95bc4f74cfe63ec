//! Ray-cast G-buffer of a scene: depth and G-buffer in the format of Bevy's prepass, by a ray
//! through the center of each pixel. It is the reference for screen-space kernels and the source of
//! reflective shadow maps in tests.

use glam::{Mat4, Vec2, Vec3};
use meshless_gi::internals::frame::gbuffer;
use meshless_gi::{Geometry, Ray};
use rayon::prelude::*;

/// Depth and G-buffer of a view.
#[derive(Clone, Debug, PartialEq)]
pub struct RaycastView {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Transform from clip space (reversed depth, y up) to the world.
    pub world_from_clip: Mat4,
    /// Depth of each pixel, row by row from the top: reversed, 0 for pixels without a surface.
    pub depth: Vec<f32>,
    /// Texels of the G-buffer. See [`gbuffer`].
    pub gbuffer: Vec<[u32; 4]>,
}

impl RaycastView {
    /// Renders `geometry` for the camera with these matrices. Normals of double-sided surfaces face
    /// the camera.
    #[must_use]
    pub fn new(geometry: &dyn Geometry, clip_from_world: Mat4, size: [u32; 2]) -> Self {
        let world_from_clip = clip_from_world.inverse();
        let pixels = size[0] as usize * size[1] as usize;
        let drawn: Vec<(f32, [u32; 4])> = (0..pixels)
            .into_par_iter()
            .map(|i| {
                let [x, y] = [i as u32 % size[0], i as u32 / size[0]];
                let at = (Vec2::new(x as f32, y as f32) + 0.5)
                    / Vec2::new(size[0] as f32, size[1] as f32);
                let ndc = Vec2::new(at.x * 2.0 - 1.0, 1.0 - at.y * 2.0);
                // The ray starts on the near plane. The far plane may be at infinity.
                let near = world_from_clip.project_point3(ndc.extend(1.0));
                let further = world_from_clip.project_point3(ndc.extend(0.5));
                let Some(direction) = (further - near).try_normalize() else {
                    return (0.0, [0; 4]);
                };
                let ray = Ray::new(near, direction);
                let Some(hit) = geometry.cast(&ray) else {
                    return (0.0, [0; 4]);
                };
                let surface = geometry.surface(&ray, &hit);
                let depth = clip_from_world.project_point3(surface.position).z;
                let texel = gbuffer::pack(surface.albedo, 0.0, 1.0, surface.normal, 0);
                (depth, texel)
            })
            .collect();
        let (depth, gbuffer) = drawn.into_iter().unzip();
        Self {
            size,
            world_from_clip,
            depth,
            gbuffer,
        }
    }

    /// Returns the transform from the world to clip space of a pinhole camera with an infinite far
    /// plane, as in Bevy. `vertical_angle` is in radians, and the near plane is at a distance of
    /// `near` meters.
    #[must_use]
    pub fn perspective(
        eye: Vec3,
        target: Vec3,
        up: Vec3,
        vertical_angle: f32,
        size: [u32; 2],
        near: f32,
    ) -> Mat4 {
        let aspect = size[0] as f32 / size[1] as f32;
        Mat4::perspective_infinite_reverse_rh(vertical_angle, aspect, near)
            * Mat4::look_at_rh(eye, target, up)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use meshless_gi::internals::frame::{GridShape, SplatParams, splat};
    use meshless_gi::internals::scene::{ImplicitObject, ImplicitScene, Shape};

    #[test]
    fn gbuffer_pixels_reconstruct_surface() {
        let (center, radius) = (Vec3::new(0.5, 1.0, -3.0), 1.0);
        let scene = ImplicitScene::new(vec![ImplicitObject {
            shape: Shape::Sphere { center, radius },
            albedo: Vec3::splat(0.5),
            radiance: Vec3::ZERO,
        }]);
        let size = [64, 48];
        let eye = Vec3::new(0.0, 1.0, 0.0);
        let ortho = Mat4::orthographic_rh(-2.0, 2.0, -1.5, 1.5, 10.0, 0.1)
            * Mat4::look_at_rh(eye, center, Vec3::Y);
        let perspective = RaycastView::perspective(eye, center, Vec3::Y, 1.0, size, 0.1);
        for clip_from_world in [perspective, ortho] {
            let view = RaycastView::new(&scene, clip_from_world, size);
            let params = SplatParams::new(
                view.world_from_clip,
                Mat4::IDENTITY,
                [0.0, 0.0, 64.0, 48.0],
                size,
                1.0,
                GridShape {
                    slot_mask: 0,
                    cell_size: 1.0,
                },
            );
            let drawn: Vec<usize> = (0..view.depth.len())
                .filter(|&i| view.depth[i] > 0.0)
                .collect();
            assert!(
                drawn.len() > 200 && drawn.len() < view.depth.len() - 200,
                "{}",
                drawn.len()
            );
            for i in drawn {
                let pixel = [i as u32 % size[0], i as u32 / size[0]];
                let (x, n) = splat::pixel_position(&params, pixel, view.depth[i], view.gbuffer[i]);
                assert!(((x - center).length() - radius).abs() < 1e-3, "{x}");
                assert!((n - (x - center)).length() < 3e-3, "{n}");
                assert!(n.dot((center - eye).normalize()) < 0.05);
            }
        }
    }
}
