//! Animated PNG of a moving light: direct light on the left, with indirect light on the right.

use super::demo_frame::{self, DemoLight};
use super::picture::{self, View};
use super::progress;
use glam::Vec3;
use meshless_gi::{BakedScene, TriangleMesh};
use std::f32::consts::TAU;

/// Edge of each of the two pictures, in pixels.
pub const SIZE: u32 = 192;
/// Number of frames of one round of the light.
const FRAMES: u32 = 32;
/// Duration of a frame, in milliseconds.
const DELAY: u16 = 100;
/// Pixels between the pictures.
const GAP: usize = 4;

/// Renders all frames and encodes them.
pub fn render(
    scene: &BakedScene,
    mesh: &TriangleMesh,
    view: &View,
) -> Result<Vec<u8>, png::EncodingError> {
    let width = 2 * SIZE as usize + GAP;
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, SIZE);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_compression(png::Compression::High);
    encoder.set_animated(FRAMES, 0)?;
    encoder.set_frame_delay(DELAY, 1000)?;
    let mut writer = encoder.write_header()?;
    let mut exposure = None;
    for i in 0..FRAMES {
        let step = progress::Step::new(format!("frame {} of {FRAMES}", i + 1));
        let frame = demo_frame::compute(scene, mesh, view, &light(i));
        let [left, right] = [view.develop(&frame.direct), view.develop(&frame.total())];
        // One exposure for all frames, so that brightness follows the light.
        let exposure = *exposure.get_or_insert_with(|| picture::exposure(&right));
        let [left, right] = [left, right].map(|p| picture::tone_map(&p, exposure));
        let rows = left
            .chunks_exact(SIZE as usize)
            .zip(right.chunks_exact(SIZE as usize));
        let pixels: Vec<[u8; 3]> = rows
            .flat_map(|(left, right)| [left, &[[255; 3]; GAP], right].concat())
            .collect();
        writer.write_image_data(pixels.as_flattened())?;
        drop(step);
    }
    writer.finish()?;
    Ok(bytes)
}

/// Returns the light of a frame. It moves on an ellipse below the ceiling and turns from wall to
/// wall.
fn light(frame: u32) -> DemoLight {
    let (sin, cos) = (TAU * frame as f32 / FRAMES as f32).sin_cos();
    let center = Vec3::new(0.5 * sin, 1.55, 0.35 + 0.25 * cos);
    DemoLight::new(
        "moving",
        center,
        Vec3::new(1.1 * sin, -0.7, -0.3 - 0.2 * cos),
    )
}
