//! Invalid input of the running plugin: non-finite values, entities replaced in one frame, a
//! thousand lights, and settings changed at run time. Frames with invalid input can be dark. They
//! must not fail, and later frames must match the CPU.

use crate::support::app::{app, camera, picture, run};
use crate::support::flip::{Picture, flip};
use crate::support::scenes::{cornell, cpu_indirect};
use crate::support::stage::{
    CANDELA, MAX, assert_pictures_match, bevy_light, counters, indirect, light_source, lit_room,
    settings, spawn_room, view,
};
use bevy::camera::Hdr;
use bevy::gizmos::config::GizmoConfigStore;
use bevy::light::{EnvironmentMapLight, IrradianceVolume, LightProbe};
use bevy::pbr::DefaultOpaqueRendererMethod;
use bevy::prelude::*;
use bevy::render::camera::TemporalJitter;
use bevy_meshless_gi::internals::plan::FrameStage;
use bevy_meshless_gi::prelude::*;
use bevy_meshless_gi::{GiColorMode, GiGizmos, GiSettings, GiWarning, GiWarnings};
use meshless_gi::Light;

const LIGHT_POSITION: Vec3 = Vec3::new(0.2, 1.5, 0.4);

/// Spawns a room, a camera that shows indirect light only, its target, and a light at
/// [`LIGHT_POSITION`].
fn stage(app: &mut App) -> (Entity, Entity, Handle<Image>, Entity) {
    lit_room(app, LIGHT_POSITION)
}

fn cpu(lights: &[Light]) -> Picture {
    let (room, bake) = cornell();
    let at = Transform::IDENTITY;
    cpu_indirect(&room, &bake, at, view(), lights, &settings())
}

#[track_caller]
fn finite(p: &Picture, case: &str) {
    let wrong = p.pixels.iter().flatten().filter(|v| !v.is_finite()).count();
    assert_eq!(wrong, 0, "{case}: values that are not finite");
}

#[test]
fn invalid_values_do_not_affect_later_frames() {
    let mut app = app();
    let (root, _, image, light_entity) = stage(&mut app);
    run(&mut app, 2);
    let right = cpu(&[light_source(LIGHT_POSITION)]);
    assert_pictures_match("before", &right, &picture(&mut app, &image));

    type Set = fn(&mut PointLight, &mut Transform);
    let light_sources: [(&str, Set); 7] = [
        ("no range", |l, _| l.range = 0.0),
        ("a negative range", |l, _| l.range = -3.0),
        ("the largest range", |l, _| l.range = f32::MAX),
        ("a range of NaN", |l, _| l.range = f32::NAN),
        ("infinite intensity", |l, _| l.intensity = f32::INFINITY),
        ("a position of NaN", |_, t| t.translation.x = f32::NAN),
        ("infinite position", |_, t| t.translation.y = f32::INFINITY),
    ];
    for (case, set) in light_sources {
        let (mut light, mut at) = (bevy_light(), Transform::from_translation(LIGHT_POSITION));
        set(&mut light, &mut at);
        app.world_mut().entity_mut(light_entity).insert((light, at));
        run(&mut app, 2);
        finite(&picture(&mut app, &image), case);
    }
    let whole = (bevy_light(), Transform::from_translation(LIGHT_POSITION));
    app.world_mut().entity_mut(light_entity).insert(whole);
    run(&mut app, 1);
    assert_pictures_match("after_lights", &right, &picture(&mut app, &image));

    // Lights without a direction. They are hidden, because Bevy's renderer does not support visible
    // ones.
    let nowhere = (Transform::from_scale(Vec3::ZERO), Visibility::Hidden);
    let others = [
        app.world_mut()
            .spawn((DirectionalLight::default(), nowhere))
            .id(),
        app.world_mut().spawn((SpotLight::default(), nowhere)).id(),
        app.world_mut().spawn((RectLight::default(), nowhere)).id(),
    ];
    run(&mut app, 2);
    finite(&picture(&mut app, &image), "no direction");
    for other in others {
        app.world_mut().despawn(other);
    }

    let environment = GiEnvironment {
        sky: GiSky::Uniform(LinearRgba::rgb(f32::NAN, f32::INFINITY, -5.0)),
        emissive_luminance: f32::NAN,
    };
    let solver = GiSolver {
        bounces: GiBounceCount::Fixed(u32::MAX),
        color_mode: GiColorMode::Auto,
    };
    (app.world_mut().entity_mut(root)).insert((environment, solver));
    run(&mut app, 1);
    finite(&picture(&mut app, &image), "invalid lighting");
    app.world_mut()
        .entity_mut(root)
        .insert((GiEnvironment::default(), GiSolver::default()));
    run(&mut app, 1);
    assert_pictures_match("after_lighting", &right, &picture(&mut app, &image));
}

#[test]
fn root_with_invalid_transform_is_hidden_and_frees_memory() {
    let mut app = app();
    let (root, _, image, _) = stage(&mut app);
    app.world_mut()
        .resource_mut::<GiSettings>()
        .unload_after_frames = 2;
    run(&mut app, 2);
    assert!(counters(&app).buffers > 0);
    for scale in [0.0, f32::NAN] {
        app.world_mut().get_mut::<Transform>(root).unwrap().scale = Vec3::splat(scale);
        run(&mut app, 4);
        let c = counters(&app);
        assert_eq!((c.active_scenes, c.buffers), (0, 0), "{scale}: {}", c.plan);
    }
    app.world_mut().get_mut::<Transform>(root).unwrap().scale = Vec3::ONE;
    run(&mut app, 2);
    let again = picture(&mut app, &image);
    assert_pictures_match(
        "placed_again",
        &cpu(&[light_source(LIGHT_POSITION)]),
        &again,
    );
}

#[test]
fn respawned_roots_and_cameras_render_again() {
    let mut app = app();
    let (mut root, mut camera_entity, image, _) = stage(&mut app);
    run(&mut app, 2);
    let (bytes, pipelines) = (counters(&app).bytes, counters(&app).pipelines);
    for i in 0..6 {
        // Despawn and spawn occur in one frame.
        app.world_mut().despawn(root);
        root = spawn_room(&mut app, Transform::IDENTITY);
        run(&mut app, 1);
        let c = counters(&app);
        assert_eq!(
            (
                c.dispatches_of(FrameStage::UPLOAD),
                c.projected_slots,
                c.bytes
            ),
            (1, 1, bytes),
            "{i}: {}",
            c.plan
        );
        match i % 3 {
            0 => {
                app.world_mut().despawn(camera_entity);
                camera_entity = app
                    .world_mut()
                    .spawn((camera(&image, view()), indirect()))
                    .id();
            }
            1 => {
                app.world_mut()
                    .entity_mut(camera_entity)
                    .remove::<GiCamera>();
                run(&mut app, 1);
                let c = counters(&app);
                assert_eq!(c.dispatches.len(), 0, "{}", c.plan);
                app.world_mut().entity_mut(camera_entity).insert(indirect());
            }
            _ => {
                app.world_mut()
                    .get_mut::<Camera>(camera_entity)
                    .unwrap()
                    .is_active = false;
                run(&mut app, 1);
                let c = counters(&app);
                assert_eq!(c.dispatches.len(), 0, "{}", c.plan);
                app.world_mut()
                    .get_mut::<Camera>(camera_entity)
                    .unwrap()
                    .is_active = true;
            }
        }
        run(&mut app, 2);
        let c = counters(&app);
        assert_eq!(
            (c.bytes, c.pipelines),
            (bytes, pipelines),
            "{i}: {}",
            c.plan
        );
    }
    assert_pictures_match(
        "at_last",
        &cpu(&[light_source(LIGHT_POSITION)]),
        &picture(&mut app, &image),
    );
}

#[test]
fn thousand_lights_then_none_frees_slots() {
    let mut app = app();
    let (_, _, image, first) = stage(&mut app);
    app.world_mut().despawn(first);
    let position = |i: usize| {
        let (x, y, z) = ((i % 10) as f32, (i / 10 % 10) as f32, (i / 100) as f32);
        Vec3::new(0.16 * (x - 4.5), 1.0 + 0.09 * y, 0.7 * (z - 4.5) / 4.5)
    };
    let dim = PointLight {
        intensity: bevy_light().intensity / 300.0,
        ..bevy_light()
    };
    let light_sources: Vec<Entity> = (0..1000)
        .map(|i| {
            let at = Transform::from_translation(position(i));
            app.world_mut().spawn((dim, at)).id()
        })
        .collect();
    run(&mut app, 1);
    let c = counters(&app);
    assert_eq!(
        (c.projected_slots, c.dispatches_of(FrameStage::PROJECT)),
        (1000, 1),
        "{}",
        c.plan
    );
    let lights: Vec<Light> = (0..1000)
        .map(|i| Light::Point {
            position: position(i),
            intensity: Vec3::splat(CANDELA / 300.0),
            range: 20.0,
        })
        .collect();
    assert_pictures_match("thousand", &cpu(&lights), &picture(&mut app, &image));
    for light_source in light_sources {
        app.world_mut().despawn(light_source);
    }
    run(&mut app, 1);
    assert!(counters(&app).dispatches_of(FrameStage::APPLY) > 0);
    assert_eq!(picture(&mut app, &image).mean(), 0.0, "all lights are gone");
}

#[test]
fn failed_asset_allocates_nothing_and_can_be_replaced() {
    let mut app = app();
    let (root, _, image, _) = stage(&mut app);
    let missing = app
        .world()
        .resource::<AssetServer>()
        .load("there_is_no_such.mgi");
    let good = app.world().get::<GiScene>(root).unwrap().clone();
    app.world_mut().entity_mut(root).insert(GiScene(missing));
    run(&mut app, 10);
    let c = counters(&app);
    assert_eq!((c.pipelines, c.buffers), (0, 0), "{}", c.plan);
    app.world_mut().entity_mut(root).insert(good);
    run(&mut app, 2);
    assert_pictures_match(
        "replaced",
        &cpu(&[light_source(LIGHT_POSITION)]),
        &picture(&mut app, &image),
    );
}

#[test]
fn camera_that_regains_prepasses_renders_again() {
    let mut app = app();
    let (_, camera_entity, image, _) = stage(&mut app);
    run(&mut app, 2);
    app.world_mut().entity_mut(camera_entity).remove::<Hdr>();
    run(&mut app, 2);
    assert_eq!(counters(&app).active_scenes, 0);
    app.world_mut().entity_mut(camera_entity).insert(Hdr);
    run(&mut app, 3);
    let again = picture(&mut app, &image);
    assert_pictures_match("regained", &cpu(&[light_source(LIGHT_POSITION)]), &again);

    // Multisampling set at run time: Bevy removes it from a deferred camera.
    app.world_mut()
        .entity_mut(camera_entity)
        .insert(Msaa::Sample4);
    run(&mut app, 3);
    assert_eq!(app.world().get::<Msaa>(camera_entity), Some(&Msaa::Off));
    let again = picture(&mut app, &image);
    assert_pictures_match(
        "one_sample_again",
        &cpu(&[light_source(LIGHT_POSITION)]),
        &again,
    );
}

#[test]
fn jittered_camera_reconstructs_surface_positions() {
    let mut app = app();
    let (_, camera_entity, image, _) = stage(&mut app);
    run(&mut app, 2);
    // Horizontal shift by an eighth of the picture, much more than the jitter of antialiasing.
    let shift = 16;
    app.world_mut()
        .entity_mut(camera_entity)
        .insert(TemporalJitter {
            offset: Vec2::new(shift as f32, 0.0),
        });
    run(&mut app, 3);
    let jittered = picture(&mut app, &image);
    let still = cpu(&[light_source(LIGHT_POSITION)]);
    let width = still.width - shift;
    let (left, right) = (still.columns(0, width), still.columns(shift, width));
    let moved_right = jittered.columns(shift, width);
    let moved_left = jittered.columns(0, width);
    assert!(flip(&left, &right) > MAX, "the jitter shows");
    // The test accepts both signs of Bevy's jitter.
    if flip(&left, &moved_right) < flip(&right, &moved_left) {
        assert_pictures_match("jittered", &left, &moved_right);
    } else {
        assert_pictures_match("jittered", &right, &moved_left);
    }
}

#[test]
fn every_double_counting_is_reported() {
    let mut app = app();
    let (_, camera_entity, _, _) = stage(&mut app);
    run(&mut app, 1);
    let found = |app: &App| app.world().resource::<GiWarnings>().0.clone();
    assert_eq!(found(&app), []);
    // The images are not loaded yet. The warning does not wait for them.
    let pending = app.world().resource::<Assets<Image>>().reserve_handle();
    let map = || EnvironmentMapLight {
        diffuse_map: pending.clone(),
        specular_map: pending.clone(),
        intensity: 100.0,
        ..default()
    };
    app.world_mut().entity_mut(camera_entity).insert(map());
    run(&mut app, 1);
    assert_eq!(found(&app), [GiWarning::EnvironmentMap]);
    app.world_mut()
        .entity_mut(camera_entity)
        .remove::<EnvironmentMapLight>();
    app.world_mut()
        .spawn((LightProbe::default(), map(), Transform::IDENTITY));
    run(&mut app, 1);
    assert_eq!(found(&app)[1..], [GiWarning::LightProbe]);
    app.world_mut().spawn((
        LightProbe::default(),
        IrradianceVolume {
            voxels: pending.clone(),
            intensity: 100.0,
            ..default()
        },
        Transform::IDENTITY,
    ));
    app.insert_resource(DefaultOpaqueRendererMethod::forward());
    run(&mut app, 1);
    assert_eq!(
        found(&app)[2..],
        [GiWarning::IrradianceVolume, GiWarning::ForwardMaterials]
    );
    // All warnings are kept, and none is logged again.
    run(&mut app, 3);
    assert_eq!(found(&app).len(), 4);

    // With the check off, nothing is logged.
    let mut quiet = crate::support::app::app();
    quiet
        .world_mut()
        .resource_mut::<GiSettings>()
        .warn_double_counting = false;
    quiet.insert_resource(GlobalAmbientLight::default());
    stage(&mut quiet);
    run(&mut quiet, 2);
    assert_eq!(found(&quiet), []);
}

#[test]
fn gizmos_are_drawn_only_when_enabled() {
    let mut app = app();
    let (_, _, image, _) = stage(&mut app);
    let store = app.world().resource::<GizmoConfigStore>();
    let (config, group) = store.config::<GiGizmos>();
    assert!(!config.enabled, "off by default");
    assert_eq!(*group, GiGizmos::default());
    run(&mut app, 3);
    let plain = picture(&mut app, &image);

    let mut show = |set: &dyn Fn(&mut GiGizmos)| {
        let mut store = app.world_mut().resource_mut::<GizmoConfigStore>();
        let (config, group) = store.config_mut::<GiGizmos>();
        (config.enabled, config.depth_bias) = (true, -1.0);
        *group = GiGizmos {
            points: false,
            ..default()
        };
        set(group);
        run(&mut app, 2);
        picture(&mut app, &image)
    };
    let pure = |p: &Picture, channel: usize| {
        let of = |rgb: &&[f32; 3]| (0..3).all(|c| (rgb[c] > 0.9) == (c == channel));
        p.pixels.iter().filter(of).count()
    };
    let (red, blue) = (0, 2);
    assert_eq!((pure(&plain, red), pure(&plain, blue)), (0, 0));
    let nothing = show(&|_| ());
    assert_eq!((pure(&nothing, red), pure(&nothing, blue)), (0, 0));

    // All levels together are red and blue, the coarsest level is red. Crosses (points), strokes
    // (normals) and circles (radii) differ.
    let all = show(&|g| (g.points, g.size) = (true, 0.3));
    assert!(pure(&all, red) > 20 && pure(&all, blue) > 20);
    let coarsest = show(&|g| (g.points, g.size, g.level) = (true, 0.3, Some(0)));
    assert!(pure(&coarsest, red) > 20 && pure(&coarsest, blue) == 0);
    let normals = show(&|g| (g.normals, g.level) = (true, Some(0)));
    let radii = show(&|g| (g.radii, g.level) = (true, Some(0)));
    assert!(pure(&normals, red) > 20 && pure(&radii, red) > 100);
    assert!(normals != coarsest && radii != coarsest && radii != normals);
}
