//! Parallel surfaces close to each other: a board in front of a wall, and the gap between them.

use super::support::{baked, mesh, room, small, square};
use glam::Vec3;
use meshless_gi::{
    Bounces, Evaluator, Light, Material, Recipe, ReferenceSettings, TriangleMesh,
    internals::eval::irradiance_at_all,
};
use meshless_gi_lab::accuracy::errors;

/// Distance of the board from the wall, and its thickness, meters.
const GAP: f32 = 0.04;
const THICKNESS: f32 = 0.02;

/// A room of 2 m with a board of 1 m in front of the wall at z = 0.
fn board_before_wall() -> TriangleMesh {
    let mut triangles = room(Vec3::ZERO, Vec3::splat(2.0));
    let corner = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
    let (back, front) = (GAP, GAP + THICKNESS);
    for (a, u, v) in [
        (corner(0.5, 0.5, front), Vec3::X, Vec3::Y),
        (corner(0.5, 0.5, back), Vec3::Y, Vec3::X),
        (corner(0.5, 0.5, back), Vec3::X, Vec3::Z * THICKNESS),
        (corner(0.5, 1.5, back), Vec3::Z * THICKNESS, Vec3::X),
        (corner(0.5, 0.5, back), Vec3::Z * THICKNESS, Vec3::Y),
        (corner(1.5, 0.5, back), Vec3::Y, Vec3::Z * THICKNESS),
    ] {
        triangles.extend(square(a, u, v));
    }
    mesh(triangles, Material::diffuse(Vec3::splat(0.5)))
}

/// Positions on a grid over the middle half of the board's width, at height `z`.
fn grid(z: f32) -> Vec<(Vec3, Vec3)> {
    let at = |k: usize| 0.75 + 0.1 * k as f32;
    (0..36)
        .map(|k| (Vec3::new(at(k % 6), at(k / 6), z), Vec3::Z))
        .collect()
}

/// Light in the gap relative to the light on the board, in the bake and in the reference, and the
/// NRMSE on the board.
fn measure(mesh: &TriangleMesh, clip_planes: bool) -> ([f32; 2], f64) {
    let recipe = Recipe {
        clip_planes: Some(clip_planes),
        ..small()
    };
    let scene = baked(mesh, &recipe).scene;
    let light = [Light::Point {
        position: Vec3::new(1.1, 1.2, 1.5),
        intensity: Vec3::splat(5.0),
        range: f32::INFINITY,
    }];
    let ours = Evaluator::new(&scene, &[], &light, Bounces::Count(4));
    let of = |positions: &[(Vec3, Vec3)]| -> Vec<Vec3> {
        let at = |(k, &(x, n)): (u64, &(Vec3, Vec3))| ours.at(x, n, k).indirect.unwrap_or_default();
        (0..).zip(positions).map(at).collect()
    };
    let mean = |list: &[Vec3]| list.iter().sum::<Vec3>().x / list.len() as f32;
    let (front, gap) = (grid(GAP + THICKNESS), grid(0.0));
    let settings = ReferenceSettings {
        paths: 2048,
        bounces: Some(4),
        seed: 3,
    };
    let truth = |positions: &[(Vec3, Vec3)]| irradiance_at_all(mesh, &light, positions, &settings);
    let (right, noise): (Vec<Vec3>, Vec<Vec3>) = truth(&front)
        .iter()
        .map(|e| (e.indirect, e.indirect_error))
        .unzip();
    let dark: Vec<Vec3> = truth(&gap).iter().map(|e| e.indirect).collect();
    let values = of(&front);
    let nrmse = errors(&values, &right, &noise).raw_nrmse;
    let ratios = [mean(&of(&gap)) / mean(&values), mean(&dark) / mean(&right)];
    println!(
        "clip planes {clip_planes}: gap {ratios:.4?}, board {:.2} %",
        100.0 * nrmse
    );
    (ratios, nrmse)
}

#[test]
fn board_before_wall_has_no_light_of_gap() {
    let mesh = board_before_wall();
    let ([gap, right], nrmse) = measure(&mesh, true);
    assert!(right < 0.01, "{right}");
    assert!(gap < 0.08, "{gap}");
    assert!(nrmse < 0.02, "{nrmse}");
    let (_, without) = measure(&mesh, false);
    assert!(without > 0.03, "{without}");
}
