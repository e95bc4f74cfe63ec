//! Image of a view: the reference, bakes next to it, and their differences below them.

use super::view_reference::ReferencePoint;
use crate::accuracy::Image;
use glam::Vec3;

/// Mean of the reference in an image, over pixels and channels.
const MEAN_BRIGHTNESS: f32 = 0.2;
/// Magnification of differences.
const DIFFERENCE_SCALE: f32 = 3.0;
/// Brightness of pixels without difference.
const GRAY: f32 = 0.2;
/// Brightness of pixels without a surface.
const BACKGROUND_BRIGHTNESS: f32 = 0.02;

/// Returns the exposure at which the reference has the mean brightness of images. Returns 0 without
/// light.
#[must_use]
pub fn exposure(points: &[ReferencePoint]) -> f32 {
    let sum: f32 = points.iter().map(|p| p.irradiance.element_sum()).sum();
    let count = 3.0 * points.len() as f32;
    if sum > 0.0 {
        MEAN_BRIGHTNESS * count / sum
    } else {
        0.0
    }
}

/// Images of one view side by side.
#[derive(Clone, Debug)]
pub struct Strip {
    view: [u32; 2],
    columns: Vec<[Vec<Vec3>; 2]>,
}

impl Strip {
    /// Creates a strip with the image of the reference. Its exposure is [`exposure`].
    #[must_use]
    pub fn new(view: [u32; 2], points: &[ReferencePoint]) -> Self {
        let mut strip = Self {
            view,
            columns: Vec::new(),
        };
        let scale = exposure(points);
        let values = points.iter().map(|p| scale * p.irradiance);
        let top = strip.image(points, values);
        let bottom = vec![Vec3::splat(BACKGROUND_BRIGHTNESS); top.len()];
        strip.columns.push([top, bottom]);
        strip
    }

    /// Adds the image of `values`, and below it the magnified differences to the reference. Pixels
    /// without a difference are gray.
    pub fn add(&mut self, points: &[ReferencePoint], values: &[Vec3]) {
        let scale = exposure(points);
        let top = self.image(points, values.iter().map(|v| scale * *v));
        let differences = points.iter().zip(values);
        let bottom = differences
            .map(|(p, v)| Vec3::splat(GRAY) + DIFFERENCE_SCALE * scale * (*v - p.irradiance));
        let bottom = self.image(points, bottom);
        self.columns.push([top, bottom]);
    }

    fn image(&self, points: &[ReferencePoint], values: impl Iterator<Item = Vec3>) -> Vec<Vec3> {
        let [width, height] = self.view;
        let mut pixels = vec![Vec3::splat(BACKGROUND_BRIGHTNESS); width as usize * height as usize];
        for (point, value) in points.iter().zip(values) {
            if let Some(pixel) = pixels.get_mut(point.pixel as usize) {
                *pixel = value;
            }
        }
        pixels
    }

    /// Returns the complete image.
    #[must_use]
    pub fn picture(&self) -> Image {
        let [width, height] = self.view.map(|s| s as usize);
        let mut pixels = Vec::with_capacity(2 * self.columns.len() * width * height);
        for row in 0..2 * height {
            for column in &self.columns {
                let start = row % height * width;
                pixels.extend_from_slice(&column[row / height][start..start + width]);
            }
        }
        Image {
            width: (self.columns.len() * width) as u32,
            height: 2 * height as u32,
            pixels,
        }
    }
}
