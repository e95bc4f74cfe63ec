//! Point clouds as scanners and broken files produce them, baked by links and by the octree of
//! method `fmm`. In a closed room each cloud has the light of the closed form.

use super::support::{baked, irradiances, lit, mesh, room, small};
use glam::{Vec2, Vec3};
use meshless_gi::internals::samples::{Random, scatter, uniform_sphere};
use meshless_gi::internals::scene::{PlyPoints, PointsError};
use meshless_gi::{
    CpuFrame, FrameLight, FrameSettings, Material, PointCloud, Recipe, TransportMethod,
    TriangleMesh,
};

/// A closed room of 2 m that reflects a half, as points.
fn points() -> PlyPoints {
    let walls = mesh(
        room(Vec3::ZERO, Vec3::splat(2.0)),
        Material::diffuse(Vec3::splat(0.5)),
    );
    scatter(&walls, 0.08, 1).expect("points")
}

fn cloud(points: PlyPoints) -> TriangleMesh {
    PointCloud::new(points, &[]).expect("a cloud").mesh().0
}

fn by(rule: TransportMethod) -> Recipe {
    Recipe {
        transport: rule,
        ..small()
    }
}

/// Bakes by both methods, and tests every number and the light of the room.
fn closed_form(name: &str, mesh: &TriangleMesh, scale: f32, max: f32) {
    for rule in [TransportMethod::Bounded, TransportMethod::fmm()] {
        let recipe = Recipe {
            coarse_radius: Some(0.3 * scale),
            ..by(rule)
        };
        let scene = baked(mesh, &recipe).scene;
        assert_eq!(scene.data().fmm.is_some(), rule == TransportMethod::fmm());
        let (one, eight) = lit(&scene, scale);
        eprintln!("{name}, {rule:?}: {one:.4} of one reflection, {eight:.4} of eight");
        assert!((one - 1.0).abs() < max, "{name}, {rule:?}: {one}");
        // Σ over eight: (1 − 2⁻⁸) / (1 − ½).
        assert!(
            (eight / 1.992 - 1.0).abs() < max,
            "{name}, {rule:?}: {eight}"
        );
    }
}

#[test]
fn point_room_matches_closed_form_at_any_scale() {
    let right = points();
    for scale in [1e-4f32, 1e4] {
        let mut scaled = right.clone();
        scaled.positions.iter_mut().for_each(|x| *x *= scale);
        closed_form(
            &format!("a room of {} m", 2.0 * scale),
            &cloud(scaled),
            scale,
            0.03,
        );
    }
}

#[test]
fn duplicate_points_and_zero_normals_change_little() {
    let right = points();
    let mesh = cloud(right.clone());
    // Each point five times over: bit by bit the same scene.
    let five = |of: &[Vec3]| of.iter().flat_map(|v| [*v; 5]).collect::<Vec<_>>();
    let copies = PlyPoints {
        positions: five(&right.positions),
        normals: right.normals.as_deref().map(five),
        albedo: right.albedo.as_deref().map(five),
        ..PlyPoints::default()
    };
    let copies = PointCloud::new(copies, &[]).expect("a cloud");
    assert_eq!(copies.problems.coincident, 4 * right.positions.len() as u64);
    assert_eq!(copies.mesh().0.content_hash(), mesh.content_hash());
    // A third of the normals has no length.
    let mut some = right.clone();
    let normals = some.normals.as_mut().expect("normals");
    normals.iter_mut().step_by(3).for_each(|n| *n = Vec3::ZERO);
    // Near creases estimated normals are those of either wall: some cells there let light out.
    closed_form("a third without normals", &cloud(some), 1.0, 0.1);
    let mut none = right;
    let normals = none.normals.as_mut().expect("normals");
    normals.fill(Vec3::ZERO);
    closed_form("no normals", &cloud(none), 1.0, 0.1);
}

/// A stationary scanner: ten times as many points as the room has, within a tenth of a millimeter,
/// with all orientations.
#[test]
fn dense_point_spot_changes_room_little() {
    let mut all = points();
    let at = Vec3::new(1.3, 0.0, 0.7);
    for i in 0..30_000 {
        let mut r = Random::new(5, 6, i);
        let off = Vec3::new(r.unit(), r.unit(), r.unit());
        all.positions.push(at + 1e-4 * off);
        let normal = uniform_sphere(Vec2::new(r.unit(), r.unit()));
        all.normals.as_mut().expect("normals").push(normal);
        all.albedo.as_mut().expect("colors").push(Vec3::splat(0.5));
    }
    closed_form("a spot", &cloud(all), 1.0, 0.05);
}

#[test]
fn coplanar_points_exchange_no_light() {
    let flat = PlyPoints {
        positions: (0..4000u64)
            .map(|i| {
                let mut r = Random::new(7, 7, i);
                Vec3::new(2.0 * r.unit(), 0.0, 2.0 * r.unit())
            })
            .collect(),
        normals: Some(vec![Vec3::Y; 4000]),
        ..PlyPoints::default()
    };
    let mesh = cloud(flat);
    for rule in [TransportMethod::Bounded, TransportMethod::fmm()] {
        let scene = baked(&mesh, &by(rule)).scene;
        let mut frame = CpuFrame::new(&scene);
        let light_source = FrameLight::point(Vec3::new(0.9, 1.1, 1.2), Vec3::ONE, f32::INFINITY);
        frame.set_lights(&scene, &[light_source]);
        frame.solve(&scene, &FrameSettings::bounces(8));
        let dark = irradiances(&frame, &scene);
        let max = dark
            .iter()
            .map(|e| e.abs().max_element())
            .fold(0.0, f32::max);
        eprintln!("a plane, {rule:?}: at most {max:e}");
        assert!(max < 1e-6, "{rule:?}: {max}");
        // It sends light.
        assert!(frame.senders().iter().flatten().any(|c| *c > 0.01));
    }
}

#[test]
fn too_few_points_are_rejected() {
    for count in 0..3 {
        let few = PlyPoints {
            positions: points().positions[..count].to_vec(),
            ..PlyPoints::default()
        };
        let error = PointCloud::new(few, &[]).expect_err("no surface");
        assert!(matches!(error, PointsError::TooFew { usable, .. } if usable == count as u64));
    }
}
