//! Directional skies and dynamic materials in the running plugin. Pictures match the CPU's frame,
//! in the frame of the change. No work is done in a frame without a change.

use crate::support::app::{app, camera, picture, run, target};
use crate::support::flip::flip;
use crate::support::scenes::{Room, cpu_indirect, rough_recipe};
use crate::support::stage::{
    MAX, assert_pictures_match, bevy_light, counters, indirect, light_source, settings,
    spawn_baked, view, work,
};
use bevy::prelude::*;
use bevy_meshless_gi::internals::plan::{FrameStage, bounces_for_spectral_radius};
use bevy_meshless_gi::prelude::*;
use bevy_meshless_gi::{GiDynamicMaterials, GiSky, GiWarning, GiWarnings};
use glam::Mat3;
use meshless_gi::internals::frame::materials::dynamic_surfaces;
use meshless_gi::{BakedScene, FrameSettings, Recipe, SkyModel, SkyRadiance};
use std::sync::{Arc, OnceLock};

/// Indices of the quads of the room's left wall and of the block's top.
const LEFT: usize = 3;
const TOP: usize = 9;

/// Returns the Cornell room and its bake, with the settings that all tests of this file need.
fn cornell() -> (Room, Arc<BakedScene>) {
    static BAKED: OnceLock<Arc<BakedScene>> = OnceLock::new();
    let room = Room::cornell();
    let recipe = Recipe {
        sky: SkyModel::Harmonics,
        dynamic_materials: true,
        ..rough_recipe()
    };
    let baked = BAKED.get_or_init(|| room.bake_as(&recipe)).clone();
    (room, baked)
}

/// Spawns the room at `root` and a camera that shows indirect light alone.
fn stage(app: &mut App, bake: &Arc<BakedScene>, root: Transform) -> (Entity, Handle<Image>) {
    let root = spawn_baked(app, &Room::cornell(), bake, root);
    let image = target(app);
    app.world_mut().spawn((camera(&image, view()), indirect()));
    (root, image)
}

#[test]
fn directional_sky_follows_world_directions() {
    let (room, bake) = cornell();
    let mut app = app();
    let turn = Quat::from_euler(EulerRot::YXZ, 0.5, 0.2, -0.1);
    let placed = Transform::from_rotation(turn);
    let (root, image) = stage(&mut app, &bake, placed);
    let (zenith, horizon, ground) = (
        LinearRgba::rgb(100.0, 200.0, 700.0),
        LinearRgba::rgb(600.0, 500.0, 400.0),
        LinearRgba::rgb(50.0, 40.0, 30.0),
    );
    let mut radiance = GiSky::gradient(zenith, horizon, ground).radiance();
    // The sky is brighter on the open side of the room.
    radiance.terms[2] = Vec3::new(400.0, 200.0, 100.0);
    let sky = GiSky::from(radiance);
    let environment = GiEnvironment { sky, ..default() };
    app.world_mut().entity_mut(root).insert(environment);
    run(&mut app, 3);
    let plan = counters(&app).plan.to_string();
    assert!(plan.contains("eight terms of a sky that varies"), "{plan}");
    let cpu = |sky: SkyRadiance| {
        let settings = FrameSettings { sky, ..settings() };
        cpu_indirect(&room, &bake, placed, view(), &[], &settings)
    };
    let local = sky.radiance().rotate(Mat3::from_quat(turn.inverse()));
    let expected = cpu(local);
    assert_pictures_match("sky_that_varies", &expected, &picture(&mut app, &image));
    // Another direction of the sky's light gives another picture.
    assert!(flip(&expected, &cpu(sky.radiance())) > MAX);
    assert!(flip(&expected, &cpu(local.mean.into())) > MAX);
    run(&mut app, 1);
    assert_eq!(work(&counters(&app)), [0; 4], "at rest");

    // A bake with a uniform sky uses the mean only, and the plan logs it.
    let plain = room.bake(1);
    let scene = plain.clone();
    let asset = app
        .world_mut()
        .resource_mut::<Assets<GiBakedScene>>()
        .add(GiBakedScene { scene });
    app.world_mut().entity_mut(root).insert(GiScene(asset));
    run(&mut app, 3);
    let plan = counters(&app).plan.to_string();
    assert!(plan.contains("the mean of its sky"), "{plan}");
    let settings = FrameSettings {
        sky: local.mean.into(),
        ..settings()
    };
    let mean = cpu_indirect(&room, &plain, placed, view(), &[], &settings);
    assert_pictures_match("mean_of_the_sky", &mean, &picture(&mut app, &image));
}

#[test]
fn dynamic_materials_change_light_in_same_frame_and_idle_without_change() {
    let (room, bake) = cornell();
    let mut app = app();
    let (root, image) = stage(&mut app, &bake, Transform::IDENTITY);
    let position = Vec3::new(0.0, 1.7, 0.2);
    let at = Transform::from_translation(position);
    app.world_mut().spawn((bevy_light(), at));
    // The materials of the quads, in the order of the quads.
    let children: Vec<Entity> = app.world().get::<Children>(root).unwrap().to_vec();
    let handle = |app: &App, k: usize| {
        let material = app
            .world()
            .get::<MeshMaterial3d<StandardMaterial>>(children[k]);
        material.unwrap().0.clone()
    };
    let named = [LEFT, TOP].map(|k| (format!("quad {k}"), handle(&app, k)));
    let [left, top] = named.clone().map(|n| n.1);
    let all = GiDynamicMaterials(named.to_vec());
    app.world_mut().entity_mut(root).insert(all);
    run(&mut app, 3);
    let lights = [light_source(position)];
    let before = cpu_indirect(
        &room,
        &bake,
        Transform::IDENTITY,
        view(),
        &lights,
        &settings(),
    );
    assert_pictures_match("as_baked", &before, &picture(&mut app, &image));
    run(&mut app, 1);
    let c = counters(&app);
    assert_eq!(
        (work(&c), c.dispatches_of(FrameStage::MATERIALS)),
        ([0; 4], 0)
    );

    // The emission of the block's top changes, and the left wall is recolored.
    let mut last = before;
    for (glow, paint) in [
        (0.0, Vec3::new(0.05, 0.1, 0.7)),
        (1.5, Vec3::new(0.05, 0.1, 0.7)),
        (0.4, Vec3::new(0.6, 0.6, 0.1)),
    ] {
        {
            let mut assets = app.world_mut().resource_mut::<Assets<StandardMaterial>>();
            let mut wall = assets.get_mut(&left).unwrap();
            wall.base_color = Color::linear_rgb(paint.x, paint.y, paint.z);
            drop(wall);
            let mut sign = assets.get_mut(&top).unwrap();
            sign.emissive = LinearRgba::rgb(glow, 0.5 * glow, 0.1 * glow);
        }
        run(&mut app, 1);
        let c = counters(&app);
        assert_eq!(c.dispatches_of(FrameStage::MATERIALS), 1, "{}", c.plan);
        assert!(
            c.plan.to_string().contains("materials changed"),
            "{}",
            c.plan
        );
        assert!(c.projected_slots == 0 && c.dispatches_of(FrameStage::APPLY) > 0);
        let mut factors = bake.data().materials.as_ref().unwrap().factors.clone();
        factors[LEFT].base_color = paint.to_array();
        factors[TOP].emissive = [glow, 0.5 * glow, 0.1 * glow];
        let mut now = (*bake).clone();
        let surfaces = dynamic_surfaces(bake.data(), &factors).unwrap();
        now.data_mut().surfaces[..surfaces.len()].copy_from_slice(&surfaces);
        let wall = room.0[LEFT].color;
        let seen = room.recolored(|c| if c == wall { paint } else { c });
        let expected = cpu_indirect(
            &seen,
            &now,
            Transform::IDENTITY,
            view(),
            &lights,
            &settings(),
        );
        let found = picture(&mut app, &image);
        assert_pictures_match("dynamic", &expected, &found);
        assert!(flip(&last, &expected) > MAX, "the change shows");
        last = expected;
        run(&mut app, 1);
        let c = counters(&app);
        let none = ([0; 4], 0);
        assert_eq!((work(&c), c.dispatches_of(FrameStage::MATERIALS)), none);
    }

    // The number of reflections follows the albedo. It rises if a wall becomes white, and does not
    // fall if the wall becomes dark again.
    let mut solver = app.world_mut().get_mut::<GiSolver>(root).unwrap();
    let requested = std::mem::take(&mut solver.bounces);
    let reflections = |app: &mut App, gray: f32| {
        let mut assets = app.world_mut().resource_mut::<Assets<StandardMaterial>>();
        assets.get_mut(&left).unwrap().base_color = Color::linear_rgb(gray, gray, gray);
        run(app, 2);
        let [(_, picked)] = counters(app).plan.reflections[..] else {
            panic!("{}", counters(app).plan);
        };
        println!("{picked}");
        picked.bounces
    };
    let (gray, white) = (reflections(&mut app, 0.7), reflections(&mut app, 0.95));
    assert!(
        bounces_for_spectral_radius(bake.info().energy.spectral_radius_bound) < white
            && gray <= white,
        "{gray} {white}"
    );
    assert_eq!(reflections(&mut app, 0.05), white);
    let mut solver = app.world_mut().get_mut::<GiSolver>(root).unwrap();
    solver.bounces = requested;
    run(&mut app, 2);

    // With a repeated name, an unknown name and a removed material, the other materials still
    // update. Another texture has no effect and gives a warning.
    let findings = |app: &App| app.world().resource::<GiWarnings>().0.clone();
    let before = findings(&app);
    let mut more = named.to_vec();
    more.insert(0, ("unknown".into(), left.clone()));
    more.push((format!("quad {TOP}"), Handle::default()));
    app.world_mut()
        .entity_mut(root)
        .insert(GiDynamicMaterials(more));
    run(&mut app, 2);
    let c = counters(&app);
    let none = ([0; 4], 0);
    assert_eq!((work(&c), c.dispatches_of(FrameStage::MATERIALS)), none);
    assert_eq!(findings(&app), before);
    let mut assets = app.world_mut().resource_mut::<Assets<StandardMaterial>>();
    assets.get_mut(&left).unwrap().base_color_texture = Some(Handle::default());
    run(&mut app, 2);
    let c = counters(&app);
    assert_eq!((work(&c), c.dispatches_of(FrameStage::MATERIALS)), none);
    assert_eq!(
        findings(&app)[before.len()..],
        [GiWarning::DynamicMaterialTexture]
    );
}
