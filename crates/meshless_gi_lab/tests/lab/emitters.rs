//! Light of a small emissive sign on walls five meters away, at preset `Draft`, against its closed
//! form: a sign that emits on one side, and a sheet that emits on both.

use glam::Vec3;
use meshless_gi::{
    BakedScene, CpuFrame, FrameSettings, Geometry, Material, Preset, Progress, Recipe,
    TriangleMesh, bake_scene,
};
use meshless_gi_lab::accuracy::{closed_form::polygon, errors};

/// Distance from the sign to both walls, meters.
const DISTANCE: f32 = 5.0;
/// Emitted radiance, W/(m² sr).
const RADIANCE: Vec3 = Vec3::new(50.0, 30.0, 10.0);
/// Corners of the sign, counterclockwise as viewed from the wall at z = 5 m.
const SIGN: [Vec3; 4] = [
    Vec3::new(-0.15, 1.45, 0.0),
    Vec3::new(0.15, 1.45, 0.0),
    Vec3::new(0.15, 1.55, 0.0),
    Vec3::new(-0.15, 1.55, 0.0),
];

/// Two black walls of 4 x 3 m that face each other, and the sign in the middle between them.
fn sign_between_walls(is_double_sided: bool) -> TriangleMesh {
    let wall = |x: f32, z: f32| {
        [(-x, 0.0), (x, 0.0), (x, 3.0), (-x, 3.0)].map(|(x, y)| Vec3::new(x, y, z))
    };
    let mut triangles = Vec::new();
    for [a, b, c, d] in [wall(2.0, -DISTANCE), wall(-2.0, DISTANCE), SIGN] {
        triangles.extend([[a, b, c], [a, c, d]]);
    }
    let sign = Material {
        double_sided: is_double_sided,
        ..Material::emissive(Vec3::ZERO, RADIANCE)
    };
    let black = Material::diffuse(Vec3::ZERO);
    TriangleMesh::new(triangles, vec![0, 0, 0, 0, 1, 1], vec![black, sign])
}

fn bake(mesh: &TriangleMesh) -> BakedScene {
    let recipe = Recipe {
        preset: Preset::Draft,
        viewpoints: vec![[0.5, 1.5, 2.5], [0.5, 1.5, -2.5]],
        ..Recipe::default()
    };
    bake_scene(mesh, &recipe, 0, &Progress::default())
        .expect("a bake")
        .scene
}

/// Irradiance of the bake and the closed form at positions of the wall at `z`.
fn irradiances(scene: &BakedScene, z: f32) -> [Vec<Vec3>; 2] {
    let mut frame = CpuFrame::new(scene);
    frame.solve(scene, &FrameSettings::default());
    let n = Vec3::new(0.0, 0.0, -z.signum());
    let corners = SIGN.map(Vec3::as_dvec3);
    let mut out = [Vec::new(), Vec::new()];
    for k in 0..16 * 12 {
        let (i, j) = ((k % 16) as f32, (k / 16) as f32);
        let x = Vec3::new(-1.9 + i * 3.8 / 15.0, 0.1 + j * 2.8 / 11.0, z);
        out[0].push(frame.irradiance(scene, x, n).unwrap_or_default());
        let e = polygon(x.as_dvec3(), n.as_dvec3(), &corners, 1.0);
        out[1].push(e.abs() as f32 * RADIANCE);
    }
    out
}

fn nrmse(values: &[Vec3], right: &[Vec3]) -> f64 {
    errors(values, right, &vec![Vec3::ZERO; right.len()]).nrmse
}

#[test]
fn double_sided_sign_lights_both_walls() {
    let mesh = sign_between_walls(true);
    let mut scene = bake(&mesh);
    for z in [-DISTANCE, DISTANCE] {
        let [values, right] = irradiances(&scene, z);
        let error = nrmse(&values, &right);
        println!("double-sided, wall at {z} m: NRMSE {error:.4}");
        assert!(error <= 0.05, "wall at {z} m: {error}");
    }
    // Fails if a sender on the sign emits a tenth less.
    for surface in &mut scene.data_mut().surfaces {
        surface.emission = surface.emission.map(|e| 0.9 * e);
    }
    let [values, right] = irradiances(&scene, DISTANCE);
    assert!(nrmse(&values, &right) > 0.05);
}

#[test]
fn one_sided_sign_lights_wall_before_it() {
    let mesh = sign_between_walls(false);
    let scene = bake(&mesh);
    let [values, right] = irradiances(&scene, DISTANCE);
    let error = nrmse(&values, &right);
    println!("one-sided: NRMSE {error:.4}");
    assert!(error <= 0.05, "{error}");
    let [behind, _] = irradiances(&scene, -DISTANCE);
    assert!(
        behind.iter().all(|e| *e == Vec3::ZERO),
        "light behind the sign"
    );
}

/// The senders on the sign are its own: none of them emits a mean of the sign and another surface.
#[test]
fn senders_on_emitter_have_its_emission() {
    let mesh = sign_between_walls(true);
    let scene = bake(&mesh);
    let emission = std::f32::consts::PI * RADIANCE;
    let emissions = scene.data().surfaces.iter().map(|s| Vec3::from(s.emission));
    let emissive: Vec<Vec3> = emissions.filter(|e| *e != Vec3::ZERO).collect();
    assert!(!emissive.is_empty() && mesh.emitters().is_some());
    for e in emissive {
        assert!(e.abs_diff_eq(emission, 1e-3 * emission.x), "{e}");
    }
}
