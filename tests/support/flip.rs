//! Pictures that tests compare by the library's FLIP of \[ANA20\].

use meshless_gi_lab::accuracy::{self, Image};

/// Picture in linear RGB.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    pub width: usize,
    pub height: usize,
    pub pixels: Vec<[f32; 3]>,
}

impl Picture {
    /// Converts the picture to an image of the library.
    fn image(&self) -> Image {
        Image {
            width: self.width as u32,
            height: self.height as u32,
            pixels: self.pixels.iter().map(|&p| p.into()).collect(),
        }
    }

    /// Returns the mean of all pixels and channels.
    pub fn mean(&self) -> f32 {
        self.pixels.iter().flatten().sum::<f32>() / (3 * self.pixels.len()) as f32
    }

    /// Returns the RMS difference divided by the RMS of the reference.
    pub fn nrmse(&self, reference: &Self) -> f32 {
        let square = |v: f32| v * v;
        let pairs = self
            .pixels
            .iter()
            .flatten()
            .zip(reference.pixels.iter().flatten());
        let error: f32 = pairs.map(|(a, b)| square(a - b)).sum();
        let power: f32 = reference.pixels.iter().flatten().map(|b| square(*b)).sum();
        (error / power).sqrt()
    }

    /// Joins this picture with another one on its right, for inspection. Each pixel is enlarged to
    /// 3 × 3 pixels.
    pub fn beside(&self, other: &Self) -> Self {
        let (width, height) = (6 * self.width, 3 * self.height);
        let pixel = |i: usize| {
            let (x, y) = (i % width / 3, i / width / 3);
            let (from, x) = if x < self.width {
                (self, x)
            } else {
                (other, x - self.width)
            };
            from.pixels[y * self.width + x]
        };
        Self {
            width,
            height,
            pixels: (0..width * height).map(pixel).collect(),
        }
    }

    /// Returns the columns from `left` on, `width` wide.
    pub fn columns(&self, left: usize, width: usize) -> Self {
        let row = |y: usize| &self.pixels[y * self.width + left..y * self.width + left + width];
        Self {
            width,
            height: self.height,
            pixels: (0..self.height).flat_map(row).copied().collect(),
        }
    }

    /// Returns the sum of two pictures.
    pub fn plus(&self, other: &Self) -> Self {
        let add = |(a, b): (&[f32; 3], &[f32; 3])| [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
        Self {
            pixels: self.pixels.iter().zip(&other.pixels).map(add).collect(),
            ..*self
        }
    }

    /// Writes a PNG with sRGB gamma.
    pub fn save(&self, path: &std::path::Path) {
        let bytes: Vec<u8> = self
            .pixels
            .iter()
            .flatten()
            .map(|&v| (255.0 * to_srgb(v) + 0.5) as u8)
            .collect();
        image::save_buffer(
            path,
            &bytes,
            self.width as u32,
            self.height as u32,
            image::ColorType::Rgb8,
        )
        .unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    }
}

fn to_srgb(v: f32) -> f32 {
    let v = v.clamp(0.0, 1.0);
    if v <= 0.003_130_8 {
        12.92 * v
    } else {
        1.055 * v.powf(1.0 / 2.4) - 0.055
    }
}

/// Returns the mean FLIP of two pictures of equal size.
pub fn flip(reference: &Picture, test: &Picture) -> f32 {
    accuracy::flip(&reference.image(), &test.image())
}
