//! Plan of the running plugin: inventory, decisions with their settings, and costs from the device
//! or the test.

use crate::support::app::{app, camera, finish_plugins, headless_plugins, picture, run, target};
use crate::support::flip::flip;
use crate::support::scenes::{Room, cornell, cpu_indirect};
use crate::support::stage::{
    CANDELA, MAX, assert_pictures_match, counters, indirect, light_source, lit_room, settings,
    spawn_baked, spawn_light_source, view,
};
use bevy::light::RectLight;
use bevy::prelude::*;
use bevy::render::diagnostic::RenderDiagnosticsPlugin;
use bevy::render::renderer::RenderDevice;
use bevy_meshless_gi::internals::plan::{
    ChangeCounts, ColorUniformity, Cost, DecisionKind, FrameStage, Inventory, LightKind,
    MAX_TRUNCATED_FRACTION, MONOCHROME_HYSTERESIS_FRAMES, Plan, SkipReason, SkyKind, Work,
    bounces_for_spectral_radius,
};
use bevy_meshless_gi::internals::plugin::SolveCostSource;
use bevy_meshless_gi::prelude::*;
use bevy_meshless_gi::{GiColorMode, GiReflectiveShadowMap, GiReflector};
use meshless_gi::{Channels, FrameSettings, Light};
use std::sync::Arc;

const LIGHT_POSITION: Vec3 = Vec3::new(-0.3, 1.5, 0.3);

fn plan(app: &App) -> Plan {
    counters(app).plan
}

fn inventory(app: &App) -> Inventory {
    plan(app).inventory
}

fn cost(plan: &Plan, stage: FrameStage) -> Cost {
    let pass = plan.passes.iter().find(|p| p.stage == stage);
    let pass = pass.unwrap_or_else(|| panic!("no {stage:?}:\n{plan}"));
    *plan.cost_of(pass).expect("it is timed")
}

fn move_to(app: &mut App, entity: Entity, position: Vec3) {
    let world = app.world_mut();
    world.get_mut::<Transform>(entity).unwrap().translation = position;
}

#[test]
fn inventory_after_world_changes_has_new_counts() {
    let mut app = app();
    let (root, camera_entity, _, light_source) = lit_room(&mut app, LIGHT_POSITION);
    let second = spawn_light_source(&mut app, -LIGHT_POSITION + 2.0 * Vec3::Y);
    run(&mut app, 2);
    let found = inventory(&app);
    let points = found.lights_of(LightKind::Point);
    let at_rest = ChangeCounts {
        all: 2,
        on: 2,
        ..ChangeCounts::default()
    };
    assert_eq!(points, at_rest);
    assert!(found.at_rest(), "{found}");
    assert_eq!((found.bakes, found.cameras.deferred), (1, 1));
    assert_eq!((found.skies, found.normal_maps), (SkyKind::None, 0));
    assert_eq!(found.colors, ColorUniformity::Surfaces);

    // One light moves and the other changes its color, each in one frame.
    move_to(&mut app, light_source, LIGHT_POSITION + 0.1 * Vec3::X);
    let mut light = app.world_mut().get_mut::<PointLight>(second).unwrap();
    light.color = Color::linear_rgb(1.0, 0.5, 0.5);
    run(&mut app, 1);
    let points = inventory(&app).lights_of(LightKind::Point);
    assert_eq!((points.moved, points.recolored), (1, 1));
    run(&mut app, 1);
    assert!(inventory(&app).at_rest());

    // More objects: a panel with bounce, a reflector, a sky, a forward camera.
    app.world_mut().spawn(RectLight::default());
    app.world_mut()
        .entity_mut(light_source)
        .insert(GiReflectiveShadowMap::default());
    app.world_mut().spawn(GiReflector);
    app.world_mut().spawn(Camera3d::default());
    let mut environment = app.world_mut().get_mut::<GiEnvironment>(root).unwrap();
    environment.sky = GiSky::Uniform(LinearRgba::WHITE);
    run(&mut app, 1);
    let found = inventory(&app);
    assert_eq!(found.lights_of(LightKind::Rect).all, 1);
    assert_eq!((found.reflectors, found.bouncing_lights), (1, 1));
    assert_eq!((found.skies, found.skies_changed), (SkyKind::Uniform, 1));
    assert_eq!((found.cameras.sampled, found.cameras.forward), (1, 0));

    // A material gains a normal map, loses it, and is removed.
    let mut material = StandardMaterial {
        normal_map_texture: Some(Handle::default()),
        ..default()
    };
    let mut materials = app.world_mut().resource_mut::<Assets<StandardMaterial>>();
    let handle = materials.add(material.clone());
    run(&mut app, 2);
    assert_eq!(inventory(&app).normal_maps, 1);
    material.normal_map_texture = None;
    let mut materials = app.world_mut().resource_mut::<Assets<StandardMaterial>>();
    *materials.get_mut(&handle).unwrap() = material;
    run(&mut app, 2);
    assert_eq!(inventory(&app).normal_maps, 0);

    // A camera that is off is counted as such.
    let mut camera = app.world_mut().get_mut::<GiCamera>(camera_entity).unwrap();
    camera.enabled = false;
    run(&mut app, 1);
    let cameras = inventory(&app).cameras;
    assert_eq!((cameras.deferred, cameras.off), (0, 1));
}

/// The measured cost of one tier predicts the cost of another tier. The test provides the cost of
/// solves.
#[test]
fn costs_are_measured_and_predict_other_tier() {
    let mut app = app();
    let (root, _, _, light_source) = lit_room(&mut app, LIGHT_POSITION);
    run(&mut app, 1);
    let first = plan(&app);
    for stage in [
        FrameStage::PROJECT,
        FrameStage::APPLY,
        FrameStage::SPLAT,
        FrameStage::COMPOSITE,
    ] {
        let cost = cost(&first, stage);
        assert_eq!((cost.predicted, cost.measured), (None, None), "{stage:?}");
    }
    assert!(!first.to_string().contains(" ms "), "{first}");
    let Work::Links(all) = cost(&first, FrameStage::APPLY).work else {
        panic!("{first}");
    };
    let Work::Rays(rays) = cost(&first, FrameStage::PROJECT).work else {
        panic!("{first}");
    };
    assert!(all > 1000 && rays > 100, "{all} links, {rays} rays");

    app.insert_resource(SolveCostSource::Given(Arc::new(|links| {
        1e-4 * links as f32
    })));
    for k in 0..6 {
        move_to(
            &mut app,
            light_source,
            LIGHT_POSITION + 0.01 * k as f32 * Vec3::X,
        );
        run(&mut app, 1);
    }
    let seen = cost(&plan(&app), FrameStage::APPLY);
    let close = |found: Option<f32>, links: u64| {
        let expected = 1e-4 * links as f32;
        found.is_some_and(|ms| (ms / expected - 1.0).abs() < 1e-3)
    };
    assert!(
        close(seen.predicted, all) && close(seen.measured, all),
        "{seen}"
    );

    // A setting forces a tier with fewer links. Its predicted cost is lower.
    let world = app.world_mut();
    world.entity_mut(root).insert(GiQuality::Tier(1));
    run(&mut app, 1);
    let forced = plan(&app);
    let found = cost(&forced, FrameStage::APPLY);
    let Work::Links(few) = found.work else {
        panic!("{forced}");
    };
    assert!(few < all / 2, "{few} of {all}");
    assert!(close(found.predicted, few), "{found}");
    assert!(!close(found.predicted, all), "{found}");
}

/// A forced tier changes only the decision about the tier, and later frames have the same
/// decisions.
#[test]
fn forced_tier_changes_only_tier_decision() {
    let mut app = app();
    let (root, camera_entity, _, light_source) = lit_room(&mut app, LIGHT_POSITION);
    run(&mut app, 2);
    let standing = |app: &App| {
        let mut found = plan(app).decisions();
        found.retain(|d| !matches!(d.kind, DecisionKind::Effect("lights" | "transport", ..)));
        // Costs of a decision in a frame are not compared.
        found.iter_mut().for_each(|d| d.costs.clear());
        found
    };
    let before = standing(&app);
    // The test's cameras request every pixel, and its rooms a fixed number of bounces.
    let forced: Vec<&DecisionKind> = (before.iter())
        .filter(|d| d.forced.is_some())
        .map(|d| &d.kind)
        .collect();
    assert!(
        matches!(
            forced[..],
            [DecisionKind::Bounces(_), DecisionKind::Display(_)]
        ),
        "{before:?}"
    );
    let world = app.world_mut();
    world.entity_mut(root).insert(GiQuality::Tier(1));
    run(&mut app, 2);
    let forced = standing(&app);
    let differ: Vec<&DecisionKind> = (forced.iter())
        .filter(|d| !before.contains(d))
        .map(|d| &d.kind)
        .collect();
    assert!(matches!(differ[..], [DecisionKind::Tier(_)]), "{differ:?}");
    for k in 0..20 {
        if k % 3 != 0 {
            move_to(
                &mut app,
                light_source,
                LIGHT_POSITION + 0.01 * k as f32 * Vec3::X,
            );
        }
        run(&mut app, 1);
        assert_eq!(standing(&app), forced, "frame {k}");
    }
    // If the only camera is off, the plan is empty.
    let mut camera = app.world_mut().get_mut::<GiCamera>(camera_entity).unwrap();
    camera.enabled = false;
    run(&mut app, 1);
    let found = plan(&app);
    assert!(found.is_empty(), "{found}");
    assert!(
        (found.skipped.iter()).any(|(_, _, reason)| *reason == SkipReason::NotInView),
        "{found}"
    );
}

/// Timestamps of a device with a clock reach the plan. Their values are not checked.
#[test]
fn gpu_timings_reach_plan() {
    let mut app = App::new();
    app.add_plugins((
        headless_plugins(),
        RenderDiagnosticsPlugin,
        MeshlessGiPlugin::default(),
    ))
    .insert_resource(GlobalAmbientLight::NONE);
    finish_plugins(&mut app);
    let clocked = wgpu::Features::TIMESTAMP_QUERY | wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS;
    let features = app.world().resource::<RenderDevice>().features();
    let (_, _, _, light_source) = lit_room(&mut app, LIGHT_POSITION);
    for k in 0..8 {
        move_to(
            &mut app,
            light_source,
            LIGHT_POSITION + 0.01 * k as f32 * Vec3::X,
        );
        run(&mut app, 1);
    }
    let found = plan(&app);
    assert!(cost(&found, FrameStage::SPLAT).work == Work::Pixels(128 * 96));
    // A dynamic object in a reflective shadow map.
    let ball = Mesh::from(Sphere::new(0.2));
    let ball = Mesh3d(app.world_mut().resource_mut::<Assets<Mesh>>().add(ball));
    let mut materials = app.world_mut().resource_mut::<Assets<StandardMaterial>>();
    let material = MeshMaterial3d(materials.add(StandardMaterial::default()));
    let transform = Transform::from_translation(LIGHT_POSITION - 0.6 * Vec3::Y);
    (app.world_mut()).spawn((ball, material, transform, GiReflector));
    let map = GiReflectiveShadowMap::default();
    let texels = u64::from(map.texels());
    app.world_mut().entity_mut(light_source).insert(map);
    for k in 0..8 {
        move_to(
            &mut app,
            light_source,
            LIGHT_POSITION + 0.01 * k as f32 * Vec3::X,
        );
        run(&mut app, 1);
    }
    let found = plan(&app);
    println!("{found}");
    for stage in [
        FrameStage::PROJECT,
        FrameStage::APPLY,
        FrameStage::SPLAT,
        FrameStage::COMPOSITE,
        FrameStage::RSM,
    ] {
        let cost = cost(&found, stage);
        if features.contains(clocked) {
            let known = |ms: Option<f32>| ms.is_some_and(|ms| ms.is_finite() && ms >= 0.0);
            assert!(
                known(cost.measured) && known(cost.predicted),
                "{stage:?}: {cost}"
            );
        } else {
            println!("the device has no timestamp queries");
            assert_eq!((cost.predicted, cost.measured), (None, None));
        }
    }
    let Work::Texels(all) = cost(&found, FrameStage::RSM).work else {
        panic!("{found}");
    };
    assert!(all > 0 && all % (texels * texels) == 0, "{all}");
}

/// The solve uses the number of bounces for the surface albedo with `Auto`, and the set number with
/// `Fixed`. Both match the CPU.
#[test]
fn bounce_count_follows_surface_albedo() {
    let mut app = app();
    let (room, bake) = cornell();
    let root = spawn_baked(&mut app, &room, &bake, Transform::IDENTITY);
    let image = target(&mut app);
    (app.world_mut()).spawn((camera(&image, view()), indirect()));
    spawn_light_source(&mut app, LIGHT_POSITION);
    let solve_with = |app: &mut App, bounces: GiBounceCount| {
        let mut solver = app.world_mut().get_mut::<GiSolver>(root).unwrap();
        solver.bounces = bounces;
        run(app, 1);
        let plan = plan(app);
        let [(_, picked)] = plan.reflections[..] else {
            panic!("{plan}");
        };
        println!("{picked}");
        let dispatched = counters(app).dispatches_of(FrameStage::APPLY);
        assert_eq!(dispatched, picked.bounces, "{plan}");
        let settings = FrameSettings {
            sweeps: picked.bounces - 1,
            ..settings()
        };
        let lights = [light_source(LIGHT_POSITION)];
        let cpu = cpu_indirect(
            &room,
            &bake,
            Transform::IDENTITY,
            view(),
            &lights,
            &settings,
        );
        assert_pictures_match("reflections", &cpu, &picture(app, &image));
        (picked, cpu)
    };
    let (few, short) = solve_with(&mut app, GiBounceCount::Fixed(2));
    assert!(few.forced && few.bounces == 2, "{few}");
    let (many, whole) = solve_with(&mut app, GiBounceCount::Auto);
    let gain = bake.info().energy.spectral_radius_bound;
    assert!(
        !many.forced && many.bounces == bounces_for_spectral_radius(gain),
        "{many}"
    );
    assert_eq!(many.gain, Some(gain));
    // The truncation error is below the bound, and two bounces are not enough.
    let settings = FrameSettings {
        sweeps: 4 * many.bounces,
        ..settings()
    };
    let lights = [light_source(LIGHT_POSITION)];
    let all = cpu_indirect(
        &room,
        &bake,
        Transform::IDENTITY,
        view(),
        &lights,
        &settings,
    );
    let (left, lost) = (whole.nrmse(&all), short.nrmse(&all));
    println!("NRMSE to four times as many bounces: {left:.4}, with two {lost:.4}");
    assert!(
        left < MAX_TRUNCATED_FRACTION && lost > 5.0 * MAX_TRUNCATED_FRACTION,
        "{left} {lost}"
    );
}

/// A gray room under lights of one color uses one channel and matches the CPU's result in three
/// channels.
#[test]
fn gray_room_uses_monochrome_until_colored_light() {
    let gray = Room::cornell().recolored(|c| Vec3::splat(c.max_element()));
    let bake = gray.bake(1);
    let mut app = app();
    let root = spawn_baked(&mut app, &gray, &bake, Transform::IDENTITY);
    let image = target(&mut app);
    (app.world_mut()).spawn((camera(&image, view()), indirect()));
    let light_source = spawn_light_source(&mut app, LIGHT_POSITION);
    let paint = |app: &mut App, [r, g, b]: [f32; 3]| {
        let mut light = app.world_mut().get_mut::<PointLight>(light_source).unwrap();
        light.color = Color::linear_rgb(r, g, b);
    };
    let right = |colors: &[(Vec3, [f32; 3])]| {
        let lights: Vec<Light> = (colors.iter())
            .map(|(position, color)| Light::Point {
                position: *position,
                intensity: CANDELA * Vec3::from(*color),
                range: 20.0,
            })
            .collect();
        let root = Transform::IDENTITY;
        cpu_indirect(&gray, &bake, root, view(), &lights, &settings())
    };
    let channels = |app: &App| {
        let plan = plan(app);
        let [(_, picked)] = plan.channels[..] else {
            panic!("{plan}");
        };
        picked
    };
    const WARM: [f32; 3] = [1.0, 0.6, 0.3];
    const BLUE: [f32; 3] = [0.1, 0.3, 1.0];
    paint(&mut app, WARM);
    run(&mut app, 1);
    let first = plan(&app);
    assert!(
        matches!(channels(&app).channels, Channels::One(_)),
        "{first}"
    );
    assert!(matches!(cost(&first, FrameStage::APPLY).work, Work::OneChannel(n) if n > 1000));
    let warm = right(&[(LIGHT_POSITION, WARM)]);
    assert_pictures_match("one_channel", &warm, &picture(&mut app, &image));
    // Another color of all lights still uses one channel, in the same frame.
    paint(&mut app, BLUE);
    run(&mut app, 1);
    assert!(matches!(channels(&app).channels, Channels::One(_)));
    let blue = right(&[(LIGHT_POSITION, BLUE)]);
    assert!(flip(&warm, &blue) > MAX);
    assert_pictures_match("one_other_channel", &blue, &picture(&mut app, &image));

    // A second light in another color switches to three channels in the same frame.
    let position = LIGHT_POSITION + 0.6 * Vec3::X;
    let second = spawn_light_source(&mut app, position);
    run(&mut app, 1);
    assert_eq!(channels(&app).channels, Channels::Three);
    let work = |app: &App| counters(app).dispatches_of(FrameStage::APPLY);
    assert!(work(&app) > 0);
    let both = right(&[(LIGHT_POSITION, BLUE), (position, [1.0; 3])]);
    assert!(flip(&blue, &both) > MAX);
    assert_pictures_match("two_colors", &both, &picture(&mut app, &image));

    // After its removal, one channel returns after `MONOCHROME_HYSTERESIS_FRAMES` frames, without a
    // solve.
    app.world_mut().despawn(second);
    run(&mut app, 1);
    assert!(work(&app) > 0);
    let mut changed = 0;
    for _ in 0..MONOCHROME_HYSTERESIS_FRAMES + 5 {
        let before = channels(&app).channels;
        run(&mut app, 1);
        assert_eq!(work(&app), 0);
        changed += u32::from(channels(&app).channels != before);
    }
    assert_eq!(changed, 1);
    assert!(matches!(channels(&app).channels, Channels::One(_)));
    assert_pictures_match("blue_again", &blue, &picture(&mut app, &image));

    // A setting forces the channels, and the light follows in the same frame.
    let solve_with = |app: &mut App, channels| {
        let mut solver = app.world_mut().get_mut::<GiSolver>(root).unwrap();
        solver.color_mode = channels;
        run(app, 1);
    };
    solve_with(&mut app, GiColorMode::Rgb);
    assert_eq!(channels(&app).channels, Channels::Three);
    assert!(channels(&app).forced && work(&app) > 0);
    spawn_light_source(&mut app, position);
    solve_with(&mut app, GiColorMode::Monochrome);
    assert!(matches!(channels(&app).channels, Channels::One(_)));
    assert!(channels(&app).forced && work(&app) > 0);
    let found = picture(&mut app, &image);
    let colored = |p: &[f32; 3]| (p[0] - p[2]).abs() > 0.02 * p[1];
    assert!(
        !found.pixels.iter().any(colored),
        "the hue is the white of the light"
    );
    solve_with(&mut app, GiColorMode::Auto);
    assert!(!channels(&app).forced && work(&app) > 0);
    assert_pictures_match("as_it_takes", &both, &picture(&mut app, &image));
}
