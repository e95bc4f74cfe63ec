//! Reference of the indirect light of a scene, at the pixels of its views and at random surface
//! points.
//!
//! It is the light that a frame adds to direct light. For lights, it includes one to four
//! reflections. For the sky and emissive surfaces, it includes none to four.

use super::BOUNCES;
use crate::accuracy::Camera;
use crate::fixtures::TestScene;
use glam::{DVec3, Vec2, Vec3};
use meshless_gi::internals::samples::{Random, cosine_hemisphere, mix, tangents};
use meshless_gi::{Geometry, Light, Ray, ReferenceSettings, irradiance};
use rayon::prelude::*;

/// Vertical angle of view, radians.
const VERTICAL_FOV: f32 = 1.0;
/// Number of paths that search for a view from a surface point, and of their vertices.
const SEARCH_PATHS: [u32; 2] = [16, 8];
/// Number of paths of the pilot.
const PILOT_PATHS: u32 = 64;
/// Number of independent estimates whose mean is the reference. Their spread is its standard error.
/// The standard error of single paths is too large, because lattices stratify them.
const ESTIMATES: u32 = 8;
/// Target standard error, relative to the irradiance. It determines the number of paths.
const TOLERANCE: f32 = 0.05;
/// Irradiance below which the tolerance is constant, relative to the mean of all points.
const MIN_RELATIVE_IRRADIANCE: f32 = 0.1;
/// Seed of surface points and of the reference.
const SEED: u64 = 0x7669_6577;

/// Size of a reference.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ViewReferenceSize {
    /// Width and height of a view, pixels.
    pub view: [u32; 2],
    /// Number of random surface points.
    pub surface_points: usize,
    /// Smallest and largest number of paths per position.
    pub paths: [u32; 2],
}

/// Surface point with its reference.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReferencePoint {
    /// Index of the pixel in its view, row by row from the top. 0 without a view.
    pub pixel: u32,
    /// Position, meters.
    pub position: Vec3,
    /// Unit normal.
    pub normal: Vec3,
    /// Irradiance, W/m².
    pub irradiance: Vec3,
    /// Standard error of the irradiance, W/m².
    pub standard_error: Vec3,
}

/// Returns the reference at the pixels of view `k` of a scene that show a lit side of a surface.
#[must_use]
pub fn view_reference(
    scene: &TestScene,
    k: usize,
    size: &ViewReferenceSize,
) -> Vec<ReferencePoint> {
    let (eye, target) = scene.views[k];
    let camera = Camera {
        eye,
        target,
        up: Vec3::Y,
        vertical_angle: VERTICAL_FOV,
    };
    let [width, height] = size.view;
    let resolution = Vec2::new(width as f32, height as f32);
    let mesh = &scene.mesh;
    let point = |pixel: u32| {
        let corner = Vec2::new((pixel % width) as f32, (pixel / width) as f32);
        let ray = camera.ray((corner + 0.5) / resolution, resolution.x / resolution.y);
        let hit = mesh.hit_point(&ray, &mesh.cast(&ray)?);
        hit.lit.then_some(ReferencePoint {
            pixel,
            position: hit.position,
            normal: hit.normal,
            ..ReferencePoint::default()
        })
    };
    let points = (0..width * height).filter_map(point).collect();
    with_reference(scene, points, size.paths)
}

/// Returns the reference at random points of the surface, uniform in area. A path of few
/// reflections leads from each point to the position of a view.
#[must_use]
pub fn surface_reference(scene: &TestScene, size: &ViewReferenceSize) -> Vec<ReferencePoint> {
    let mesh = &scene.mesh;
    let triangles: Vec<[Vec3; 3]> = (0..mesh.len()).filter_map(|t| mesh.triangle(t)).collect();
    let mut ends = Vec::with_capacity(triangles.len());
    let mut area = 0.0f64;
    for [a, b, c] in &triangles {
        area += f64::from((b - a).cross(c - a).length());
        ends.push(area);
    }
    let mut random = Random::new(SEED, 0, 0);
    let mut points = Vec::with_capacity(size.surface_points);
    // Limits the attempts in scenes in which almost no surface is reachable.
    for k in 0..1000 * size.surface_points as u64 {
        if points.len() == size.surface_points {
            break;
        }
        let t = ends.partition_point(|&end| end < area * f64::from(random.unit()));
        let Some([a, b, c]) = triangles.get(t) else {
            continue;
        };
        let (root, v) = (random.unit().sqrt(), random.unit());
        let position = a * (1.0 - root) + b * (root * (1.0 - v)) + c * (root * v);
        let front = (b - a).cross(c - a).normalize_or(Vec3::Y);
        let is_double_sided = mesh.material(t).is_none_or(|m| m.double_sided);
        let is_back = random.unit() < 0.5;
        if is_back && !is_double_sided {
            continue;
        }
        let normal = if is_back { -front } else { front };
        if is_reached(scene, position, normal, k) {
            points.push(ReferencePoint {
                position,
                normal,
                ..ReferencePoint::default()
            });
        }
    }
    with_reference(scene, points, size.paths)
}

/// Returns `true` if a path from surface point (x, n) reaches the position of a view.
fn is_reached(scene: &TestScene, x: Vec3, n: Vec3, stream: u64) -> bool {
    let mesh = &scene.mesh;
    let [walks, steps] = SEARCH_PATHS;
    (0..walks).any(|walk| {
        let mut random = Random::new(SEED ^ 1, stream, u64::from(walk));
        let (mut position, mut normal) = (x + n * mesh.ray_offset(x), n);
        for _ in 0..steps {
            let is_visible =
                |eye: Vec3| (eye - position).dot(normal) > 0.0 && !mesh.is_occluded(position, eye);
            if scene.views.iter().any(|&(eye, _)| is_visible(eye)) {
                return true;
            }
            let (t, b) = tangents(normal);
            let d = cosine_hemisphere(Vec2::new(random.unit(), random.unit()));
            let ray = Ray::new(position, (t * d.x + b * d.y + normal * d.z).normalize());
            let Some(hit) = mesh.cast(&ray) else {
                return false;
            };
            let hit = mesh.hit_point(&ray, &hit);
            normal = hit.normal;
            position = hit.position + normal * mesh.ray_offset(hit.position);
        }
        false
    })
}

/// Computes irradiance and standard error of the points. The noise of a point in a pilot determines
/// its number of paths. The paths of the pilot are not used again, so the reference stays unbiased.
fn with_reference(
    scene: &TestScene,
    points: Vec<ReferencePoint>,
    paths: [u32; 2],
) -> Vec<ReferencePoint> {
    let sky: Vec<Light> = (scene.lights.iter().copied())
        .filter(|light| matches!(light, Light::Sky { .. }))
        .collect();
    let of = |(k, point): (usize, &ReferencePoint), paths: u32, seed: u64| {
        let of = |lights: &[Light], bounces: u32, seed: u64| {
            let settings = ReferenceSettings {
                paths: paths.div_ceil(ESTIMATES),
                bounces: Some(bounces),
                seed,
            };
            let (x, n) = (point.position, point.normal);
            irradiance(&scene.mesh, lights, x, n, k as u64, &settings)
        };
        let (mut sum, mut squares) = (DVec3::ZERO, DVec3::ZERO);
        for k in 0..u64::from(ESTIMATES) {
            let seed = mix(seed.wrapping_add(k));
            let reflected = of(&scene.lights, BOUNCES, seed);
            let glow = of(&sky, 0, seed ^ 2);
            let estimate = (reflected.indirect + glow.direct).as_dvec3();
            sum += estimate;
            squares += estimate * estimate;
        }
        let count = f64::from(ESTIMATES);
        let mean = sum / count;
        let variance = (squares / count - mean * mean).max(DVec3::ZERO) / (count - 1.0);
        ReferencePoint {
            irradiance: mean.as_vec3(),
            standard_error: variance.map(f64::sqrt).as_vec3(),
            ..*point
        }
    };
    let points = points.par_iter().enumerate();
    let pilot: Vec<ReferencePoint> = points
        .clone()
        .map(|p| of(p, PILOT_PATHS, SEED ^ 4))
        .collect();
    let sum: f32 = pilot.iter().map(|p| p.irradiance.max_element()).sum();
    let floor = MIN_RELATIVE_IRRADIANCE * sum / pilot.len().max(1) as f32;
    // Square root of the number of paths that the tolerance requires.
    let needed = |p: &ReferencePoint| {
        let tolerance = TOLERANCE * p.irradiance.max_element().max(floor);
        let noise = p.standard_error.max_element() * (PILOT_PATHS as f32).sqrt();
        if tolerance > 0.0 {
            noise / tolerance
        } else {
            0.0
        }
    };
    let mut all: Vec<f32> = pilot.iter().map(needed).collect();
    all.sort_by(f32::total_cmp);
    // Few paths can miss all light. Such a point gets the median number of paths.
    let median = all.get(all.len() / 2).copied().unwrap_or(0.0);
    points
        .zip(&pilot)
        .map(|(point, pilot)| {
            let needed = needed(pilot).max(median).powi(2);
            let count = needed.clamp(paths[0] as f32, paths[1] as f32) as u32;
            of(point, count, SEED)
        })
        .collect()
}
