//! FLIP, the perceptual difference of two pictures, after Andersson et al., "FLIP: A Difference Evaluator for Alternating
//! Images" (2020): 0 for equal pictures, 1 for the largest difference. For low-dynamic-range pictures, at 67 pixels a degree.

/// A picture in linear RGB.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    pub width: usize,
    pub height: usize,
    pub pixels: Vec<[f32; 3]>,
}

const PIXELS_PER_DEGREE: f32 = 67.0;
const WHITE: [f32; 3] = [0.950_428_5, 1.0, 1.088_900_4];

type Plane = Vec<f32>;

impl Picture {
    /// Mean of all pixels and channels.
    pub fn mean(&self) -> f32 {
        self.pixels.iter().flatten().sum::<f32>() / (3 * self.pixels.len()) as f32
    }

    /// Root of the mean squared difference over the root of the reference's mean square.
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

    /// This picture and another one to its right, each pixel threefold: to look at.
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

    /// The part from column `left` on, `width` wide.
    pub fn columns(&self, left: usize, width: usize) -> Self {
        let row = |y: usize| &self.pixels[y * self.width + left..y * self.width + left + width];
        Self {
            width,
            height: self.height,
            pixels: (0..self.height).flat_map(row).copied().collect(),
        }
    }

    /// The sum of two pictures.
    pub fn plus(&self, other: &Self) -> Self {
        let add = |(a, b): (&[f32; 3], &[f32; 3])| [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
        Self {
            pixels: self.pixels.iter().zip(&other.pixels).map(add).collect(),
            ..*self
        }
    }

    /// Writes a PNG (gamma of sRGB).
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

/// Mean FLIP of two pictures of one size.
pub fn flip(reference: &Picture, test: &Picture) -> f32 {
    let map = flip_map(reference, test);
    map.iter().sum::<f32>() / map.len() as f32
}

/// FLIP pixel by pixel.
pub fn flip_map(reference: &Picture, test: &Picture) -> Vec<f32> {
    assert_eq!(
        (reference.width, reference.height),
        (test.width, test.height),
        "pictures of one size"
    );
    let (w, h) = (reference.width, reference.height);
    let opponent = |p: &Picture| -> [Plane; 3] {
        let of = |c: usize| p.pixels.iter().map(|rgb| opponent_of(*rgb)[c]).collect();
        [of(0), of(1), of(2)]
    };
    let (a, b) = (opponent(reference), opponent(test));
    let colour = colour_difference(&filtered(&a, w, h), &filtered(&b, w, h));
    let feature = feature_difference(&a[0], &b[0], w, h);
    colour
        .iter()
        .zip(&feature)
        .map(|(c, f)| c.powf(1.0 - f))
        .collect()
}

fn xyz(rgb: [f32; 3]) -> [f32; 3] {
    let [r, g, b] = rgb.map(|v| v.clamp(0.0, 1.0));
    [
        0.412_390_8 * r + 0.357_584_34 * g + 0.180_480_8 * b,
        0.212_639 * r + 0.715_168_7 * g + 0.072_192_32 * b,
        0.019_330_818 * r + 0.119_194_78 * g + 0.950_532_15 * b,
    ]
}

/// YCxCz.
fn opponent_of(rgb: [f32; 3]) -> [f32; 3] {
    let [x, y, z] = xyz(rgb);
    let (x, y, z) = (x / WHITE[0], y / WHITE[1], z / WHITE[2]);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

fn rgb_of(opponent: [f32; 3]) -> [f32; 3] {
    let y = (opponent[0] + 16.0) / 116.0;
    let (x, z) = (
        (opponent[1] / 500.0 + y) * WHITE[0],
        (y - opponent[2] / 200.0) * WHITE[2],
    );
    [
        3.240_97 * x - 1.537_383_2 * y - 0.498_610_76 * z,
        -0.969_243_65 * x + 1.875_967_5 * y + 0.041_555_06 * z,
        0.055_630_08 * x - 0.203_976_96 * y + 1.056_971_5 * z,
    ]
    .map(|v| v.clamp(0.0, 1.0))
}

/// L*a*b* with the Hunt effect: colours of dark places count less.
fn hunt_lab(rgb: [f32; 3]) -> [f32; 3] {
    let v = xyz(rgb);
    let f = |t: f32| {
        let d: f32 = 6.0 / 29.0;
        if t > d * d * d {
            t.cbrt()
        } else {
            t / (3.0 * d * d) + 4.0 / 29.0
        }
    };
    let (x, y, z) = (f(v[0] / WHITE[0]), f(v[1] / WHITE[1]), f(v[2] / WHITE[2]));
    let l = 116.0 * y - 16.0;
    [l, 0.01 * l * 500.0 * (x - y), 0.01 * l * 200.0 * (y - z)]
}

fn hyab(a: [f32; 3], b: [f32; 3]) -> f32 {
    (a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])
}

/// A square kernel applied with the borders repeated.
fn convolve(
    plane: &Plane,
    w: usize,
    h: usize,
    radius: i32,
    kernel: impl Fn(i32, i32) -> f32,
) -> Plane {
    let side = (2 * radius + 1) as usize;
    let k: Vec<f32> = (0..side * side)
        .map(|i| kernel((i % side) as i32 - radius, (i / side) as i32 - radius))
        .collect();
    let at = |x: i32, y: i32| {
        plane[y.clamp(0, h as i32 - 1) as usize * w + x.clamp(0, w as i32 - 1) as usize]
    };
    (0..w * h)
        .map(|i| {
            let (x, y) = ((i % w) as i32, (i / w) as i32);
            (0..side * side)
                .map(|j| {
                    k[j] * at(
                        x + (j % side) as i32 - radius,
                        y + (j / side) as i32 - radius,
                    )
                })
                .sum()
        })
        .collect()
}

/// The eye's contrast sensitivity, one sum of Gaussians a channel.
fn filtered(opponent: &[Plane; 3], w: usize, h: usize) -> Vec<[f32; 3]> {
    const GAUSSIANS: [[(f32, f32); 2]; 3] = [
        [(1.0, 0.0047), (0.0, 1e-5)],
        [(1.0, 0.0053), (0.0, 1e-5)],
        [(34.1, 0.04), (13.5, 0.025)],
    ];
    use std::f32::consts::PI;
    let radius = (3.0 * (0.04 / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE).ceil() as i32;
    let planes: Vec<Plane> = (0..3)
        .map(|c| {
            let value = |x: i32, y: i32| -> f32 {
                let d2 = (x * x + y * y) as f32 / (PIXELS_PER_DEGREE * PIXELS_PER_DEGREE);
                GAUSSIANS[c]
                    .iter()
                    .map(|&(a, b)| a * (PI / b).sqrt() * (-PI * PI * d2 / b).exp())
                    .sum()
            };
            let sum: f32 = (-radius..=radius)
                .flat_map(|y| (-radius..=radius).map(move |x| (x, y)))
                .map(|(x, y)| value(x, y))
                .sum();
            convolve(&opponent[c], w, h, radius, |x, y| value(x, y) / sum)
        })
        .collect();
    (0..w * h)
        .map(|i| rgb_of([planes[0][i], planes[1][i], planes[2][i]]))
        .collect()
}

fn colour_difference(a: &[[f32; 3]], b: &[[f32; 3]]) -> Plane {
    const POWER: f32 = 0.7;
    const KNEE: f32 = 0.4;
    const AT_KNEE: f32 = 0.95;
    let most = hyab(hunt_lab([0.0, 1.0, 0.0]), hunt_lab([0.0, 0.0, 1.0])).powf(POWER);
    a.iter()
        .zip(b)
        .map(|(a, b)| {
            let d = hyab(hunt_lab(*a), hunt_lab(*b)).powf(POWER);
            if d < KNEE * most {
                AT_KNEE * d / (KNEE * most)
            } else {
                AT_KNEE + (d - KNEE * most) / (most - KNEE * most) * (1.0 - AT_KNEE)
            }
        })
        .collect()
}

/// Edges and points that one picture has and the other lacks.
fn feature_difference(a: &Plane, b: &Plane, w: usize, h: usize) -> Plane {
    let sigma = 0.5 * 0.082 * PIXELS_PER_DEGREE;
    let radius = (3.0 * sigma).ceil() as i32;
    let gauss = |x: i32, y: i32| (-((x * x + y * y) as f32) / (2.0 * sigma * sigma)).exp();
    let edge = |x: i32, y: i32| -(x as f32) * gauss(x, y);
    let point = |x: i32, y: i32| ((x * x) as f32 / (sigma * sigma) - 1.0) * gauss(x, y);
    let features = |plane: &Plane| -> (Plane, Plane) {
        let grey: Plane = plane.iter().map(|y| (y + 16.0) / 116.0).collect();
        let strength = |kernel: &dyn Fn(i32, i32) -> f32| -> Plane {
            // Positive weights sum to 1, negative ones to -1.
            let all = || (-radius..=radius).flat_map(|y| (-radius..=radius).map(move |x| (x, y)));
            let plus: f32 = all().map(|(x, y)| kernel(x, y).max(0.0)).sum();
            let minus: f32 = all().map(|(x, y)| (-kernel(x, y)).max(0.0)).sum();
            let k = |x: i32, y: i32| {
                let v = kernel(x, y);
                if v > 0.0 { v / plus } else { v / minus }
            };
            let across = convolve(&grey, w, h, radius, k);
            let down = convolve(&grey, w, h, radius, |x, y| k(y, x));
            across.iter().zip(&down).map(|(a, b)| a.hypot(*b)).collect()
        };
        (strength(&edge), strength(&point))
    };
    let ((ea, pa), (eb, pb)) = (features(a), features(b));
    (0..w * h)
        .map(|i| {
            let most = (ea[i] - eb[i]).abs().max((pa[i] - pb[i]).abs());
            (most * std::f32::consts::FRAC_1_SQRT_2).sqrt().min(1.0)
        })
        .collect()
}
