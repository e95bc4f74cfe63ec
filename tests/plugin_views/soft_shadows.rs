//! Soft shadows in the running plugin: the light subtracted from Bevy's picture, its position, and
//! the frames in which it is computed. Compares with shadow rays at every pixel.

use crate::support::app::{HEIGHT, WIDTH, app, camera, create_target_image, picture, run, target};
use crate::support::bounce::DynamicObjects;
use crate::support::flip::Picture;
use crate::support::scenes::{Room, cornell, exposure};
use crate::support::stage::{counters, save_picture, view};
use bevy::camera::RenderTarget;
use bevy::prelude::*;
use bevy_meshless_gi::internals::plan::FrameStage;
use bevy_meshless_gi::internals::plugin::FrameRecord;
use bevy_meshless_gi::prelude::*;
use bevy_meshless_gi::{GiDebugView, GiWarning, GiWarnings};
use meshless_gi::internals::frame::project::extent;
use meshless_gi::internals::frame::soft_shadow::{self, RayVisibility};
use meshless_gi::internals::frame::subtract_shadow::{self, LitSurface, SubtractShadowParams};
use meshless_gi::internals::frame::{SoftLight, SplatParams, gbuffer, splat};
use meshless_gi::{BakedScene, Geometry, Recipe, VisibilityRecipe};
use meshless_gi_lab::accuracy::RaycastView;
use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI};
use std::sync::{Arc, OnceLock};

/// Returns the room with visibility at its points, baked once.
fn bake_with_visibility() -> Arc<BakedScene> {
    static BAKED: OnceLock<Arc<BakedScene>> = OnceLock::new();
    let bake = || {
        Room::cornell().bake_as(&Recipe {
            viewpoints: vec![[0.0, 1.0, 0.6]],
            coarse_radius: Some(0.45),
            levels: Some(4),
            sender_levels: Some(4),
            max_refinement_points: Some(1000),
            rays_per_point: Some(32),
            seed: 1,
            soft_shadows: Some(VisibilityRecipe::default()),
            ..Recipe::default()
        })
    };
    BAKED.get_or_init(bake).clone()
}

const LUMENS: f32 = 20_000.0;
const RANGE: f32 = 5.0;
const HALF: Vec2 = Vec2::new(0.3, 0.2);

fn panel() -> RectLight {
    RectLight {
        intensity: LUMENS,
        color: Color::linear_rgb(1.0, 0.9, 0.6),
        width: 2.0 * HALF.x,
        height: 2.0 * HALF.y,
        range: RANGE,
    }
}

/// Returns a transform below the ceiling, facing down.
fn panel_transform(at: Vec3) -> Transform {
    Transform::from_translation(at).with_rotation(Quat::from_rotation_x(-FRAC_PI_2))
}

const PANEL_POSITION: Vec3 = Vec3::new(-0.35, 1.9, 0.1);

/// Returns the panel as a light of the core, in world space.
fn core_panel(at: Transform, samples: u32) -> SoftLight {
    let radiance = LUMENS / (PI * 4.0 * HALF.x * HALF.y) * Vec3::new(1.0, 0.9, 0.6);
    let (u, v) = (
        at.rotation * Vec3::X * HALF.x,
        at.rotation * Vec3::NEG_Y * HALF.y,
    );
    SoftLight::rectangle(at.translation, u, v, radiance, samples).with_range(RANGE)
}

/// Spawns the room on `root` with `bake`, and a camera that shows it without indirect light.
fn direct_room(
    app: &mut App,
    bake: Arc<BakedScene>,
    root: Transform,
    look: Transform,
) -> (Entity, Handle<Image>) {
    let asset = app
        .world_mut()
        .resource_mut::<Assets<GiBakedScene>>()
        .add(GiBakedScene { scene: bake });
    let root = app.world_mut().spawn((GiScene(asset), root)).id();
    Room::cornell().spawn(app, root);
    let image = target(app);
    let none = GiCamera {
        intensity: 0.0,
        ..default()
    };
    let eye = app.world_mut().spawn((camera(&image, look), none)).id();
    (eye, image)
}

/// Expected values on the CPU for the room from `look`. `bright` is the picture without shadows
/// (diffuse only). `taken` is the fraction subtracted by the twins. `seen` is the fraction of the
/// light that is visible to rays. Background pixels have the fractions 0 and 1.
struct Expected {
    bright: Picture,
    taken: Vec<Vec3>,
    seen: Vec<f32>,
}

/// Computes the expected values in world space. The light has `few` samples for the twins and
/// `many` for rays. `root` is the transform of the room.
fn expected(
    bake: &BakedScene,
    root: Transform,
    look: Transform,
    few: SoftLight,
    many: SoftLight,
) -> Expected {
    let room = Room::cornell();
    let size = [WIDTH, HEIGHT];
    let [width, height] = size.map(|v| v as f32);
    let clip_from_view = Mat4::perspective_infinite_reverse_rh(FRAC_PI_4, width / height, 0.1);
    // All values are in the local space of the bake, as required by rays.
    let local_from_world = root.to_matrix().inverse();
    let clip_from_local = clip_from_view * look.to_matrix().inverse() * root.to_matrix();
    let things = DynamicObjects {
        quads: room.0.clone(),
        ..DynamicObjects::default()
    };
    let drawn = RaycastView::new(&things, clip_from_local, size);
    let view = SplatParams::new(
        clip_from_local.inverse(),
        Mat4::IDENTITY,
        [0.0, 0.0, width, height],
        size,
        exposure(),
        (&bake.data().display.grid).into(),
    );
    let lights = [few.to_local(&local_from_world)];
    let many = many.to_local(&local_from_world);
    let occluded_irradiances = soft_shadow::occluded_irradiances(bake.data(), &lights);
    let params = SubtractShadowParams::new(bake.data(), 1);
    let eye = local_from_world.transform_point3(look.translation);
    let mut out = Expected {
        bright: Picture {
            width: WIDTH as usize,
            height: HEIGHT as usize,
            pixels: Vec::new(),
        },
        taken: Vec::new(),
        seen: Vec::new(),
    };
    for i in 0..WIDTH * HEIGHT {
        // The room's material is rough.
        let texel = gbuffer::with_roughness(drawn.gbuffer[i as usize], 1.0, 0.0);
        let depth = drawn.depth[i as usize];
        if depth <= 0.0 {
            out.bright.pixels.push([0.0; 3]);
            out.taken.push(Vec3::ZERO);
            out.seen.push(1.0);
            continue;
        }
        let (x, n) = splat::pixel_position(&view, [i % WIDTH, i / WIDTH], depth, texel);
        let surface = LitSurface::from_texel(texel, n, (eye - x).normalize());
        let bright = exposure() * subtract_shadow::drawn(&params, None, &lights, x, &surface);
        out.bright.pixels.push(bright.to_array());
        let missing = subtract_shadow::occluded_radiance(bake.data(), &occluded_irradiances, x, n);
        out.taken
            .push(subtract_shadow::SUBTRACTED_FRACTION * missing.unwrap_or_default());
        let rays = RayVisibility {
            geometry: &room,
            start: x + n * room.ray_offset(x),
        };
        out.seen.push(
            match soft_shadow::unshadowed(&many, x, n, extent(bake.data())) > 0.0 {
                true => soft_shadow::visible_fraction(&many, x, n, &rays).0,
                false => 1.0,
            },
        );
    }
    out
}

impl Expected {
    /// Returns Bevy's picture with the shadows of the twins.
    fn by_twins(&self, plain: &Picture) -> Picture {
        let mut out = plain.clone();
        for (pixel, taken) in out.pixels.iter_mut().zip(&self.taken) {
            *pixel = (Vec3::from_array(*pixel) * (Vec3::ONE - taken)).to_array();
        }
        out
    }

    /// Returns Bevy's picture with the shadows of rays.
    fn by_rays(&self, plain: &Picture) -> Picture {
        let mut out = plain.clone();
        for (pixel, seen) in out.pixels.iter_mut().zip(&self.seen) {
            *pixel = pixel.map(|v| v * seen);
        }
        out
    }
}

/// Returns the ratio of the sums of `picture` and `of` over the pixels selected by `which`.
fn brightness_ratio(picture: &Picture, of: &Picture, which: impl Fn(usize) -> bool) -> f32 {
    let luminance = |p: [f32; 3]| p[0] + p[1] + p[2];
    let (mut sum, mut whole, mut count) = (0.0, 0.0, 0);
    for i in (0..of.pixels.len()).filter(|&i| which(i)) {
        sum += luminance(picture.pixels[i]);
        whole += luminance(of.pixels[i]);
        count += 1;
    }
    assert!(count > 10 && whole > 0.0, "{count} pixels");
    sum / whole
}

/// Returns the pixels with neighbors that all have a visible fraction accepted by `accepted`.
fn interior_pixels(seen: &[f32], accepted: impl Fn(f32) -> bool) -> Vec<bool> {
    let (w, h) = (WIDTH as i32, HEIGHT as i32);
    let at = |i: i32| {
        (-1..=1).all(|dy| {
            (-1..=1).all(|dx| {
                let (x, y) = ((i % w + dx).clamp(0, w - 1), (i / w + dy).clamp(0, h - 1));
                accepted(seen[(y * w + x) as usize])
            })
        })
    };
    (0..w * h).map(at).collect()
}

fn soft_shadow_dispatches(c: &FrameRecord) -> [u32; 2] {
    [FrameStage::SOFT_SHADOW, FrameStage::SUBTRACT_SHADOW].map(|s| c.dispatches_of(s))
}

/// Asserts properties of a picture with soft shadows. No value is below zero. The picture equals
/// Bevy's where the light is fully visible, and is dark where the light is hidden. It matches the
/// twins everywhere, and rays within the accuracy of the baked visibility.
#[track_caller]
fn assert_shadows(name: &str, plain: &Picture, shaded: &Picture, expected: &Expected) {
    let (by_twins, by_rays) = (expected.by_twins(plain), expected.by_rays(plain));
    save_picture(&format!("{name}_plain"), &expected.bright.beside(plain));
    save_picture(&format!("{name}_twins"), &by_twins.beside(shaded));
    save_picture(name, &by_rays.beside(shaded));
    let min = (shaded.pixels.iter().flatten()).fold(0.0f32, |a, v| a.min(*v));
    let lit = interior_pixels(&expected.seen, |f| f > 0.999);
    let dark = interior_pixels(&expected.seen, |f| f < 0.001);
    let in_light = brightness_ratio(shaded, plain, |i| lit[i]);
    let in_shadow = brightness_ratio(shaded, plain, |i| dark[i]);
    let (twins, rays) = (shaded.nrmse(&by_twins), shaded.nrmse(&by_rays));
    let without = plain.nrmse(&by_rays);
    println!(
        "{name}: minimum {min:.1e}; {in_light:.4} of full light, {in_shadow:.4} in the umbra; NRMSE to the twins {twins:.4}, to rays {rays:.4}, without shadows {without:.4}"
    );
    assert!(min >= 0.0, "{name}: darker than black, {min}");
    assert!(
        (in_light - 1.0).abs() < 0.01,
        "{name}: in full light {in_light}"
    );
    assert!(in_shadow < 0.05, "{name}: in full shadow {in_shadow}");
    assert!(twins < 0.002, "{name}: NRMSE to the twins {twins}");
    // The room is bright and the shadows are small. The limit is relative to the error of a picture
    // without shadows.
    let max = 0.3 * without;
    assert!(
        without > 0.02,
        "{name}: shadows do not matter here, {without}"
    );
    assert!(rays < max, "{name}: NRMSE to rays {rays}");
    // The comparison fails for shadows at another position.
    let mut moved = shaded.clone();
    moved.pixels.rotate_right(3);
    assert!(moved.nrmse(&by_twins) > 0.002 && moved.nrmse(&by_rays) > max);
}

/// Inserts or removes the component.
fn set_soft_shadow(app: &mut App, light_source: Entity, soft: Option<GiSoftShadow>) {
    let mut light_source = app.world_mut().entity_mut(light_source);
    match soft {
        Some(soft) => light_source.insert(soft),
        None => light_source.remove::<GiSoftShadow>(),
    };
}

#[test]
fn panel_shadow_matches_rays_and_light_is_not_doubled() {
    let bake = bake_with_visibility();
    let mut app = app();
    let (_, image) = direct_room(&mut app, bake.clone(), Transform::IDENTITY, view());
    let light_source = app
        .world_mut()
        .spawn((panel(), panel_transform(PANEL_POSITION)))
        .id();
    run(&mut app, 3);
    let before = counters(&app);
    assert_eq!(soft_shadow_dispatches(&before), [0, 0], "{}", before.plan);
    let plain = picture(&mut app, &image);

    let soft = GiSoftShadow::default();
    set_soft_shadow(&mut app, light_source, Some(soft));
    run(&mut app, 1);
    let c = counters(&app);
    assert_eq!(
        soft_shadow_dispatches(&c),
        [1, 1],
        "in the same frame: {}",
        c.plan
    );
    assert!(
        c.plan
            .to_string()
            .contains("soft shadows changed, 1 light(s)"),
        "{}",
        c.plan
    );
    assert!(c.buffers > before.buffers && c.pipelines > before.pipelines);
    run(&mut app, 1);
    let c = counters(&app);
    assert_eq!(soft_shadow_dispatches(&c), [0, 1], "at rest: {}", c.plan);
    let shaded = picture(&mut app, &image);
    let at = |at| {
        let (few, many) = (core_panel(at, 25), core_panel(at, 225));
        expected(&bake, Transform::IDENTITY, view(), few, many)
    };
    let here = at(panel_transform(PANEL_POSITION));
    assert_shadows("panel", &plain, &shaded, &here);
    let off = plain.nrmse(&here.bright);
    println!("NRMSE of Bevy's light without shadows and gloss to the twin: {off:.4}");
    assert!(
        off < 0.03,
        "Bevy's light differs from the light that is subtracted: {off}"
    );

    // The light moves: the shadowed irradiance is computed once, and the shadow moves.
    let position = panel_transform(Vec3::new(-0.6, 1.6, 0.3));
    let move_to = |app: &mut App, to| {
        *app.world_mut().get_mut::<Transform>(light_source).unwrap() = to;
        run(app, 1);
    };
    move_to(&mut app, position);
    assert_eq!(soft_shadow_dispatches(&counters(&app)), [1, 1]);
    let moved = picture(&mut app, &image);
    set_soft_shadow(&mut app, light_source, None);
    let bare = picture(&mut app, &image);
    assert_shadows("moved_panel", &bare, &moved, &at(position));
    assert!(
        moved.nrmse(&here.by_twins(&plain)) > 0.1,
        "the shadow did not move"
    );
    set_soft_shadow(&mut app, light_source, Some(soft));
    move_to(&mut app, panel_transform(PANEL_POSITION));

    // A view of indirect light alone has no direct light to subtract from.
    let mut cameras = app.world_mut().query::<&mut GiCamera>();
    let mut only = |app: &mut App, view| {
        for mut camera in cameras.iter_mut(app.world_mut()) {
            camera.debug_view = view;
        }
        run(app, 1);
        soft_shadow_dispatches(&counters(app))
    };
    assert_eq!(only(&mut app, GiDebugView::IndirectOnly), [0, 0]);
    let indirect = picture(&mut app, &image);
    assert!(indirect.pixels.iter().flatten().all(|v| *v == 0.0));
    assert_eq!(only(&mut app, GiDebugView::Final), [0, 1]);

    // With a hidden light or without the component, the picture equals Bevy's bit for bit, and the
    // buffers are released.
    for off in [true, false] {
        let mut entity = app.world_mut().entity_mut(light_source);
        if off {
            entity.insert(Visibility::Hidden);
        } else {
            entity.insert(Visibility::Visible).remove::<GiSoftShadow>();
        }
        run(&mut app, 2);
        let c = counters(&app);
        assert_eq!(soft_shadow_dispatches(&c), [0, 0], "{}", c.plan);
        assert_eq!((c.buffers, c.bytes), (before.buffers, before.bytes));
    }
    assert_eq!(picture(&mut app, &image), plain);

    // On glossy surfaces, the specular reflection of the light is shadowed too.
    let mut materials = app.world_mut().resource_mut::<Assets<StandardMaterial>>();
    let all: Vec<_> = materials.ids().collect();
    for id in all {
        let mut material = materials.get_mut(id).unwrap();
        (material.perceptual_roughness, material.metallic) = (0.35, 0.6);
        material.reflectance = 0.5;
    }
    run(&mut app, 2);
    let plain = picture(&mut app, &image);
    set_soft_shadow(&mut app, light_source, Some(soft));
    run(&mut app, 2);
    let shaded = picture(&mut app, &image);
    assert!(plain.nrmse(&here.bright) > 0.2, "gloss is visible");
    assert_shadows("shiny", &plain, &shaded, &here);
    let findings = &app.world().resource::<GiWarnings>().0;
    assert_eq!(findings, &[], "no warnings");
}

#[test]
fn soft_shadow_in_transformed_room_matches_rays() {
    let bake = bake_with_visibility();
    let mut app = app();
    let root = Transform {
        translation: Vec3::new(20.0, -3.0, 7.0),
        rotation: Quat::from_euler(EulerRot::XYZ, 0.3, 1.1, -0.7),
        scale: Vec3::splat(2.0),
    };
    let look = Transform::from_matrix(
        root.with_scale(Vec3::ONE).to_matrix() * {
            let mut near = view();
            near.translation *= 2.0;
            near.to_matrix()
        },
    );
    let (_, image) = direct_room(&mut app, bake.clone(), root, look);
    let position = root.transform_point(Vec3::new(-0.4, 1.6, 0.3));
    let bulb = PointLight {
        intensity: 30_000.0 * 4.0,
        radius: 0.3,
        range: 12.0,
        ..default()
    };
    let light_source = app
        .world_mut()
        .spawn((bulb, Transform::from_translation(position)))
        .id();
    run(&mut app, 3);
    let plain = picture(&mut app, &image);
    set_soft_shadow(&mut app, light_source, Some(GiSoftShadow { samples: 16 }));
    run(&mut app, 2);
    let shaded = picture(&mut app, &image);
    let candela = Vec3::splat(bulb.intensity / (4.0 * PI));
    let core = |samples| SoftLight::sphere(position, 0.3, candela, 12.0, samples);
    let right = expected(&bake, root, look, core(16), core(225));
    assert_shadows("bulb", &plain, &shaded, &right);
    let off = plain.nrmse(&right.bright);
    println!("NRMSE of Bevy's light without shadows to the twin: {off:.4}");
    assert!(
        off < 0.01,
        "Bevy's light differs from the light that is subtracted: {off}"
    );
}

#[test]
fn lights_without_soft_shadows_state_reason_and_use_no_memory() {
    let mut app = app();
    let (_, bake_without_visibility) = cornell();
    let (_, image) = direct_room(
        &mut app,
        bake_without_visibility,
        Transform::IDENTITY,
        view(),
    );
    let light_source = app
        .world_mut()
        .spawn((panel(), panel_transform(PANEL_POSITION)))
        .id();
    run(&mut app, 3);
    let before = counters(&app);
    let plain = picture(&mut app, &image);
    let found = |app: &App| app.world().resource::<GiWarnings>().0.clone();
    assert_eq!(found(&app), []);

    // A bake without visibility.
    set_soft_shadow(&mut app, light_source, Some(GiSoftShadow::default()));
    run(&mut app, 2);
    let c = counters(&app);
    assert_eq!(soft_shadow_dispatches(&c), [0, 0]);
    assert!(
        c.plan.to_string().contains("the bake holds no visibility"),
        "{}",
        c.plan
    );
    assert_eq!(
        (c.buffers, c.bytes, c.pipelines),
        (before.buffers, before.bytes, before.pipelines)
    );
    assert_eq!(picture(&mut app, &image), plain);
    let mut expected = vec![GiWarning::NoVisibility];
    assert_eq!(found(&app), expected);

    // Lights of other kinds, and a light with a shadow map.
    app.world_mut()
        .spawn((SpotLight::default(), GiSoftShadow::default()));
    run(&mut app, 1);
    expected.push(GiWarning::SoftShadowKind);
    assert_eq!(found(&app), expected);
    let mapped = PointLight {
        shadow_maps_enabled: true,
        ..default()
    };
    app.world_mut().spawn((mapped, GiSoftShadow::default()));
    run(&mut app, 1);
    expected.push(GiWarning::SoftShadowTwice);
    assert_eq!(found(&app), expected);
    // More panels than Bevy's limit.
    for _ in 0..8 {
        app.world_mut()
            .spawn((panel(), panel_transform(PANEL_POSITION)));
    }
    run(&mut app, 1);
    expected.push(GiWarning::SoftShadowCount);
    assert_eq!(found(&app), expected);
}

#[test]
fn nan_lights_and_many_lights_do_not_panic() {
    let mut app = app();
    let (eye, _) = direct_room(
        &mut app,
        bake_with_visibility(),
        Transform::IDENTITY,
        view(),
    );
    // No pixels are compared, so a small picture is enough.
    let small = app
        .world_mut()
        .resource_mut::<Assets<Image>>()
        .add(create_target_image(32, 24));
    app.world_mut()
        .entity_mut(eye)
        .insert(RenderTarget::Image(small.clone().into()));
    let soft = GiSoftShadow { samples: u32::MAX };
    let bad = RectLight {
        intensity: f32::NAN,
        ..panel()
    };
    app.world_mut()
        .spawn((bad, panel_transform(PANEL_POSITION), soft));
    let flat = RectLight {
        width: 0.0,
        ..panel()
    };
    app.world_mut()
        .spawn((flat, panel_transform(PANEL_POSITION), soft));
    for i in 0..20 {
        let bulb = PointLight {
            intensity: 1000.0,
            ..default()
        };
        let position = Transform::from_xyz(-0.8 + 0.08 * i as f32, 1.5, 0.4);
        app.world_mut()
            .spawn((bulb, position, GiSoftShadow { samples: 0 }));
    }
    run(&mut app, 3);
    assert_eq!(soft_shadow_dispatches(&counters(&app)), [0, 1]);
    assert!(counters(&app).plan.to_string().contains("subtract_shadow"));
    // With more panels, the buffers grow.
    for i in 0..20 {
        let position = Transform::from_xyz(-0.8 + 0.08 * i as f32, 1.2, 0.5);
        app.world_mut()
            .spawn((PointLight::default(), position, GiSoftShadow::default()));
    }
    run(&mut app, 1);
    assert_eq!(soft_shadow_dispatches(&counters(&app)), [1, 1]);
    run(&mut app, 1);
    let _ = picture(&mut app, &small);
}
