//! FLIP, the perceptual difference of two images (\[ANA20\]): 0 for equal images, 1 for the largest
//! difference. The images have low dynamic range in linear RGB, and values outside of 0..1 are
//! clamped. The viewing distance corresponds to 67 pixels per degree.
//!
//! The difference of a pixel combines two differences: ΔE = ΔE_c^(1 − ΔE_f). ΔE_c compares colors
//! in an opponent space after a blur by the eye's contrast sensitivity. It uses HyAB in L*a*b* with
//! the Hunt effect and compresses large values. ΔE_f compares features: edges and points that only
//! one image has.

use super::Image;
use rayon::prelude::*;

const PIXELS_PER_DEGREE: f32 = 67.0;
/// D65, the white point of sRGB, in XYZ.
const WHITE: [f32; 3] = [0.950_428_5, 1.0, 1.088_900_4];

type Plane = Vec<f32>;

/// Returns the mean FLIP of two images. The difference around a NaN pixel is 1.
///
/// # Panics
/// Panics if the images differ in size.
#[must_use]
pub fn flip(reference: &Image, test: &Image) -> f32 {
    let map = flip_map(reference, test);
    // A sum of millions of values in single precision would lose small ones.
    let sum: f64 = map.iter().map(|&d| f64::from(d)).sum();
    (sum / map.len() as f64) as f32
}

/// Returns FLIP per pixel.
///
/// # Panics
/// Panics if the images differ in size.
#[must_use]
pub fn flip_map(reference: &Image, test: &Image) -> Vec<f32> {
    assert_eq!(
        (reference.width, reference.height),
        (test.width, test.height),
        "pictures of one size"
    );
    let (w, h) = (reference.width as usize, reference.height as usize);
    let opponent = |p: &Image| -> [Plane; 3] {
        let of = |c: usize| {
            let all = p.pixels.iter();
            all.map(|rgb| opponent_of(rgb.to_array())[c]).collect()
        };
        [of(0), of(1), of(2)]
    };
    let (a, b) = (opponent(reference), opponent(test));
    let color = color_difference(&filtered(&a, w, h), &filtered(&b, w, h));
    let feature = feature_difference(&a[0], &b[0], w, h);
    color
        .iter()
        .zip(&feature)
        .map(|(c, f)| c.powf(1.0 - f))
        .map(|d| if d.is_nan() { 1.0 } else { d })
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

/// Converts linear RGB to YCxCz.
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

/// Converts linear RGB to L*a*b* with the Hunt effect: dark colors count less.
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

/// Convolves a plane with the product of a kernel along rows and one along columns. Both have odd
/// length, and borders are repeated.
fn convolve(plane: &Plane, w: usize, h: usize, across: &[f32], down: &[f32]) -> Plane {
    if plane.is_empty() {
        return Plane::new();
    }
    let reach = |kernel: &[f32]| kernel.len() / 2;
    let mut rows = vec![0.0; w * h];
    rows.par_chunks_mut(w)
        .zip(plane.par_chunks(w))
        .for_each(|(out, row)| {
            let edge = reach(across);
            let mut padded = vec![row[0]; edge];
            padded.extend_from_slice(row);
            padded.resize(w + 2 * edge, row[w - 1]);
            for (j, k) in across.iter().enumerate() {
                for (o, v) in out.iter_mut().zip(&padded[j..]) {
                    *o += k * v;
                }
            }
        });
    let mut out = vec![0.0; w * h];
    out.par_chunks_mut(w).enumerate().for_each(|(y, out)| {
        for (j, k) in down.iter().enumerate() {
            let from = (y + j).saturating_sub(reach(down)).min(h - 1);
            for (o, v) in out.iter_mut().zip(&rows[from * w..]) {
                *o += k * v;
            }
        }
    });
    out
}

/// Filters the image by the eye's contrast sensitivity, one sum of Gaussians per channel.
fn filtered(opponent: &[Plane; 3], w: usize, h: usize) -> Vec<[f32; 3]> {
    const GAUSSIANS: [[(f32, f32); 2]; 3] = [
        [(1.0, 0.0047), (0.0, 1e-5)],
        [(1.0, 0.0053), (0.0, 1e-5)],
        [(34.1, 0.04), (13.5, 0.025)],
    ];
    use std::f32::consts::PI;
    let radius = (3.0 * (0.04 / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE).ceil() as i32;
    // exp(-π² d² / b) is a product over the axes.
    let bell = |b: f32| -> Vec<f32> {
        let value = |x: i32| {
            let d = x as f32 / PIXELS_PER_DEGREE;
            (-PI * PI * d * d / b).exp()
        };
        (-radius..=radius).map(value).collect()
    };
    let planes: Vec<Plane> = (0..3)
        .map(|c| {
            let mut out = vec![0.0; w * h];
            let mut total = 0.0;
            for (a, b) in GAUSSIANS[c].into_iter().filter(|(a, _)| *a > 0.0) {
                let (bell, weight) = (bell(b), a * (PI / b).sqrt());
                total += weight * bell.iter().sum::<f32>().powi(2);
                let part = convolve(&opponent[c], w, h, &bell, &bell);
                out.iter_mut().zip(part).for_each(|(o, v)| *o += weight * v);
            }
            out.iter_mut().for_each(|v| *v /= total);
            out
        })
        .collect();
    (0..w * h)
        .into_par_iter()
        .map(|i| rgb_of([planes[0][i], planes[1][i], planes[2][i]]))
        .collect()
}

fn color_difference(a: &[[f32; 3]], b: &[[f32; 3]]) -> Plane {
    const POWER: f32 = 0.7;
    const KNEE: f32 = 0.4;
    const AT_KNEE: f32 = 0.95;
    let max = hyab(hunt_lab([0.0, 1.0, 0.0]), hunt_lab([0.0, 0.0, 1.0])).powf(POWER);
    a.par_iter()
        .zip(b)
        .map(|(a, b)| {
            let d = hyab(hunt_lab(*a), hunt_lab(*b)).powf(POWER);
            if d < KNEE * max {
                AT_KNEE * d / (KNEE * max)
            } else {
                AT_KNEE + (d - KNEE * max) / (max - KNEE * max) * (1.0 - AT_KNEE)
            }
        })
        .collect()
}

/// Returns the difference of edges and points of two images.
fn feature_difference(a: &Plane, b: &Plane, w: usize, h: usize) -> Plane {
    let sigma = 0.5 * 0.082 * PIXELS_PER_DEGREE;
    let radius = (3.0 * sigma).ceil() as i32;
    // Both detectors are separable: a Gaussian across the feature, and its first or second
    // derivative along it.
    let bell = |x: i32| (-((x * x) as f32) / (2.0 * sigma * sigma)).exp();
    let along = |of: &dyn Fn(i32) -> f32| -> Vec<f32> { (-radius..=radius).map(of).collect() };
    let gauss = along(&bell);
    let edge = along(&|x| -(x as f32) * bell(x));
    let point = along(&|x| ((x * x) as f32 / (sigma * sigma) - 1.0) * bell(x));
    let features = |plane: &Plane| -> (Plane, Plane) {
        let gray: Plane = plane.iter().map(|y| (y + 16.0) / 116.0).collect();
        let strength = |kernel: &[f32]| -> Plane {
            // Positive weights sum to 1, negative ones to -1.
            let beside: f32 = gauss.iter().sum();
            let sum = |sign: f32| kernel.iter().map(|v| (sign * v).max(0.0)).sum::<f32>() * beside;
            let (plus, minus) = (sum(1.0), sum(-1.0));
            let even = |v: &f32| if *v > 0.0 { v / plus } else { v / minus };
            let k: Vec<f32> = kernel.iter().map(even).collect();
            let across = convolve(&gray, w, h, &k, &gauss);
            let down = convolve(&gray, w, h, &gauss, &k);
            across.iter().zip(&down).map(|(a, b)| a.hypot(*b)).collect()
        };
        (strength(&edge), strength(&point))
    };
    let ((ea, pa), (eb, pb)) = (features(a), features(b));
    (0..w * h)
        .map(|i| {
            let max = (ea[i] - eb[i]).abs().max((pa[i] - pb[i]).abs());
            (max * std::f32::consts::FRAC_1_SQRT_2).sqrt().min(1.0)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn flat(color: Vec3) -> Image {
        Image {
            width: 24,
            height: 16,
            pixels: vec![color; 24 * 16],
        }
    }

    #[test]
    fn flip_of_uniform_pictures_matches_color_difference() {
        let of = |a, b| flip(&flat(a), &flat(b));
        // Green against blue is the largest difference by definition. Black against white is 100 by
        // HyAB, 0.967 after compression.
        assert!((of(Vec3::Y, Vec3::Z) - 1.0).abs() < 1e-3);
        assert!((of(Vec3::ZERO, Vec3::ONE) - 0.967).abs() < 2e-3);
        let gray = Vec3::splat(0.2);
        assert_eq!(of(gray, gray), 0.0);
        let (near, far) = (of(gray, 1.02 * gray), of(gray, 1.2 * gray));
        assert!(0.0 < near && near < 0.5 * far && far < 0.2, "{near} {far}");
        assert_eq!(of(gray, 0.5 * gray), of(0.5 * gray, gray));
        // Values above 1 are white.
        assert!(of(Vec3::splat(7.0), Vec3::ONE) < 1e-4);
        assert_eq!(of(Vec3::NAN, Vec3::ONE), 1.0);
    }

    #[test]
    fn flip_missing_edge_exceeds_blurred_edge() {
        let step = |width: f32| Image {
            width: 48,
            height: 16,
            pixels: (0..48 * 16)
                .map(|i| {
                    let t = ((i % 48) as f32 - 23.5) / width;
                    Vec3::splat(0.3 + 0.2 * t.clamp(-0.5, 0.5))
                })
                .collect(),
        };
        let (sharp, soft, none) = (step(0.5), step(3.0), flat(Vec3::ZERO));
        let none = Image {
            width: 48,
            pixels: vec![Vec3::splat(0.3); 48 * 16],
            ..none
        };
        let (blurred, lost) = (flip(&sharp, &soft), flip(&sharp, &none));
        assert!(0.0 < blurred && blurred < 0.5 * lost, "{blurred} {lost}");
        let map = flip_map(&sharp, &soft);
        // The difference is at the edge and small far from it.
        assert!(map[8 * 48 + 23] > 10.0 * map[8 * 48 + 1].max(1e-4));
    }
}
