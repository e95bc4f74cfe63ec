//! Changes by a game in the running plugin: switched lights, render layers, textures, resized
//! targets, added and removed entities, and camera requirements.

use crate::support::app::{HEIGHT, WIDTH, app, camera, create_target_image, picture, run, target};
use crate::support::flip::flip;
use crate::support::scenes::{cornell, cpu_indirect, cpu_indirect_sized, cpu_indirect_textured};
use crate::support::stage::{
    CANDELA, MAX, assert_pictures_match, bevy_light, counters, indirect, light_source,
    room_and_camera, settings, spawn_light_source, spawn_room, view, work,
};
use bevy::asset::RenderAssetUsages;
use bevy::camera::visibility::RenderLayers;
use bevy::camera::{Exposure, Hdr, RenderTarget};
use bevy::core_pipeline::prepass::{DeferredPrepass, DepthPrepass, NormalPrepass};
use bevy::core_pipeline::tonemapping::Tonemapping;
use bevy::prelude::*;
use bevy::render::render_resource::{Extent3d, TextureDimension, TextureFormat};
use bevy_meshless_gi::internals::plan::FrameStage;
use bevy_meshless_gi::internals::plugin::SharedCoefficients;
use bevy_meshless_gi::prelude::*;
use bevy_meshless_gi::{GiGizmos, GiSettings, GiWarning, GiWarnings};
use meshless_gi::Light;

fn cpu(lights: &[Light]) -> crate::support::flip::Picture {
    let (room, bake) = cornell();
    let at = Transform::IDENTITY;
    cpu_indirect(&room, &bake, at, view(), lights, &settings())
}

#[test]
fn initially_dark_lights_are_projected_when_switched_on() {
    let mut app = app();
    let (_, _, image) = room_and_camera(&mut app);
    let positions = [
        Vec3::new(-0.5, 1.6, 0.3),
        Vec3::new(0.5, 1.5, 0.3),
        Vec3::new(0.0, 1.0, 0.7),
    ];
    let hidden = spawn_light_source(&mut app, positions[0]);
    app.world_mut()
        .entity_mut(hidden)
        .insert(Visibility::Hidden);
    let dim = spawn_light_source(&mut app, positions[1]);
    let lumens = bevy_light().intensity;
    let set = |app: &mut App, lumens| {
        app.world_mut()
            .get_mut::<PointLight>(dim)
            .unwrap()
            .intensity = lumens;
    };
    set(&mut app, 0.0);
    let far = spawn_light_source(&mut app, Vec3::new(0.0, 900.0, 0.0));
    run(&mut app, 3);
    assert_eq!(picture(&mut app, &image).mean(), 0.0, "all lights are dark");

    for (i, light_source) in [hidden, dim, far].into_iter().enumerate() {
        match i {
            0 => {
                app.world_mut()
                    .entity_mut(light_source)
                    .insert(Visibility::Visible);
            }
            1 => set(&mut app, lumens),
            _ => {
                let mut at = app.world_mut().get_mut::<Transform>(light_source).unwrap();
                at.translation = positions[2];
            }
        }
        run(&mut app, 1);
        let c = counters(&app);
        assert_eq!(c.projected_slots, 1, "light {i}: {}", c.plan);
        let lit: Vec<Light> = positions[..=i]
            .iter()
            .map(|p| crate::support::stage::light_source(*p))
            .collect();
        assert_pictures_match(
            &format!("switched_{i}"),
            &cpu(&lit),
            &picture(&mut app, &image),
        );
    }
}

#[test]
fn added_lights_grow_slots_and_project_only_new() {
    let mut app = app();
    let (_, _, image) = room_and_camera(&mut app);
    let position = |i: usize| {
        let (x, y, z) = ((i % 5) as f32, (i / 5 % 4) as f32, (i / 20) as f32);
        Vec3::new(0.35 * (x - 2.0), 1.2 + 0.2 * y, 0.25 * (z - 2.0))
    };
    let some = |app: &mut App, range: std::ops::Range<usize>| {
        range
            .map(|i| {
                let light_source = PointLight {
                    intensity: bevy_light().intensity / 20.0,
                    ..bevy_light()
                };
                let at = Transform::from_translation(position(i));
                app.world_mut().spawn((light_source, at)).id()
            })
            .collect::<Vec<_>>()
    };
    let light_sources = some(&mut app, 0..80);
    run(&mut app, 1);
    let first = counters(&app);
    assert_eq!(
        (
            first.projected_slots,
            first.dispatches_of(FrameStage::PROJECT)
        ),
        (80, 1),
        "{}",
        first.plan
    );
    let more = some(&mut app, 80..120);
    run(&mut app, 1);
    let c = counters(&app);
    assert_eq!(c.projected_slots, 40, "only the new ones: {}", c.plan);
    let dim = |p: Vec3| Light::Point {
        position: p,
        intensity: Vec3::splat(CANDELA / 20.0),
        range: 20.0,
    };
    let all: Vec<Light> = (0..120).map(|i| dim(position(i))).collect();
    assert_pictures_match("many_lights", &cpu(&all), &picture(&mut app, &image));

    // One light moves. Then all but three are despawned.
    let bytes = counters(&app).bytes;
    let to = Vec3::new(0.0, 0.4, 0.6);
    app.world_mut()
        .get_mut::<Transform>(light_sources[7])
        .unwrap()
        .translation = to;
    run(&mut app, 1);
    let c = counters(&app);
    assert_eq!(c.projected_slots, 1, "{}", c.plan);
    for light_source in light_sources[10..]
        .iter()
        .chain(&more)
        .chain(&light_sources[..7])
    {
        app.world_mut().despawn(*light_source);
    }
    run(&mut app, 1);
    let c = counters(&app);
    assert_eq!((c.projected_slots, c.bytes), (0, bytes), "{}", c.plan);
    let left = [dim(to), dim(position(8)), dim(position(9))];
    assert_pictures_match("three_lights", &cpu(&left), &picture(&mut app, &image));
}

#[test]
fn render_layers_select_cameras_and_lights() {
    let mut app = app();
    let (root, camera_entity, image) = room_and_camera(&mut app);
    let positions = [Vec3::new(-0.4, 1.6, 0.3), Vec3::new(0.5, 1.2, 0.5)];
    spawn_light_source(&mut app, positions[0]);
    let elsewhere = spawn_light_source(&mut app, positions[1]);
    app.world_mut()
        .entity_mut(elsewhere)
        .insert(RenderLayers::layer(3));
    run(&mut app, 1);
    let c = counters(&app);
    assert_eq!(c.projected_slots, 1, "{}", c.plan);
    assert_pictures_match(
        "one_layer",
        &cpu(&[light_source(positions[0])]),
        &picture(&mut app, &image),
    );

    let both = RenderLayers::from_layers(&[0, 3]);
    app.world_mut().entity_mut(root).insert(both);
    run(&mut app, 1);
    assert_eq!(counters(&app).projected_slots, 1);
    assert_pictures_match(
        "both_layers",
        &cpu(&positions.map(light_source)),
        &picture(&mut app, &image),
    );

    app.world_mut()
        .entity_mut(root)
        .insert(RenderLayers::layer(5));
    run(&mut app, 1);
    let c = counters(&app);
    assert_eq!(
        c.active_scenes, 0,
        "another layer than the camera's: {}",
        c.plan
    );
    app.world_mut()
        .entity_mut(camera_entity)
        .insert(RenderLayers::from_layers(&[0, 5]));
    run(&mut app, 1);
    assert_eq!(counters(&app).active_scenes, 1);
}

#[test]
fn root_moving_with_its_lights_runs_no_transport() {
    let mut app = app();
    let (root, ..) = room_and_camera(&mut app);
    for position in [Vec3::new(-0.4, 1.6, 0.3), Vec3::new(0.5, 1.2, 0.5)] {
        let light_source = spawn_light_source(&mut app, position);
        app.world_mut()
            .entity_mut(light_source)
            .insert(ChildOf(root));
    }
    run(&mut app, 2);
    for i in 1..20 {
        let mut at = app.world_mut().get_mut::<Transform>(root).unwrap();
        at.rotation = Quat::from_euler(EulerRot::YXZ, 0.05 * i as f32, 0.01 * i as f32, 0.02);
        at.translation.z = -0.1 * i as f32;
        run(&mut app, 1);
        let c = counters(&app);
        assert_eq!(work(&c), [0; 4], "turn {i}: {}", c.plan);
    }
}

#[test]
fn hidden_or_removed_scene_frees_memory() {
    let mut app = app();
    let (root, camera_entity, _) = room_and_camera(&mut app);
    let light_source = spawn_light_source(&mut app, Vec3::new(0.0, 1.6, 0.3));
    app.world_mut()
        .resource_mut::<GiSettings>()
        .unload_after_frames = 3;
    run(&mut app, 2);
    let shown = counters(&app);
    let gpu_resources = |app: &App| {
        let c = counters(app);
        (c.pipelines, c.buffers, c.bytes)
    };
    assert!(shown.pipelines > 0 && shown.buffers > 0 && shown.bytes > 0);

    for visibility in [Visibility::Hidden, Visibility::Inherited] {
        app.world_mut().entity_mut(root).insert(visibility);
        run(&mut app, 6);
        let held = gpu_resources(&app);
        match visibility {
            Visibility::Hidden => assert_eq!(held, (0, 0, 0), "{}", counters(&app).plan),
            _ => assert_eq!(held, (shown.pipelines, shown.buffers, shown.bytes)),
        }
    }

    // A despawned camera frees its parameters and textures in the next frame. The scene's buffers
    // are freed some frames after the last camera is gone.
    let image = target(&mut app);
    let second = app
        .world_mut()
        .spawn((camera(&image, view()), indirect()))
        .id();
    run(&mut app, 2);
    assert!(gpu_resources(&app).2 > shown.bytes);
    app.world_mut().despawn(second);
    run(&mut app, 1);
    assert_eq!(
        gpu_resources(&app),
        (shown.pipelines, shown.buffers, shown.bytes)
    );
    app.world_mut()
        .get_mut::<GiCamera>(camera_entity)
        .unwrap()
        .enabled = false;
    run(&mut app, 6);
    assert_eq!(gpu_resources(&app), (0, 0, 0), "no camera is enabled");
    app.world_mut()
        .get_mut::<GiCamera>(camera_entity)
        .unwrap()
        .enabled = true;
    run(&mut app, 1);
    assert_eq!(counters(&app).projected_slots, 1);
    app.world_mut().despawn(camera_entity);
    run(&mut app, 6);
    assert_eq!(gpu_resources(&app), (0, 0, 0), "the camera was despawned");

    // Read-back coefficients for gizmos are removed with the scene.
    app.world_mut().spawn((camera(&image, view()), indirect()));
    let mut store = app
        .world_mut()
        .resource_mut::<bevy::gizmos::config::GizmoConfigStore>();
    let (config, group) = store.config_mut::<GiGizmos>();
    (config.enabled, group.coefficients) = (true, true);
    run(&mut app, 5);
    let back = |app: &App| app.world().resource::<SharedCoefficients>().get(root);
    assert!(back(&app).is_some());
    app.world_mut().despawn(light_source);
    run(&mut app, 1);
    app.world_mut().despawn(root);
    run(&mut app, 1);
    assert_eq!(gpu_resources(&app), (0, 0, 0), "the scene was despawned");
    run(&mut app, 2);
    assert!(back(&app).is_none(), "the coefficients were removed");
}

#[test]
fn resized_target_matches_cpu_without_solve() {
    let mut app = app();
    let (_, _, image) = room_and_camera(&mut app);
    let position = Vec3::new(0.2, 1.5, 0.4);
    spawn_light_source(&mut app, position);
    run(&mut app, 3);
    assert_pictures_match(
        "before",
        &cpu(&[light_source(position)]),
        &picture(&mut app, &image),
    );
    let bytes = counters(&app).bytes;
    let (room, bake) = cornell();
    for [w, h] in [[96, 128], [160, 64]] {
        app.world_mut()
            .resource_mut::<Assets<Image>>()
            .insert(&image, create_target_image(w, h))
            .expect("the handle is valid");
        run(&mut app, 3);
        let resized = cpu_indirect_sized(
            &room,
            &bake,
            Transform::IDENTITY,
            view(),
            &[light_source(position)],
            &settings(),
            [w, h],
        );
        assert_pictures_match(
            &format!("resized_{w}"),
            &resized,
            &picture(&mut app, &image),
        );
        let c = counters(&app);
        assert_eq!(
            work(&c),
            [0; 4],
            "a change of the size needs no solve: {}",
            c.plan
        );
        let pixels = i64::from(w * h) - i64::from(WIDTH * HEIGHT);
        assert_eq!(c.bytes as i64 - bytes as i64, 8 * pixels);
    }
}

/// Creates an image of one texel.
fn texel(app: &mut App, rgba: [u8; 4], format: TextureFormat) -> Handle<Image> {
    let size = Extent3d {
        width: 1,
        height: 1,
        depth_or_array_layers: 1,
    };
    let usages = RenderAssetUsages::all();
    let image = Image::new_fill(size, TextureDimension::D2, &rgba, format, usages);
    app.world_mut().resource_mut::<Assets<Image>>().add(image)
}

#[test]
fn normal_maps_and_base_color_textures_are_used() {
    let mut app = app();
    let (room, bake) = cornell();
    let (_, _, image) = room_and_camera(&mut app);
    let position = Vec3::new(0.2, 1.5, 0.4);
    spawn_light_source(&mut app, position);

    let (bump, tint) = ([204, 128, 229, 255], [255, 128, 200, 255]);
    let normal_map = texel(&mut app, bump, TextureFormat::Rgba8Unorm);
    let color = texel(&mut app, tint, TextureFormat::Rgba8UnormSrgb);
    let mut materials = app.world_mut().resource_mut::<Assets<StandardMaterial>>();
    for (_, material) in materials.iter_mut() {
        material.normal_map_texture = Some(normal_map.clone());
        material.base_color_texture = Some(color.clone());
    }
    let mut meshes = app.world_mut().resource_mut::<Assets<Mesh>>();
    for (_, mesh) in meshes.iter_mut() {
        let Some(bevy::mesh::VertexAttributeValues::Float32x3(corners)) =
            mesh.attribute(Mesh::ATTRIBUTE_POSITION)
        else {
            continue;
        };
        let u = (Vec3::from(corners[1]) - Vec3::from(corners[0])).normalize();
        let uv = vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        mesh.insert_attribute(Mesh::ATTRIBUTE_UV_0, uv);
        mesh.insert_attribute(Mesh::ATTRIBUTE_TANGENT, vec![[u.x, u.y, u.z, 1.0]; 4]);
    }
    run(&mut app, 4);

    let bump = Vec3::from([bump[0], bump[1], bump[2]].map(|b| f32::from(b) / 127.5 - 1.0));
    let tint = Color::srgb_u8(tint[0], tint[1], tint[2]).to_linear();
    let tint = Vec3::new(tint.red, tint.green, tint.blue);
    let draw = |bumpy: bool, tinted: bool| {
        cpu_indirect_textured(
            &room,
            &bake,
            [Transform::IDENTITY, view()],
            &[light_source(position)],
            &settings(),
            [WIDTH, HEIGHT],
            |quad, mut surface| {
                let (u, v) = (quad.u.normalize(), quad.v.normalize());
                if bumpy {
                    surface.normal =
                        (bump.x * u + bump.y * v + bump.z * surface.normal).normalize();
                }
                if tinted {
                    surface.albedo *= tint;
                }
                surface
            },
        )
    };
    let both = draw(true, true);
    for other in [draw(false, true), draw(true, false)] {
        assert!(flip(&both, &other) > MAX, "each of them shows");
    }
    assert_pictures_match("textured", &both, &picture(&mut app, &image));
}

#[test]
fn indirect_light_precedes_transparency_and_tonemapping() {
    let mut app = app();
    let (_, camera_entity, image) = room_and_camera(&mut app);
    let position = Vec3::new(0.2, 1.5, 0.4);
    spawn_light_source(&mut app, position);
    // A pane of tinted glass in front of the camera.
    let (alpha, tint) = (0.4, [0.05, 0.1, 0.3]);
    let mesh = app
        .world_mut()
        .resource_mut::<Assets<Mesh>>()
        .add(Rectangle::new(4.0, 4.0));
    let glass = app
        .world_mut()
        .resource_mut::<Assets<StandardMaterial>>()
        .add(StandardMaterial {
            base_color: Color::LinearRgba(LinearRgba::new(tint[0], tint[1], tint[2], alpha)),
            alpha_mode: AlphaMode::Blend,
            unlit: true,
            ..default()
        });
    let pane = Transform::from_translation(Vec3::new(0.0, 1.0, 3.0));
    app.world_mut()
        .spawn((Mesh3d(mesh), MeshMaterial3d(glass), pane));
    run(&mut app, 4);
    let bare = cpu(&[light_source(position)]);
    let mut through = bare.clone();
    for pixel in &mut through.pixels {
        for (value, tint) in pixel.iter_mut().zip(tint) {
            *value = (1.0 - alpha) * *value + alpha * tint;
        }
    }
    assert_pictures_match("glass", &through, &picture(&mut app, &image));

    // Reinhard: x / (1 + x) of the sum, after the pane and after indirect light.
    app.world_mut()
        .entity_mut(camera_entity)
        .insert((Tonemapping::Reinhard, Exposure { ev100: 7.7 }));
    run(&mut app, 4);
    let mut mapped = bare.clone();
    let mut wrong = bare;
    for (pixel, wrong) in mapped.pixels.iter_mut().zip(&mut wrong.pixels) {
        for ((value, wrong), tint) in pixel.iter_mut().zip(wrong).zip(tint) {
            let sum = (1.0 - alpha) * 4.0 * *value + alpha * tint;
            *wrong = sum;
            *value = sum / (1.0 + sum);
        }
    }
    assert!(flip(&mapped, &wrong) > MAX, "tonemapping shows");
    assert_pictures_match("tonemapped", &mapped, &picture(&mut app, &image));
}

#[test]
fn gi_camera_adds_requirements_and_warns_on_removal() {
    let mut app = app();
    spawn_room(&mut app, Transform::IDENTITY);
    let image = target(&mut app);
    // `GiCamera` must override Bevy's default sample count.
    let camera_entity = app
        .world_mut()
        .spawn((camera(&image, view()), Msaa::Sample4, GiCamera::default()))
        .id();
    let entity = app.world().entity(camera_entity);
    assert!(
        entity.contains::<Hdr>()
            && entity.contains::<DepthPrepass>()
            && entity.contains::<NormalPrepass>()
            && entity.contains::<DeferredPrepass>()
    );
    assert_eq!(entity.get::<Msaa>(), Some(&Msaa::Off));
    assert!(matches!(
        entity.get::<RenderTarget>(),
        Some(RenderTarget::Image(_))
    ));
    run(&mut app, 2);
    assert_eq!(counters(&app).active_scenes, 1);
    assert_eq!(app.world().resource::<GiWarnings>().0, []);

    app.world_mut().entity_mut(camera_entity).remove::<Hdr>();
    run(&mut app, 2);
    let c = counters(&app);
    assert_eq!(c.active_scenes, 0, "{}", c.plan);
    assert_eq!(
        app.world().resource::<GiWarnings>().0,
        [GiWarning::NoGbuffer]
    );
}

#[test]
fn sky_emission_and_bounce_changes_skip_projection() {
    let mut app = app();
    let (root, _, image) = room_and_camera(&mut app);
    let position =
        Transform::from_xyz(0.2, 1.5, 0.4).looking_to(Vec3::new(-0.3, -0.4, -1.0), Vec3::Y);
    let sun = DirectionalLight {
        illuminance: 900.0,
        ..default()
    };
    let both = app.world_mut().spawn((bevy_light(), sun, position)).id();
    run(&mut app, 1);
    assert_eq!(counters(&app).projected_slots, 2);
    let lights = [
        light_source(position.translation),
        Light::Directional {
            direction: position.forward().as_vec3(),
            irradiance: Vec3::splat(900.0),
        },
    ];
    assert_pictures_match("two_lights", &cpu(&lights), &picture(&mut app, &image));
    app.world_mut()
        .entity_mut(both)
        .remove::<DirectionalLight>();
    run(&mut app, 1);
    assert_pictures_match("one_left", &cpu(&lights[..1]), &picture(&mut app, &image));

    let (room, bake) = cornell();
    let change = |app: &mut App, set: fn(&mut GiEnvironment, &mut GiSolver)| {
        let mut both = app
            .world_mut()
            .query::<(&mut GiEnvironment, &mut GiSolver)>();
        let (mut environment, mut solver) = both.get_mut(app.world_mut(), root).unwrap();
        set(&mut environment, &mut solver);
        run(app, 1);
        let c = counters(app);
        assert_eq!(c.projected_slots, 0, "{}", c.plan);
        assert!(c.dispatches_of(FrameStage::APPLY) > 0, "{}", c.plan);
    };
    change(&mut app, |_, s| s.bounces = GiBounceCount::Fixed(1));
    change(&mut app, |e, _| e.emissive_luminance = 0.0);
    change(&mut app, |e, _| {
        e.sky = GiSky::Uniform(LinearRgba::rgb(30.0, 40.0, 60.0));
    });
    let changed = meshless_gi::FrameSettings {
        sky: Vec3::new(30.0, 40.0, 60.0).into(),
        emission: 0.0,
        ..meshless_gi::FrameSettings::bounces(1)
    };
    let cpu = cpu_indirect(
        &room,
        &bake,
        Transform::IDENTITY,
        view(),
        &lights[..1],
        &changed,
    );
    assert_pictures_match("sky", &cpu, &picture(&mut app, &image));
}
