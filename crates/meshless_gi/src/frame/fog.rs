//! Kernel `fog`: radiance that a fog volume scatters to the eye from a scene's indirect light,
//! pixel by pixel. The engine's own fog displays the direct light of its lights. The result is
//! drawn after that fog and added to the picture. The kernel samples the volume that kernel
//! [`volume`](super::volume) wrote, and takes its walls into account ([`read_voxels`]).
//!
//! A ray leads from the eye to the surface that the pixel shows. The part of the ray inside both
//! the fog and the scene is divided into steps. Each step has single scattering in closed form: T J
//! σₛ (1 − e^(−σₜ h)) / σₜ. T is the transmittance to the eye (Beer-Lambert law), h the length of
//! the step. Light varies at the scale of the voxels, so steps are two voxels long, and the result
//! has no noise.
//!
//! J is the scene's light that fog at a position scatters to the eye.
//! [`fog_inscatter`](super::fog_inscatter) computes it at the center of each voxel. It is
//! interpolated between eight centers like other lookups of that volume, without those behind a
//! wall.
//!
//! Attenuation on the way to the fog follows Bevy's formula for lights, e^(−σₜ r) with r the radius
//! of the fog volume. The ratio of indirect to direct light is therefore the same as in clear air.

use super::volume_sample::read_voxels;
use super::volume_weights::VoxelGrid;
use bytemuck::{Pod, Zeroable};
use glam::{Mat4, UVec3, Vec2, Vec3, Vec4};

/// Maximum number of other scenes that may overlap this one and come first.
pub const MAX_EARLIER: usize = 4;
/// Transmittance below which the rest of the ray is skipped.
pub const MIN_TRANSMITTANCE: f32 = 1e-3;
/// Length of a ray step, in voxels. The loss is 0.7 % of the light, and 0.3 % at one voxel
/// (`cargo test -p meshless_gi_lab --test lab fog -- --nocapture`).
pub const STEP_VOXELS: f32 = 2.0;
/// Smallest magnitude of a ray direction's component along an axis of a box.
pub const PARALLEL: f32 = 1e-9;
/// Length of a ray without a surface behind it, meters.
pub const MAX_RAY_LENGTH: f32 = 3.4e38;

/// Parameters of one fog volume and one scene in one view, for `fog`. 560 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct FogParams {
    /// Inverse of the view's projection. Depth is 1 at the near plane.
    pub view_from_clip: [[f32; 4]; 4],
    /// Transform from view space to the fog volume, a cube with edges of 1 around the origin.
    /// Lengths in view space are the world's.
    pub fog_from_view: [[f32; 4]; 4],
    /// Transform from view space to voxels, measured from the corner of the scene's volume.
    pub voxels_from_view: [[f32; 4]; 4],
    /// Transforms from view space to the bounds of scenes that come first, as cubes like the fog.
    /// Fog inside them is not lit by this scene.
    pub earlier: [[[f32; 4]; 4]; MAX_EARLIER],
    /// Corner and size of the view on its target, pixels.
    pub viewport: [f32; 4],
    /// Factor of the scattered light. It contains σₛ and the exposure.
    pub color: [f32; 3],
    /// σₜ, absorption plus out-scattering, 1/m.
    pub extinction: f32,
    /// Offset of positions in the density texture.
    pub offset: [f32; 3],
    /// Factor of `extinction`, `color` and the density texture.
    pub density: f32,
    /// Voxels along each edge.
    pub size: [u32; 3],
    /// Maximum number of steps of a ray.
    pub steps: u32,
    /// Low corner of the scene, in voxels from the corner of its volume. Voxels beyond it store the
    /// light of the outermost walls.
    pub low: [f32; 3],
    /// Number of entries of `earlier` in use.
    pub earlier_count: u32,
    /// High corner of the scene, in the same unit.
    pub high: [f32; 3],
    /// 1 if a texture stores the density.
    pub textured: u32,
    /// Radius of the fog volume, meters.
    pub radius: f32,
    /// Length of a ray step, world meters: [`STEP_VOXELS`] times the shortest edge of a voxel.
    pub part: f32,
    /// Padding, not used.
    pub pad: [u32; 2],
}

/// View through fog.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FogView {
    /// Transform from clip space to view space. Depth is 1 at the near plane and 0 at the far end.
    pub view_from_clip: Mat4,
    /// Transform from view space to the world, meters.
    pub world_from_view: Mat4,
    /// Corner and size of the view on its target, pixels.
    pub viewport: [f32; 4],
    /// Factor of the light.
    pub exposure: f32,
    /// Maximum number of steps of a ray.
    pub steps: u32,
}

/// Fog volume: a cube with edges of 1 around its origin, transformed to the world. The fields are
/// those of Bevy's `FogVolume`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fog {
    /// Transform of the cube.
    pub world_from_local: Mat4,
    /// Color of the fog, times all factors of the light.
    pub color: Vec3,
    /// Factor of the coefficients.
    pub density: f32,
    /// Absorption coefficient, 1/m.
    pub absorption: f32,
    /// Scattering coefficient, 1/m.
    pub scattering: f32,
    /// Asymmetry g of the phase function, -1 to 1.
    pub asymmetry: f32,
    /// Offset of the density texture. `None` if there is no texture.
    pub texture: Option<Vec3>,
}

impl FogParams {
    /// Creates the parameters of a scene. `bounds` are those of the scene and `shape` is the grid
    /// of its volume, both in its local space. `earlier` has the bounds of scenes that come first,
    /// as transforms of cubes with edges of 1 around their origins.
    #[must_use]
    pub fn new(
        view: &FogView,
        fog: &Fog,
        shape: &VoxelGrid,
        bounds: [Vec3; 2],
        world_from_local: &Mat4,
        earlier: &[Mat4],
    ) -> Self {
        // Worlds are large: positions near the eye need double precision.
        let world_from_view = view.world_from_view.as_dmat4();
        let seen = |transform: &Mat4| transform.as_dmat4().inverse() * world_from_view;
        let fog_from_view = seen(&fog.world_from_local).as_mat4();
        let voxels_from_view = Mat4::from_scale(1.0 / shape.voxel())
            * Mat4::from_translation(-shape.origin())
            * seen(world_from_local).as_mat4();
        let scale = world_from_local.transform_vector3(Vec3::X).length();
        let [low, high] = bounds.map(|b| ((b - shape.origin()) / shape.voxel()).to_array());
        let mut params = Self {
            view_from_clip: view.view_from_clip.to_cols_array_2d(),
            fog_from_view: fog_from_view.to_cols_array_2d(),
            voxels_from_view: voxels_from_view.to_cols_array_2d(),
            viewport: view.viewport,
            color: (fog.color * fog.scattering * view.exposure).to_array(),
            offset: fog.texture.unwrap_or_default().to_array(),
            density: fog.density,
            size: shape.size().to_array(),
            steps: view.steps.max(1),
            extinction: fog.absorption + fog.scattering,
            radius: (fog.world_from_local.transform_vector3(Vec3::splat(0.5))).length(),
            part: STEP_VOXELS * shape.voxel().min_element() * scale,
            earlier_count: earlier.len().min(MAX_EARLIER) as u32,
            low,
            textured: u32::from(fog.texture.is_some()),
            high,
            ..Zeroable::zeroed()
        };
        for (to, earlier) in params.earlier.iter_mut().zip(earlier) {
            *to = seen(earlier).as_mat4().to_cols_array_2d();
        }
        params
    }
}

/// Returns the radiance that the shader adds at a pixel, from the position of its center on the
/// target and its depth. `texels` is the output of [`volume`](super::volume::volume), `light` that
/// of [`fog_inscatter`](super::fog_inscatter::fog_inscatter). `texture` returns the density at a
/// position in its texture, each coordinate from 0 to 1.
#[must_use]
pub fn fog(
    params: &FogParams,
    texels: &[[f32; 4]],
    light: &[[f32; 4]],
    texture: &dyn Fn(Vec3) -> f32,
    pixel: Vec2,
    depth: f32,
) -> Vec3 {
    let fog_from_view = Mat4::from_cols_array_2d(&params.fog_from_view);
    let voxels_from_view = Mat4::from_cols_array_2d(&params.voxels_from_view);
    let ray = FogRay::new(params, pixel, depth);
    let whole = ray.range_in_box(&fog_from_view, Vec3::splat(-0.5), Vec3::splat(0.5));
    let lit = ray.range_in_box(&voxels_from_view, params.low.into(), params.high.into());
    let lit = [lit[0].max(whole[0]), lit[1].min(whole[1])];
    if lit[1] <= lit[0] {
        return Vec3::ZERO;
    }
    let density = |t: f32| match params.textured {
        0 => params.density,
        _ => {
            let at = fog_from_view.transform_point3(ray.point_at(t));
            params.density * texture(at + 0.5 + Vec3::from(params.offset))
        }
    };
    let mut left = transmittance_to(params, &density, whole, lit[0]);
    let steps = steps(params, whole, lit);
    let part = (lit[1] - lit[0]) / steps as f32;
    let size = UVec3::from(params.size);
    let sent =
        |v: UVec3| Vec3::from_slice(&light[(v.x + size.x * (v.y + size.y * v.z)) as usize][..3]);
    let mut sum = Vec3::ZERO;
    for k in 0..steps {
        if left < MIN_TRANSMITTANCE {
            break;
        }
        let t = lit[0] + (k as f32 + 0.5) * part;
        let x = ray.point_at(t);
        let density = density(t);
        let lost = density * params.extinction;
        if !is_earlier(params, x) {
            let position = voxels_from_view.transform_point3(x);
            let arrives = read_voxels(params.size, texels, position, sent);
            let way = (-lost * params.radius).exp();
            sum += left * density * way * part * mean_transmittance(lost * part) * arrives;
        }
        left *= (-lost * part).exp();
    }
    sum * Vec3::from(params.color)
}

/// Returns the transmittance of the fog from the eye to the ray's entry into the scene.
fn transmittance_to(
    params: &FogParams,
    density: &dyn Fn(f32) -> f32,
    whole: [f32; 2],
    enters: f32,
) -> f32 {
    let before = enters - whole[0];
    let steps = match params.textured {
        0 => 1,
        _ => steps_of_part(params, before / (whole[1] - whole[0])),
    };
    let part = before / steps as f32;
    let through: f32 = (0..steps)
        .map(|k| density(whole[0] + (k as f32 + 0.5) * part))
        .sum();
    (-through * params.extinction * part).exp()
}

/// Returns the number of a view's steps per ray that belong to this part of the ray.
fn steps_of_part(params: &FogParams, part: f32) -> u32 {
    ((params.steps as f32 * part).ceil() as u32).clamp(1, params.steps)
}

/// Returns the number of steps of the ray inside the scene. A step has a length of [`STEP_VOXELS`]
/// voxels, and is shorter if a density texture requires it.
fn steps(params: &FogParams, whole: [f32; 2], lit: [f32; 2]) -> u32 {
    let length = lit[1] - lit[0];
    let by_light = (length / params.part).ceil().min(params.steps as f32) as u32;
    match params.textured {
        0 => by_light.max(1),
        _ => by_light.max(steps_of_part(params, length / (whole[1] - whole[0]))),
    }
}

/// Returns (1 − e^(−x)) / x, the mean transmittance on the way out of a step.
fn mean_transmittance(x: f32) -> f32 {
    match x < 1e-2 {
        true => 1.0 - x * (0.5 - x / 6.0),
        false => (1.0 - (-x).exp()) / x,
    }
}

fn is_earlier(params: &FogParams, x: Vec3) -> bool {
    let earlier = &params.earlier[..params.earlier_count as usize];
    earlier.iter().any(|local| {
        let at = Mat4::from_cols_array_2d(local).transform_point3(x);
        at.abs().cmple(Vec3::splat(0.5)).all()
    })
}

/// Ray from the near plane to the surface that a pixel shows, in view space.
struct FogRay {
    origin: Vec3,
    direction: Vec3,
    length: f32,
}

impl FogRay {
    fn new(params: &FogParams, pixel: Vec2, depth: f32) -> Self {
        let [x, y, width, height] = params.viewport;
        let uv = (pixel - Vec2::new(x, y)) / Vec2::new(width, height);
        let unproject = |depth: f32| {
            Mat4::from_cols_array_2d(&params.view_from_clip)
                * Vec4::new(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, depth, 1.0)
        };
        let near = unproject(1.0);
        let near = near.truncate() / near.w;
        // Without a far plane, the farthest position is a direction.
        let far = unproject(0.0);
        let direction = (far.truncate() - far.w * near).normalize();
        let seen = unproject(depth);
        let length = match seen.w > 0.0 {
            true => (seen.truncate() / seen.w - near).dot(direction),
            false => MAX_RAY_LENGTH,
        };
        Self {
            origin: near,
            direction,
            length,
        }
    }

    fn point_at(&self, t: f32) -> Vec3 {
        self.origin + t * self.direction
    }

    /// Returns the start and end of the ray inside a box of another space. The end is the smaller
    /// one if the ray misses the box.
    fn range_in_box(&self, space: &Mat4, low: Vec3, high: Vec3) -> [f32; 2] {
        let (o, d) = (
            space.transform_point3(self.origin),
            space.transform_vector3(self.direction),
        );
        let mut span = [0.0f32, self.length];
        for axis in 0..3 {
            let d = match d[axis].abs() < PARALLEL {
                true => PARALLEL,
                false => d[axis],
            };
            let (a, b) = ((low[axis] - o[axis]) / d, (high[axis] - o[axis]) / d);
            span = [span[0].max(a.min(b)), span[1].min(a.max(b))];
        }
        span
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn eye() -> Mat4 {
        let at = Vec3::new(-2.0, 1.5, 2.5);
        Mat4::look_at_rh(at, at + Vec3::X, Vec3::Y).inverse()
    }

    /// Returns a room of 4 × 3 × 5 voxels of one meter. The eye is at x = −2 and the view direction
    /// is +x. View space has the scale of the world.
    fn scene(fog: Fog, steps: u32) -> FogParams {
        let shape = VoxelGrid::new([Vec3::ZERO, Vec3::new(4.0, 3.0, 5.0)], UVec3::new(4, 3, 5));
        let view = FogView {
            view_from_clip: Mat4::perspective_infinite_reverse_rh(0.5, 1.0, 0.1).inverse(),
            world_from_view: eye(),
            viewport: [0.0, 0.0, 100.0, 100.0],
            exposure: 2.0,
            steps,
        };
        let shape = shape.unwrap();
        let bounds = [Vec3::ZERO, Vec3::new(4.0, 3.0, 5.0)];
        FogParams::new(&view, &fog, &shape, bounds, &Mat4::IDENTITY, &[])
    }

    fn plain() -> Fog {
        Fog {
            world_from_local: Mat4::from_translation(Vec3::new(2.0, 1.5, 2.5))
                * Mat4::from_scale(Vec3::splat(20.0)),
            color: Vec3::new(1.0, 0.5, 0.25),
            density: 0.5,
            absorption: 0.3,
            scattering: 0.2,
            asymmetry: 0.0,
            texture: None,
        }
    }

    fn uniform_voxels(texels: usize) -> Vec<[f32; 4]> {
        vec![[3.0, 3.0, 3.0, -2.0]; texels * 60]
    }

    fn middle(params: &FogParams, depth: f32) -> Vec3 {
        fog(
            params,
            &uniform_voxels(6),
            &uniform_voxels(1),
            &|_| 1.0,
            Vec2::splat(50.0),
            depth,
        )
    }

    /// Returns the closed form of ∫ e^(−σₜ (t − a)) dt from the ray's entry into the scene to its
    /// exit.
    fn closed(fog: &Fog, from: f32, to: f32) -> Vec3 {
        let lost = fog.density * (fog.absorption + fog.scattering);
        let radius = 10.0 * 3f32.sqrt();
        let sent = 3.0 * 2.0 * fog.density * fog.scattering * (-lost * radius).exp();
        let light = ((-lost * from).exp() - (-lost * to).exp()) / lost;
        fog.color * sent * light
    }

    #[test]
    fn uniform_fog_any_step_count_matches_closed_form() {
        let fog = plain();
        for steps in [1, 2, 64] {
            let params = scene(fog, steps);
            // From the near plane at −1.9: the scene is crossed from 1.9 to 5.9.
            for (depth, to) in [(0.0, 5.9), (0.1 / 4.0, 3.9)] {
                let (found, right) = (middle(&params, depth), closed(&fog, 1.9, to));
                assert!(
                    (found / right - 1.0).abs().max_element() < 1e-4,
                    "{found} {right}"
                );
            }
        }
        // Fog in front of the scene is not lit by it.
        assert_eq!(middle(&scene(fog, 64), 0.1 / 1.5), Vec3::ZERO);
        // Very thin fog.
        let thin = Fog {
            density: 1e-7,
            ..fog
        };
        let (found, right) = (
            middle(&scene(thin, 64), 0.0),
            4.0 * 6.0 * 0.2e-7 * fog.color,
        );
        assert!(
            (found / right - 1.0).abs().max_element() < 1e-3,
            "{found} {right}"
        );
        // A texture of uniform density, and one without density in front of the scene.
        let textured = Fog {
            texture: Some(Vec3::ZERO),
            ..fog
        };
        let params = scene(textured, 64);
        let found = middle(&params, 0.0);
        let right = closed(&fog, 1.9, 5.9);
        assert!(
            (found / right - 1.0).abs().max_element() < 1e-4,
            "{found} {right}"
        );
        let clear = |at: Vec3| f32::from(u8::from(at.x >= 0.4));
        let found = super::fog(
            &params,
            &uniform_voxels(6),
            &uniform_voxels(1),
            &clear,
            Vec2::splat(50.0),
            0.0,
        );
        let right = closed(&fog, 0.0, 4.0);
        assert!(
            (found / right - 1.0).abs().max_element() < 0.02,
            "{found} {right}"
        );
    }

    #[test]
    fn fog_of_other_scene_is_separate() {
        let params = scene(plain(), 64);
        let all = Mat4::from_translation(Vec3::new(2.0, 1.5, 2.5));
        let with = |cube: Mat4| {
            let mut with = params;
            with.earlier[0] = (cube.inverse() * eye()).to_cols_array_2d();
            with.earlier_count = 1;
            middle(&with, 0.0)
        };
        assert_eq!(with(all * Mat4::from_scale(Vec3::splat(9.0))), Vec3::ZERO);
        let aside = with(Mat4::from_translation(Vec3::splat(50.0)));
        assert_eq!(aside, middle(&params, 0.0));
        // The nearer half belongs to the other scene. It attenuates the light of this one as
        // before.
        let half = with(
            Mat4::from_translation(Vec3::new(-3.0, 1.5, 2.5)) * Mat4::from_scale(Vec3::splat(10.0)),
        );
        let right = closed(&plain(), 3.9, 5.9);
        assert!(
            (half / right - 1.0).abs().max_element() < 1e-4,
            "{half} {right}"
        );
    }

    #[test]
    fn fog_rays_of_orthographic_view_are_parallel() {
        let mut params = scene(plain(), 64);
        params.view_from_clip = Mat4::orthographic_rh(-1.0, 1.0, -1.0, 1.0, 50.0, 0.1)
            .inverse()
            .to_cols_array_2d();
        let right = closed(&plain(), 1.9, 5.9);
        for pixel in [Vec2::splat(50.0), Vec2::new(20.0, 60.0)] {
            let found = fog(
                &params,
                &uniform_voxels(6),
                &uniform_voxels(1),
                &|_| 1.0,
                pixel,
                0.0,
            );
            assert!(
                (found / right - 1.0).abs().max_element() < 1e-4,
                "{found} {right}"
            );
        }
    }
}
