//! What the cases share: rooms, quick bakes, and the look at every number of what came out.

use bevy_meshless_gi::asset::{BakedScene, Limits};
use bevy_meshless_gi::bake::{Baked, Preset, Progress, Recipe, bake_level};
use bevy_meshless_gi::frame::{CpuFrame, FrameLight, FrameSettings, VectorIrradiance};
use bevy_meshless_gi::scene::{Geometry, Material, TriangleMesh, cornell_box, mesh_of_quads};
use glam::Vec3;
use std::f32::consts::PI;

/// Three corners a triangle, metres.
pub type Triangles = Vec<[Vec3; 3]>;

/// A bake of a second: draft, on three levels, for what is about the laws of light and not about detail.
pub fn quick() -> Recipe {
    Recipe {
        preset: Preset::Draft,
        levels: Some(3),
        sender_levels: Some(2),
        extra_levels: Some(0),
        rays: Some(64),
        places: Some(4),
        // What the bake's own estimate traces; frames say for themselves how many they want.
        bounces: Some(1),
        ..Recipe::default()
    }
}

/// As [`quick`], with points 0.3 m apart at first, for rooms of two metres.
pub fn small() -> Recipe {
    Recipe {
        coarse_radius: Some(0.3),
        ..quick()
    }
}

/// Bakes, and looks at everything.
pub fn baked(mesh: &TriangleMesh, recipe: &Recipe) -> Baked {
    let baked = bake_level(mesh, recipe, 2, &Progress::default()).expect("a bake");
    sound(&baked.scene);
    let stats = &baked.stats;
    let energy = stats.energy;
    assert_eq!(energy, baked.scene.info.energy);
    for number in [
        stats.estimated_nrmse,
        stats.estimated_nrmse_interval,
        stats.uncovered,
        stats.largest_row_sum,
        stats.link_error,
        energy.gain.into(),
        energy.gain_found.into(),
        energy.guard_factor.into(),
        energy.row_deviation.into(),
        energy.row_deviation_rms.into(),
        energy.reciprocity.into(),
    ] {
        assert!(number.is_finite() && number >= 0.0, "{stats:?}");
    }
    assert!(energy.gain < 1.0, "{energy:?}");
    baked
}

/// No number of a baked scene is not one, and it comes back from its bytes.
pub fn sound(scene: &BakedScene) {
    scene.validate().expect("a valid scene");
    let mut numbers: Vec<f32> = Vec::new();
    for p in &scene.points {
        numbers.extend(p.position.iter().chain(&p.normal).chain([&p.radius]));
    }
    for s in &scene.surfaces {
        numbers.extend(s.albedo.iter().chain(&s.emission).chain(&s.sky));
    }
    for p in &scene.places.list {
        numbers.extend(p.x().to_array().iter().chain(&p.n().to_array()));
    }
    let weights = scene.pull.entries.iter().chain(&scene.parents.entries);
    numbers.extend(weights.map(|w| w.weight));
    numbers.extend(scene.operator.rows.iter().map(|r| r.scale));
    for link in &scene.operator.links {
        numbers.extend(link.vector().to_array());
    }
    if let Some(octree) = &scene.fmm {
        for p in &octree.places {
            numbers.extend(p.position.iter().chain(&p.normal).chain(&p.sky));
            numbers.extend([p.share, p.factor]);
        }
        for node in &octree.nodes {
            numbers.extend(node.center.iter().chain([&node.size]));
        }
        numbers.extend(octree.entries.iter().map(|entry| entry.weight));
    }
    if let Some(bounces) = &scene.bounces {
        numbers.extend(bounces.links.iter().flat_map(|l| l.gain));
    }
    numbers.extend(scene.display.planes.iter().flatten());
    for node in &scene.bvh.nodes {
        numbers.extend(node.min.iter().chain(&node.max));
    }
    for t in &scene.bvh.triangles {
        numbers.extend([t.a, t.b, t.c].iter().flatten());
    }
    let wrong = numbers.iter().filter(|v| !v.is_finite()).count();
    assert_eq!(wrong, 0, "of {} numbers", numbers.len());
    let bytes = scene.to_bytes().expect("bytes");
    let back = BakedScene::from_bytes(&bytes, &Limits::default()).expect("a scene");
    assert_eq!(back.info, scene.info);
}

/// No number of a frame is not one. Returns the irradiance at each of the points, W/m².
pub fn irradiances(frame: &CpuFrame, scene: &BakedScene) -> Vec<Vec3> {
    let finite = |v: &VectorIrradiance| [v.x, v.y, v.z].iter().flatten().all(|c| c.is_finite());
    assert!(frame.values().iter().all(finite));
    assert!(frame.senders().iter().flatten().all(|c| c.is_finite()));
    let pairs = frame.values().iter().zip(&scene.points);
    pairs.map(|(e, p)| e.dot(p.n())).collect()
}

/// Mean over the points of the level that covers everything evenly.
pub fn mean(values: &[Vec3], scene: &BakedScene) -> Vec3 {
    let even = scene.level(scene.levels() - 1);
    values[even.clone()].iter().sum::<Vec3>() / even.len() as f32
}

/// The light of a lamp in the middle of a room of 2 m times `scale` that reflects half of it: one reflection's mean over ρ Φ / A, and the mean of eight.
pub fn lit(scene: &BakedScene, scale: f32) -> (f32, f32) {
    let place = scale * Vec3::new(0.9, 1.1, 1.2);
    let lamp = FrameLight::point(place, Vec3::splat(scale * scale), f32::INFINITY);
    let mut frame = CpuFrame::new(scene);
    frame.set_lights(scene, &[lamp]);
    let mut after = |bounces: u32| {
        frame.solve(scene, &FrameSettings::bounces(bounces));
        mean(&irradiances(&frame, scene), scene).x / (0.5 * 4.0 * PI / 24.0)
    };
    (after(1), after(8))
}

/// A box, its faces towards the inside.
pub fn room(min: Vec3, size: Vec3) -> Triangles {
    let (x, y, z) = (Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z);
    let mut out = Vec::new();
    for (a, u, v) in [
        (min, z, x),
        (min + y, x, z),
        (min, x, y),
        (min + z, y, x),
        (min, y, z),
        (min + x, z, y),
    ] {
        out.extend(square(a, u, v));
    }
    out
}

/// Two triangles that face u × v.
pub fn square(a: Vec3, u: Vec3, v: Vec3) -> Triangles {
    vec![[a, a + u, a + u + v], [a, a + u + v, a + v]]
}

/// Triangles of one material.
pub fn mesh(triangles: Triangles, material: Material) -> TriangleMesh {
    let count = triangles.len();
    TriangleMesh::new(triangles, vec![0; count], vec![material])
}

/// A closed room of 2 m.
pub fn closed(material: Material) -> TriangleMesh {
    mesh(room(Vec3::ZERO, Vec3::splat(2.0)), material)
}

/// The Cornell box, scaled about the origin and then moved.
pub fn cornell(scale: f32, by: Vec3) -> TriangleMesh {
    let mut quads = cornell_box();
    for corner in quads.iter_mut().flat_map(|q| &mut q.corners) {
        *corner = scale * *corner + by;
    }
    mesh_of_quads(&quads)
}

/// Places on the surfaces of the Cornell box of 2 m, inside of it, and their normals.
pub fn cornell_places() -> Vec<(Vec3, Vec3)> {
    use bevy_meshless_gi::samples::trace_particles;
    let level = cornell(1.0, Vec3::ZERO);
    let inside = |p: Vec3| level.bounds().min.cmple(p).all() && level.bounds().max.cmpge(p).all();
    let traced = trace_particles(&level, &[Vec3::new(0.0, 1.6, 0.6)], 0..128, 3, false);
    let surfaces = traced.candidates.iter().map(|c| &c.surface);
    let places = surfaces.filter(|s| inside(s.position));
    places.map(|s| (s.position, s.normal)).step_by(3).collect()
}
