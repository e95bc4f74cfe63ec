//! Subsplats in the running plugin, compared with the evaluation of every pixel. The pictures
//! match, fewer evaluations run, and the picture is stable along a camera path. Buffers are created
//! and released with the display setting.

use crate::support::app::{app, camera, create_target_image, picture, run};
use crate::support::flip::{Picture, flip};
use crate::support::stage::{
    assert_pictures_match, counters, indirect, save_picture, spawn_light_source, spawn_room, view,
};
use bevy::prelude::*;
use bevy_meshless_gi::internals::plan::FrameStage;
use bevy_meshless_gi::prelude::*;
use bevy_meshless_gi::{DepthTest, NormalTest, SubsplatSettings};

/// Size of the pictures in pixels, large enough for all levels.
const SIZE: UVec2 = UVec2::new(256, 192);
const LIGHT_SOURCE: Vec3 = Vec3::new(0.3, 1.7, 0.2);

/// Spawns the room with its light, and a camera at `at` with the display `display`.
fn spawn_room_and_camera(
    app: &mut App,
    at: Transform,
    display: GiSplatting,
) -> (Entity, Handle<Image>) {
    spawn_room(app, Transform::IDENTITY);
    spawn_light_source(app, LIGHT_SOURCE);
    eye(app, at, display)
}

fn eye(app: &mut App, at: Transform, display: GiSplatting) -> (Entity, Handle<Image>) {
    let image = create_target_image(SIZE.x, SIZE.y);
    let image = app.world_mut().resource_mut::<Assets<Image>>().add(image);
    let eye = app.world_mut().spawn((camera(&image, at), indirect())).id();
    app.world_mut().entity_mut(eye).insert(display);
    run(app, 2);
    (eye, image)
}

/// Returns the picture with the current display, the picture with `GiSplatting::PerPixel`, and the
/// number of evaluations of the first per pixel.
fn compare_displays(app: &mut App, eye: Entity, image: &Handle<Image>) -> (Picture, Picture, f32) {
    let display = *app.world().get::<GiSplatting>(eye).unwrap();
    let by = picture(app, image);
    run(app, 3);
    let counts = counters(app);
    let counts = counts.subsplats.values().next().expect("they are counted");
    assert_eq!(counts.pixels, SIZE.x * SIZE.y);
    let share = counts.total() as f32 / counts.pixels as f32;
    app.world_mut()
        .entity_mut(eye)
        .insert(GiSplatting::PerPixel);
    run(app, 2);
    let full = picture(app, image);
    assert!(counters(app).subsplats.is_empty());
    app.world_mut().entity_mut(eye).insert(display);
    run(app, 2);
    (by, full, share)
}

#[test]
fn subsplats_match_per_pixel_display() {
    let mut app = app();
    let (eye, image) = spawn_room_and_camera(&mut app, view(), GiSplatting::default());
    let (by, full, share) = compare_displays(&mut app, eye, &image);
    assert_pictures_match("subsplats", &full, &by);
    println!("{:.1} % of the pixels", 100.0 * share);
    // Edges have a large share in a small picture. docs/reports/subsplats.md has the figures of a
    // full screen.
    assert!(share < 0.35, "{share}");
    // Other tests: those of [N09], and coarser ones.
    let settings = SubsplatSettings::default();
    for (name, settings) in [
        (
            "minima",
            SubsplatSettings {
                coarsest_level: 6,
                depth: DepthTest::MinMax(0.05),
                normal: NormalTest::MinMax(0.3),
                radiance_threshold: f32::INFINITY,
                ..settings
            },
        ),
        (
            "derivatives",
            SubsplatSettings {
                depth: DepthTest::Derivative(0.05),
                normal: NormalTest::Curvature(0.3),
                ..settings
            },
        ),
    ] {
        app.world_mut()
            .entity_mut(eye)
            .insert(GiSplatting::Multiresolution(settings));
        run(&mut app, 2);
        let (by, full, share) = compare_displays(&mut app, eye, &image);
        println!("{name}: {:.1} % of the pixels", 100.0 * share);
        assert_pictures_match(name, &full, &by);
    }
    // Invalid settings are clamped to their range.
    let wild = SubsplatSettings {
        coarsest_level: 0,
        finest_level: 99,
        depth: DepthTest::Plane(f32::NAN),
        radiance_threshold: f32::NAN,
        min_similarity: 7.0,
        detail: -1.0,
        ..settings
    };
    app.world_mut()
        .entity_mut(eye)
        .insert(GiSplatting::Multiresolution(wild));
    run(&mut app, 2);
    let (by, full, _) = compare_displays(&mut app, eye, &image);
    assert_pictures_match("wild", &full, &by);
}

#[test]
fn subsplats_of_flat_view_evaluate_few_nodes() {
    let mut app = app();
    let at = Transform::from_xyz(0.1, 1.1, 0.6).looking_at(Vec3::new(0.1, 1.2, -1.0), Vec3::Y);
    let (eye, image) = spawn_room_and_camera(&mut app, at, GiSplatting::default());
    let (by, full, share) = compare_displays(&mut app, eye, &image);
    assert_pictures_match("flat", &full, &by);
    println!("{:.2} % of the pixels", 100.0 * share);
    // At least one of 64 pixels is evaluated.
    assert!(share < 0.08, "{share}");
}

#[test]
fn subsplats_along_camera_path_are_stable() {
    let mut app = app();
    let (eye, image) = spawn_room_and_camera(&mut app, view(), GiSplatting::default());
    let mut path = |display: GiSplatting| -> Vec<Picture> {
        app.world_mut().entity_mut(eye).insert(display);
        (0..6)
            .map(|k| {
                let mut at = app.world_mut().get_mut::<Transform>(eye).unwrap();
                at.translation = view().translation + Vec3::new(0.003, 0.001, -0.002) * k as f32;
                run(&mut app, 2);
                picture(&mut app, &image)
            })
            .collect()
    };
    let by = path(GiSplatting::default());
    let full = path(GiSplatting::PerPixel);
    let mean = full[0].mean();
    let mut max = 0.0f32;
    for (frames, reference) in by.windows(2).zip(full.windows(2)) {
        // Change of the subsplat error from one frame to the next. Only the camera moves.
        let change = |i: usize, c: usize| {
            let wrong = |f: usize| frames[f].pixels[i][c] - reference[f].pixels[i][c];
            (wrong(1) - wrong(0)).abs()
        };
        let count = reference[0].pixels.len();
        let sum: f32 = (0..count)
            .flat_map(|i| (0..3).map(move |c| (i, c)))
            .map(|(i, c)| change(i, c))
            .sum();
        let steady = sum / (3 * count) as f32 / mean;
        let between = flip(&frames[0], &frames[1]) - flip(&reference[0], &reference[1]);
        println!("{steady:.5} of the mean, FLIP between frames {between:+.5} above the reference");
        assert!(steady < 0.01 && between < 0.005, "{steady}, {between}");
        max = max.max(steady);
    }
    assert!(max > 0.0, "nothing was compared");
}

#[test]
fn reflector_with_subsplats_matches_per_pixel_display() {
    let mut app = app();
    let (eye, image) = spawn_room_and_camera(&mut app, view(), GiSplatting::default());
    let mesh = Sphere::new(0.25).mesh().ico(12).unwrap();
    let mesh = app.world_mut().resource_mut::<Assets<Mesh>>().add(mesh);
    let red = StandardMaterial {
        base_color: Color::linear_rgb(0.8, 0.02, 0.02),
        perceptual_roughness: 1.0,
        ..default()
    };
    let material = app
        .world_mut()
        .resource_mut::<Assets<StandardMaterial>>()
        .add(red);
    let position = Transform::from_xyz(-0.3, 0.3, 0.4);
    app.world_mut().spawn((
        Mesh3d(mesh),
        MeshMaterial3d(material),
        position,
        GiReflector,
    ));
    let mut light_sources = app.world_mut().query_filtered::<Entity, With<PointLight>>();
    let light_source = light_sources.single(app.world()).unwrap();
    let before = picture(&mut app, &image);
    app.world_mut()
        .entity_mut(light_source)
        .insert(GiReflectiveShadowMap::default());
    run(&mut app, 3);
    let (by, full, share) = compare_displays(&mut app, eye, &image);
    println!("{:.1} % of the pixels", 100.0 * share);
    assert_pictures_match("ball", &full, &by);
    let seen = by.nrmse(&before);
    println!("the bounce changes the picture by {seen}");
    assert!(seen > 0.005, "the ball's bounce is not visible: {seen}");
}

#[test]
fn subsplats_of_two_bakes_share_picture() {
    let mut app = app();
    spawn_room(&mut app, Transform::from_xyz(-1.3, 0.0, -1.0));
    spawn_room(
        &mut app,
        Transform::from_xyz(1.3, 0.0, -1.5).with_rotation(Quat::from_rotation_y(0.4)),
    );
    spawn_light_source(&mut app, Vec3::new(-1.1, 1.6, -0.7));
    spawn_light_source(&mut app, Vec3::new(1.2, 1.5, -1.3));
    let at = Transform::from_xyz(0.0, 1.2, 4.5).looking_at(Vec3::new(0.0, 1.0, -1.0), Vec3::Y);
    let (eye, image) = eye(&mut app, at, GiSplatting::default());
    let (by, full, share) = compare_displays(&mut app, eye, &image);
    println!("{:.1} % of the pixels", 100.0 * share);
    assert_pictures_match("two_bakes", &full, &by);
}

#[test]
fn subsplat_buffers_follow_display_setting() {
    let mut app = app();
    let (eye, image) = spawn_room_and_camera(&mut app, view(), GiSplatting::PerPixel);
    let full = counters(&app);
    assert_eq!(full.dispatches_of(FrameStage::SPLAT), 1);
    app.world_mut()
        .entity_mut(eye)
        .insert(GiSplatting::default());
    run(&mut app, 2);
    let by = counters(&app);
    assert!(by.buffers > full.buffers && by.bytes > full.bytes);
    assert!(by.dispatches_of(FrameStage::SPLAT) > 10, "{by:?}");
    app.world_mut()
        .entity_mut(eye)
        .insert(GiSplatting::PerPixel);
    run(&mut app, 2);
    let again = counters(&app);
    assert_eq!((again.buffers, again.bytes), (full.buffers, full.bytes));
    // A disabled camera holds no buffers.
    app.world_mut()
        .entity_mut(eye)
        .insert(GiSplatting::default());
    run(&mut app, 2);
    let mut settings = app.world_mut().get_mut::<GiCamera>(eye).unwrap();
    settings.enabled = false;
    run(&mut app, 2);
    let off = counters(&app);
    assert!(off.buffers < full.buffers && off.subsplats.is_empty());
    assert_eq!(off.dispatches_of(FrameStage::SPLAT), 0);
    save_picture("off", &picture(&mut app, &image));
}
