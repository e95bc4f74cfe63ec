//! The frame on the CPU against closed forms: geometric series of bounces and the lights' textbook
//! irradiances. It repeats no unnecessary work and computes the same bits for any number of
//! threads. The GPU's frame is compared with this one in `twins.rs`.

use meshless_gi_lab::fixtures::synthetic;

use glam::Vec3;
use meshless_gi::internals::asset::{FlatBasis, LightSamples, PointSurface, SceneData};
use meshless_gi::internals::basis::{Weights, support_bounds};
use meshless_gi::internals::frame::project;
use meshless_gi::internals::samples::{HashedGrid, LightSample, Point};
use meshless_gi::internals::scene::{BvhNode, BvhTriangle};
use meshless_gi::internals::transport::{
    BounceLink, BounceOperator, Link, Operator, Row, SenderForm,
};
use meshless_gi::{
    BakeInfo, BakedScene, Bvh, CpuFrame, FrameLight, FrameSettings, Material, TierInfo,
    TriangleMesh,
};
use std::f32::consts::PI;

const ALBEDO: f32 = 0.5;
const EMISSION: f32 = 3.0;
/// Four senders, and two finer receivers for each.
const SENDERS: usize = 4;
const POINTS: usize = 12;

/// Returns an abstract closed box: from every point only one sender is visible, in the direction of
/// its normal. With `to_sky` it is the sky.
fn furnace(to_sky: bool) -> BakedScene {
    let normal = |i: usize| Vec3::new(0.6, if i.is_multiple_of(2) { 0.8 } else { -0.8 }, 0.0);
    let points: Vec<Point> = (0..POINTS)
        .map(|i| Point::new(Vec3::X * (i % SENDERS) as f32, normal(i), 0.9))
        .collect();
    let link = |i: usize| {
        let sender = if to_sky { SENDERS } else { (i + 1) % SENDERS };
        Link::pack(normal(i), 1.0, sender as u16)
    };
    let data = SceneData {
        surfaces: vec![
            PointSurface {
                albedo: [ALBEDO; 3],
                emission: [EMISSION; 3],
                ..PointSurface::default()
            };
            POINTS
        ],
        level_starts: vec![0, SENDERS as u32, POINTS as u32],
        sender_levels: 1,
        light_samples: LightSamples::default(),
        pull: Weights::from_rows((0..SENDERS).map(|_| [])),
        parents: Weights::from_rows((0..POINTS).map(|_| [])),
        operator: Operator {
            form: SenderForm::Averages,
            rows: (0..POINTS)
                .map(|i| Row {
                    start: i as u32,
                    count: 1,
                    scale: 1.0,
                    tier: 1,
                })
                .collect(),
            links: (0..POINTS).map(link).collect(),
            steps: Vec::new(),
            precision: Vec::new(),
            compression: None,
        },
        visibility: None,
        probes: None,
        occluders: None,
        fmm: None,
        illumination: Vec::new(),
        sky: None,
        materials: None,
        bounces: None,
        display: FlatBasis {
            radius: 0.9,
            planes: Vec::new(),
            grid: HashedGrid::build(POINTS, 0.9, |i| support_bounds(&points[i])),
        },
        points,
        bvh: Bvh::default(),
        bounds: [[0.0; 3]; 2],
    };
    let mut info = BakeInfo::default();
    info.tiers = TierInfo::from_scene(&data);
    BakedScene::new(data, info)
}

/// A sender's light is the mean over its positions: with one of four in shadow it is three
/// quarters. The light at its own point does not count.
#[test]
fn sender_light_is_mean_over_samples() {
    let mut scene = furnace(false);
    let position = |k: usize| Vec3::new(2.0 + 0.1 * (k % 4) as f32, 0.0, (k / 4) as f32);
    scene.data_mut().light_samples = LightSamples {
        per_sender: 4,
        list: (0..4 * SENDERS)
            .map(|k| LightSample::new(position(k), Vec3::Y))
            .collect(),
    };
    scene.validate().expect("valid");
    // A blocker above the first position of the first sender alone.
    let above = position(0) + 0.5 * Vec3::Y;
    let corners = [
        above + Vec3::new(-0.04, 0.0, -0.04),
        above + Vec3::new(0.04, 0.0, -0.04),
        above + Vec3::new(0.0, 0.0, 0.06),
    ];
    scene.data_mut().bvh =
        TriangleMesh::new(vec![corners], vec![0], vec![Material::default()]).bvh();
    let sun = FrameLight::directional(Vec3::NEG_Y, Vec3::ONE);
    let mut frame = CpuFrame::new(&scene);
    frame.set_lights(&scene, &[sun]);
    let found = frame.projected(0);
    assert!((found[0] - 0.75).abs() < 1e-6, "{found:?}");
    for e in &found[1..] {
        assert!((e - 1.0).abs() < 1e-6, "{found:?}");
    }
    scene.data_mut().light_samples = LightSamples::default();
    let mut own = CpuFrame::new(&scene);
    own.set_lights(&scene, &[sun]);
    assert!(
        (own.projected(0)[0] - 0.8).abs() < 1e-6,
        "the point's own normal"
    );
}

/// Irradiance at point `i` for its normal.
fn irradiance(scene: &BakedScene, frame: &CpuFrame, i: usize) -> f32 {
    frame.vector_irradiance()[i]
        .dot(scene.data().points[i].n())
        .y
}

#[test]
fn bounces_form_geometric_series() {
    let scene = furnace(false);
    let mut frame = CpuFrame::new(&scene);
    for bounces in 1..6 {
        frame.solve(&scene, &FrameSettings::bounces(bounces));
        let series: f32 = (0..bounces).map(|k| ALBEDO.powi(k as i32)).sum();
        for i in 0..POINTS {
            let e = irradiance(&scene, &frame, i);
            // The links are 16-bit floats.
            assert!(
                (e - EMISSION * series).abs() < 1e-3 * e,
                "{bounces} bounces, point {i}: {e}"
            );
        }
    }
    frame.solve(
        &scene,
        &FrameSettings {
            emission: 0.0,
            ..FrameSettings::bounces(4)
        },
    );
    assert_eq!(irradiance(&scene, &frame, 0), 0.0);
}

#[test]
fn baked_bounces_are_added_once() {
    let mut scene = furnace(false);
    // All further bounces in closed form: ρ / (1 − ρ) of the direct radiosity.
    scene.data_mut().bounces = Some(BounceOperator {
        starts: (0..=SENDERS as u32).collect(),
        links: (0..SENDERS as u32)
            .map(|sender| BounceLink {
                gain: [ALBEDO / (1.0 - ALBEDO); 3],
                sender,
            })
            .collect(),
        bounces: 99,
    });
    let mut frame = CpuFrame::new(&scene);
    frame.solve(&scene, &FrameSettings::bounces(4));
    let e = irradiance(&scene, &frame, 5);
    assert!((e - EMISSION / (1.0 - ALBEDO)).abs() < 1e-3 * e, "{e}");
    let runtime = FrameSettings {
        baked_bounces: false,
        ..FrameSettings::bounces(1)
    };
    frame.solve(&scene, &runtime);
    assert!((irradiance(&scene, &frame, 5) - EMISSION).abs() < 1e-2);
}

#[test]
fn sky_light_uses_sky_links() {
    let scene = furnace(true);
    let mut frame = CpuFrame::new(&scene);
    let settings = FrameSettings {
        sky: Vec3::new(0.0, 2.0, 0.0).into(),
        ..FrameSettings::default()
    };
    frame.solve(&scene, &settings);
    let e = irradiance(&scene, &frame, 3);
    assert!((e - 2.0 * PI).abs() < 1e-2, "{e}");
    assert!(frame.vector_irradiance()[3].x[0] == 0.0, "red");
}

#[test]
fn frame_recomputes_only_changes() {
    let scene = synthetic::scene(SenderForm::Averages);
    let mut lights = synthetic::lights();
    let shining = lights.iter().filter(|l| l.kind != FrameLight::NONE).count();
    let mut frame = CpuFrame::new(&scene);
    let settings = FrameSettings::default();
    assert_eq!(frame.set_lights(&scene, &lights), shining);
    assert!(frame.solve(&scene, &settings));
    assert_eq!(frame.set_lights(&scene, &lights), 0);
    assert!(!frame.solve(&scene, &settings), "nothing changed");

    lights[0].color = [9.0, 1.0, 1.0];
    assert_eq!(
        frame.set_lights(&scene, &lights),
        0,
        "a color needs no projection"
    );
    assert!(frame.solve(&scene, &settings));
    lights[2].direction = [0.0, -1.0, 0.0];
    assert_eq!(frame.set_lights(&scene, &lights), 1);
    assert!(frame.solve(&scene, &settings));
    let counters = frame.counters();
    assert_eq!(
        (counters.projected, counters.solves, counters.skipped_solves),
        (shining as u64 + 1, 3, 1)
    );

    // The state equals that of a frame that had only the last lights.
    let mut fresh = CpuFrame::new(&scene);
    fresh.set_lights(&scene, &lights);
    fresh.solve(&scene, &settings);
    assert_eq!(fresh.vector_irradiance(), frame.vector_irradiance());
    // Fewer lights: the others no longer shine; and back again.
    frame.set_lights(&scene, &lights[..1]);
    frame.solve(&scene, &settings);
    assert_ne!(fresh.vector_irradiance(), frame.vector_irradiance());
    assert_eq!(
        frame.set_lights(&scene, &lights),
        0,
        "the slots are still projected"
    );
    frame.solve(&scene, &settings);
    assert_eq!(fresh.vector_irradiance(), frame.vector_irradiance());
}

#[test]
fn frame_any_thread_count_has_equal_bits() {
    for form in [SenderForm::Averages, SenderForm::Differences] {
        let scene = synthetic::scene(form);
        let solve = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| {
                let mut frame = CpuFrame::new(&scene);
                frame.set_lights(&scene, &synthetic::lights());
                frame.solve(&scene, &FrameSettings::bounces(3));
                frame.vector_irradiance().to_vec()
            })
        };
        assert_eq!(solve(1), solve(2));
        assert_eq!(solve(1), solve(5));
    }
}

#[test]
fn direct_light_matches_inverse_square_law() {
    let x = Vec3::new(0.0, 0.0, 0.0);
    let light_source = Vec3::new(1.0, 2.0, 0.0);
    let (square, cosine) = (5.0f32, 2.0 / 5.0f32.sqrt());
    let near = |light: &FrameLight, expected: f32| {
        let e = project::unshadowed(light, x, Vec3::Y);
        assert!(
            (e - expected).abs() <= 2e-6 * expected.max(0.1),
            "{light:?}: {e}, not {expected}"
        );
    };
    near(
        &FrameLight::point(light_source, Vec3::ONE, f32::INFINITY),
        cosine / square,
    );
    let window = 1.0 - (square / 9.0) * (square / 9.0);
    near(
        &FrameLight::point(light_source, Vec3::ONE, 3.0),
        cosine / square * window * window,
    );
    near(&FrameLight::point(light_source, Vec3::ONE, 2.0), 0.0);
    near(
        &FrameLight::point(-light_source, Vec3::ONE, f32::INFINITY),
        0.0,
    );
    near(
        &FrameLight::directional(Vec3::new(0.0, -1.0, 1.0), Vec3::ONE),
        0.5f32.sqrt(),
    );
    near(
        &FrameLight::patch(light_source, Vec3::NEG_Y, Vec3::ONE),
        cosine * cosine / square,
    );
    near(&FrameLight::patch(light_source, Vec3::Y, Vec3::ONE), 0.0);
    // Straight down: the position is 26.6° off the axis of the cone.
    let spot = |inner: f32, outer: f32| {
        FrameLight::spot(
            light_source,
            Vec3::NEG_Y,
            Vec3::ONE,
            inner.to_radians(),
            outer.to_radians(),
            f32::INFINITY,
        )
    };
    near(&spot(30.0, 40.0), cosine / square);
    near(&spot(10.0, 20.0), 0.0);
    let (inner, outer) = (10f32.to_radians().cos(), 40f32.to_radians().cos());
    let part = (cosine - outer) / (inner - outer);
    near(&spot(10.0, 40.0), cosine / square * part * part);
    // At the light itself: dark, and no NaN.
    assert_eq!(
        project::unshadowed(&FrameLight::point(x, Vec3::ONE, f32::INFINITY), x, Vec3::Y),
        0.0
    );
}

#[test]
fn direct_light_is_blocked_by_geometry() {
    let mut scene = furnace(false);
    // A plate of one meter, one meter above the ground.
    scene.data_mut().bvh = Bvh {
        nodes: vec![BvhNode {
            min: [-0.5, 0.999, -0.5],
            first: 0,
            max: [0.5, 1.001, 0.5],
            count: 1,
        }],
        triangles: vec![BvhTriangle {
            a: [-0.5, 1.0, -0.5],
            b: [0.5, 1.0, -0.5],
            c: [0.0, 1.0, 0.5],
            ..BvhTriangle::default()
        }],
    };
    scene.data_mut().bounds = [[-1.0, 0.0, -1.0], [1.0, 3.0, 1.0]];
    let mut frame = CpuFrame::new(&scene);
    frame.set_lights(
        &scene,
        &[FrameLight::directional(
            Vec3::NEG_Y,
            Vec3::new(1.0, 2.0, 3.0),
        )],
    );
    assert_eq!(frame.direct(&scene, Vec3::ZERO, Vec3::Y), Vec3::ZERO);
    assert_eq!(
        frame.direct(&scene, Vec3::X, Vec3::Y),
        Vec3::new(1.0, 2.0, 3.0)
    );
    // On the plate, on both sides of it.
    assert_eq!(
        frame.direct(&scene, Vec3::Y, Vec3::Y),
        Vec3::new(1.0, 2.0, 3.0)
    );
    assert_eq!(frame.direct(&scene, Vec3::Y, Vec3::NEG_Y), Vec3::ZERO);
    // The light below the plate is not in its shadow, the one on it is.
    for (height, lit) in [(0.9, true), (1.0, true), (1.1, false)] {
        let light_source = FrameLight::point(Vec3::new(0.0, height, 0.0), Vec3::ONE, f32::INFINITY);
        frame.set_lights(&scene, &[light_source]);
        assert_eq!(
            frame.direct(&scene, Vec3::ZERO, Vec3::Y).x > 0.0,
            lit,
            "{height}"
        );
    }
}

#[test]
fn evaluation_of_uncovered_point_is_none_without_nan() {
    let scene = furnace(false);
    let mut frame = CpuFrame::new(&scene);
    frame.solve(&scene, &FrameSettings::bounces(1));
    let n = scene.data().points[0].n();
    // All functions of this normal have the same value: the quotient is that of one.
    let e = frame
        .irradiance(&scene, Vec3::new(0.3, 0.1, 0.0), n)
        .unwrap();
    assert!((e.x - EMISSION).abs() < 1e-2, "{e}");
    assert_eq!(
        frame.irradiance(&scene, Vec3::new(0.3, 0.1, 0.0), -Vec3::X),
        None
    );
    assert_eq!(frame.irradiance(&scene, Vec3::Y * 50.0, n), None);
    assert_eq!(frame.irradiance(&scene, Vec3::NAN, n), None);
    assert_eq!(frame.irradiance(&scene, Vec3::ZERO, Vec3::NAN), None);
    // From the middle of a support to beyond its end: a number or nothing.
    for step in 0..2000 {
        let x = Vec3::X * (SENDERS as f32 - 1.0 + step as f32 * 0.0005);
        let found = frame.irradiance(&scene, x, n);
        assert!(
            found.is_none_or(|e| e.is_finite() && (e.x - EMISSION).abs() < 1e-2),
            "{x}: {found:?}"
        );
    }
}

#[test]
fn difference_levels_sum_to_averages() {
    let scene = synthetic::scene(SenderForm::Differences);
    let mut frame = CpuFrame::new(&scene);
    frame.set_lights(&scene, &synthetic::lights());
    frame.solve(&scene, &FrameSettings::bounces(1));
    for j in 0..scene.data().senders() {
        let mut sum = Vec3::from_slice(&frame.differences()[j]);
        for entry in scene.data().parents.row(j) {
            sum += entry.weight * Vec3::from_slice(&frame.differences()[entry.index as usize]);
        }
        let whole = Vec3::from_slice(&frame.senders()[j]);
        assert!(
            (sum - whole).length() <= 1e-4 * (1.0 + whole.length()),
            "{j}: {sum} {whole}"
        );
    }
}
