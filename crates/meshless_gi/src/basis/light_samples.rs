//! Light samples of a sender, spread over its function's support with the density of the basis
//! function B_j ([L08] Eq. (2)).
//!
//! \[L08\] §2.1 evaluates light at the function's own center. The shadow edge of a moving light
//! then jumps from center to center. A sender next to a lit ledge is either lit or dark. A sender
//! of the finest level is therefore the mean over several samples.
//!
//! Candidates come from a lattice with the kernel's density ([L08] Eq. (9)), rotated for each
//! sender and projected to the surface. Samples are selected by the inverse of the level's sum of
//! weights. Together, the senders of a level then represent each part of the surface once. Samples
//! that a wall or a fold occludes from the center are left out.
//!
//! On a rough surface (the cells of a point cloud) samples lie above the surrounding rims. The
//! shadow rays of a frame would hit the rims otherwise. Visibility is then tested from above the
//! surface, as for clip planes: on a curved surface, the next cell would occlude everything behind
//! it. On triangles it is tested from the surface itself. From a higher origin, surfaces with other
//! light behind sills and ledges would be visible.

use super::visibility::support_origin_height;
use super::weight::weight;
use super::{LevelBasis, WeightEntry, support_bounds};
use crate::samples::{LightSample, Random, free_height, lattice, morton, tangents};
use crate::scene::{Geometry, Ray, Surface};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Number of candidate lattices. Each has as many points as a sender has samples.
const LATTICES: u32 = 8;
/// Lower bound of the sum of weights. Without it, one candidate at the rim of an isolated function
/// would represent most of the surface.
const MIN_WEIGHTS: f32 = 0.25;

/// Candidate for a light sample.
struct SampleCandidate {
    surface: Surface,
    /// Inverse of the sum of the level's weights at the candidate.
    share: f32,
}

/// Finest level of senders.
#[derive(Clone, Copy, Debug)]
pub struct SenderLevel<'a> {
    /// Basis functions.
    pub basis: &'a LevelBasis,
    /// `true` for each sender on an emissive surface. The samples of these senders lie on emissive
    /// surfaces, those of the other senders do not. Empty if emitters are not separate.
    pub emissive: &'a [bool],
}

/// Returns `per_sender` light samples for each function of the level, function after function, and
/// the number of rays cast. `surfaces` are the surfaces at the function centers. Their albedo and
/// emission are replaced by the means over the samples.
pub fn place_light_samples(
    geometry: &dyn Geometry,
    level: &SenderLevel<'_>,
    surfaces: &mut [Surface],
    per_sender: u32,
    seed: u64,
) -> (Vec<LightSample>, u64) {
    let count = per_sender as usize;
    let reach: Vec<f32> = (0..per_sender)
        .map(|k| quantile((k as f32 + 0.5) / per_sender as f32))
        .collect();
    let found: Vec<(Vec<LightSample>, u64)> = surfaces
        .par_iter_mut()
        .enumerate()
        .map(|(i, surface)| {
            let (candidates, rays) = sample_support(geometry, level, i, surface, &reach, seed);
            let mut seen = resample(&candidates, count);
            if seen.is_empty() {
                seen = vec![*surface; count];
            }
            let share = 1.0 / count as f32;
            let [albedo, emission] = seen.iter().fold([Vec3::ZERO; 2], |[a, m], s| {
                [a + s.albedo * share, m + s.emission * share]
            });
            (surface.albedo, surface.emission) = (albedo.min(Vec3::ONE), emission);
            let samples = seen.iter().map(|s| {
                let above = s.normal * geometry.surface_relief(s.position);
                LightSample::new(s.position + above, s.normal)
            });
            (samples.collect(), rays)
        })
        .collect();
    let rays = found.iter().map(|f| f.1).sum();
    (found.into_iter().flat_map(|f| f.0).collect(), rays)
}

/// Returns the candidates of function `i` at lattice points around its center, and the number of
/// rays cast. Each lattice has one point at each radius in `reach`, relative to the support radius.
fn sample_support(
    geometry: &dyn Geometry,
    level: &SenderLevel<'_>,
    i: usize,
    surface: &Surface,
    reach: &[f32],
    seed: u64,
) -> (Vec<SampleCandidate>, u64) {
    let mut seen = Vec::new();
    let point = &level.basis.points[i];
    let is_on_emitter = level.emissive.get(i).copied();
    let (x, n) = (surface.position, surface.normal);
    let (t, b) = tangents(n);
    let mut random = Random::new(seed, 0x70_6c_61_63, i as u64);
    // Rays stay within the support along the normal ([L08] Eq. (10)) and below any surface above
    // the center.
    let depth = 0.25 * point.radius;
    let height = 0.5 * free_height(geometry, x, n, 2.0 * depth);
    let mut rays = 1;
    let up = support_origin_height(geometry, x, n, point.radius, &mut rays);
    let eye = x + n * up;
    let mut weights = Vec::new();
    for _ in 0..LATTICES {
        let turn = Vec2::new(0.0, random.unit());
        for (k, r) in reach.iter().enumerate() {
            let angle = lattice(k as u32, reach.len() as u32, turn).y * std::f32::consts::TAU;
            let across = (t * libm::cosf(angle) + b * libm::sinf(angle)) * (r * point.radius);
            // Ray from above down to the surface.
            let ray = Ray::segment(x + across + n * height, -n, height + depth);
            rays += 1;
            let Some(hit) = geometry.cast(&ray) else {
                continue;
            };
            let is_emitter = || {
                geometry
                    .emitters()
                    .is_some_and(|e| e.contains(hit.primitive))
            };
            if is_on_emitter.is_some_and(|own| own != is_emitter()) {
                continue;
            }
            let there = geometry.surface(&ray, &hit);
            if weight(point, &level.basis.planes, there.position, there.normal) <= 0.0 {
                continue;
            }
            rays += 1;
            let above = there.position + there.normal * up;
            if geometry.is_occluded(eye, above) {
                continue;
            }
            weights.clear();
            level
                .basis
                .raw_weights(there.position, there.normal, &mut weights);
            let shares =
                |w: &&WeightEntry| level.emissive.get(w.index as usize).copied() == is_on_emitter;
            let sum: f32 = weights.iter().filter(shares).map(|w| w.weight).sum();
            seen.push(SampleCandidate {
                surface: there,
                share: 1.0 / sum.max(MIN_WEIGHTS),
            });
        }
    }
    // Consecutive samples are close to each other, so that systematic resampling leaves no gaps.
    let bounds = support_bounds(point);
    seen.sort_by_cached_key(|c| morton(c.surface.position, &bounds));
    (seen, rays)
}

/// Selects `count` candidates, each in proportion to its share (systematic resampling). Returns an
/// empty list if `candidates` is empty.
fn resample(candidates: &[SampleCandidate], count: usize) -> Vec<Surface> {
    let whole: f32 = candidates.iter().map(|c| c.share).sum();
    let mut chosen = Vec::with_capacity(count);
    let mut sum = 0.0;
    for candidate in candidates {
        sum += candidate.share;
        while chosen.len() < count && (chosen.len() as f32 + 0.5) * whole <= sum * count as f32 {
            chosen.push(candidate.surface);
        }
    }
    // Rounding can leave out the last sample.
    while let (true, Some(last)) = (chosen.len() < count, candidates.last()) {
        chosen.push(last.surface);
    }
    chosen
}

/// Computes the radius, relative to the support radius, that encloses the fraction `u` of a
/// function's weight on a plane. It inverts ∫ K(t) t dt = 2t⁵/5 − 3t⁴/4 + t²/2, divided by its
/// total 3/20, with K of \[L08\] Eq. (9).
fn quantile(u: f32) -> f32 {
    let inside = |t: f32| t * t * (0.5 + t * t * (0.4 * t - 0.75)) / 0.15;
    let (mut low, mut high) = (0.0f32, 1.0f32);
    for _ in 0..24 {
        let middle = 0.5 * (low + high);
        if inside(middle) < u {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::{Point, uniform_sphere};
    use crate::scene::{Material, TriangleMesh};
    #[cfg(feature = "point_clouds")]
    use crate::scene::{PlyPoints, PointCloud};

    fn square(corners: [Vec3; 4]) -> [[Vec3; 3]; 2] {
        let [a, b, c, d] = corners;
        [[a, b, c], [a, c, d]]
    }

    /// Floor of 4 m with a wall of zero thickness at x = 0.3.
    fn floor_and_wall() -> TriangleMesh {
        let floor = square([
            Vec3::new(-2.0, 0.0, 2.0),
            Vec3::new(2.0, 0.0, 2.0),
            Vec3::new(2.0, 0.0, -2.0),
            Vec3::new(-2.0, 0.0, -2.0),
        ]);
        let wall = square([
            Vec3::new(0.3, 0.0, 2.0),
            Vec3::new(0.3, 0.0, -2.0),
            Vec3::new(0.3, 1.0, -2.0),
            Vec3::new(0.3, 1.0, 2.0),
        ]);
        let triangles = [floor, wall].concat();
        TriangleMesh::new(triangles, vec![0; 4], vec![Material::default()])
    }

    fn senders(basis: &LevelBasis) -> SenderLevel<'_> {
        SenderLevel {
            basis,
            emissive: &[],
        }
    }

    fn surface(position: Vec3, normal: Vec3) -> Surface {
        Surface {
            position,
            normal,
            albedo: Vec3::ONE,
            emission: Vec3::ZERO,
            front: true,
        }
    }

    #[test]
    fn kernel_quantile_matches_kernel_integral() {
        // Compare the quantile with the midpoint rule over K(t) t.
        for u in [0.1f32, 0.5, 0.9] {
            let t = quantile(u);
            let steps = 20_000;
            let (mut inside, mut all) = (0.0f64, 0.0f64);
            for k in 0..steps {
                let r = (f64::from(k) + 0.5) / f64::from(steps);
                let w = f64::from(super::super::weight::kernel(r as f32)) * r;
                all += w;
                if r < f64::from(t) {
                    inside += w;
                }
            }
            assert!((inside / all - f64::from(u)).abs() < 1e-3, "{u}: {t}");
        }
    }

    #[test]
    fn light_samples_of_separate_functions_spread_and_stop_at_walls() {
        let mesh = floor_and_wall();
        let level = LevelBasis::new(
            vec![
                Point::new(Vec3::new(-1.0, 0.0, 0.0), Vec3::Y, 0.8),
                Point::new(Vec3::ZERO, Vec3::Y, 0.8),
            ],
            Vec::new(),
        );
        let mut surfaces: Vec<Surface> =
            level.points.iter().map(|p| surface(p.x(), p.n())).collect();
        let (samples, rays) = place_light_samples(&mesh, &senders(&level), &mut surfaces, 16, 3);
        assert_eq!(samples.len(), 32);
        assert!(rays >= 2 * 32);
        let (open, beside) = samples.split_at(16);
        let mean = open.iter().map(LightSample::x).sum::<Vec3>() / 16.0;
        assert!((mean - level.points[0].x()).length() < 0.08, "{mean}");
        let r2 = |p: &LightSample| (p.x() - level.points[0].x()).length_squared();
        // Mean square distance with the density K / max(K, 0.25), by the midpoint rule.
        let (mut whole, mut right) = (0.0, 0.0);
        for k in 0..1000 {
            let t = (k as f32 + 0.5) / 1000.0;
            let kernel = super::super::weight::kernel(t);
            let density = t * kernel / kernel.max(MIN_WEIGHTS);
            whole += density;
            right += density * t * t * 0.64;
        }
        let right = right / whole;
        let found = open.iter().map(r2).sum::<f32>() / 16.0;
        assert!((found / right - 1.0).abs() < 0.15, "{found} {right}");
        assert!(beside.iter().all(|p| p.x().x < 0.3), "none behind the wall");
        assert!(beside.iter().any(|p| p.x().x > 0.1));
        assert!(samples.iter().all(|p| (p.n() - Vec3::Y).length() < 1e-4));
        assert_eq!(surfaces[0].albedo, surfaces[1].albedo);
    }

    #[test]
    fn light_samples_of_enclosed_function_keep_its_origin() {
        let mesh = floor_and_wall();
        let x = Vec3::new(0.0, 5.0, 0.0);
        let level = LevelBasis::new(vec![Point::new(x, Vec3::Y, 0.5)], Vec::new());
        let mut surfaces = [surface(x, Vec3::Y)];
        let (samples, _) = place_light_samples(&mesh, &senders(&level), &mut surfaces, 4, 1);
        assert!(samples.len() == 4 && samples.iter().all(|p| p.x() == x));
        assert_eq!(surfaces[0].albedo, Vec3::ONE);
    }

    #[cfg(feature = "point_clouds")]
    fn on_the_sphere(seed: u64, i: u64) -> Vec3 {
        let mut r = Random::new(5, seed, i);
        uniform_sphere(Vec2::new(r.unit(), r.unit()))
    }

    #[cfg(feature = "point_clouds")]
    /// Sphere of points of radius 1, and functions of radius 0.2 on it.
    fn ball() -> (TriangleMesh, LevelBasis, Vec<Surface>) {
        let ball: Vec<Vec3> = (0..1500).map(|i| on_the_sphere(1, i)).collect();
        let points = PlyPoints {
            normals: Some(ball.clone()),
            positions: ball,
            ..PlyPoints::default()
        };
        let (mesh, _) = PointCloud::new(points, &[]).expect("a cloud").mesh();
        let seen = |i: u64| {
            let ray = Ray::new(3.0 * on_the_sphere(2, i), -on_the_sphere(2, i));
            Some(mesh.surface(&ray, &mesh.cast(&ray)?))
        };
        let surfaces: Vec<Surface> = (0..300).filter_map(seen).collect();
        let centers = surfaces.iter();
        let centers = centers.map(|s| Point::new(s.position, s.normal, 0.2));
        let level = LevelBasis::new(centers.collect(), Vec::new());
        (mesh, level, surfaces)
    }

    #[cfg(feature = "point_clouds")]
    #[test]
    fn light_samples_on_point_sphere_follow_curvature() {
        let (mesh, level, mut surfaces) = ball();
        let (samples, _) = place_light_samples(&mesh, &senders(&level), &mut surfaces, 16, 3);
        let mut sum = 0.0;
        for (point, own) in level.points.iter().zip(samples.chunks(16)) {
            let square = |p: &LightSample| (p.x() - point.x()).length_squared();
            sum += own.iter().map(square).sum::<f32>() / 16.0;
        }
        // Mean square distance under B_j, at random positions.
        let (mut whole, mut right) = (0.0, 0.0);
        let mut weights = Vec::new();
        for i in 0..20_000 {
            let n = on_the_sphere(4, i);
            level.weights(n, n, &mut weights);
            for w in &weights {
                whole += w.weight;
                let way = n - level.points[w.index as usize].x();
                right += w.weight * way.length_squared();
            }
        }
        let right = right / whole;
        let found = sum / level.points.len() as f32;
        println!("squared distance of samples {found}, {right} under the basis");
        assert!((found / right - 1.0).abs() < 0.15, "{found} {right}");
    }

    #[cfg(feature = "point_clouds")]
    #[test]
    fn light_samples_on_point_sphere_lie_above_neighbor_disks() {
        let (mesh, level, mut surfaces) = ball();
        let (samples, _) = place_light_samples(&mesh, &senders(&level), &mut surfaces, 64, 3);
        // The sphere is the only geometry. A light above the horizon of a position and its
        // neighbors must be visible from the position. The ray starts as a frame's shadow ray does.
        let blocked = |raised: f32| {
            let dark = |(k, sample): (usize, &LightSample)| {
                let (x, n) = (sample.x(), sample.n());
                let up = (x.normalize() + 0.9 * on_the_sphere(3, k as u64)).normalize();
                let start = x + n * (2e-5 + (raised - 1.0) * mesh.surface_relief(x));
                up.dot(n) > 0.3 && mesh.cast(&Ray::new(start, up)).is_some()
            };
            samples.iter().enumerate().filter(|p| dark(*p)).count()
        };
        let (stored, flat) = (blocked(1.0), blocked(0.0));
        println!(
            "{stored} of {} samples are dark, {flat} on the cells themselves",
            samples.len()
        );
        assert!(
            stored * 1000 <= samples.len(),
            "{stored} of {}",
            samples.len()
        );
        assert!(flat > 10 * (stored + 1), "{flat} against {stored}");
    }
}
