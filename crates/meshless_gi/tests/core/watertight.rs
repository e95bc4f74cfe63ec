//! No ray escapes from a closed mesh. Four million rays start inside, near the origin and far from
//! it. A quarter of them is aimed at vertices and midpoints of edges. The same count detects a
//! missing triangle.

use glam::{Vec2, Vec3};
use meshless_gi::internals::samples::{Random, uniform_sphere};
use meshless_gi::{Bvh, Geometry, Material, Ray, TriangleMesh};
use rayon::prelude::*;

const RAYS: u64 = 4_000_000;

type Triangles = Vec<[Vec3; 3]>;

/// Returns a subdivided octahedron projected onto the unit sphere. It is closed, and shared
/// vertices have equal bits.
fn sphere(rounds: u32) -> Triangles {
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    let mut out = Vec::new();
    for (a, b, c) in [(x, y, z), (y, -x, z), (-x, -y, z), (-y, x, z)] {
        out.push([a, b, c]);
        out.push([b, a, -c]);
    }
    for _ in 0..rounds {
        out = out
            .into_iter()
            .flat_map(|[a, b, c]: [Vec3; 3]| {
                // The sum does not depend on the triangle, so that neighbors get the same bits.
                let middle = |p: Vec3, q: Vec3| (p + q).normalize();
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    out
}

/// Returns a cube of side 2 with grids as faces. Every cell is a pyramid that points inwards or
/// outwards by a random length.
fn spiked_box(cells: u32) -> Triangles {
    let mut r = Random::new(5, 0, 0);
    let mut out = Vec::new();
    let at = |i: u32| 2.0 * i as f32 / cells as f32 - 1.0;
    for axis in 0..3 {
        for side in [-1.0f32, 1.0] {
            let position = |u: f32, v: f32, w: f32| match axis {
                0 => Vec3::new(w, u, v),
                1 => Vec3::new(v, w, u),
                _ => Vec3::new(u, v, w),
            };
            for i in 0..cells {
                for j in 0..cells {
                    let corner = |di: u32, dj: u32| position(at(i + di), at(j + dj), side);
                    let ring = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                    let height = side * (1.0 + 0.5 * (r.unit() - 0.5));
                    let tip = position(
                        at(i) + 0.9 / cells as f32,
                        at(j) + 1.1 / cells as f32,
                        height,
                    );
                    for k in 0..4 {
                        let (a, b) = (ring[k], ring[(k + 1) % 4]);
                        out.push(if side > 0.0 { [a, b, tip] } else { [b, a, tip] });
                    }
                }
            }
        }
    }
    out
}

/// Creates ray `k`.
fn ray(triangles: &Triangles, center: Vec3, k: u64) -> Ray {
    let mut r = Random::new(11, 1, k);
    let origin = center + 0.3 * Vec3::new(r.unit() - 0.5, r.unit() - 0.5, r.unit() - 0.5);
    let direction = match k % 8 {
        // Toward a vertex, or toward the middle of an edge.
        0 | 1 => {
            let [a, b, c] = triangles[r.below(triangles.len())];
            let target = if k.is_multiple_of(8) {
                a
            } else {
                [a + b, b + c, c + a][r.below(3)] * 0.5
            };
            (target - origin).normalize()
        }
        // Along an axis, with negative zeros.
        2 if k % 64 == 2 => -[Vec3::X, Vec3::Y, Vec3::Z][r.below(3)],
        _ => uniform_sphere(Vec2::new(r.unit(), r.unit())),
    };
    // From the exact center some rays pass exactly through shared vertices.
    let origin = if k % 128 == 2 { center } else { origin };
    Ray::new(origin, direction)
}

/// Returns the number of `count` rays that miss: by closest hit, by the mesh's occlusion, and by
/// the frame's.
fn misses(triangles: &Triangles, center: Vec3, count: u64) -> [u64; 3] {
    let mesh = TriangleMesh::new(
        triangles.clone(),
        vec![0; triangles.len()],
        vec![Material::default()],
    );
    assert_eq!(mesh.len(), triangles.len(), "no triangle is dropped");
    let bvh: Bvh = mesh.bvh();
    let chunks: Vec<[u64; 3]> = (0..count.div_ceil(1 << 14))
        .into_par_iter()
        .map(|chunk| {
            let mut missed = [0; 3];
            for k in chunk << 14..((chunk + 1) << 14).min(count) {
                let ray = ray(triangles, center, k);
                missed[0] += u64::from(mesh.cast(&ray).is_none());
                missed[1] +=
                    u64::from(!mesh.is_occluded(ray.origin, ray.origin + 4.0 * ray.direction));
                missed[2] += u64::from(!bvh.is_occluded(&ray));
            }
            missed
        })
        .collect();
    chunks
        .into_iter()
        .fold([0; 3], |sum, m| [0, 1, 2].map(|i| sum[i] + m[i]))
}

fn translate(mut triangles: Triangles, offset: Vec3) -> Triangles {
    triangles.iter_mut().flatten().for_each(|v| *v += offset);
    triangles
}

/// Returns two closed meshes, each at three distances from the origin.
fn cases() -> Vec<(&'static str, Triangles, Vec3)> {
    let mut out = Vec::new();
    for offset in [0.0, 10.0, 1000.0] {
        let center = Vec3::new(offset, -0.7 * offset, 0.3 * offset);
        out.push(("sphere", translate(sphere(4), center), center));
        out.push(("spiked box", translate(spiked_box(12), center), center));
    }
    out
}

#[test]
fn closed_mesh_blocks_every_ray() {
    let cases = cases();
    let each = RAYS / cases.len() as u64 + 1;
    for (name, triangles, center) in &cases {
        assert_eq!(
            misses(triangles, *center, each),
            [0; 3],
            "{name} at {center}: of {each} rays"
        );
    }
}

#[test]
fn missing_triangle_is_detected() {
    for (name, mut triangles, center) in cases() {
        // Triangle with the largest solid angle from the center.
        let solid_angle = |t: &[Vec3; 3]| {
            let [a, b, c] = t.map(|v| v - center);
            (b - a).cross(c - a).dot(a).abs() / (a + b + c).length().powi(3)
        };
        let largest = (0..triangles.len())
            .max_by(|&i, &j| solid_angle(&triangles[i]).total_cmp(&solid_angle(&triangles[j])));
        triangles.swap_remove(largest.unwrap());
        let missed = misses(&triangles, center, 50_000);
        assert!(
            missed.iter().all(|&m| m > 0),
            "{name} at {center}: {missed:?}"
        );
    }
}

/// The lower index of two coincident triangles is hit, for any order in the BVH.
#[test]
fn coincident_triangles_hit_lower_index() {
    let mut triangles = sphere(3);
    let count = triangles.len();
    triangles.extend(triangles.clone());
    let mesh = TriangleMesh::new(triangles.clone(), Vec::new(), Vec::new());
    let reversed: Triangles = triangles.into_iter().rev().collect();
    let backwards = TriangleMesh::new(reversed, Vec::new(), Vec::new());
    for k in 0..20_000 {
        let mut r = Random::new(3, 3, k);
        let ray = Ray::new(Vec3::ZERO, uniform_sphere(Vec2::new(r.unit(), r.unit())));
        let (a, b) = (mesh.cast(&ray).unwrap(), backwards.cast(&ray).unwrap());
        assert!(
            (a.primitive as usize) < count && (b.primitive as usize) < count,
            "ray {k}"
        );
        assert_eq!(a.t, b.t, "ray {k}");
    }
}

/// An empty mesh has no hits, and degenerate meshes and rays do not cause panics.
#[test]
fn degenerate_meshes_and_rays_do_not_panic() {
    let bad = vec![
        [Vec3::ZERO, Vec3::X, Vec3::NAN],
        [Vec3::ZERO, Vec3::X, 2.0 * Vec3::X],
        [Vec3::ZERO, Vec3::X, Vec3::Y * 1e30],
    ];
    let empty = TriangleMesh::new(bad, vec![0; 3], vec![Material::default()]);
    assert_eq!(
        (
            empty.len(),
            empty.problems().not_finite,
            empty.problems().no_area
        ),
        (0, 2, 1)
    );
    let mesh = TriangleMesh::new(sphere(2), Vec::new(), Vec::new());
    let wild = [f32::NAN, f32::INFINITY, 0.0, -0.0, 1e38, f32::MIN_POSITIVE];
    for x in wild {
        for y in wild {
            let ray = Ray::new(Vec3::new(x, 0.0, 0.1), Vec3::new(y, -0.0, 0.0));
            assert!(empty.cast(&ray).is_none() && empty.bvh().nodes.is_empty());
            let _ = mesh.cast(&ray);
            let _ = (
                mesh.is_occluded(ray.origin, ray.direction),
                mesh.bvh().is_occluded(&ray),
            );
        }
    }
    let indexed = TriangleMesh::indexed(
        &[Vec3::ZERO, Vec3::X, Vec3::Y],
        &[[0, 1, 2], [0, 1, 3]],
        &[7],
        Vec::new(),
    );
    assert_eq!(
        (
            indexed.len(),
            indexed.problems().bad_index,
            indexed.problems().bad_material
        ),
        (1, 1, 1)
    );
}

/// `site` equals `surface` without its colors, on front sides and on back sides.
#[test]
fn hit_point_matches_surface_position() {
    let triangles = sphere(2);
    let sides = [false, true].map(|double_sided| Material {
        double_sided,
        ..Material::default()
    });
    let material_of = (0..triangles.len() as u32).map(|i| i % 2).collect();
    let mesh = TriangleMesh::new(triangles.clone(), material_of, sides.into());
    let mut kinds = [0u32; 4];
    for k in 0..4000 {
        let inside = ray(&triangles, Vec3::ZERO, k);
        let ray = match k % 3 {
            // From outside, toward the center.
            0 => Ray::new(-3.0 * inside.direction, inside.direction),
            _ => inside,
        };
        let hit = mesh.cast(&ray).expect("a sphere");
        let (site, surface) = (mesh.hit_point(&ray, &hit), mesh.surface(&ray, &hit));
        assert_eq!(site.position, surface.position, "ray {k}");
        assert_eq!(site.normal, surface.normal, "ray {k}");
        let lit = surface.front || surface.albedo != Vec3::ZERO;
        assert_eq!(site.lit, lit, "ray {k}");
        kinds[2 * usize::from(surface.front) + usize::from(lit)] += 1;
    }
    assert!(
        kinds[0] > 100 && kinds[1] > 100 && kinds[3] > 100,
        "{kinds:?}"
    );
}

#[test]
fn surface_near_ray_origin_is_hit() {
    // A triangle of one millimeter at distances of 1 mm to 10 µm, in a scene of two meters.
    // Repeated a thousand times smaller and larger.
    for scale in [1e-3f32, 1.0, 1e3] {
        let v = |x: f32, y: f32, z: f32| scale * Vec3::new(x, y, z);
        let tile = [v(-5e-4, 0.0, -5e-4), v(5e-4, 0.0, -5e-4), v(0.0, 0.0, 5e-4)];
        let far = [v(-1.0, -1.0, -1.0), v(1.0, -1.0, -1.0), v(0.0, -1.0, 1.0)];
        let mesh = TriangleMesh::new(vec![far, tile], vec![0; 2], vec![Material::default()]);
        for height in [1e-3, 5e-5, 1e-5] {
            let from = v(0.0, height, 0.0);
            let hit = mesh.cast(&Ray::new(from, -Vec3::Y)).expect("a hit");
            assert_eq!(hit.primitive, 1, "scale {scale}, height {height}");
            assert!(
                mesh.is_occluded(from, v(0.0, -0.9, 0.0)),
                "scale {scale}, height {height}"
            );
            assert!(!mesh.is_occluded(from, v(0.0, 0.9, 0.0)));
        }
    }
}
