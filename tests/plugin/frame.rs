//! Running plugin without a window: its pictures match those of the CPU's frame. A frame runs only
//! required stages.

use crate::support::app::{HEIGHT, WIDTH, app, camera, picture, run, target};
use crate::support::flip::{Picture, flip};
use crate::support::scenes::{Room, cornell, cpu_indirect, cpu_indirect_sized};
use crate::support::stage::{
    CANDELA, MAX, assert_pictures_match, bevy_light, counters, indirect, light_source,
    save_picture, settings, spawn_room, view, work,
};
use bevy::prelude::*;
use bevy_meshless_gi::internals::plan::FrameStage;
use bevy_meshless_gi::internals::plugin::SharedCoefficients;
use bevy_meshless_gi::prelude::*;
use bevy_meshless_gi::{GiDebugView, GiGizmos, GiWarning, GiWarnings};
use meshless_gi::{CpuFrame, FrameLight, Light};
use std::f32::consts::PI;

#[test]
fn frame_matches_cpu_for_moved_light_and_moved_root() {
    let mut app = app();
    let (room, bake) = cornell();
    let root = spawn_room(&mut app, Transform::IDENTITY);
    let image = target(&mut app);
    app.world_mut().spawn((camera(&image, view()), indirect()));
    let positions = [Vec3::new(0.0, 1.7, 0.2), Vec3::new(-0.6, 0.5, 0.5)];
    let light = app
        .world_mut()
        .spawn((bevy_light(), Transform::from_translation(positions[0])))
        .id();
    run(&mut app, 3);

    let still = cpu_indirect(
        &room,
        &bake,
        Transform::IDENTITY,
        view(),
        &[light_source(positions[0])],
        &settings(),
    );
    assert_pictures_match("still", &still, &picture(&mut app, &image));

    app.world_mut()
        .get_mut::<Transform>(light)
        .unwrap()
        .translation = positions[1];
    run(&mut app, 1);
    let after_one = counters(&app);
    assert_eq!(
        (
            after_one.projected_slots,
            after_one.dispatches_of(FrameStage::APPLY) > 0
        ),
        (1, true),
        "{}",
        after_one.plan
    );
    let moved = cpu_indirect(
        &room,
        &bake,
        Transform::IDENTITY,
        view(),
        &[light_source(positions[1])],
        &settings(),
    );
    assert!(flip(&still, &moved) > MAX, "the light's move shows");
    assert_pictures_match("moved", &moved, &picture(&mut app, &image));

    // The root is translated, rotated and scaled.
    let placed = Transform {
        translation: Vec3::new(0.4, -0.3, -0.5),
        rotation: Quat::from_euler(EulerRot::YXZ, 0.35, 0.1, -0.2),
        scale: Vec3::splat(1.3),
    };
    let position = placed.transform_point(Vec3::new(0.5, 1.4, 0.5));
    *app.world_mut().get_mut::<Transform>(root).unwrap() = placed;
    app.world_mut()
        .get_mut::<Transform>(light)
        .unwrap()
        .translation = position;
    run(&mut app, 2);
    let placed = cpu_indirect(
        &room,
        &bake,
        placed,
        view(),
        &[light_source(position)],
        &settings(),
    );
    assert!(flip(&moved, &placed) > MAX, "the root's move shows");
    assert_pictures_match("placed", &placed, &picture(&mut app, &image));
}

#[test]
fn two_cameras_share_solve_and_show_equal_light() {
    let mut app = app();
    let (room, bake) = cornell();
    spawn_room(&mut app, Transform::IDENTITY);
    let views = [
        view(),
        Transform::from_xyz(1.5, 1.6, 3.0).looking_at(Vec3::new(-0.2, 0.7, 0.0), Vec3::Y),
    ];
    let images = [target(&mut app), target(&mut app)];
    for (i, image) in images.iter().enumerate() {
        let order = Camera {
            order: i as isize,
            clear_color: ClearColorConfig::Custom(Color::BLACK),
            ..default()
        };
        let entity = app
            .world_mut()
            .spawn((camera(image, views[i]), indirect()))
            .id();
        app.world_mut().entity_mut(entity).insert(order);
    }
    let position = Vec3::new(0.3, 1.5, 0.6);
    app.world_mut()
        .spawn((bevy_light(), Transform::from_translation(position)));
    run(&mut app, 1);
    let first = counters(&app);
    assert_eq!(
        (first.projected_slots, first.active_scenes),
        (1, 1),
        "{}",
        first.plan
    );
    run(&mut app, 2);
    assert_eq!(counters(&app).dispatches_of(FrameStage::COMPOSITE), 2);
    let expected = views.map(|at| {
        let root = Transform::IDENTITY;
        cpu_indirect(
            &room,
            &bake,
            root,
            at,
            &[light_source(position)],
            &settings(),
        )
    });
    assert!(
        flip(&expected[0], &expected[1]) > MAX,
        "the two sides differ"
    );
    for (i, image) in images.iter().enumerate() {
        assert_pictures_match(
            &format!("camera_{i}"),
            &expected[i],
            &picture(&mut app, image),
        );
    }
}

#[test]
fn picture_is_sum_of_direct_and_indirect_light() {
    let mut app = app();
    let (room, bake) = cornell();
    spawn_room(&mut app, Transform::IDENTITY);
    let image = target(&mut app);
    let off = GiCamera {
        enabled: false,
        ..default()
    };
    let camera_entity = app.world_mut().spawn((camera(&image, view()), off)).id();
    let position = Vec3::new(0.0, 1.6, 0.3);
    app.world_mut().spawn((
        PointLight {
            shadow_maps_enabled: true,
            ..bevy_light()
        },
        Transform::from_translation(position),
    ));
    run(&mut app, 3);
    let direct = picture(&mut app, &image);
    app.world_mut()
        .entity_mut(camera_entity)
        .insert(GiCamera::default());
    run(&mut app, 3);
    let lit = picture(&mut app, &image);
    let indirect = cpu_indirect(
        &room,
        &bake,
        Transform::IDENTITY,
        view(),
        &[light_source(position)],
        &settings(),
    );
    let sum = direct.plus(&indirect);
    save_picture("direct", &direct);
    assert_pictures_match("lit", &sum, &lit);
    assert!(flip(&direct, &lit) > MAX, "indirect light shows");
}

/// Spawns eight lights around the room.
fn eight_lights(app: &mut App) -> Vec<Entity> {
    (0..8)
        .map(|i| {
            let turn = Quat::from_rotation_y(i as f32 * PI / 4.0);
            let position = turn * Vec3::new(0.7, 0.0, 0.0) + Vec3::new(0.0, 1.6, 0.0);
            app.world_mut()
                .spawn((bevy_light(), Transform::from_translation(position)))
                .id()
        })
        .collect()
}

#[test]
fn static_lights_run_no_transport_and_moved_light_projects_once() {
    let mut app = app();
    let root = spawn_room(&mut app, Transform::IDENTITY);
    let image = target(&mut app);
    app.world_mut()
        .spawn((camera(&image, view()), GiCamera::default()));
    let light_sources = eight_lights(&mut app);
    run(&mut app, 1);
    let first = counters(&app);
    assert_eq!(
        (
            first.projected_slots,
            first.dispatches_of(FrameStage::UPLOAD)
        ),
        (8, 1),
        "{}",
        first.plan
    );
    assert!(work(&first).iter().all(|n| *n > 0), "{first:?}");

    for _ in 0..3 {
        run(&mut app, 1);
        let rest = counters(&app);
        assert_eq!(
            (
                work(&rest),
                rest.projected_slots,
                rest.dispatches_of(FrameStage::UPLOAD)
            ),
            ([0; 4], 0, 0),
            "{}",
            rest.plan
        );
        assert_eq!(
            (
                rest.dispatches_of(FrameStage::SPLAT),
                rest.dispatches_of(FrameStage::COMPOSITE)
            ),
            (1, 1),
            "{}",
            rest.plan
        );
        assert_eq!(rest.pipelines, first.pipelines, "no pipeline is made twice");
    }

    app.world_mut()
        .get_mut::<Transform>(light_sources[3])
        .unwrap()
        .translation
        .y = 1.2;
    run(&mut app, 1);
    let moved = counters(&app);
    assert_eq!(
        (
            moved.projected_slots,
            moved.dispatches_of(FrameStage::PROJECT)
        ),
        (1, 1),
        "{}",
        moved.plan
    );
    assert!(moved.dispatches_of(FrameStage::APPLY) > 0);

    // A new color needs no projection. A hidden light goes dark, and returns without a new
    // projection.
    app.world_mut()
        .get_mut::<PointLight>(light_sources[0])
        .unwrap()
        .color = Color::srgb(1.0, 0.2, 0.2);
    run(&mut app, 1);
    let colored = counters(&app);
    assert_eq!(
        (
            colored.projected_slots,
            colored.dispatches_of(FrameStage::APPLY) > 0
        ),
        (0, true),
        "{}",
        colored.plan
    );
    for visibility in [Visibility::Hidden, Visibility::Inherited] {
        app.world_mut()
            .entity_mut(light_sources[1])
            .insert(visibility);
        run(&mut app, 1);
        let c = counters(&app);
        assert_eq!(
            (c.projected_slots, c.dispatches_of(FrameStage::APPLY) > 0),
            (0, true),
            "{visibility:?}: {}",
            c.plan
        );
    }

    // Motion of the root together with all lights causes no change in the bake's space.
    for light_source in &light_sources {
        app.world_mut()
            .entity_mut(*light_source)
            .insert(ChildOf(root));
    }
    run(&mut app, 2);
    app.world_mut()
        .get_mut::<Transform>(root)
        .unwrap()
        .translation
        .x = 0.25;
    run(&mut app, 1);
    let carried = counters(&app);
    assert_eq!(work(&carried), [0; 4], "{}", carried.plan);

    // Bevy's diagnostics contain the counters.
    run(&mut app, 1);
    let store = app.world().resource::<bevy::diagnostic::DiagnosticsStore>();
    let value = |path: &str| {
        store
            .get(&bevy::diagnostic::DiagnosticPath::new(path.to_owned()))
            .unwrap()
            .value()
            .unwrap()
    };
    assert_eq!(value("meshless_gi/dispatches/splat"), 1.0);
    assert_eq!(value("meshless_gi/dispatches/project"), 0.0);
    assert_eq!(value("meshless_gi/scenes/active"), 1.0);
    assert!(value("meshless_gi/buffers") > 10.0 && value("meshless_gi/pipelines") > 5.0);

    // After removal of a light the transport runs once.
    app.world_mut().despawn(light_sources[7]);
    run(&mut app, 1);
    assert!(counters(&app).dispatches_of(FrameStage::APPLY) > 0);
    run(&mut app, 1);
    assert_eq!(work(&counters(&app)), [0; 4]);
}

#[test]
fn app_without_scenes_has_no_gpu_resources() {
    let assert_no_gpu_resources = |app: &App, condition: &str| {
        let c = counters(app);
        assert!(c.frame > 0, "frames are counted");
        let found = (
            c.pipelines,
            c.buffers,
            c.bytes,
            c.active_scenes,
            c.dispatches.len(),
        );
        assert_eq!(found, (0, 0, 0, 0, 0), "{condition}: {}", c.plan);
    };
    let mut app = app();
    eight_lights(&mut app);
    let image = target(&mut app);
    let plain = app.world_mut().spawn(camera(&image, view())).id();
    run(&mut app, 2);
    assert_no_gpu_resources(&app, "no baked scene");

    let root = spawn_room(&mut app, Transform::IDENTITY);
    run(&mut app, 2);
    assert_no_gpu_resources(&app, "a camera without the component");

    app.world_mut().entity_mut(plain).insert((
        GiCamera::default(),
        Transform::from_xyz(0.0, 0.0, 30.0).looking_to(Vec3::Z, Vec3::Y),
    ));
    run(&mut app, 2);
    assert_no_gpu_resources(&app, "the scene is behind the camera");

    app.world_mut().entity_mut(root).insert(Visibility::Hidden);
    app.world_mut().entity_mut(plain).insert(view());
    run(&mut app, 2);
    assert_no_gpu_resources(&app, "the scene is hidden");

    app.world_mut()
        .entity_mut(root)
        .insert((Visibility::Inherited, GiScene(Handle::default())));
    run(&mut app, 2);
    assert_no_gpu_resources(&app, "the asset is not loaded");

    // After the asset is loaded, the scene has buffers and pipelines. A scene that is hidden for a
    // few frames keeps them. A despawned scene frees them.
    let (_, bake) = cornell();
    let asset = app
        .world_mut()
        .resource_mut::<Assets<GiBakedScene>>()
        .add(GiBakedScene { scene: bake });
    app.world_mut().entity_mut(root).insert(GiScene(asset));
    run(&mut app, 2);
    let shown = counters(&app);
    assert!(
        shown.pipelines > 0 && shown.buffers > 0 && shown.active_scenes == 1,
        "{}",
        shown.plan
    );
    app.world_mut()
        .resource_mut::<bevy_meshless_gi::GiSettings>()
        .unload_after_frames = 3;
    app.world_mut().entity_mut(root).insert(Visibility::Hidden);
    run(&mut app, 1);
    assert!(counters(&app).buffers > 0, "buffers stay for a while");
    run(&mut app, 2);
    app.world_mut()
        .entity_mut(root)
        .insert(Visibility::Inherited);
    run(&mut app, 1);
    assert!(counters(&app).active_scenes == 1);
    app.world_mut().despawn(root);
    run(&mut app, 1);
    assert_no_gpu_resources(&app, "the scene was despawned");
}

#[test]
fn new_bake_replaces_old_in_next_frame() {
    let mut app = app();
    let (room, bake) = cornell();
    let root = spawn_room(&mut app, Transform::IDENTITY);
    let image = target(&mut app);
    app.world_mut().spawn((camera(&image, view()), indirect()));
    let position = Vec3::new(0.0, 1.6, 0.2);
    app.world_mut()
        .spawn((bevy_light(), Transform::from_translation(position)));
    run(&mut app, 3);
    let old = picture(&mut app, &image);

    // A bake of the same room with darker walls replaces the asset of the same handle. The drawn
    // surfaces are unchanged.
    let darker = room.recolored(|c| 0.5 * c).bake(2);
    let handle = app.world().get::<GiScene>(root).unwrap().0.clone();
    let asset = GiBakedScene {
        scene: darker.clone(),
    };
    app.world_mut()
        .resource_mut::<Assets<GiBakedScene>>()
        .insert(&handle, asset)
        .expect("the handle is valid");
    run(&mut app, 1);
    let first = counters(&app);
    assert_eq!(
        (
            first.dispatches_of(FrameStage::UPLOAD),
            first.projected_slots
        ),
        (1, 1),
        "{}",
        first.plan
    );
    run(&mut app, 1);
    assert_eq!(counters(&app).dispatches_of(FrameStage::UPLOAD), 0);
    let new = picture(&mut app, &image);
    assert!(
        new.mean() < 0.6 * old.mean(),
        "{} after {}",
        new.mean(),
        old.mean()
    );
    let cpu = cpu_indirect(
        &room,
        &darker,
        Transform::IDENTITY,
        view(),
        &[light_source(position)],
        &settings(),
    );
    assert_pictures_match("baked_again", &cpu, &new);
    let before = cpu_indirect(
        &room,
        &bake,
        Transform::IDENTITY,
        view(),
        &[light_source(position)],
        &settings(),
    );
    assert_pictures_match("baked_before", &before, &old);
}

/// Returns the mean of 4 × 4 pixels in the middle.
fn middle(p: &Picture) -> [f32; 3] {
    let mut sum = [0.0; 3];
    let (w, h) = (p.width, p.height);
    for y in h / 2 - 2..h / 2 + 2 {
        for x in w / 2 - 2..w / 2 + 2 {
            for (sum, value) in sum.iter_mut().zip(p.pixels[y * w + x]) {
                *sum += value / 16.0;
            }
        }
    }
    sum
}

#[test]
fn white_wall_under_sky_matches_bevy_light() {
    let mut app = app();
    let room = Room::wall(0.8);
    // A uniform sky of radiance L in front of the wall has the irradiance E = πL. A light of πL lux
    // along the normal has the same irradiance.
    let radiance = 700.0;
    let bake = meshless_gi::Recipe {
        viewpoints: vec![[0.0, 0.0, 1.0]],
        coarse_radius: Some(0.5),
        levels: Some(2),
        rays_per_point: Some(1024),
        ..default()
    };
    let bake = room.bake_as(&bake);
    let asset = app
        .world_mut()
        .resource_mut::<Assets<GiBakedScene>>()
        .add(GiBakedScene { scene: bake });
    let sky = GiEnvironment {
        sky: GiSky::Uniform(LinearRgba::rgb(radiance, radiance, radiance)),
        ..default()
    };
    let root = app
        .world_mut()
        .spawn((GiScene(asset), sky, Transform::IDENTITY))
        .id();
    room.spawn(&mut app, root);
    let image = target(&mut app);
    let front = Transform::from_xyz(0.0, 0.0, 3.0).looking_at(Vec3::ZERO, Vec3::Y);
    let camera_entity = app
        .world_mut()
        .spawn((camera(&image, front), GiCamera::default()))
        .id();
    run(&mut app, 3);
    let ours = middle(&picture(&mut app, &image));

    app.world_mut().entity_mut(camera_entity).insert(GiCamera {
        enabled: false,
        ..default()
    });
    app.world_mut().spawn((
        DirectionalLight {
            illuminance: PI * radiance,
            ..default()
        },
        Transform::default().looking_to(Vec3::NEG_Z, Vec3::Y),
    ));
    run(&mut app, 3);
    let bevys = middle(&picture(&mut app, &image));
    let predicted = crate::support::scenes::exposure() * 0.8 * radiance;
    println!("plugin {ours:?}, Bevy's {bevys:?}, predicted {predicted}");
    for c in 0..3 {
        assert!(
            (bevys[c] / predicted - 1.0).abs() < 0.01,
            "Bevy's light: {bevys:?}, predicted {predicted}"
        );
        assert!(
            (ours[c] / bevys[c] - 1.0).abs() < 0.02,
            "plugin {ours:?}, Bevy's {bevys:?}"
        );
    }
}

#[test]
fn bevy_light_units_match_for_every_light_type() {
    use meshless_gi::internals::frame::project::unshadowed;
    let mut app = app();
    let room = Room::wall(0.6);
    let root = app
        .world_mut()
        .spawn((Transform::IDENTITY, Visibility::default()))
        .id();
    room.spawn(&mut app, root);
    let image = target(&mut app);
    let front = Transform::from_xyz(0.0, 0.0, 3.0).looking_at(Vec3::ZERO, Vec3::Y);
    app.world_mut()
        .spawn((camera(&image, front), GiCamera::default()));
    let at = Vec3::new(0.0, 0.0, 1.5);
    let facing = Transform::from_translation(at).looking_at(Vec3::new(0.25, 0.0, 0.0), Vec3::Y);
    let (inner, outer) = (0.1, 0.5);
    type Spawn = Box<dyn Fn(&mut App) -> Entity>;
    let light_sources: [(Spawn, Light); 3] = [
        (
            Box::new(move |app| {
                let light_source = PointLight {
                    range: 2.0,
                    ..bevy_light()
                };
                app.world_mut()
                    .spawn((light_source, Transform::from_translation(at)))
                    .id()
            }),
            Light::Point {
                position: at,
                intensity: Vec3::splat(CANDELA),
                range: 2.0,
            },
        ),
        (
            Box::new(move |app| {
                let light_source = SpotLight {
                    intensity: CANDELA * 4.0 * PI,
                    range: 20.0,
                    inner_angle: inner,
                    outer_angle: outer,
                    ..default()
                };
                app.world_mut().spawn((light_source, facing)).id()
            }),
            Light::Spot {
                position: at,
                direction: facing.forward().as_vec3(),
                intensity: Vec3::splat(CANDELA),
                inner,
                outer,
                range: 20.0,
            },
        ),
        (
            Box::new(|app| {
                let light_source = DirectionalLight {
                    illuminance: 900.0,
                    ..default()
                };
                app.world_mut()
                    .spawn((
                        light_source,
                        Transform::default().looking_to(Vec3::NEG_Z, Vec3::Y),
                    ))
                    .id()
            }),
            Light::Directional {
                direction: Vec3::NEG_Z,
                irradiance: Vec3::splat(900.0),
            },
        ),
    ];
    for (spawn, light) in &light_sources {
        let entity = spawn(&mut app);
        run(&mut app, 3);
        let bevys = middle(&picture(&mut app, &image));
        let ours = FrameLight::expand(light, 1)[0];
        let e = ours.color[0] * unshadowed(&ours, Vec3::ZERO, Vec3::Z);
        let predicted = crate::support::scenes::exposure() * 0.6 * e / PI;
        println!("{light:?}: Bevy's {bevys:?}, predicted {predicted}");
        assert!(
            e > 10.0 && (bevys[0] / predicted - 1.0).abs() < 0.01,
            "{light:?}: Bevy's {bevys:?}, predicted {predicted}"
        );
        app.world_mut().despawn(entity);
    }
}

#[test]
fn double_counting_warns_once() {
    let mut app = app();
    app.insert_resource(GlobalAmbientLight::default());
    spawn_room(&mut app, Transform::IDENTITY);
    let image = target(&mut app);
    let camera_entity = app
        .world_mut()
        .spawn((camera(&image, view()), GiCamera::default()))
        .id();
    run(&mut app, 2);
    assert_eq!(
        app.world().resource::<GiWarnings>().0,
        [GiWarning::GlobalAmbient]
    );
    app.insert_resource(GlobalAmbientLight::NONE);
    app.world_mut()
        .entity_mut(camera_entity)
        .insert(AmbientLight::default());
    run(&mut app, 2);
    let found = &app.world().resource::<GiWarnings>().0;
    assert_eq!(found, &[GiWarning::GlobalAmbient, GiWarning::CameraAmbient]);
    assert!(
        found.iter().all(|f| f.message().contains("brightness")
            || f.message().contains("GlobalAmbientLight::NONE"))
    );
}

#[test]
fn two_baked_scenes_add_up_in_one_camera() {
    let mut app = app();
    let (room, bake) = cornell();
    let roots = [-1.4, 1.4]
        .map(|x| Transform::from_xyz(x, 0.0, 0.0).with_rotation(Quat::from_rotation_y(0.2 * x)));
    for root in roots {
        spawn_room(&mut app, root);
    }
    let image = target(&mut app);
    let far = Transform::from_xyz(0.05, 1.1, 6.5).looking_at(Vec3::new(0.0, 1.0, 0.0), Vec3::Y);
    app.world_mut().spawn((camera(&image, far), indirect()));
    // One light in each room. Each bake contains only its own walls and receives both lights.
    let positions = roots.map(|root| root.transform_point(Vec3::new(0.1, 1.5, 0.4)));
    for position in positions {
        app.world_mut()
            .spawn((bevy_light(), Transform::from_translation(position)));
    }
    run(&mut app, 1);
    let first = counters(&app);
    assert_eq!(
        (first.active_scenes, first.projected_slots),
        (2, 4),
        "{}",
        first.plan
    );
    run(&mut app, 2);
    let rest = counters(&app);
    assert_eq!(
        (
            rest.dispatches_of(FrameStage::SPLAT),
            rest.dispatches_of(FrameStage::COMPOSITE)
        ),
        (2, 1),
        "{}",
        rest.plan
    );
    let [left, right] = roots.map(|root| {
        cpu_indirect(
            &room,
            &bake,
            root,
            far,
            &positions.map(light_source),
            &settings(),
        )
    });
    assert_pictures_match("two_scenes", &left.plus(&right), &picture(&mut app, &image));
}

#[test]
fn side_by_side_views_on_one_target_are_separate() {
    let mut app = app();
    let (room, bake) = cornell();
    spawn_room(&mut app, Transform::IDENTITY);
    let image = target(&mut app);
    let half = WIDTH / 2;
    let views = [
        view(),
        Transform::from_xyz(0.8, 1.2, 4.5).looking_at(Vec3::new(0.1, 0.9, 0.0), Vec3::Y),
    ];
    for (i, at) in views.into_iter().enumerate() {
        let camera_entity = app.world_mut().spawn((camera(&image, at), indirect())).id();
        let mut camera_entity = app.world_mut().entity_mut(camera_entity);
        let mut camera = camera_entity.get_mut::<Camera>().unwrap();
        camera.order = i as isize;
        camera.viewport = Some(bevy::camera::Viewport {
            physical_position: UVec2::new(i as u32 * half, 0),
            physical_size: UVec2::new(half, HEIGHT),
            ..default()
        });
        if i > 0 {
            camera.clear_color = ClearColorConfig::None;
        }
    }
    let position = Vec3::new(0.2, 1.5, 0.4);
    app.world_mut()
        .spawn((bevy_light(), Transform::from_translation(position)));
    run(&mut app, 3);
    let both = picture(&mut app, &image);
    for (i, at) in views.into_iter().enumerate() {
        let cpu = cpu_indirect_sized(
            &room,
            &bake,
            Transform::IDENTITY,
            at,
            &[light_source(position)],
            &settings(),
            [half, HEIGHT],
        );
        assert_pictures_match(
            &format!("half_{i}"),
            &cpu,
            &both.columns(i * half as usize, half as usize),
        );
    }
}

#[test]
fn every_light_type_is_extracted_and_can_opt_out() {
    let mut app = app();
    let (room, bake) = cornell();
    spawn_room(&mut app, Transform::IDENTITY);
    let image = target(&mut app);
    let camera_entity = app
        .world_mut()
        .spawn((camera(&image, view()), indirect()))
        .id();
    let aimed = Transform::from_xyz(0.4, 1.7, 0.7).looking_at(Vec3::new(-0.8, 0.3, -0.4), Vec3::Y);
    let sun = Transform::default().looking_to(Vec3::new(-0.3, -0.4, -1.0), Vec3::Y);
    let panel = Transform::from_xyz(0.3, 1.9, 0.2).looking_to(Vec3::NEG_Y, Vec3::Z);
    let (lumens, lux) = (30_000.0, 800.0);
    let spot = SpotLight {
        intensity: CANDELA * 4.0 * PI,
        range: 20.0,
        inner_angle: 0.2,
        outer_angle: 0.6,
        ..default()
    };
    let directional = DirectionalLight {
        illuminance: lux,
        color: Color::linear_rgb(1.0, 0.9, 0.7),
        ..default()
    };
    let rect = RectLight {
        intensity: lumens,
        width: 0.6,
        height: 0.4,
        ..default()
    };
    app.world_mut().spawn((spot, aimed));
    app.world_mut().spawn((directional, sun));
    app.world_mut().spawn((rect, panel));
    // Two excluded lights: one for direct light only, and a hidden one.
    let only_direct = GiLight {
        enabled: false,
        ..default()
    };
    app.world_mut().spawn((
        bevy_light(),
        only_direct,
        Transform::from_xyz(0.0, 1.0, 0.5),
    ));
    app.world_mut().spawn((
        bevy_light(),
        Visibility::Hidden,
        Transform::from_xyz(0.0, 1.0, 0.5),
    ));
    let lights = [
        Light::Spot {
            position: aimed.translation,
            direction: aimed.forward().as_vec3(),
            intensity: Vec3::splat(CANDELA),
            inner: 0.2,
            outer: 0.6,
            range: 20.0,
        },
        Light::Directional {
            direction: sun.forward().as_vec3(),
            irradiance: lux * Vec3::new(1.0, 0.9, 0.7),
        },
        Light::Rect {
            center: panel.translation,
            u: panel.rotation * Vec3::X * 0.3,
            v: panel.rotation * Vec3::NEG_Y * 0.2,
            radiance: Vec3::splat(lumens / (0.24 * PI)),
        },
    ];
    run(&mut app, 3);
    let cpu = cpu_indirect(
        &room,
        &bake,
        Transform::IDENTITY,
        view(),
        &lights,
        &settings(),
    );
    assert_pictures_match("lights", &cpu, &picture(&mut app, &image));
    for i in 0..lights.len() {
        let mut fewer = lights.to_vec();
        fewer.remove(i);
        let without = cpu_indirect(
            &room,
            &bake,
            Transform::IDENTITY,
            view(),
            &fewer,
            &settings(),
        );
        assert!(
            without.nrmse(&cpu) > 0.03,
            "light {i} shows: {}",
            without.nrmse(&cpu)
        );
    }

    // The debug view shows irradiance on white surfaces.
    app.world_mut()
        .get_mut::<GiCamera>(camera_entity)
        .unwrap()
        .debug_view = GiDebugView::Irradiance;
    run(&mut app, 1);
    let white = cpu_indirect(
        &room.recolored(|_| Vec3::ONE),
        &bake,
        Transform::IDENTITY,
        view(),
        &lights,
        &settings(),
    );
    assert_pictures_match("irradiance", &white, &picture(&mut app, &image));
}

#[test]
fn coefficients_are_read_back_only_for_gizmos() {
    use bevy::gizmos::config::GizmoConfigStore;
    let mut app = app();
    let (_, bake) = cornell();
    let root = spawn_room(&mut app, Transform::IDENTITY);
    let image = target(&mut app);
    app.world_mut()
        .spawn((camera(&image, view()), GiCamera::default()));
    let position = Vec3::new(0.2, 1.5, 0.4);
    app.world_mut()
        .spawn((bevy_light(), Transform::from_translation(position)));
    run(&mut app, 3);
    let plain = picture(&mut app, &image);
    let back = |app: &App| app.world().resource::<SharedCoefficients>().get(root);
    assert!(back(&app).is_none());
    assert_eq!(counters(&app).dispatches_of(FrameStage::READ_BACK), 0);

    let show = |app: &mut App, on: bool| {
        let mut store = app.world_mut().resource_mut::<GizmoConfigStore>();
        let (config, group) = store.config_mut::<GiGizmos>();
        (config.enabled, config.depth_bias) = (on, -1.0);
        (group.points, group.coefficients, group.size) = (false, true, 0.3);
    };
    show(&mut app, true);
    run(&mut app, 5);
    let values = back(&app).expect("they have arrived");
    let mut frame = CpuFrame::new(&bake);
    frame.set_lights(&bake, &FrameLight::expand(&light_source(position), 1));
    frame.solve(&bake, &settings());
    assert_eq!(values.len(), bake.data().points.len());
    let largest = values.iter().copied().fold(0.0, f32::max);
    for (i, v) in frame
        .vector_irradiance()
        .iter()
        .enumerate()
        .filter(|(i, _)| bake.data().operator.rows[*i].tier != 0)
    {
        let size: f32 = [v.x, v.y, v.z]
            .iter()
            .flat_map(|axis| &axis[..3])
            .map(|c| c * c)
            .sum::<f32>()
            .sqrt();
        assert!(
            (size - values[i]).abs() < 1e-3 * largest,
            "point {i}: {} came back, {size} on the CPU",
            values[i]
        );
    }
    let dots = picture(&mut app, &image);
    save_picture("dots", &plain.beside(&dots));
    let green = |p: &Picture| {
        p.pixels
            .iter()
            .filter(|[r, g, b]| *g > 0.8 && *r < 0.3 && *b < 0.3)
            .count()
    };
    assert!(
        green(&dots) > 50 && green(&plain) == 0,
        "{} green pixels",
        green(&dots)
    );

    show(&mut app, false);
    run(&mut app, 2);
    assert_eq!(counters(&app).dispatches_of(FrameStage::READ_BACK), 0);
}
