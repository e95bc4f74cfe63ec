//! Images of a scene on the CPU by primary rays through a pinhole camera. The caller supplies the
//! shading.

use glam::{Vec2, Vec3};
use meshless_gi::internals::samples::Random;
use meshless_gi::{Geometry, Ray, Surface};
use rayon::prelude::*;

/// Pinhole camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Position, meters.
    pub eye: Vec3,
    /// Target, meters.
    pub target: Vec3,
    /// Up direction, not parallel to the view direction.
    pub up: Vec3,
    /// Full vertical field of view, radians.
    pub vertical_angle: f32,
}

impl Camera {
    /// Returns the ray through a position of the image: (0, 0) is its upper left corner, (1, 1) its
    /// lower right one.
    #[must_use]
    pub fn ray(&self, at: Vec2, aspect: f32) -> Ray {
        let forward = (self.target - self.eye).normalize_or(Vec3::NEG_Z);
        let right = forward
            .cross(self.up)
            .normalize_or(forward.any_orthonormal_vector());
        let up = right.cross(forward);
        let half = (0.5 * self.vertical_angle).tan();
        let p = (at * 2.0 - Vec2::ONE) * Vec2::new(half * aspect, -half);
        Ray::new(self.eye, (forward + right * p.x + up * p.y).normalize())
    }
}

/// Image in linear RGB, row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width` · `height` pixels.
    pub pixels: Vec<Vec3>,
}

impl Image {
    /// Converts the image to 8-bit sRGB, three bytes per pixel, after multiplication by `exposure`.
    /// Values above 1 are clipped.
    #[must_use]
    pub fn to_srgb8(&self, exposure: f32) -> Vec<u8> {
        self.pixels
            .iter()
            .flat_map(|p| srgb8(exposure * *p))
            .collect()
    }
}

/// Converts a linear color to 8-bit sRGB channels (IEC 61966-2-1), clipped to [0, 1]. NaN becomes
/// 0.
pub(super) fn srgb8(linear: Vec3) -> [u8; 3] {
    linear.to_array().map(|x| {
        let x = x.clamp(0.0, 1.0);
        let x = if x <= 0.003_130_8 {
            12.92 * x
        } else {
            1.055 * x.powf(1.0 / 2.4) - 0.055
        };
        (255.0 * x).round() as u8
    })
}

/// Renders an image with `samples` jittered rays per pixel. `shade` returns the radiance at a hit
/// from the ray, the surface and its own random numbers. `background` returns the radiance of a
/// direction without a hit. The result does not depend on the number of threads.
#[must_use]
pub fn render(
    geometry: &dyn Geometry,
    camera: &Camera,
    (width, height): (u32, u32),
    samples: u32,
    shade: &(dyn Fn(&Ray, &Surface, &mut Random) -> Vec3 + Sync),
    background: &(dyn Fn(Vec3) -> Vec3 + Sync),
) -> Image {
    let size = Vec2::new(width as f32, height as f32);
    let samples = samples.max(1);
    let pixel = |index: usize| {
        let corner = Vec2::new(
            (index % width as usize) as f32,
            (index / width as usize) as f32,
        );
        let mut sum = Vec3::ZERO;
        for k in 0..samples {
            let mut random = Random::new(0x0ca3, index as u64, u64::from(k));
            let jitter = match samples {
                1 => Vec2::splat(0.5),
                _ => Vec2::new(random.unit(), random.unit()),
            };
            let ray = camera.ray((corner + jitter) / size, size.x / size.y);
            sum += match geometry.cast(&ray) {
                Some(hit) => shade(&ray, &geometry.surface(&ray, &hit), &mut random),
                None => background(ray.direction),
            };
        }
        sum / samples as f32
    };
    Image {
        width,
        height,
        pixels: (0..width as usize * height as usize)
            .into_par_iter()
            .map(pixel)
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use meshless_gi::internals::scene::{ImplicitObject, ImplicitScene, Shape};

    #[test]
    fn render_of_sphere_has_position_and_size() {
        let shape = Shape::Sphere {
            center: Vec3::new(0.0, 1.0, 0.0),
            radius: 1.0,
        };
        let scene = ImplicitScene::new(vec![ImplicitObject {
            shape,
            albedo: Vec3::ONE,
            radiance: Vec3::ZERO,
        }]);
        let camera = Camera {
            eye: Vec3::new(0.0, 1.0, 4.0),
            target: Vec3::new(0.0, 1.0, 0.0),
            up: Vec3::Y,
            vertical_angle: std::f32::consts::FRAC_PI_2,
        };
        let shade = |_: &Ray, s: &Surface, _: &mut Random| s.normal * 0.5 + Vec3::splat(0.5);
        let picture = render(&scene, &camera, (160, 80), 1, &shade, &|_| {
            Vec3::splat(-1.0)
        });
        let ball = picture.pixels.iter().filter(|p| p.x >= 0.0).count();
        // The sphere subtends a half angle of asin(1/4). Its image is a disk of radius
        // tan(asin(1/4)) · 40 pixels.
        let disk = std::f32::consts::PI * (40.0 * 0.25f32.asin().tan()).powi(2);
        assert!(
            (ball as f32 / disk - 1.0).abs() < 0.05,
            "{ball} pixels, expected {disk}"
        );
        let at = |x: usize, y: usize| picture.pixels[y * 160 + x];
        assert!(at(80, 35).y > 0.6 && at(80, 45).y < 0.4, "vertical axis");
        assert!(at(85, 40).x > 0.6 && at(75, 40).x < 0.4, "horizontal axis");
        assert_eq!(at(5, 5), Vec3::splat(-1.0));
        let bytes = picture.to_srgb8(1.0);
        assert_eq!((bytes.len(), bytes[0]), (3 * 160 * 80, 0));
        let gray = Image {
            width: 1,
            height: 1,
            pixels: vec![Vec3::new(0.502_886, 1.0, 7.0)],
        };
        assert_eq!(gray.to_srgb8(1.0), [188, 255, 255]);
    }
}
