//! One bounce from dynamic objects in the running plugin: the cameras that draw the maps, their
//! layers, and the light that the bounce adds to the picture.

use crate::support::app::{app, camera, picture, run, target};
use crate::support::bounce::{Ball, DynamicObjects, cpu_bounce, cpu_specular, cpu_vpls};
use crate::support::flip::{Picture, flip};
use crate::support::scenes::{Room, cornell};
use crate::support::stage::{
    CANDELA, assert_pictures_match, counters, indirect, light_source, room_and_camera,
    save_picture, spawn_light_source, view, work,
};
use bevy::camera::visibility::RenderLayers;
use bevy::prelude::*;
use bevy_meshless_gi::internals::plan::FrameStage;
use bevy_meshless_gi::internals::plugin::FrameRecord;
use bevy_meshless_gi::prelude::*;
use bevy_meshless_gi::{GiRsmCamera, GiWarning, GiWarnings, SpecularSettings};
use meshless_gi::Light;
use std::f32::consts::PI;

fn spawn_ball(app: &mut App, ball: Ball) -> Entity {
    let mesh = Sphere::new(ball.radius).mesh().ico(20).unwrap();
    let mesh = app.world_mut().resource_mut::<Assets<Mesh>>().add(mesh);
    let [r, g, b] = ball.color.to_array();
    let material = app
        .world_mut()
        .resource_mut::<Assets<StandardMaterial>>()
        .add(StandardMaterial {
            base_color: Color::linear_rgb(r, g, b),
            perceptual_roughness: 1.0,
            reflectance: 0.0,
            ..default()
        });
    app.world_mut()
        .spawn((
            Mesh3d(mesh),
            MeshMaterial3d(material),
            Transform::from_translation(ball.center),
        ))
        .id()
}

/// Returns the number of map cameras, and the number of those that are active.
fn captures(app: &mut App) -> [usize; 2] {
    let mut cameras = app
        .world_mut()
        .query_filtered::<&Camera, With<GiRsmCamera>>();
    let all: Vec<bool> = cameras
        .iter(app.world())
        .map(|camera| camera.is_active)
        .collect();
    [all.len(), all.iter().filter(|a| **a).count()]
}

fn layers(app: &App, entity: Entity) -> Option<RenderLayers> {
    app.world().get::<RenderLayers>(entity).cloned()
}

const RED: Ball = Ball {
    center: Vec3::new(-0.4, 0.3, 0.3),
    radius: 0.25,
    color: Vec3::new(0.8, 0.02, 0.02),
};
const LIGHT_SOURCE: Vec3 = Vec3::new(0.0, 1.7, 0.4);

#[test]
fn rsm_cameras_follow_reflectors() {
    let mut app = app();
    room_and_camera(&mut app);
    let light_source = spawn_light_source(&mut app, LIGHT_SOURCE);
    run(&mut app, 2);
    let bare = counters(&app);
    let ball = spawn_ball(&mut app, RED);
    run(&mut app, 2);
    assert_eq!(captures(&mut app), [0, 0], "no light has the component");

    // A light with the component, and no reflector.
    app.world_mut()
        .entity_mut(light_source)
        .insert(GiReflectiveShadowMap::default());
    run(&mut app, 2);
    assert_eq!(captures(&mut app), [0, 0], "no reflector");
    let c = counters(&app);
    assert!(
        c.plan.to_string().contains("no dynamic objects"),
        "{}",
        c.plan
    );
    assert_eq!(
        (c.buffers, c.bytes, c.pipelines),
        (bare.buffers, bare.bytes, bare.pipelines),
        "a light without reflectors has no resources"
    );

    // The ball becomes a reflector. Its mesh has other render layers.
    let own = RenderLayers::from_layers(&[0, 3]);
    app.world_mut().entity_mut(ball).insert(own.clone());
    let parent = app.world_mut().spawn(Transform::default()).id();
    let parent_of = app
        .world_mut()
        .spawn((Transform::default(), ChildOf(parent)))
        .id();
    app.world_mut().entity_mut(ball).insert(ChildOf(parent_of));
    app.world_mut().entity_mut(parent).insert(GiReflector);
    run(&mut app, 2);
    assert_eq!(captures(&mut app), [1, 1]);
    assert_eq!(
        layers(&app, ball),
        Some(own.clone().with(GiRsmCamera::RENDER_LAYER))
    );
    assert_eq!(layers(&app, parent), None, "it has no mesh");
    let c = counters(&app);
    let ran = |c: &FrameRecord| c.plan.to_string().matches("run  rsm").count();
    assert_eq!(ran(&c), 1, "{}", c.plan);
    assert_eq!(work(&c), [0; 4], "the bake has no work: {}", c.plan);

    // A game that adds its components to all cameras also adds them to map cameras. These get no
    // view of indirect light, and no further cameras are spawned.
    let all: Vec<Entity> = app
        .world_mut()
        .query_filtered::<Entity, (With<Camera3d>, Without<GiCamera>)>()
        .iter(app.world())
        .collect();
    assert_eq!(all.len(), 1);
    app.world_mut()
        .entity_mut(all[0])
        .insert(GiCamera::default());
    run(&mut app, 3);
    assert_eq!(captures(&mut app), [1, 1]);
    let c = counters(&app);
    assert_eq!(
        c.plan.to_string().matches("run  composite").count(),
        1,
        "{}",
        c.plan
    );
    app.world_mut().entity_mut(all[0]).remove::<GiCamera>();

    // A mesh without frustum culling has no `Aabb` from Bevy. It bounces light too.
    app.world_mut()
        .entity_mut(ball)
        .remove::<bevy::camera::primitives::Aabb>()
        .insert(bevy::camera::visibility::NoFrustumCulling);
    run(&mut app, 2);
    assert_eq!(captures(&mut app), [1, 1]);

    // No map is drawn if the ball is out of range, the light is off, or no camera displays the
    // light.
    type Change = fn(&mut App, Entity, Entity, bool);
    let changes: [(&str, Change); 4] = [
        ("no dynamic object is in range", |app, ball, _, away| {
            let mut at = app.world_mut().get_mut::<Transform>(ball).unwrap();
            at.translation.x = if away { 1e4 } else { -0.4 };
        }),
        ("the light is off", |app, _, light_source, off| {
            let shown = if off {
                Visibility::Hidden
            } else {
                Visibility::Visible
            };
            app.world_mut().entity_mut(light_source).insert(shown);
        }),
        ("no dynamic objects", |app, ball, _, hidden| {
            let shown = if hidden {
                Visibility::Hidden
            } else {
                Visibility::Visible
            };
            app.world_mut().entity_mut(ball).insert(shown);
        }),
        ("no camera with indirect light", |app, _, _, off| {
            let mut cameras = app.world_mut().query::<&mut GiCamera>();
            for mut camera in cameras.iter_mut(app.world_mut()) {
                camera.enabled = !off;
            }
        }),
    ];
    for (why, change) in changes {
        change(&mut app, ball, light_source, true);
        run(&mut app, 2);
        assert_eq!(captures(&mut app), [1, 0], "{why}");
        let c = counters(&app);
        assert_eq!(ran(&c), 0, "{}", c.plan);
        assert!(c.plan.to_string().contains(why), "{why}: {}", c.plan);
        change(&mut app, ball, light_source, false);
        run(&mut app, 2);
        assert_eq!(captures(&mut app), [1, 1], "{why}");
    }

    // Removing the component restores the layers and releases everything.
    app.world_mut().entity_mut(parent).remove::<GiReflector>();
    run(&mut app, 2);
    assert_eq!(layers(&app, ball), Some(own), "the layers are restored");
    assert_eq!(captures(&mut app), [1, 0]);
    app.world_mut().entity_mut(ball).remove::<RenderLayers>();
    app.world_mut().entity_mut(ball).insert(GiReflector);
    run(&mut app, 2);
    assert_eq!(
        layers(&app, ball),
        Some(RenderLayers::from_layers(&[0, GiRsmCamera::RENDER_LAYER]))
    );
    app.world_mut().entity_mut(ball).remove::<GiReflector>();
    run(&mut app, 2);
    assert_eq!(layers(&app, ball), None, "the ball had no layers");
    app.world_mut()
        .entity_mut(light_source)
        .remove::<GiReflectiveShadowMap>();
    run(&mut app, 2);
    assert_eq!(captures(&mut app), [0, 0]);
    let c = counters(&app);
    assert_eq!(
        (c.buffers, c.bytes),
        (bare.buffers, bare.bytes),
        "all resources are released"
    );

    // Despawning the light removes its camera too.
    app.world_mut().entity_mut(ball).insert(GiReflector);
    app.world_mut()
        .entity_mut(light_source)
        .insert(GiReflectiveShadowMap::default());
    run(&mut app, 2);
    assert_eq!(captures(&mut app), [1, 1]);
    app.world_mut().despawn(light_source);
    run(&mut app, 2);
    assert_eq!(captures(&mut app), [0, 0]);
}

/// Spawns the room without a bake, a camera that shows reflected light alone, and a moving ball.
fn spawn_unbaked_room(app: &mut App) -> (Entity, Handle<Image>, Entity) {
    let root = app
        .world_mut()
        .spawn((Transform::IDENTITY, Visibility::Inherited))
        .id();
    Room::cornell().spawn(app, root);
    let image = target(app);
    // The twins evaluate every pixel.
    app.world_mut().spawn((camera(&image, view()), indirect()));
    let ball = spawn_ball(app, RED);
    app.world_mut().entity_mut(ball).insert(GiReflector);
    (root, image, ball)
}

/// Compares the dim light of a ball's bounce. Both pictures are scaled so that the mean of the
/// expected picture is 0.05.
#[track_caller]
fn assert_bounce_alike(name: &str, expected: &Picture, drawn: &Picture) {
    let brighter = 0.05 / expected.mean();
    assert!(brighter < 1e4, "{name}: the CPU's picture is dark");
    let bright = |p: &Picture| {
        let mut p = p.clone();
        p.pixels.iter_mut().flatten().for_each(|v| *v *= brighter);
        p
    };
    assert_pictures_match(name, &bright(expected), &bright(drawn));
}

fn room_and_ball(ball: Ball) -> DynamicObjects {
    DynamicObjects {
        quads: Room::cornell().0,
        balls: vec![ball],
    }
}

#[test]
fn every_light_type_reflects_off_ball_without_bake() {
    let mut app = app();
    let (_, image, ball) = spawn_unbaked_room(&mut app);
    run(&mut app, 2);
    assert_eq!(picture(&mut app, &image).mean(), 0.0, "no light yet");
    let requested = GiReflectiveShadowMap::default();
    let to_ball = |from: Vec3| Transform::from_translation(from).looking_at(RED.center, Vec3::Y);
    let spot_at = to_ball(Vec3::new(0.5, 1.5, 0.8));
    let sun_at = to_ball(Vec3::new(0.8, 2.3, 1.6));
    let lights = [
        ("point", light_source(LIGHT_SOURCE)),
        (
            "spot",
            Light::Spot {
                position: spot_at.translation,
                direction: spot_at.forward().as_vec3(),
                intensity: Vec3::splat(CANDELA),
                inner: 0.1,
                outer: 0.15,
                range: 20.0,
            },
        ),
        (
            "directional",
            Light::Directional {
                direction: sun_at.forward().as_vec3(),
                irradiance: Vec3::splat(2000.0),
            },
        ),
    ];
    let balls = DynamicObjects {
        balls: vec![RED],
        ..DynamicObjects::default()
    };
    for (name, light) in lights {
        let entity = match name {
            "point" => spawn_light_source(&mut app, LIGHT_SOURCE),
            "spot" => {
                let spot = SpotLight {
                    intensity: CANDELA * 4.0 * PI,
                    range: 20.0,
                    inner_angle: 0.1,
                    outer_angle: 0.15,
                    ..default()
                };
                app.world_mut().spawn((spot, spot_at)).id()
            }
            _ => {
                let sun = DirectionalLight {
                    illuminance: 2000.0,
                    ..default()
                };
                app.world_mut().spawn((sun, sun_at)).id()
            }
        };
        app.world_mut().entity_mut(entity).insert(requested.clone());
        run(&mut app, 3);
        let c = counters(&app);
        assert_eq!(captures(&mut app)[1], 1, "{name}");
        let ran = [
            FrameStage::RSM,
            FrameStage::SPLAT,
            FrameStage::VPL,
            FrameStage::COMPOSITE,
        ];
        let ran = ran.map(|s| c.dispatches_of(s));
        assert_eq!(ran, [2, 0, 1, 1], "{name}: texels and choice; {}", c.plan);
        let vpls = cpu_vpls(&balls, &light, &requested, None);
        let expected = cpu_bounce(&room_and_ball(RED), &vpls, None, view());
        let drawn = picture(&mut app, &image);
        println!("{name}: mean {} and {}", expected.mean(), drawn.mean());
        assert_bounce_alike(&format!("bounce_{name}"), &expected, &drawn);
        app.world_mut().despawn(entity);
        run(&mut app, 1);
    }
    // Two lights. Their maps use the same textures one after the other.
    let entity = spawn_light_source(&mut app, LIGHT_SOURCE);
    app.world_mut().entity_mut(entity).insert(requested.clone());
    let other = Vec3::new(-0.8, 0.9, 0.9);
    let second = spawn_light_source(&mut app, other);
    let few = GiReflectiveShadowMap {
        vpl_count: 32,
        ..requested.clone()
    };
    app.world_mut().entity_mut(second).insert(few.clone());
    run(&mut app, 3);
    assert_eq!(captures(&mut app)[1], 2);
    let c = counters(&app);
    let ran = [FrameStage::RSM, FrameStage::VPL].map(|s| c.dispatches_of(s));
    assert_eq!(ran, [4, 1], "{}", c.plan);
    let mut vpls = cpu_vpls(&balls, &light_source(LIGHT_SOURCE), &requested, None);
    vpls.extend(cpu_vpls(&balls, &light_source(other), &few, None));
    let expected = cpu_bounce(&room_and_ball(RED), &vpls, None, view());
    assert_bounce_alike("bounce_two", &expected, &picture(&mut app, &image));
    app.world_mut().despawn(second);

    // The ball moves. Its reflected light follows in the same frame.
    run(&mut app, 3);
    let moved = Ball {
        center: Vec3::new(-0.6, 0.9, 0.2),
        ..RED
    };
    *app.world_mut().get_mut::<Transform>(ball).unwrap() =
        Transform::from_translation(moved.center);
    let drawn = picture(&mut app, &image);
    let balls = DynamicObjects {
        balls: vec![moved],
        ..DynamicObjects::default()
    };
    let vpls = cpu_vpls(&balls, &light_source(LIGHT_SOURCE), &requested, None);
    let expected = cpu_bounce(&room_and_ball(moved), &vpls, None, view());
    assert_bounce_alike("bounce_moved", &expected, &drawn);
}

/// Returns the number of dispatches that read maps and that lit pixels in the last frame.
fn ran(app: &App) -> [u32; 2] {
    let c = counters(app);
    [FrameStage::RSM, FrameStage::VPL].map(|s| c.dispatches_of(s))
}

#[test]
fn static_reflector_is_not_redrawn_and_keeps_light() {
    let mut app = app();
    let (_, image, ball) = spawn_unbaked_room(&mut app);
    let requested = GiReflectiveShadowMap::default();
    let entity = spawn_light_source(&mut app, LIGHT_SOURCE);
    app.world_mut().entity_mut(entity).insert(requested.clone());
    run(&mut app, 3);
    assert_eq!(ran(&app), [2, 1]);
    let drawn = picture(&mut app, &image);
    run(&mut app, 20);
    assert_eq!(ran(&app), [0, 1]);
    assert!(counters(&app).plan.to_string().contains("nothing changed"));
    let idle = picture(&mut app, &image);
    assert!(drawn.mean() > 0.0 && idle.pixels == drawn.pixels);

    // Every change that can alter the maps redraws them in the same frame.
    type Change = fn(&mut App, Entity, Entity);
    let changes: [(&str, Change); 6] = [
        ("moved", |app, ball, _| {
            app.world_mut()
                .get_mut::<Transform>(ball)
                .unwrap()
                .translation
                .y += 0.01;
        }),
        ("recolored", |app, _, _| {
            let mut materials = app.world_mut().resource_mut::<Assets<StandardMaterial>>();
            let ids: Vec<_> = materials.ids().collect();
            for id in ids {
                materials.get_mut(id).unwrap().perceptual_roughness = 0.9;
            }
        }),
        ("hidden and shown", |app, ball, _| {
            app.world_mut().entity_mut(ball).insert(Visibility::Hidden);
            run(app, 1);
            app.world_mut().entity_mut(ball).insert(Visibility::Visible);
        }),
        ("the light moved", |app, _, light_source| {
            app.world_mut()
                .get_mut::<Transform>(light_source)
                .unwrap()
                .translation
                .x += 0.01;
        }),
        ("the light's color", |app, _, light_source| {
            app.world_mut()
                .get_mut::<PointLight>(light_source)
                .unwrap()
                .color = Color::WHITE.darker(0.1);
        }),
        ("more lights", |app, _, light_source| {
            app.world_mut()
                .get_mut::<GiReflectiveShadowMap>(light_source)
                .unwrap()
                .vpl_count = 64;
        }),
    ];
    for (name, change) in changes {
        change(&mut app, ball, entity);
        run(&mut app, 1);
        assert_eq!(ran(&app), [2, 1], "{name}");
        run(&mut app, 10);
        assert_eq!(ran(&app), [0, 1], "{name}");
    }
    let moved = picture(&mut app, &image);
    assert!(moved.pixels != drawn.pixels);

    // A new bake shadows the VPLs, so they are computed again.
    let (_, bake) = cornell();
    let asset = app
        .world_mut()
        .resource_mut::<Assets<GiBakedScene>>()
        .add(GiBakedScene { scene: bake });
    app.world_mut().spawn((GiScene(asset), Transform::IDENTITY));
    let mut woken = false;
    for _ in 0..4 {
        run(&mut app, 1);
        woken |= ran(&app)[0] > 0;
    }
    assert!(woken);
    run(&mut app, 20);
    assert_eq!(ran(&app)[0], 0);
}

#[test]
fn specular_shows_reflectors_to_cameras_with_setting() {
    const SMOOTH: [f32; 2] = [0.35, 1.0];
    const BRIGHT: f32 = 1e4;
    let mut app = app();
    let (_, image, ball) = spawn_unbaked_room(&mut app);
    let of_ball = app
        .world()
        .get::<MeshMaterial3d<StandardMaterial>>(ball)
        .unwrap()
        .id();
    let mut materials = app.world_mut().resource_mut::<Assets<StandardMaterial>>();
    let ids: Vec<_> = materials.ids().filter(|id| *id != of_ball).collect();
    for id in ids {
        let mut material = materials.get_mut(id).unwrap();
        [material.perceptual_roughness, material.reflectance] = SMOOTH;
    }
    let requested = GiReflectiveShadowMap {
        trace_shadows: false,
        ..default()
    };
    let entity = spawn_light_source(&mut app, LIGHT_SOURCE);
    app.world_mut().entity_mut(entity).insert(requested.clone());
    let mut bright = app.world_mut().get_mut::<PointLight>(entity).unwrap();
    bright.intensity *= BRIGHT;
    run(&mut app, 3);
    let without = picture(&mut app, &image);
    let before = counters(&app);
    assert_eq!(before.dispatches_of(FrameStage::VPL_SPECULAR), 0);
    let mut cameras = app.world_mut().query_filtered::<Entity, With<GiCamera>>();
    let eye = cameras.single(app.world()).unwrap();
    app.world_mut()
        .entity_mut(eye)
        // A small picture has few nodes.
        .insert(GiSpecular(SpecularSettings {
            coarsest_level: 2,
            radiance_threshold: 1e-4,
            ..default()
        }));
    run(&mut app, 2);
    let c = counters(&app);
    assert_eq!(
        c.dispatches_of(FrameStage::VPL_SPECULAR),
        3,
        "levels, pixels: {}",
        c.plan
    );
    assert!(
        c.plan
            .to_string()
            .contains("vpl_specular of the world in view"),
        "{}",
        c.plan
    );
    let with = picture(&mut app, &image);
    let balls = DynamicObjects {
        balls: vec![RED],
        ..DynamicObjects::default()
    };
    let bright = Light::Point {
        position: LIGHT_SOURCE,
        intensity: Vec3::splat(BRIGHT * CANDELA),
        range: 20.0,
    };
    let vpls = cpu_vpls(&balls, &bright, &requested, None);
    // The ball itself is rough.
    let mut gloss = with.clone();
    for (g, w) in gloss.pixels.iter_mut().zip(&without.pixels) {
        for c in 0..3 {
            g[c] -= w[c];
        }
    }
    let dark: Vec<bool> = (gloss.pixels.iter())
        .map(|g| g.iter().all(|v| v.abs() < 1e-9))
        .collect();
    assert!(dark.iter().filter(|d| !**d).count() * 4 > dark.len());
    let expected = |surface| {
        let mut expected = cpu_specular(&room_and_ball(RED), &vpls, view(), surface);
        for (pixel, dark) in expected.pixels.iter_mut().zip(&dark) {
            if *dark {
                *pixel = [0.0; 3];
            }
        }
        expected
    };
    let right = expected(SMOOTH);
    save_picture("gloss", &right.beside(&gloss));
    // The nodes are four pixels apart. The expected picture evaluates every pixel.
    let off = gloss.mean() / right.mean() - 1.0;
    let (d, nrmse) = (flip(&right, &gloss), gloss.nrmse(&right));
    println!("gloss: mean {off:+.4}, FLIP {d:.4}, NRMSE {nrmse:.4}");
    assert!(off.abs() < 0.03 && d < 0.03 && nrmse < 0.12);
    let rougher = expected([0.45, 1.0]);
    assert!(gloss.nrmse(&rougher) > 0.2, "{}", gloss.nrmse(&rougher));

    // Without VPLs, the specular pass does not run and its buffers are released.
    app.world_mut().despawn(entity);
    run(&mut app, 2);
    let c = counters(&app);
    assert_eq!(c.dispatches_of(FrameStage::VPL_SPECULAR), 0);
    assert!(
        c.buffers < before.buffers,
        "{} {}",
        c.buffers,
        before.buffers
    );
}

#[test]
fn fully_dynamic_scene_has_one_bounce() {
    let mut app = app();
    let (root, image, _) = spawn_unbaked_room(&mut app);
    app.world_mut().entity_mut(root).insert(GiReflector);
    let light_source_at = Vec3::new(0.3, 1.5, 0.5);
    let requested = GiReflectiveShadowMap {
        vpl_count: 256,
        ..default()
    };
    let entity = spawn_light_source(&mut app, light_source_at);
    app.world_mut().entity_mut(entity).insert(requested.clone());
    run(&mut app, 3);
    assert!(
        captures(&mut app)[1] > 1,
        "walls all around take several maps"
    );
    let drawn = picture(&mut app, &image);
    let all = room_and_ball(RED);
    let vpls = cpu_vpls(&all, &light_source(light_source_at), &requested, None);
    let expected = cpu_bounce(&all, &vpls, None, view());
    assert_pictures_match("bounce_dynamic", &expected, &drawn);
}

#[test]
fn reflectors_add_to_bake_and_are_shadowed_by_walls() {
    let mut app = app();
    let (_, bake) = cornell();
    let (root, eye, image) = room_and_camera(&mut app);
    let light_source_at = Vec3::new(-0.3, 1.2, 0.6);
    let entity = spawn_light_source(&mut app, light_source_at);
    // The light is bright enough for a visible bounce and visible shadows of a small ball.
    let bright = 100.0;
    let mut light_source = app.world_mut().get_mut::<PointLight>(entity).unwrap();
    light_source.intensity *= bright;
    let light = Light::Point {
        position: light_source_at,
        intensity: Vec3::splat(bright * CANDELA),
        range: 20.0,
    };
    // The ball is behind the block, so the block shadows its light.
    let behind = Ball {
        center: Vec3::new(-0.35, 0.3, -0.1),
        ..RED
    };
    let ball = spawn_ball(&mut app, behind);
    run(&mut app, 3);
    let baked = picture(&mut app, &image);
    let requested = GiReflectiveShadowMap::default();
    app.world_mut().entity_mut(entity).insert(requested.clone());
    run(&mut app, 2);
    let same = picture(&mut app, &image);
    assert!(
        baked.mean() > 0.01 && same.pixels == baked.pixels,
        "the picture without reflectors is unchanged"
    );

    app.world_mut().entity_mut(ball).insert(GiReflector);
    run(&mut app, 2);
    let c = counters(&app);
    assert_eq!(
        c.dispatches_of(FrameStage::RSM),
        3,
        "texels, shadows, choice: {}",
        c.plan
    );
    assert_eq!(work(&c), [0; 4], "{}", c.plan);
    let both = picture(&mut app, &image);
    let added = |p: &Picture| p.mean() - baked.mean();
    assert!(added(&both) > 0.0);
    // The bake is on another layer than the light. It still exists, but it is dark.
    let layers = [RenderLayers::layer(5), RenderLayers::from_layers(&[0, 5])];
    app.world_mut().entity_mut(root).insert(layers[0].clone());
    app.world_mut().entity_mut(eye).insert(layers[1].clone());
    run(&mut app, 2);
    let alone = picture(&mut app, &image);
    assert!(
        (alone.mean() / added(&both) - 1.0).abs() < 0.05,
        "the contributions add up"
    );
    let balls = DynamicObjects {
        balls: vec![behind],
        ..DynamicObjects::default()
    };
    let vpls = cpu_vpls(&balls, &light, &requested, Some(&bake));
    let seen = room_and_ball(behind);
    let expected = cpu_bounce(&seen, &vpls, Some(&bake), view());
    assert_bounce_alike("bounce_with_bake", &expected, &alone);
    let sum = |p: &Picture| {
        p.pixels
            .iter()
            .fold([0.0; 3], |s, c| [s[0] + c[0], s[1] + c[1], s[2] + c[2]])
    };
    let [r, g, _] = sum(&alone);
    assert!(r > 10.0 * g, "the light of a red ball is red: {r} to {g}");
    let open = cpu_bounce(&seen, &vpls, None, view());
    assert!(
        open.nrmse(&expected) > 0.06,
        "the block's shadow shows: {}",
        open.nrmse(&expected)
    );

    // Without shadows, the light passes through the block.
    let without_shadows = GiReflectiveShadowMap {
        trace_shadows: false,
        ..requested
    };
    app.world_mut()
        .entity_mut(entity)
        .insert(without_shadows.clone());
    run(&mut app, 2);
    let open = picture(&mut app, &image);
    let vpls = cpu_vpls(&balls, &light, &without_shadows, Some(&bake));
    let expected = cpu_bounce(&seen, &vpls, None, view());
    assert_bounce_alike("bounce_without_shadows", &expected, &open);
    app.world_mut().entity_mut(root).remove::<RenderLayers>();

    // Without the reflector, the picture equals the picture of the bake.
    app.world_mut().entity_mut(ball).remove::<GiReflector>();
    run(&mut app, 2);
    assert!(picture(&mut app, &image).pixels == baked.pixels);
    app.world_mut().entity_mut(eye).insert(GiCamera::default());
    app.world_mut().entity_mut(ball).insert(GiReflector);
    run(&mut app, 2);
    app.world_mut()
        .get_mut::<PointLight>(entity)
        .unwrap()
        .intensity /= bright;
    run(&mut app, 2);
    save_picture("bounce_lit", &picture(&mut app, &image));
}

#[test]
fn materials_without_indirect_light_warn_once() {
    use bevy::material::OpaqueRendererMethod;
    let mut app = app();
    let (.., ball) = spawn_unbaked_room(&mut app);
    run(&mut app, 2);
    let found = |app: &App| app.world().resource::<GiWarnings>().0.clone();
    assert_eq!(found(&app), [], "opaque and deferred");
    let mut change = |look: fn(&mut StandardMaterial)| {
        let material = app
            .world()
            .get::<MeshMaterial3d<StandardMaterial>>(ball)
            .unwrap()
            .0
            .clone();
        let mut materials = app.world_mut().resource_mut::<Assets<StandardMaterial>>();
        look(&mut materials.get_mut(&material).unwrap());
        run(&mut app, 2);
        found(&app)
    };
    let unlit = change(|m| (m.alpha_mode, m.unlit) = (AlphaMode::Blend, true));
    assert_eq!(unlit, [], "unlit materials need none");
    let cut_out = change(|m| (m.alpha_mode, m.unlit) = (AlphaMode::Mask(0.5), false));
    assert_eq!(cut_out, []);
    let forward = change(|m| m.opaque_render_method = OpaqueRendererMethod::Forward);
    assert_eq!(forward, [GiWarning::ForwardMaterial]);
    let blended = change(|m| m.alpha_mode = AlphaMode::Blend);
    let both = [GiWarning::ForwardMaterial, GiWarning::TransparentMaterial];
    assert_eq!(blended, both);
    assert_eq!(change(|m| m.alpha_mode = AlphaMode::Add), both, "once");
}
