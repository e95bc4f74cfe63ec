//! Tier of the operator in the running plugin: selected by number, by error, and by a GPU budget
//! while camera and light move. The test provides the time, so that no test depends on a clock.

use crate::support::app::{
    app, create_target_image, finish_plugins, headless_plugins, picture, run,
};
use crate::support::scenes::{cornell, cpu_indirect};
use crate::support::stage::{
    assert_pictures_match, counters, light_source, lit_room, settings, view,
};
use bevy::camera::RenderTarget;
use bevy::prelude::*;
use bevy::render::diagnostic::RenderDiagnosticsPlugin;
use bevy_meshless_gi::GiActiveTier;
use bevy_meshless_gi::internals::plan::TierCandidate;
use bevy_meshless_gi::internals::plugin::SolveCostSource;
use bevy_meshless_gi::prelude::*;
use meshless_gi::{FrameSettings, Light};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

struct Stage {
    root: Entity,
    camera_entity: Entity,
    light_source: Entity,
    image: Handle<Image>,
}

const LIGHT_POSITION: Vec3 = Vec3::new(-0.3, 1.5, 0.3);

fn stage(app: &mut App) -> Stage {
    let (root, camera_entity, image, light_source) = lit_room(app, LIGHT_POSITION);
    Stage {
        root,
        camera_entity,
        light_source,
        image,
    }
}

fn set_quality(app: &mut App, stage: &Stage, quality: GiQuality) {
    app.world_mut().entity_mut(stage.root).insert(quality);
}

fn tier(app: &App, stage: &Stage) -> (u32, String) {
    let found = app.world().get::<GiActiveTier>(stage.root).unwrap();
    let picked = found.selection().unwrap();
    (picked.tier, picked.reason)
}

/// Each requested tier matches the CPU's picture of that tier, and the plan contains the tier and
/// the reason.
#[test]
fn requested_tier_matches_cpu() {
    let mut app = app();
    let stage = stage(&mut app);
    let (room, bake) = cornell();
    let tiers = bake.data().operator.tiers();
    assert_eq!(tiers, 4);
    let lights: [Light; 1] = [light_source(LIGHT_POSITION)];
    let mut pictures = Vec::new();
    for n in [4, 1, 2] {
        set_quality(&mut app, &stage, GiQuality::Tier(n));
        run(&mut app, 2);
        let c = counters(&app);
        assert!(
            c.plan
                .to_string()
                .contains(&format!("with tier {n} of 4: requested")),
            "{}",
            c.plan
        );
        let settings = FrameSettings {
            tier: n,
            ..settings()
        };
        let cpu = cpu_indirect(
            &room,
            &bake,
            Transform::IDENTITY,
            view(),
            &lights,
            &settings,
        );
        let found = picture(&mut app, &stage.image);
        assert_pictures_match(&format!("tier_{n}"), &cpu, &found);
        pictures.push((found, cpu));
    }
    // Each picture is closest to the CPU's picture of its own tier.
    for (i, (found, own)) in pictures.iter().enumerate() {
        for (j, (_, other)) in pictures.iter().enumerate() {
            let (near, far) = (found.nrmse(own), found.nrmse(other));
            assert!(i == j || far > 2.0 * near, "{i}, {j}: {far} and {near}");
        }
    }
    // Without motion, a change of the tier causes one solve.
    set_quality(&mut app, &stage, GiQuality::Tier(3));
    run(&mut app, 1);
    assert_eq!(counters(&app).solved.values().collect::<Vec<_>>(), [&3]);
    run(&mut app, 1);
    assert!(counters(&app).solved.is_empty());

    // Selection by error: the bake stores the error of each tier.
    let upper: Vec<f32> = TierCandidate::all_of(&bake, 3)
        .iter()
        .map(|t| t.error)
        .collect();
    for max in [upper[0], 1e-6, f32::NAN] {
        set_quality(&mut app, &stage, GiQuality::MaxError(max));
        run(&mut app, 1);
        let expected = upper
            .iter()
            .position(|&e| e <= max)
            .map_or(4, |at| at as u32 + 1);
        let (found, reason) = tier(&app, &stage);
        assert_eq!(found, expected, "{max}: {reason}");
        let met = max > 1e-3;
        assert!(reason.starts_with("none") != met, "{reason}");
    }
}

/// Replaces the camera's target by a small image, for tests of many frames that read no picture.
fn shrink_target(app: &mut App, stage: &Stage) {
    let image = (app.world_mut().resource_mut::<Assets<Image>>()).add(create_target_image(32, 24));
    let target = RenderTarget::Image(image.into());
    app.world_mut()
        .entity_mut(stage.camera_entity)
        .insert(target);
}

/// The budget is met while light and camera move and the load changes, and the tier does not
/// oscillate.
#[test]
fn gpu_budget_is_met_while_light_and_camera_move() {
    let mut app = app();
    let stage = stage(&mut app);
    shrink_target(&mut app, &stage);
    let (_, bake) = cornell();
    let choices = TierCandidate::all_of(&bake, 3);
    let all = choices[3].work as f32;
    // Time of a solve with all links, in microseconds.
    let load = Arc::new(AtomicU32::new(2_000));
    let (given, count) = (load.clone(), Arc::new(AtomicU32::new(0)));
    let requested = count.clone();
    app.insert_resource(SolveCostSource::Given(Arc::new(move |work| {
        let n = requested.fetch_add(1, Ordering::Relaxed);
        let noise = 1.0 + 0.15 * ((n.wrapping_mul(0x9e37_79b9) >> 16) as f32 / 32768.0 - 1.0);
        noise * given.load(Ordering::Relaxed) as f32 / 1000.0 * work as f32 / all
    })));
    const BUDGET: f32 = 3.0;
    set_quality(
        &mut app,
        &stage,
        GiQuality::GpuBudget(Duration::from_secs_f32(1e-3 * BUDGET)),
    );
    let mut over = 0;
    let mut frame = 0u32;
    let mut run_frames = |app: &mut App, frames: u32| -> Vec<u32> {
        (0..frames)
            .map(|_| {
                frame += 1;
                let t = frame as f32 * 0.02;
                let mut position = app
                    .world_mut()
                    .get_mut::<Transform>(stage.light_source)
                    .unwrap();
                position.translation =
                    LIGHT_POSITION + Vec3::new(0.2 * t.sin(), 0.0, 0.1 * t.cos());
                let mut camera_entity = app
                    .world_mut()
                    .get_mut::<Transform>(stage.camera_entity)
                    .unwrap();
                *camera_entity = view() * Transform::from_xyz(0.05 * t.sin(), 0.0, 0.0);
                run(app, 1);
                let used = *counters(app)
                    .solved
                    .values()
                    .next()
                    .expect("the light moved");
                let work = choices[used as usize - 1].work as f32;
                over +=
                    u32::from(load.load(Ordering::Relaxed) as f32 / 1000.0 * work / all > BUDGET);
                used
            })
            .collect()
    };
    let easy = run_frames(&mut app, 30);
    assert!(easy.iter().all(|&t| t == 4), "{easy:?}");
    let words = counters(&app).plan.to_string();
    assert!(
        words.contains("ms a solve, within 3 ms; there is no higher one"),
        "{words}"
    );
    load.store(8_000, Ordering::Relaxed);
    let heavy = run_frames(&mut app, 30);
    // The controller finds the fitting tier within 12 frames, and keeps it.
    let fits = (1..=4)
        .rev()
        .find(|&t| 8.0 * choices[t as usize - 1].work as f32 / all <= 0.8 * BUDGET);
    let fits = fits.unwrap_or(1);
    assert!(heavy[12..].iter().all(|&t| t == fits), "{fits}: {heavy:?}");
    load.store(2_000, Ordering::Relaxed);
    // Each step to a higher tier waits for 60 solves.
    let again = run_frames(&mut app, 70);
    assert!(*again.last().unwrap() > fits, "{:?}", tier(&app, &stage));
    let changes = app
        .world()
        .get::<GiActiveTier>(stage.root)
        .unwrap()
        .changes();
    assert!((2..=5).contains(&changes), "{changes}");
    assert!(over <= 12, "{over} solves over the budget");
    assert!(count.load(Ordering::Relaxed) > 100);
    // At rest nothing is solved, and no cost is requested.
    run(&mut app, 3);
    let before = count.load(Ordering::Relaxed);
    run(&mut app, 5);
    assert_eq!(count.load(Ordering::Relaxed), before);
}

/// GPU timestamps reach the tier controller if the device supports them. The test does not check
/// their values, except that a budget of 1 ns is exceeded.
#[test]
fn gpu_timings_reach_tier_controller() {
    let mut app = App::new();
    app.add_plugins((
        headless_plugins(),
        RenderDiagnosticsPlugin,
        MeshlessGiPlugin::default(),
    ));
    finish_plugins(&mut app);
    let stage = stage(&mut app);
    shrink_target(&mut app, &stage);
    set_quality(
        &mut app,
        &stage,
        GiQuality::GpuBudget(Duration::from_nanos(1)),
    );
    for k in 0..60 {
        let mut position = app
            .world_mut()
            .get_mut::<Transform>(stage.light_source)
            .unwrap();
        position.translation.x = LIGHT_POSITION.x + 0.005 * k as f32;
        run(&mut app, 1);
    }
    let store = app.world().resource::<bevy::diagnostic::DiagnosticsStore>();
    let timed = store.iter().any(|d| {
        d.path().as_str().ends_with("elapsed_gpu") && d.path().as_str().contains("/solve_")
    });
    let (found, reason) = tier(&app, &stage);
    println!("timestamps: {timed}; tier {found}: {reason}");
    if timed {
        assert_eq!(found, 1, "{reason}");
        assert!(reason.contains("over"), "{reason}");
    } else {
        assert_eq!(found, 4, "{reason}");
        assert!(reason.contains("not measured"), "{reason}");
    }
}
