//! Light between points: closed rooms of points, evenly sampled and noisy, compared with the closed
//! form. A statue of points in a room of triangles is compared with the reference integrator. The
//! comparison with the integrator must fail at wrong positions.

use meshless_gi_lab::fixtures::points as points_support;

use glam::{Vec2, Vec3};
use meshless_gi::internals::samples::{Random, scatter, uniform_sphere};
use meshless_gi::internals::scene::{PlyPoints, statue};
use meshless_gi::{
    BakedScene, Bounces, Geometry, Light, PointCloud, Preset, Quad, Ray, TriangleMesh,
};
use meshless_gi_lab::accuracy::closed_form;
use points_support::{REFLECTIONS, baked, evaluate_bake, indirect, nrmse, reference};
use std::f64::consts::PI;

const INTENSITY: f32 = 2.0;

fn bulb() -> [Light; 1] {
    [Light::Point {
        position: Vec3::new(0.3, 0.2, -0.25),
        intensity: Vec3::splat(INTENSITY),
        range: f32::INFINITY,
    }]
}

/// Reflected irradiance of each `step`th point at the first hit of the ray from the origin to it,
/// W/m², with the area of the point, m². All reflections, from a bake of the cloud's cells.
fn reflected(scene: &BakedScene, cloud: &PointCloud, step: usize) -> Vec<(f32, f32)> {
    let (cells, _) = cloud.mesh();
    let (samples, areas): (Vec<(Vec3, Vec3)>, Vec<f32>) = (0..cloud.len())
        .step_by(step)
        .filter_map(|i| {
            let ray = Ray::new(Vec3::ZERO, cloud.positions[i].normalize());
            let surface = cells.surface(&ray, &cells.cast(&ray)?);
            Some(((surface.position, surface.normal), cloud.areas[i]))
        })
        .unzip();
    let (_, indirect) = evaluate_bake(scene, cells, &bulb(), &samples, Bounces::All);
    indirect.iter().map(|e| e.x).zip(areas).collect()
}

/// A closed ball of radius 1 m.
fn ball(spacing: f32, albedo: f32) -> PlyPoints {
    let count = (4.0 * PI / f64::from(spacing * spacing)) as u64;
    let unit = |i: u64| {
        let mut r = Random::new(5, 1, i);
        uniform_sphere(Vec2::new(r.unit(), r.unit()))
    };
    let positions: Vec<Vec3> = (0..count).map(unit).collect();
    PlyPoints {
        normals: Some(positions.iter().map(|x| -*x).collect()),
        albedo: Some(vec![Vec3::splat(albedo); positions.len()]),
        positions,
        faces: 0,
    }
}

/// A closed cube of 2 m around the origin, evenly sampled, which faces inward.
fn cube(spacing: f32, albedo: f32) -> PlyPoints {
    let side = |axis: usize, high: bool| {
        let at = |u: f32, v: f32| {
            let mut x = Vec3::ZERO;
            x[axis] = if high { 1.0 } else { -1.0 };
            (x[(axis + 1) % 3], x[(axis + 2) % 3]) = (u, v);
            x
        };
        let corners = [at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)];
        let [a, b, c, d] = corners;
        let corners = if high { [d, c, b, a] } else { corners };
        meshless_gi::Quad {
            corners,
            material: meshless_gi::Material::diffuse(Vec3::splat(albedo)),
        }
    };
    let sides: Vec<_> = (0..6).map(|k| side(k % 3, k < 3)).collect();
    let points = scatter(&TriangleMesh::from_quads(&sides), spacing, 2).expect("points");
    let normals = points.normals.as_ref().expect("scattered with normals");
    let inside = points
        .positions
        .iter()
        .zip(normals)
        .all(|(x, n)| x.dot(*n) < 0.0);
    assert!(inside, "the room must face inward");
    points
}

/// Mean over the surface, and the standard deviation as a fraction of the mean.
fn mean_and_spread(values: &[(f32, f32)]) -> (f64, f64) {
    let sum = |of: &dyn Fn(f64) -> f64| -> f64 {
        values
            .iter()
            .map(|(e, a)| of(f64::from(*e)) * f64::from(*a))
            .sum()
    };
    let mean = sum(&|e| e) / sum(&|_| 1.0);
    let spread = (sum(&|e| (e - mean) * (e - mean)) / sum(&|_| 1.0)).sqrt();
    (mean, spread / mean)
}

/// Reflected light in a ball is the same everywhere, and its mean in any closed room is
/// Φ ρ / ((1 − ρ) A), for any position of the light. At ρ = 0.9 the loss of one reflection through
/// slits between points counts ten times.
#[test]
fn closed_point_rooms_conserve_energy() {
    let power = 4.0 * PI * f64::from(INTENSITY);
    for (name, points, area, max_spread) in [
        ("ball", ball(0.06, 0.9), 4.0 * PI, 0.02),
        ("cube", cube(0.06, 0.9), 24.0, f64::INFINITY),
    ] {
        let cloud = PointCloud::new(points, &[]).expect("a cloud");
        // A link depends on no albedo: one bake has both.
        let mut scene = baked(&cloud.mesh().0, Preset::Draft);
        for albedo in [0.9f32, 0.5] {
            for surface in &mut scene.data_mut().surfaces {
                surface.albedo = [albedo; 3];
            }
            let expected = closed_form::enclosure_reflected(power / area, albedo.into(), None);
            let (mean, spread) = mean_and_spread(&reflected(&scene, &cloud, 7));
            let error = mean / expected - 1.0;
            println!(
                "{name} of {} points, albedo {albedo}: error {:+.2} %, spread {:.2} %",
                cloud.len(),
                100.0 * error,
                100.0 * spread
            );
            assert!(
                error.abs() < 0.02,
                "{name} {albedo}: {mean}, expected {expected}"
            );
            assert!(spread < max_spread, "{name} {albedo}: {spread}");
        }
    }
}

/// A noisy scan: points displaced by half a spacing in any direction. The error of the mean is the
/// light lost at the rims of cells and in slits between them.
#[test]
fn noisy_closed_point_room_conserves_energy() {
    const SPACING: f32 = 0.06;
    let mut points = cube(SPACING, 0.5);
    for (i, x) in (0..).zip(&mut points.positions) {
        let mut r = Random::new(9, 9, i);
        let direction = uniform_sphere(Vec2::new(r.unit(), r.unit()));
        *x += 0.5 * SPACING * r.unit() * direction;
    }
    let cloud = PointCloud::new(points, &[Vec3::ZERO]).expect("a cloud");
    let power = 4.0 * PI * f64::from(INTENSITY);
    let expected = closed_form::enclosure_reflected(power / 24.0, 0.5, None);
    let scene = baked(&cloud.mesh().0, Preset::Draft);
    let (mean, spread) = mean_and_spread(&reflected(&scene, &cloud, 7));
    println!(
        "{} noisy points: error {:+.1} %, spread {:.1} %",
        cloud.len(),
        100.0 * (mean / expected - 1.0),
        100.0 * spread
    );
    assert!(
        (mean / expected - 1.0).abs() < 0.03,
        "{mean}, expected {expected}"
    );
    // The light is nearer to some walls: without noise it is 0.11.
    assert!(spread < 0.16, "{spread}");
}

/// The five walls of the box as triangles and the statue as points, with albedos times a factor.
fn walls_and_statue(walls: f32, statue_factor: f32) -> (TriangleMesh, usize) {
    let mut quads = Quad::cornell_box();
    quads.truncate(5);
    for quad in &mut quads {
        quad.material.base_color *= Vec3::splat(walls).extend(1.0);
    }
    let mut points = scatter(&statue(), 0.03, 1).expect("points");
    let orange = Vec3::new(0.85, 0.4, 0.06) * statue_factor;
    points.albedo = Some(vec![orange; points.positions.len()]);
    let cloud = PointCloud::new(points, &[]).expect("a cloud");
    let room = TriangleMesh::from_quads(&quads);
    let count = room.len();
    (TriangleMesh::joined(vec![room, cloud.mesh().0]), count)
}

/// Positions on the walls and on the statue that are visible to cameras in front, on the left and
/// on the right.
fn visible_positions(mesh: &TriangleMesh, walls: usize, count: u64) -> [Vec<(Vec3, Vec3)>; 2] {
    let mut positions = [Vec::new(), Vec::new()];
    for k in 0..count {
        let mut r = Random::new(4, 4, k);
        let eye = [
            Vec3::new(0.0, 1.2, 2.5),
            Vec3::new(-0.8, 1.6, 0.8),
            Vec3::new(0.8, 0.5, 0.6),
        ][(k % 3) as usize];
        let to = Vec3::new(2.0 * r.unit() - 1.0, 2.0 * r.unit(), 2.0 * r.unit() - 1.0);
        let ray = Ray::new(eye, (to - eye).normalize());
        let Some(hit) = mesh.cast(&ray) else {
            continue;
        };
        let surface = mesh.surface(&ray, &hit);
        positions[usize::from(hit.primitive as usize >= walls)]
            .push((surface.position, surface.normal));
    }
    positions
}

/// Light from the points alone on the triangles, from the triangles alone on the points, and all of
/// it on both.
#[test]
fn point_statue_and_triangle_room_exchange_light() {
    let light_source = [Light::Rect {
        center: Vec3::new(0.3, 1.9, 0.5),
        u: Vec3::X * 0.2,
        v: Vec3::Z * 0.2,
        radiance: Vec3::splat(25.0),
    }];
    let sum = |light: &[Vec3]| light.iter().sum::<Vec3>();
    for (name, walls, statue_factor, bounds) in [
        ("the statue reflects", 0.0, 1.0, [0.165, 0.215]),
        ("the walls reflect", 1.0, 0.0, [0.045, 0.215]),
        ("all reflects", 1.0, 1.0, [0.09, 0.215]),
    ] {
        let (mesh, count) = walls_and_statue(walls, statue_factor);
        let samples = visible_positions(&mesh, count, 900);
        let scene = baked(&mesh, Preset::Draft);
        let all: Vec<(Vec3, Vec3)> = samples.concat();
        let truth = reference(&mesh, &light_source, &all, 64);
        let (_, found) = evaluate_bake(
            &scene,
            mesh,
            &light_source,
            &all,
            Bounces::Count(REFLECTIONS),
        );
        let cut = samples[0].len();
        for (part, from, to, bound) in [
            ("walls", 0, cut, bounds[0]),
            ("statue", cut, all.len(), bounds[1]),
        ] {
            let truth = [0, 1].map(|k| truth[k][from..to].to_vec());
            let found = &found[from..to];
            let error = nrmse(found, &truth, indirect);
            let own: Vec<Vec3> = truth[0].iter().map(indirect).collect();
            println!(
                "{name}: on the {part} ({} positions) NRMSE {error:.4}, sum {:.1}, reference {:.1}",
                to - from,
                sum(found),
                sum(&own)
            );
            assert!(error < bound, "{name}, {part}: {error}");
            // Must fail: the same light at wrong positions.
            let reversed: Vec<Vec3> = found.iter().rev().copied().collect();
            assert!(nrmse(&reversed, &truth, indirect) > 0.25, "{name}, {part}");
        }
    }
}
