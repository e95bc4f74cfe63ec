//! Pictures of the demo: camera samples, tone mapping and PNG files.

use glam::{Vec2, Vec3};
use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use meshless_gi::Geometry;
use meshless_gi_lab::accuracy::{Camera, Image};
use rayon::prelude::*;
use std::f32::consts::PI;

/// Positions of a pixel's samples, in units of its edge. No two share a row or a column.
const PATTERN: [[f32; 2]; 4] = [
    [0.375, 0.125],
    [0.875, 0.375],
    [0.125, 0.625],
    [0.625, 0.875],
];
/// Pixels between the pictures of a grid.
const GAP: u32 = 6;
/// Luminance that tone mapping maps to white, relative to the exposed mean.
const WHITE: f32 = 4.0;

/// Surface point at one sample of a pixel.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Position in meters.
    pub position: Vec3,
    /// Unit normal.
    pub normal: Vec3,
    albedo: Vec3,
}

/// Surface points of all samples of a picture.
pub struct View {
    size: u32,
    /// Samples of each pixel, row by row. `None` if a sample hits nothing.
    samples: Vec<Option<Sample>>,
}

impl View {
    /// Casts the camera rays of a square picture with an edge of `size` pixels.
    pub fn new(geometry: &dyn Geometry, camera: &Camera, size: u32) -> Self {
        let samples = (0..size * size * PATTERN.len() as u32)
            .into_par_iter()
            .map(|i| {
                let (pixel, sample) = (i / PATTERN.len() as u32, i as usize % PATTERN.len());
                let corner = Vec2::new((pixel % size) as f32, (pixel / size) as f32);
                let uv = (corner + Vec2::from_array(PATTERN[sample])) / size as f32;
                let ray = camera.ray(uv, 1.0);
                let surface = geometry.surface(&ray, &geometry.cast(&ray)?);
                Some(Sample {
                    position: surface.position,
                    normal: surface.normal,
                    albedo: surface.albedo,
                })
            })
            .collect();
        Self { size, samples }
    }

    /// Iterates over the samples that hit a surface.
    pub fn samples(&self) -> impl Iterator<Item = &Sample> {
        self.samples.iter().flatten()
    }

    /// Evaluates `value` at each of [`Self::samples`] in parallel.
    pub fn evaluate(&self, value: impl Fn(&Sample) -> Vec3 + Sync + Send) -> Vec<Vec3> {
        let all: Vec<&Sample> = self.samples().collect();
        all.into_par_iter().map(value).collect()
    }

    /// Converts irradiances at [`Self::samples`] to a picture of the mean radiance of each pixel.
    pub fn develop(&self, irradiance: &[Vec3]) -> Image {
        let mut next = irradiance.iter();
        let mut light = |sample: &Option<Sample>| match sample {
            Some(sample) => sample.albedo * next.next().copied().unwrap_or_default() / PI,
            None => Vec3::ZERO,
        };
        let pixels = self
            .samples
            .chunks(PATTERN.len())
            .map(|pixel| pixel.iter().map(&mut light).sum::<Vec3>() / PATTERN.len() as f32)
            .collect();
        Image {
            width: self.size,
            height: self.size,
            pixels,
        }
    }
}

fn luminance(c: Vec3) -> f32 {
    c.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

/// Returns the exposure that maps the picture's mean luminance to middle gray.
pub fn exposure(picture: &Image) -> f32 {
    let mean: f32 =
        picture.pixels.iter().map(|c| luminance(*c)).sum::<f32>() / picture.pixels.len() as f32;
    if mean > 0.0 { 0.25 / mean } else { 1.0 }
}

/// Converts radiance to 8-bit sRGB: exposure, then [Reinhard's
/// curve](https://doi.org/10.1145/566654.566575) on the luminance. The hue is kept.
pub fn tone_map(picture: &Image, exposure: f32) -> Vec<[u8; 3]> {
    let mut mapped = picture.clone();
    for c in &mut mapped.pixels {
        *c *= exposure;
        let l = luminance(*c);
        *c *= (1.0 + l / (WHITE * WHITE)) / (1.0 + l);
    }
    mapped
        .to_srgb8(1.0)
        .chunks_exact(3)
        .map(|c| [c[0], c[1], c[2]])
        .collect()
}

/// Arranges rows of three square pictures of `size` pixels with gaps. Returns the edge of the grid
/// in pixels and its pixels.
pub fn grid(rows: &[[Vec<[u8; 3]>; 3]], size: u32) -> (u32, Vec<[u8; 3]>) {
    let side = 3 * size + 2 * GAP;
    let mut out = vec![[255; 3]; (side * side) as usize];
    for (r, row) in rows.iter().enumerate() {
        for (c, picture) in row.iter().enumerate() {
            let corner = [c, r].map(|k| k * (size + GAP) as usize);
            for (y, line) in picture.chunks_exact(size as usize).enumerate() {
                let start = (corner[1] + y) * side as usize + corner[0];
                out[start..start + size as usize].copy_from_slice(line);
            }
        }
    }
    (side, out)
}

/// Encodes a PNG file.
pub fn png(width: u32, height: u32, pixels: &[[u8; 3]]) -> image::ImageResult<Vec<u8>> {
    let mut out = Vec::new();
    PngEncoder::new(&mut out).write_image(
        pixels.as_flattened(),
        width,
        height,
        ExtendedColorType::Rgb8,
    )?;
    Ok(out)
}
