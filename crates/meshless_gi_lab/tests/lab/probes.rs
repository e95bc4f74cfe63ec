//! Light between surfaces: a ball that moves through a scene, compared with the reference
//! integrator. Also sealed rooms, closed forms and the file.

use glam::{Mat4, Vec2, Vec3};
use meshless_gi::internals::asset::Probes;
use meshless_gi::internals::eval::irradiance_at_all;
use meshless_gi::internals::frame::probe::probe;
use meshless_gi::internals::frame::splat::{FULL_COVER, splat_covered};
use meshless_gi::internals::frame::volume::volume_texels;
use meshless_gi::internals::frame::volume_sample::read_volume;
use meshless_gi::internals::frame::{
    VectorIrradiance, VolumeParams, VolumeValues, VoxelGrid, VoxelWeights, voxels_of,
};
use meshless_gi::internals::samples::{Random, lattice, trace_particles, uniform_sphere};
use meshless_gi::{
    BakedScene, Bounces, CpuFrame, Evaluator, FrameLight, FrameSettings, Light, Limits, Material,
    Preset, ProbeSettings, Progress, Quad, Recipe, RecipeError, ReferenceSettings, TransportMethod,
    TriangleMesh, bake_scene,
};
use meshless_gi_lab::accuracy::{BOUNCES, Errors, errors};
use meshless_gi_lab::fixtures::data::open_rooms;
use std::f32::consts::PI;
use std::sync::LazyLock;

fn baked(mesh: &TriangleMesh, recipe: Recipe) -> BakedScene {
    bake_scene(mesh, &recipe, 0, &Progress::default())
        .unwrap()
        .scene
}

/// `rooms_open` and its bake.
static OPEN_ROOMS: LazyLock<(TriangleMesh, BakedScene)> = LazyLock::new(|| {
    let (mesh, _) = open_rooms();
    let scene = baked(&mesh, draft());
    (mesh, scene)
});

/// Bake of two rooms side by side, with a wall of two centimeters between them.
static TWO_CLOSED_ROOMS: LazyLock<BakedScene> =
    LazyLock::new(|| baked(&closed_rooms(0.02), draft()));

/// Size of each of two closed rooms, meters.
const ROOM: Vec3 = Vec3::new(3.0, 2.5, 3.0);

/// Two closed rooms side by side, `gap` meters apart.
fn closed_rooms(gap: f32) -> TriangleMesh {
    let low = Vec3::X * (ROOM.x + gap);
    let mut quads = room(Vec3::ZERO, ROOM, 0.7, |_| false);
    quads.extend(room(low, low + ROOM, 0.7, |_| false));
    TriangleMesh::from_quads(&quads)
}

fn draft() -> Recipe {
    Recipe {
        preset: Preset::Draft,
        probes: Some(ProbeSettings::default()),
        ..Recipe::default()
    }
}

/// Positions on spheres of `radius` around `centers`, with their outward normals.
fn balls(centers: &[Vec3], radius: f32, each: u32) -> Vec<(Vec3, Vec3)> {
    centers
        .iter()
        .enumerate()
        .flat_map(|(i, &c)| {
            (0..each).map(move |k| {
                let shift = Vec2::new(i as f32 * 0.618, i as f32 * 0.755).fract();
                let n = uniform_sphere(lattice(k, each, shift)).normalize();
                (c + radius * n, n)
            })
        })
        .collect()
}

/// Compares the indirect light of `lights` at `positions` with the reference after four
/// reflections.
fn compare(
    scene: &BakedScene,
    mesh: &TriangleMesh,
    lights: &[Light],
    positions: &[(Vec3, Vec3)],
) -> (Errors, usize) {
    let meshes = std::slice::from_ref(mesh);
    let ours = Evaluator::new(scene, meshes, lights, Bounces::Count(4));
    let settings = ReferenceSettings {
        paths: 8192,
        bounces: BOUNCES[2],
        seed: 17,
    };
    assert_eq!(settings.bounces, Some(4));
    let right = irradiance_at_all(mesh, lights, positions, &settings);
    let found: Vec<Option<Vec3>> = positions
        .iter()
        .map(|&(x, n)| ours.probe_irradiance(x, n))
        .collect();
    let missing = found.iter().filter(|e| e.is_none()).count();
    let values: Vec<Vec3> = found.iter().map(|e| e.unwrap_or(Vec3::ZERO)).collect();
    let (right, noise): (Vec<Vec3>, Vec<Vec3>) =
        right.iter().map(|e| (e.indirect, e.indirect_error)).unzip();
    (errors(&values, &right, &noise), missing)
}

/// Path from the far corner of one room of `rooms_open` through the door, up and down, to the far
/// corner of the other.
fn through_two_rooms() -> Vec<Vec3> {
    (0..100)
        .map(|k| {
            let t = k as f32 / 99.0;
            let door = (-((t - 0.5) * 9.0).powi(2)).exp();
            let z = 0.5 + 3.0 * (0.5 + 0.5 * (t * 21.0).sin());
            let y = 0.4 + 1.8 * (0.5 + 0.5 * (t * 33.0).sin());
            Vec3::new(0.4 + 7.2 * t, y + door * (1.0 - y), z + door * (1.95 - z))
        })
        .collect()
}

#[test]
fn moving_ball_through_two_rooms_matches_reference() {
    let (mesh, scene) = &*OPEN_ROOMS;
    let (_, lights) = open_rooms();
    let centers = through_two_rooms();
    let positions = balls(&centers, 0.15, 8);
    let (found, missing) = compare(scene, mesh, &lights, &positions);
    let probes = scene.data().probes.as_ref().unwrap();
    println!(
        "{} probes, {} links, {} kB: {found:?}",
        probes.points.len(),
        probes.links.len(),
        probes.bytes() / 1024
    );
    assert_eq!(missing, 0);
    assert!(found.nrmse <= 0.10, "{found:?}");
    // Must fail: light from another position.
    let moved: Vec<Light> = lights
        .iter()
        .map(|light| match *light {
            Light::Point {
                position,
                intensity,
                range,
            } => Light::Point {
                position: position + Vec3::X,
                intensity,
                range,
            },
            other => other,
        })
        .collect();
    let meshes = std::slice::from_ref(mesh);
    let wrong = Evaluator::new(scene, meshes, &moved, Bounces::Count(4));
    let right = Evaluator::new(scene, meshes, &lights, Bounces::Count(4));
    let value = |e: &Evaluator<'_>| -> Vec<Vec3> {
        let at = |&(x, n): &(Vec3, Vec3)| e.probe_irradiance(x, n).unwrap();
        positions.iter().map(at).collect()
    };
    let none = vec![Vec3::ZERO; positions.len()];
    assert!(errors(&value(&wrong), &value(&right), &none).nrmse > 0.15);
}

/// `rooms_open` with its opening walled up: a ball on the same path gets no light of the lit room
/// in the other room.
#[test]
fn ball_in_sealed_room_stays_dark() {
    let (open, with_opening) = &*OPEN_ROOMS;
    let (_, lights) = open_rooms();
    let corner = |x| Vec3::new(x, 0.0, 1.5);
    let (up, across) = (2.0 * Vec3::Y, 0.9 * Vec3::Z);
    let mut triangles = Vec::new();
    let mut materials = Vec::new();
    for i in 0..open.len() {
        triangles.push(open.triangle(i).unwrap());
        materials.push(open.material(i).unwrap().clone());
    }
    for (a, u, v) in [(corner(4.0), across, up), (corner(4.02), up, across)] {
        triangles.extend([[a, a + u, a + u + v], [a, a + u + v, a + v]]);
        materials.extend([(); 2].map(|()| Material::diffuse(Vec3::splat(0.7))));
    }
    let sealed = TriangleMesh::new(triangles, (0..materials.len() as u32).collect(), materials);
    let recipe = Recipe {
        viewpoints: vec![[2.0, 1.4, 2.0], [6.0, 1.4, 2.0]],
        ..draft()
    };
    let light = |mesh: &TriangleMesh, scene: &BakedScene| {
        let meshes = std::slice::from_ref(mesh);
        let ours = Evaluator::new(scene, meshes, &lights, Bounces::Count(4));
        let (mut lit, mut dark) = (Vec::new(), Vec::new());
        for center in through_two_rooms() {
            for (x, n) in balls(&[center], 0.15, 8) {
                // Nothing lies in the wall.
                if (3.99..4.03).contains(&x.x) {
                    continue;
                }
                let side = if x.x < 4.0 { &mut lit } else { &mut dark };
                side.push(
                    ours.probe_irradiance(x, n)
                        .expect("a probe reaches")
                        .element_sum(),
                );
            }
        }
        let mean = |v: &[f32]| v.iter().sum::<f32>() / v.len() as f32;
        let max = dark.iter().fold(0.0f32, |a, &b| a.max(b));
        (mean(&lit), mean(&dark), max)
    };
    let (lit, dark, max) = light(&sealed, &baked(&sealed, recipe));
    let (_, through, _) = light(open, with_opening);
    println!(
        "sealed: {:.1e} of what comes through the opening, at most {:.1e} of the lit room's",
        dark / through,
        max / lit
    );
    assert!(lit > 0.0 && through > 0.01 * lit, "{through} and {lit}");
    assert!(max <= 1e-4 * lit, "{max} of {lit}");
}

/// Returns the six walls of a room, visible from the inside. Walls (0 to 5) that `shines` selects
/// emit 1 W/m² and reflect nothing.
fn room(low: Vec3, high: Vec3, albedo: f32, shines: impl Fn(usize) -> bool) -> Vec<Quad> {
    let size = high - low;
    let axes = [Vec3::X, Vec3::Y, Vec3::Z];
    (0..6)
        .map(|k| {
            let along = k / 2;
            let (u, v) = (axes[(along + 1) % 3] * size, axes[(along + 2) % 3] * size);
            let (origin, u, v) = match k % 2 {
                0 => (low, u, v),
                _ => (low + axes[along] * size, v, u),
            };
            let mut material = Material::diffuse(Vec3::splat(albedo));
            if shines(k) {
                material = Material::diffuse(Vec3::ZERO);
                material.emissive = Vec3::ONE;
            }
            Quad {
                corners: [origin, origin + u, origin + u + v, origin + v],
                material,
            }
        })
        .collect()
}

/// Solves a frame of `scene` under `lights`, with emission and a uniform sky of radiance `sky`,
/// W/(m² sr).
fn solved(scene: &BakedScene, lights: &[FrameLight], sky: f32, sweeps: u32) -> CpuFrame {
    let mut frame = CpuFrame::new(scene);
    frame.set_lights(scene, lights);
    let settings = FrameSettings {
        sky: Vec3::splat(sky).into(),
        emission: 1.0,
        ..FrameSettings::bounces(sweeps)
    };
    frame.solve(scene, &settings);
    frame
}

#[test]
fn probes_behind_wall_of_any_thickness_stay_dark() {
    let touching = baked(&closed_rooms(0.0), draft());
    for (gap, scene) in [(0.02, &*TWO_CLOSED_ROOMS), (0.0, &touching)] {
        let light_source = Light::Point {
            position: Vec3::new(1.5, 2.0, 1.5),
            intensity: Vec3::ONE,
            range: f32::INFINITY,
        };
        let frame = solved(scene, &FrameLight::expand(&light_source, 1), 0.0, 4);
        let mut random = Random::new(1, 0, 0);
        let (mut lit, mut dark) = (0.0f32, 0.0f32);
        for _ in 0..2000 {
            let mut unit = || 0.01 + 0.98 * random.unit();
            let x = Vec3::new(3.0 * unit(), 2.5 * unit(), 3.0 * unit());
            let at = |x| {
                let light = frame
                    .probe_irradiance(scene, x, Vec3::ZERO)
                    .expect("a probe reaches");
                light.irradiance(Vec3::Y).x + light.irradiance(Vec3::NEG_X).x
            };
            lit += at(x);
            dark = dark.max(at(x + Vec3::X * (3.0 + gap)));
        }
        lit /= 2000.0;
        println!(
            "wall of {gap} m: largest of the dark room over the lit one's mean: {}",
            dark / lit
        );
        assert!(lit > 0.1 && dark <= 1e-4 * lit, "{gap}: {dark} of {lit}");
    }
}

/// Behind a wall of two centimeters a volume is black for any voxel size. On the lit walls and in
/// the air it equals the probes, or the display of the walls. The scene is also tested turned.
#[test]
fn volumes_match_room_and_stay_dark_behind_walls() {
    let scene = &*TWO_CLOSED_ROOMS;
    let light_source = Light::Point {
        position: Vec3::new(1.5, 2.0, 1.5),
        intensity: Vec3::ONE,
        range: f32::INFINITY,
    };
    let frame = solved(scene, &FrameLight::expand(&light_source, 1), 0.0, 4);
    let [from, to] = scene.info().bounds.map(Vec3::from);
    let values = VolumeValues {
        points: frame.vector_irradiance(),
        probes: frame.probes(),
    };
    let leaning = Mat4::from_euler(glam::EulerRot::XYZ, 0.5, 0.8, 0.3);
    let turns = [
        ("as it stands", Mat4::IDENTITY, 0.12),
        ("turned upright", Mat4::from_rotation_y(0.6), 0.12),
        ("leaning", leaning, 0.08),
        ("coarse", Mat4::IDENTITY, 0.19),
    ];
    for (how, turn, edge) in turns {
        let (from, to) = (from - edge, to + edge);
        let voxels = voxels_of(to - from, edge, u32::MAX);
        let shape = VoxelGrid::new([from, to], voxels).unwrap();
        let weights = VoxelWeights::from_scene(shape, scene.data());
        check_voxel_weights(&weights, scene, frame.probes());
        println!(
            "{} faces, {} shares, {} probe shares",
            weights.wall_samples().wall_samples.len(),
            weights.wall_samples().weights.len(),
            weights.weights().len()
        );
        let params = VolumeParams::new(&shape, &turn);
        let texels = volume_texels(&params, &weights, values);
        // Normals are in world space, positions in the space of the bake.
        let read = |x: Vec3, n: Vec3| {
            let at = (x - from) / shape.voxel();
            read_volume(
                params.size,
                &texels,
                at,
                turn.inverse().transform_vector3(n),
            )
        };
        let mut random = Random::new(2, 0, 0);
        let (mut on_walls, mut shown, mut behind) = (vec![], vec![], vec![]);
        let (mut in_air, mut said) = (vec![], vec![]);
        let mut dark = 0.0f32;
        for k in 0..3000 {
            let mut unit = || random.unit();
            let mut x = ROOM * Vec3::new(unit(), unit(), unit());
            let mut n = uniform_sphere(Vec2::new(unit(), unit()));
            // Every other position lies on one of the walls, and faces the room.
            let wall = k % 2 == 0;
            if wall {
                let (axis, far) = (k / 2 % 3, k / 6 % 2 == 1);
                x[axis] = if far { ROOM[axis] } else { 0.0 };
                n = Vec3::ZERO;
                n[axis] = if far { -1.0 } else { 1.0 };
            }
            let found = PI * read(x, n);
            let next_door = read(x + 3.02 * Vec3::X, n).max_element();
            dark = dark.max(next_door);
            if wall {
                on_walls.push(frame.irradiance(scene, x, n).expect("covered"));
                shown.push(found);
                behind.push(PI * read(x, -n));
            } else {
                in_air.push(
                    frame
                        .probe_irradiance(scene, x, n)
                        .expect("reached")
                        .irradiance(n),
                );
                said.push(found);
            }
        }
        let nrmse = |found: &[Vec3], right: &[Vec3]| {
            errors(found, right, &vec![Vec3::ZERO; right.len()]).nrmse
        };
        let (walls, air) = (nrmse(&shown, &on_walls), nrmse(&said, &in_air));
        let mean = said.iter().map(|e| e.x).sum::<f32>() / said.len() as f32;
        println!(
            "{voxels} voxels, {how}: NRMSE {walls:.3} on the walls, {air:.3} in the air, {dark} of {mean} in the dark room"
        );
        assert!(walls < 0.1 && air < 0.1, "{how}: {walls} {air}");
        assert!(dark <= 1e-4 * mean, "{how}: {dark} of {mean}");
        // The sides swapped.
        assert!(nrmse(&behind, &on_walls) > 0.15);
    }
}

/// Compares the light of each position from its shares with the lookup that they represent. The
/// shares are also computed in many calls and in one call.
fn check_voxel_weights(weights: &VoxelWeights, scene: &BakedScene, values: &[VectorIrradiance]) {
    let probes = scene.data().probes.as_ref().unwrap();
    let shape = weights.shape();
    let mut by_and_by = VoxelWeights::new(*shape);
    let mut calls = 1;
    while !by_and_by.find(scene.data(), 1) {
        calls += 1;
    }
    assert!(calls > 1 && by_and_by == *weights, "{calls} calls");
    let all = shape.voxels();
    let (mut found, mut right, mut aside) = (vec![], vec![], vec![]);
    for at in 0..all {
        let said = weights.light(values, at);
        let asked = probe(probes, values, shape.voxel_center(at), Vec3::ZERO);
        assert_eq!(said.is_some(), asked.is_some(), "voxel {at}");
        if let (Some(said), Some(asked)) = (said, asked) {
            for n in [Vec3::X, Vec3::Y, Vec3::Z, Vec3::ONE.normalize()] {
                found.push(said.irradiance(n));
                right.push(asked.irradiance(n));
                let other = weights.light(values, (at + 1) % all);
                aside.push(other.unwrap_or(said).irradiance(n));
            }
        }
    }
    assert!(
        found.len() as u32 > all,
        "{} of {all} voxels",
        found.len() / 4
    );
    let noise = vec![Vec3::ZERO; right.len()];
    let [off, other] = [&found, &aside].map(|e| errors(e, &right, &noise).nrmse);
    println!("shares against lookups: NRMSE {off:.6}; of the next voxel {other:.3}");
    assert!(off < 1e-3 && other > 1e-2, "{off} {other}");
}

#[test]
fn probes_match_closed_forms() {
    // A sky over a single quad, from above: half of all directions. E(n) of the upper hemisphere is
    // (1 + n.y) / 2 of all.
    let floor = Quad {
        corners: [[-9.0, -9.0], [-9.0, 9.0], [9.0, 9.0], [9.0, -9.0]]
            .map(|[x, z]| Vec3::new(x, 0.0, z)),
        material: Material::diffuse(Vec3::ZERO),
    };
    let recipe = Recipe {
        probes: Some(ProbeSettings {
            spacing: Some(1.0),
            rays_per_probe: Some(4096),
        }),
        viewpoints: vec![[0.0, 2.0, 0.0]],
        ..draft()
    };
    let open = TriangleMesh::from_quads(&[floor]);
    let scene = baked(&open, recipe.clone());
    let frame = solved(&scene, &[], 1.0, 1);
    for k in 0..40 {
        let n = uniform_sphere(lattice(k, 40, Vec2::ZERO)).normalize();
        let x = Vec3::new(0.3, 0.05, -0.2);
        let light = frame
            .probe_irradiance(&scene, x, Vec3::ZERO)
            .expect("a probe reaches");
        let right = std::f32::consts::PI * 0.5 * (1.0 + n.y);
        let found = light.irradiance(n).x;
        // Tolerance: the part that the floor hides at the probes' heights, and the part of a step
        // that two degrees leave.
        assert!(
            (found - right).abs() < 0.06 * std::f32::consts::PI,
            "{n}: {found} {right}"
        );
    }
    // A closed room that emits: E is π L for every normal and position. With one emitting wall E
    // follows from the wall's solid angle.
    for shines in [[true; 6], [false, false, true, false, false, false]] {
        let quads = room(Vec3::ZERO, Vec3::splat(2.0), 0.0, |k| shines[k]);
        let mesh = TriangleMesh::from_quads(&quads);
        // Between probes light is interpolated: a wall's falls by half within a meter.
        let recipe = Recipe {
            viewpoints: Vec::new(),
            probes: Some(ProbeSettings {
                spacing: Some(0.3),
                rays_per_probe: Some(2048),
            }),
            ..recipe.clone()
        };
        let scene = baked(&mesh, recipe);
        let frame = solved(&scene, &[], 0.0, 1);
        let mut random = Random::new(5, 0, 0);
        for k in 0..40 {
            let n = uniform_sphere(lattice(k, 40, Vec2::ZERO)).normalize();
            let x = 0.3 + 1.4 * Vec3::new(random.unit(), random.unit(), random.unit());
            let found = frame
                .probe_irradiance(&scene, x, n)
                .expect("a probe reaches")
                .irradiance(n);
            if shines[0] {
                let off = (found / std::f32::consts::PI - 1.0).abs().max_element();
                assert!(off < 0.01, "{n}: {found}");
            }
        }
        if !shines[0] {
            // In the middle a wall is a sixth of all directions, and the floor's light comes from
            // below: d.
            let light = frame
                .probe_irradiance(&scene, Vec3::ONE, Vec3::ZERO)
                .expect("a probe reaches");
            let [up, down] = [Vec3::Y, Vec3::NEG_Y].map(|n| light.irradiance(n).x);
            // A mean over half a meter to all sides is some percent more than the middle, for
            // light falls ever more slowly away from the wall. Form factor of a square of edge 2 to
            // a parallel element 1 above its middle: 4/π · (1/√2) · atan(1/√2) · 2 / 2.
            let s = std::f32::consts::FRAC_1_SQRT_2;
            let right = 4.0 * s * s.atan();
            assert!(
                (down - right).abs() < 0.05 * right && up < 0.05 * right,
                "{down} {up}, expected {right}"
            );
        }
    }
}

#[test]
fn probe_data_round_trips_and_damage_is_detected() {
    let mesh = TriangleMesh::from_quads(&Quad::cornell_box());
    let recipe = Recipe {
        levels: Some(3),
        sender_levels: Some(2),
        refinement_levels: Some(0),
        rays_per_point: Some(32),
        probes: Some(ProbeSettings {
            spacing: Some(0.3),
            rays_per_probe: None,
        }),
        ..draft()
    };
    let scene = baked(&mesh, recipe.clone());
    let again = bake_scene(&mesh, &recipe, 1, &Progress::default()).unwrap();
    assert_eq!(scene, again.scene, "threads change the bake");
    let probes = scene.data().probes.as_ref().unwrap();
    assert_eq!(again.stats.probes, probes.points.len() as u64);
    assert!(probes.points.len() > 100 && !probes.planes.is_empty());
    let bytes = scene.to_bytes().unwrap();
    assert_eq!(
        BakedScene::from_bytes(&bytes, &Limits::default()).unwrap(),
        scene
    );
    let mut without = scene.clone();
    without.data_mut().probes = None;
    assert!(without.to_bytes().unwrap().len() < bytes.len());
    assert!(
        CpuFrame::new(&without)
            .probe_irradiance(&without, Vec3::Y, Vec3::Y)
            .is_none()
    );
    // A bake without probes is the same.
    let plain = baked(
        &mesh,
        Recipe {
            probes: None,
            ..recipe.clone()
        },
    );
    assert_eq!(
        (&plain.data().operator, &plain.data().display),
        (&without.data().operator, &without.data().display)
    );

    let perturb = |what: &str, perturb: &dyn Fn(&mut Probes)| {
        let mut wrong = scene.clone();
        perturb(wrong.data_mut().probes.as_mut().unwrap());
        assert!(wrong.validate().is_err(), "{what} is not detected");
    };
    perturb("no probe", &|p| {
        p.points.clear();
        p.rows.clear();
        p.links.clear();
    });
    perturb("one probe less", &|p| p.points.truncate(p.points.len() - 1));
    perturb("a position that is NaN", &|p| {
        p.points[3].position[1] = f32::NAN
    });
    perturb("a radius of zero", &|p| p.points[3].radius = 0.0);
    perturb("a normal", &|p| p.points[3].normal = [0.0, 1.0, 0.0]);
    perturb("planes beyond the end", &|p| {
        p.points[3].planes = p.planes.len() as u32 | 1 << 24
    });
    perturb("an infinite plane", &|p| p.planes[0][3] = f32::INFINITY);
    perturb("another grid", &|p| p.grid.cell_size *= 2.0);
    perturb("an entry out of range", &|p| {
        *p.grid.entries.last_mut().unwrap() = u32::MAX
    });
    perturb("one row less", &|p| p.rows.truncate(p.rows.len() - 1));
    perturb("another start", &|p| p.rows[4].start += 1);
    perturb("a row of tier 0", &|p| p.rows[4].tier = 0);
    perturb("a scale of NaN", &|p| p.rows[4].scale = f32::NAN);
    perturb("a row sum above the limit", &|p| p.rows[4].scale *= 10.0);
    perturb("one link less", &|p| p.links.truncate(p.links.len() - 1));
    perturb("a sender out of range", &|p| {
        p.links[7].z_sender |= 0xffff << 16
    });
    let mut random = Random::new(4, 0, 0);
    for _ in 0..40 {
        let mut wrong = bytes.to_vec();
        let at = random.below(wrong.len());
        wrong[at] ^= 1 << random.below(8);
        let read = BakedScene::from_bytes(&wrong, &Limits::default());
        assert!(read.is_err(), "byte {at}");
    }

    for (probes, rule) in [
        (
            ProbeSettings {
                spacing: Some(0.0),
                rays_per_probe: None,
            },
            TransportMethod::Bounded,
        ),
        (
            ProbeSettings {
                spacing: Some(f32::NAN),
                rays_per_probe: None,
            },
            TransportMethod::Bounded,
        ),
        (
            ProbeSettings {
                spacing: None,
                rays_per_probe: Some(3),
            },
            TransportMethod::Bounded,
        ),
        (ProbeSettings::default(), TransportMethod::L08),
    ] {
        let wrong = Recipe {
            probes: Some(probes),
            transport: rule,
            ..Recipe::default()
        };
        assert!(matches!(wrong.check(), Err(RecipeError::OutOfRange { .. })));
    }
}

/// A dome on the floor is lit by functions of the floor below and by probes above: its light does
/// not jump between the two.
#[test]
fn surface_and_probe_light_join_continuously() {
    let mesh = TriangleMesh::from_quads(&Quad::cornell_box());
    let scene = baked(&mesh, draft());
    let light_source = Light::Point {
        position: Vec3::new(0.0, 1.8, 0.0),
        intensity: Vec3::ONE,
        range: f32::INFINITY,
    };
    let frame = solved(&scene, &FrameLight::expand(&light_source, 1), 0.0, 4);
    let meshes = std::slice::from_ref(&mesh);
    let lights = [light_source];
    let lit = Evaluator::new(&scene, meshes, &lights, Bounces::Count(4));
    // Nearly all positions of the scene have cover enough to be left alone.
    let viewpoints: Vec<Vec3> = scene.info().viewpoints.iter().map(|&v| v.into()).collect();
    let landed = trace_particles(&mesh, &viewpoints, 0..4000, 5, false).candidates;
    let covers = landed.iter().map(|c| {
        let (x, n) = (c.surface.position, c.surface.normal);
        let found = splat_covered(
            &scene.data().points,
            &scene.data().display,
            frame.vector_irradiance(),
            x,
            n,
        );
        found.map_or(0.0, |(_, cover)| cover)
    });
    let mut covers: Vec<f32> = covers.collect();
    covers.sort_by(f32::total_cmp);
    let below = covers.partition_point(|&c| c < FULL_COVER);
    println!(
        "{below} of {} positions have cover below {FULL_COVER}; the thousandth part below {}, the median {}",
        covers.len(),
        covers[covers.len() / 1000],
        covers[covers.len() / 2]
    );
    assert!(below * 200 < covers.len());

    // Up a flat dome on the floor, in steps of a millimeter: the largest step of the light, in
    // parts of the mean.
    let (radius, center) = (0.4, Vec3::new(-0.55, -0.3, 0.6));
    let steps = (PI * radius / 1e-3) as u32;
    let largest = |light: &dyn Fn(Vec3, Vec3) -> Option<Vec3>| {
        let (mut max, mut sum, mut count) = (0.0f32, 0.0, 0);
        for turn in 0..12u32 {
            let (sin, cos) = (turn as f32 / 12.0 * 2.0 * PI).sin_cos();
            let mut last: Option<f32> = None;
            for k in 0..=steps {
                let (s, c) = (k as f32 / steps as f32 * PI).sin_cos();
                let n = Vec3::new(s * cos, -c, s * sin);
                let x = center + radius * n;
                let Some(e) = (x.y > 1e-3).then(|| light(x, n)).flatten() else {
                    last = None;
                    continue;
                };
                if let Some(last) = last {
                    max = max.max((e.y - last).abs());
                }
                (sum, count, last) = (sum + e.y, count + 1, Some(e.y));
            }
        }
        max / (sum / count as f32)
    };
    let with = largest(&|x, n| lit.at(x, n, 0).indirect);
    let space = largest(&|x, n| lit.probe_irradiance(x, n));
    // Must fail: whichever covers.
    let without = largest(&|x, n| {
        let surface = frame.irradiance(&scene, x, n);
        surface.or_else(|| Some(frame.probe_irradiance(&scene, x, n)?.irradiance(n)))
    });
    println!(
        "largest step of a millimeter: {with:.4} of the mean, by probes alone {space:.4}, with a seam {without:.4}"
    );
    assert!(with < 0.05, "{with}");
    assert!(without > 5.0 * with, "{without} {with}");
}
