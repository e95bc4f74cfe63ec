//! Transport method `fmm` from recipe to frame. Compared with the reference integrator on
//! triangles, on points and on both in one room, and with method `bounded`. Also tests link tiers
//! below the octree, energy, thread counts, the file, and invalid recipes. Comparisons are repeated
//! with a wrong input, and must fail.

use bevy_meshless_gi::GiQuality;
use bevy_meshless_gi::internals::plan::{TierCandidate, TierController};
use glam::{Vec2, Vec3};
use meshless_gi::internals::eval::irradiance_at_all;
use meshless_gi::internals::samples::{Random, scatter, uniform_sphere};
use meshless_gi::internals::scene::PlyPoints;
use meshless_gi::{
    BakedScene, BounceMode, Bounces, CpuFrame, Evaluator, FmmRecipe, FrameLight, FrameSettings,
    Geometry, Irradiance, Light, Limits, Material, PointCloud, Preset, Progress, Quad, Ray, Recipe,
    ReferenceSettings, TransportMethod, TriangleMesh, bake_scene,
};

const REFLECTIONS: u32 = 4;

fn light_source() -> [Light; 1] {
    [Light::Rect {
        center: Vec3::new(0.1, 1.9, 0.0),
        u: Vec3::X * 0.2,
        v: Vec3::Z * 0.2,
        radiance: Vec3::new(30.0, 27.0, 22.0),
    }]
}

/// Returns positions and normals visible to a camera in front of the open side and to a camera
/// below the ceiling.
fn samples(mesh: &TriangleMesh, count: u64) -> Vec<(Vec3, Vec3)> {
    let seen = |k: u64| {
        let mut r = Random::new(4, 4, k);
        let eye = match k % 2 {
            0 => Vec3::new(0.0, 1.2, 2.5),
            _ => Vec3::new(0.2, 1.7, 0.3),
        };
        let to = Vec3::new(2.0 * r.unit() - 1.0, 2.0 * r.unit(), 2.0 * r.unit() - 1.0);
        let ray = Ray::new(eye, (to - eye).normalize());
        let surface = mesh.surface(&ray, &mesh.cast(&ray)?);
        Some((surface.position, surface.normal))
    };
    (0..count).filter_map(seen).collect()
}

/// Pair of references with independent noise.
type ReferencePair = [Vec<Irradiance>; 2];

fn reference(mesh: &TriangleMesh, samples: &[(Vec3, Vec3)]) -> ReferencePair {
    [1, 2].map(|seed| {
        let settings = ReferenceSettings {
            paths: 64,
            bounces: Some(REFLECTIONS),
            seed,
        };
        irradiance_at_all(mesh, &light_source(), samples, &settings)
    })
}

fn draft(rule: TransportMethod) -> Recipe {
    Recipe {
        preset: Preset::Draft,
        transport: rule,
        ..Recipe::default()
    }
}

fn baked(mesh: &TriangleMesh, recipe: &Recipe) -> BakedScene {
    bake_scene(mesh, recipe, 0, &Progress::default())
        .expect("a bake")
        .scene
}

fn indirect(scene: &BakedScene, mesh: &TriangleMesh, samples: &[(Vec3, Vec3)]) -> Vec<Vec3> {
    let mesh = std::slice::from_ref(mesh);
    let evaluator = Evaluator::new(scene, mesh, &light_source(), Bounces::Count(REFLECTIONS));
    let at = |(k, (x, n)): (usize, &(Vec3, Vec3))| {
        let e = evaluator.at(*x, *n, k as u64);
        e.indirect.unwrap_or_default()
    };
    samples.iter().enumerate().map(at).collect()
}

/// Returns ‖values − truth‖ / ‖truth‖. Products of one reference with the other cancel their noise.
fn nrmse(values: &[Vec3], truth: &ReferencePair) -> f64 {
    let (mut square, mut power) = (0.0f64, 0.0f64);
    for (i, x) in values.iter().enumerate() {
        let [a, b] = [0, 1].map(|k| truth[k][i].indirect);
        square += f64::from((*x - a).dot(*x - b));
        power += f64::from(a.dot(b));
    }
    (square.max(0.0) / power).sqrt()
}

/// Returns a room of triangles with a red ball of points above its floor.
fn room_with_ball() -> TriangleMesh {
    let of = |i: u64| {
        let mut r = Random::new(8, 8, i);
        uniform_sphere(Vec2::new(r.unit(), r.unit()))
    };
    let normals: Vec<Vec3> = (0..3000).map(of).collect();
    let ball = PlyPoints {
        positions: (normals.iter())
            .map(|n| Vec3::new(0.1, 0.6, 0.1) + 0.4 * *n)
            .collect(),
        albedo: Some(vec![Vec3::new(0.8, 0.1, 0.1); normals.len()]),
        normals: Some(normals),
        faces: 0,
    };
    let cloud = PointCloud::new(ball, &[]).expect("a cloud");
    let walls = TriangleMesh::from_quads(&Quad::cornell_box()[..5]);
    TriangleMesh::joined(vec![walls, cloud.mesh().0])
}

#[test]
fn fmm_rooms_of_triangles_points_and_both_match_reference() {
    let solid = TriangleMesh::from_quads(&Quad::cornell_box());
    let points = PointCloud::new(scatter(&solid, 0.035, 1).expect("points"), &[]);
    let rooms = [
        (
            "triangles",
            TriangleMesh::from_quads(&Quad::cornell_box()),
            0.1,
        ),
        ("points", points.expect("a cloud").mesh().0, 0.1),
        (
            "a ball of points in a room of triangles",
            room_with_ball(),
            0.1,
        ),
    ];
    for (name, mesh, max) in rooms {
        let samples = samples(&mesh, 400);
        let truth = reference(&mesh, &samples);
        let [fmm, bounded] = [TransportMethod::fmm(), TransportMethod::Bounded].map(|rule| {
            let scene = baked(&mesh, &draft(rule));
            let bytes = scene.to_bytes().expect("a file").len();
            let again = BakedScene::from_bytes(&scene.to_bytes().unwrap(), &Limits::default());
            assert!(again.expect("it can be read") == scene);
            let found = indirect(&scene, &mesh, &samples);
            let error = nrmse(&found, &truth);
            let work = TierCandidate::all_of(&scene, REFLECTIONS - 1);
            println!(
                "{name}, {rule:?}: NRMSE {error:.4}, own estimate {:.4} ± {:.4}, {bytes} bytes, frame cost {} links, gain {:.3}, not reciprocal {:.3}",
                scene.info().estimated_nrmse,
                scene.info().estimated_nrmse_interval,
                work.last().map_or(0, |tier| tier.work),
                scene.info().energy.spectral_radius_bound,
                scene.info().energy.reciprocity
            );
            (scene, found, error)
        });
        assert!(fmm.2 < max, "{name}: {}, at most {max}", fmm.2);
        assert!(bounded.2 < max, "{name}: {}", bounded.2);
        // The bake has no links, so the light is from the octree.
        assert!(fmm.0.data().operator.links.is_empty() && fmm.0.data().fmm.is_some());
        assert_eq!((fmm.0.data().tiers(), fmm.0.data().link_tiers()), (1, 0));
        let reversed: Vec<Vec3> = fmm.1.iter().rev().copied().collect();
        assert!(nrmse(&reversed, &truth) > 0.2);
        if name.contains("ball") {
            // The ball colors the floor below it. Without the ball, the same positions are less
            // red.
            let below = |(x, _): &&(Vec3, Vec3)| {
                x.y < 0.02 && Vec2::new(x.x - 0.1, x.z - 0.1).length() < 0.7
            };
            let floor: Vec<_> = samples.iter().filter(below).copied().collect();
            let bare = TriangleMesh::from_quads(&Quad::cornell_box()[..5]);
            let empty = baked(&bare, &quick(TransportMethod::fmm(), false));
            let tints = [(&fmm.0, &mesh), (&empty, &bare)].map(|(scene, mesh)| {
                let sum: Vec3 = indirect(scene, mesh, &floor).into_iter().sum();
                sum.x / sum.z
            });
            println!(
                "red over blue below the ball {:.2}, without it {:.2}",
                tints[0], tints[1]
            );
            assert!(floor.len() > 5 && tints[0] > 1.2 * tints[1]);
            // The walls of triangles color the points of the ball, red on one side and green on the
            // other.
            let side = |left: bool| {
                let center = Vec3::new(0.1, 0.6, 0.1);
                let facing = |(x, n): &&(Vec3, Vec3)| {
                    x.distance(center) < 0.45 && (if left { -n.x } else { n.x }) > 0.4
                };
                let own: Vec<_> = samples.iter().filter(facing).copied().collect();
                let sum: Vec3 = indirect(&fmm.0, &mesh, &own).into_iter().sum();
                (own.len(), sum.x / sum.y)
            };
            let (left, right) = (side(true), side(false));
            println!("red over green on the ball's sides, samples and ratio: {left:?}, {right:?}");
            assert!(left.0 > 5 && right.0 > 5 && left.1 > 1.3 * right.1);
        }
    }
}

/// Returns a recipe that bakes in a second.
fn quick(rule: TransportMethod, fallback: bool) -> Recipe {
    Recipe {
        transport: match rule {
            TransportMethod::Fmm(fmm) => TransportMethod::Fmm(FmmRecipe {
                fallback_links: fallback,
                ..fmm
            }),
            other => other,
        },
        coarse_radius: Some(0.6),
        rays_per_point: Some(64),
        levels: Some(3),
        sender_levels: Some(2),
        refinement_levels: Some(0),
        ..draft(rule)
    }
}

#[test]
fn fmm_bake_has_links_as_lower_tiers() {
    let mesh = TriangleMesh::from_quads(&Quad::cornell_box());
    let both = baked(&mesh, &quick(TransportMethod::fmm(), true));
    let links = baked(&mesh, &quick(TransportMethod::Bounded, false));
    let tiers = both.data().link_tiers();
    assert_eq!(both.data().tiers(), tiers + 1);
    assert_eq!(both.info().tiers.len() as u32, tiers + 1);
    assert!(both.data().operator.links.len() > 1000);
    let lights: Vec<FrameLight> = (light_source().iter())
        .flat_map(|l| FrameLight::expand(l, 4))
        .collect();
    let values = |scene: &BakedScene, tier: u32| {
        let mut frame = CpuFrame::new(scene);
        frame.set_lights(scene, &lights);
        let settings = FrameSettings {
            tier,
            ..FrameSettings::bounces(3)
        };
        frame.solve(scene, &settings);
        frame.vector_irradiance().to_vec()
    };
    // Lower tiers equal those of method `bounded`. The octree gives nearly the same light.
    assert!(values(&both, tiers) == values(&links, tiers));
    let (octree, linked) = (values(&both, u32::MAX), values(&both, tiers));
    let (mut square, mut power) = (0.0, 0.0);
    for ((a, b), p) in octree.iter().zip(&linked).zip(&both.data().points) {
        let (a, b) = (a.dot(p.n()), b.dot(p.n()));
        square += (a - b).length_squared();
        power += b.length_squared();
    }
    let apart = (square / power).sqrt();
    println!("octree and links differ by {apart:.3}");
    assert!(apart > 1e-3 && apart < 0.2, "{apart}");
    // With a budget that the octree exceeds, the controller selects a tier of links.
    let choices = TierCandidate::all_of(&both, 3);
    assert_eq!(choices.len() as u32, tiers + 1);
    let mut controller = TierController::new(
        GiQuality::GpuBudget(std::time::Duration::from_millis(1)),
        choices,
    );
    assert_eq!(controller.tier(), tiers + 1);
    for _ in 0..20 {
        let work = controller.tiers()[controller.tier() as usize - 1].work;
        let octree = controller.tiers()[tiers as usize].work;
        controller.record_sample(2.0 * work as f32 / octree as f32);
    }
    assert!(controller.tier() <= tiers, "{}", controller.selection());
}

#[test]
fn fmm_bake_any_thread_count_writes_equal_bytes() {
    let mesh = TriangleMesh::from_quads(&Quad::cornell_box());
    let bytes = |threads| {
        bake_scene(
            &mesh,
            &quick(TransportMethod::fmm(), false),
            threads,
            &Progress::default(),
        )
        .expect("a bake")
        .scene
        .to_bytes()
        .expect("a file")
    };
    assert!(bytes(1) == bytes(3));
}

/// Tests the irradiance inside a closed box. Walls of radiosity 1 give E = 1. With all reflections,
/// E is 1 / (1 − ρ) times the emitted radiosity.
#[test]
fn fmm_closed_room_conserves_energy() {
    let furnace = |albedo: f32| {
        let material = Material {
            emissive: Vec3::splat(std::f32::consts::FRAC_1_PI),
            ..Material::diffuse(Vec3::splat(albedo))
        };
        let walls: Vec<Quad> = (0..6)
            .map(|k| {
                let axis = Vec3::AXES[k / 2] * if k % 2 == 0 { 1.0 } else { -1.0 };
                let (u, v) = (axis.any_orthonormal_vector(), axis);
                let w = v.cross(u);
                // The front sides face the inside.
                let at = |a: f32, b: f32| axis + a * u + b * w;
                Quad {
                    corners: [at(-1.0, -1.0), at(-1.0, 1.0), at(1.0, 1.0), at(1.0, -1.0)],
                    material: material.clone(),
                }
            })
            .collect();
        let mesh = TriangleMesh::from_quads(&walls);
        baked(&mesh, &quick(TransportMethod::fmm(), false))
    };
    for albedo in [0.0f32, 0.5, 0.9] {
        let scene = furnace(albedo);
        let mut frame = CpuFrame::new(&scene);
        let sweeps = frame.converge(&scene, &FrameSettings::bounces(1), 1e-4);
        let right = 1.0 / (1.0 - albedo);
        let (mut mean, mut worst) = (0.0, 0.0f32);
        for (e, p) in frame.vector_irradiance().iter().zip(&scene.data().points) {
            let e = e.dot(p.n()).x / right;
            mean += e / scene.data().points.len() as f32;
            worst = worst.max((e - 1.0).abs());
        }
        println!(
            "albedo {albedo}: mean {mean:.4}, worst {worst:.3}, {sweeps} sweeps, gain {:.4}, row sum deviation {:.1e}",
            scene.info().energy.spectral_radius_bound,
            scene.info().energy.row_deviation
        );
        assert!((mean - 1.0).abs() < 0.01, "{mean}");
        assert!(worst < 0.05, "{worst}");
        assert!((scene.info().energy.spectral_radius_bound - albedo).abs() < 0.01);
    }
}

#[test]
fn invalid_fmm_recipes_are_rejected() {
    type Change = fn(&mut FmmRecipe, &mut BounceMode);
    let wrong: [(&str, Change); 5] = [
        ("order", |fmm, _| fmm.order = 17),
        ("leaf_size", |fmm, _| fmm.leaf_size = 0),
        ("samples_per_sender", |fmm, _| fmm.samples_per_sender = 65),
        ("visibility_rays", |fmm, _| fmm.visibility_rays = 0),
        ("bounce_mode", |_, mode| *mode = BounceMode::Baked),
    ];
    for (field, change) in wrong {
        let mut recipe = draft(TransportMethod::fmm());
        assert!(recipe.check().is_ok());
        let mut fmm = FmmRecipe::default();
        change(&mut fmm, &mut recipe.bounce_mode);
        recipe.transport = TransportMethod::Fmm(fmm);
        let error = recipe.check().expect_err(field).to_string();
        assert!(error.contains(field), "{error}");
    }
    let read = Recipe::from_ron("(rule: Fmm, order: 3, sources: 2, fallback: true)").unwrap();
    let expected = FmmRecipe {
        order: 3,
        samples_per_sender: 2,
        fallback_links: true,
        ..FmmRecipe::default()
    };
    assert_eq!(read.transport, TransportMethod::Fmm(expected));
}
