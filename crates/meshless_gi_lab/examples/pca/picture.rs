//! Picture of the soft shadow of a scene.

use super::visibility::SAMPLES;
use glam::Vec3;
use meshless_gi::internals::frame::project::extent;
use meshless_gi::internals::frame::soft_shadow::{self, SoftLight, unshadowed};
use meshless_gi::internals::frame::subtract_shadow;
use meshless_gi::internals::samples::Random;
use meshless_gi::{BakedScene, Light, Ray, Surface, TriangleMesh};
use meshless_gi_lab::accuracy::{Camera, Image, render, shadowed_irradiance};
use std::error::Error;
use std::path::Path;

/// Writes a picture: baked visibility, reference, and their difference, side by side.
pub fn draw(
    name: &str,
    mesh: &TriangleMesh,
    scene: &BakedScene,
    light: &Light,
    folder: &Path,
) -> Result<(), Box<dyn Error>> {
    let (width, height) = (360, 270);
    let camera = match name {
        "cornell" => Camera {
            eye: Vec3::new(2.78, 2.73, -7.6),
            target: Vec3::new(2.78, 2.5, 2.8),
            up: Vec3::Y,
            vertical_angle: 0.7,
        },
        _ => Camera {
            eye: Vec3::new(7.8, 2.2, 3.9),
            target: Vec3::new(4.2, 0.7, 1.6),
            up: Vec3::Y,
            vertical_angle: 1.1,
        },
    };
    let soft_light = SoftLight::from_light(light, SAMPLES).ok_or("no rectangle")?;
    let occluded_irradiances = soft_shadow::occluded_irradiances(scene.data(), &[soft_light]);
    let extent = extent(scene.data());
    let memory = |_: &Ray, s: &Surface, _: &mut Random| {
        let e = unshadowed(&soft_light, s.position, s.normal, extent);
        let missing = subtract_shadow::occluded_radiance(
            scene.data(),
            &occluded_irradiances,
            s.position,
            s.normal,
        );
        e * (Vec3::ONE - missing.unwrap_or_default())
    };
    let truth = |_: &Ray, s: &Surface, random: &mut Random| {
        Vec3::splat(shadowed_irradiance(
            mesh,
            light,
            s.position,
            s.normal,
            random.bits(),
        ))
    };
    let black = |_: Vec3| Vec3::ZERO;
    let ours = render(mesh, &camera, (width, height), 1, &memory, &black);
    let right = render(mesh, &camera, (width, height), 1, &truth, &black);
    let mean = right.pixels.iter().map(|p| p.x).sum::<f32>() / right.pixels.len() as f32;
    let exposure = 0.35 / mean;
    let mut pixels = Vec::new();
    for y in 0..height as usize {
        let row = y * width as usize..(y + 1) * width as usize;
        pixels.extend_from_slice(&ours.pixels[row.clone()]);
        pixels.extend_from_slice(&right.pixels[row.clone()]);
        let differences = ours.pixels[row.clone()].iter().zip(&right.pixels[row]);
        pixels.extend(differences.map(|(a, b)| Vec3::splat(0.2 / exposure) + 5.0 * (*a - *b)));
    }
    let image = Image {
        width: 3 * width,
        height,
        pixels,
    };
    image::save_buffer(
        folder.join(format!("{name}.png")),
        &image.to_srgb8(exposure),
        image.width,
        image.height,
        image::ExtendedColorType::Rgb8,
    )?;
    Ok(())
}
