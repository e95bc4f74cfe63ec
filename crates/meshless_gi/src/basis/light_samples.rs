//! Light samples of a sender, spread over its function's support with the density of its weight
//! ([L08] Eq. (9)).
//!
//! \[L08\] §2.1 evaluates light at the function's own center. The shadow edge of a moving light
//! then jumps from center to center, and a sender next to a lit ledge is either lit or dark. A
//! sender of the finest level is therefore the mean over several samples. They come from a lattice
//! with the kernel's density, rotated for each sender and projected to the surface. Samples that a
//! wall or a fold hides from the center are left out. On a rough surface (the cells of a point
//! cloud) samples lie above the surrounding rims, which the frame's shadow rays would hit
//! otherwise. Visibility is then tested from above the surface, as for clip planes, since the next
//! cell of a bend would hide everything behind it. On triangles it is tested from the surface
//! itself: a higher origin would see over sills and ledges to surfaces with other light.

use super::LevelBasis;
use super::clip::visibility_origin_height;
use super::kernel::weight;
use crate::samples::{LightSample, Random, lattice, tangents};
use crate::scene::{Geometry, Ray, Surface};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Lattices tried, each as large as the number of positions wanted: what walls and folds take from
/// the first, the others give.
const LATTICES: u32 = 4;

/// Finest level of senders.
#[derive(Clone, Copy, Debug)]
pub struct SenderLevel<'a> {
    /// Basis functions.
    pub basis: &'a LevelBasis,
    /// `true` for each sender on an emissive surface, whose samples lie on emissive surfaces, as
    /// those of the other senders do not. Empty if emitters are not separate.
    pub emissive: &'a [bool],
}

/// The positions of a level's functions, so many each, behind one another; `surfaces` are those at
/// the functions' centers and get the mean reflectance and emission over the positions. Also says
/// how many rays it took.
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
        .map_init(Vec::new, |seen, (i, surface)| {
            let rays = look_around(geometry, level, i, surface, &reach, seed, seen);
            if seen.is_empty() {
                seen.push(*surface);
            }
            let own = seen.len();
            seen.extend((own..count).map(|k| seen[k % own]).collect::<Vec<_>>());
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

/// The surface at lattice points around function `i` that belong to it, as many as `reach` has
/// radii where there are so many; how many rays that took.
fn look_around(
    geometry: &dyn Geometry,
    level: &SenderLevel<'_>,
    i: usize,
    surface: &Surface,
    reach: &[f32],
    seed: u64,
    seen: &mut Vec<Surface>,
) -> u64 {
    seen.clear();
    let point = &level.basis.points[i];
    let is_on_emitter = level.emissive.get(i).copied();
    let (x, n) = (surface.position, surface.normal);
    let (t, b) = tangents(n);
    let mut random = Random::new(seed, 0x70_6c_61_63, i as u64);
    // Within the support along the normal: [L08] Eq. (10).
    let height = 0.25 * point.radius;
    let mut rays = 0;
    let lift = geometry.ray_offset(x);
    let up = match geometry.surface_relief(x) > 0.0 {
        true => visibility_origin_height(geometry, x, n, point.radius, &mut rays).max(lift),
        false => lift,
    };
    let eye = x + n * up;
    for _ in 0..LATTICES {
        let turn = Vec2::new(0.0, random.unit());
        for (k, r) in reach.iter().enumerate() {
            if seen.len() == reach.len() {
                return rays;
            }
            let angle = lattice(k as u32, reach.len() as u32, turn).y * std::f32::consts::TAU;
            let across = (t * libm::cosf(angle) + b * libm::sinf(angle)) * (r * point.radius);
            // Down from above onto the surface.
            let ray = Ray::segment(x + across + n * height, -n, 2.0 * height);
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
            if !geometry.occluded(eye, above) {
                seen.push(there);
            }
        }
    }
    rays
}

/// The radius, in parts of the support's, inside of which the share `u` of a function's weight on a
/// plane lies: the inverse of ∫ K(t) t dt = 2t⁵/5 − 3t⁴/4 + t²/2 over its whole, 3/20, with K of
/// \[L08\] Eq. (9).
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

    /// A floor of 4 m with a wall through x = 0.3, as thin as can be.
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
        // Midpoint rule over K(t) t against the quantile.
        for u in [0.1f32, 0.5, 0.9] {
            let t = quantile(u);
            let steps = 20_000;
            let (mut inside, mut all) = (0.0f64, 0.0f64);
            for k in 0..steps {
                let r = (f64::from(k) + 0.5) / f64::from(steps);
                let w = f64::from(super::super::kernel::kernel(r as f32)) * r;
                all += w;
                if r < f64::from(t) {
                    inside += w;
                }
            }
            assert!((inside / all - f64::from(u)).abs() < 1e-3, "{u}: {t}");
        }
    }

    #[test]
    fn light_samples_follow_weight_and_stop_at_walls() {
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
        // ∫ K t³ / ∫ K t over the support: (2/7 − 1/2 + 1/4) / (3/20) r².
        let right = (2.0 / 7.0 - 0.25) / 0.15 * 0.64;
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
    /// A ball of points of radius 1, and functions of radius 0.2 on it.
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
        // As on a plane: the ball is five times as wide as a function.
        let right = (2.0 / 7.0 - 0.25) / 0.15 * 0.04;
        let found = sum / level.points.len() as f32;
        println!("squared distance of samples {found}, {right} is even");
        assert!((found / right - 1.0).abs() < 0.15, "{found} {right}");
    }

    #[cfg(feature = "point_clouds")]
    #[test]
    fn light_samples_on_point_sphere_lie_above_neighbor_disks() {
        let (mesh, level, mut surfaces) = ball();
        let (samples, _) = place_light_samples(&mesh, &senders(&level), &mut surfaces, 64, 3);
        // Nothing but the ball is there: a light above a position's own and its neighbors' horizon
        // shines on it. The start is a frame's.
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
