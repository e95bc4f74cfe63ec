//! Soft shadows in the running plugin: what is taken from Bevy's picture, where, and when; against shadow rays at every pixel.

mod plugin_support;

use bevy::prelude::*;
use bevy_meshless_gi::accuracy::DrawnView;
use bevy_meshless_gi::asset::BakedScene;
use bevy_meshless_gi::bake::{Recipe, SoftShadows};
use bevy_meshless_gi::frame::project::extent;
use bevy_meshless_gi::frame::shade::{self, ShadeParams};
use bevy_meshless_gi::frame::soft::{self, Rays};
use bevy_meshless_gi::frame::{SoftLight, SplatParams, gbuffer, splat};
use bevy_meshless_gi::plan::Stage;
use bevy_meshless_gi::plugin::{
    MeshlessGiCounters, MeshlessGiFinding, MeshlessGiFindings, MeshlessGiView,
};
use bevy_meshless_gi::prelude::*;
use bevy_meshless_gi::scene::Geometry;
use plugin_support::app::{HEIGHT, WIDTH, app, camera, picture, run, target};
use plugin_support::bounce::Things;
use plugin_support::flip::Picture;
use plugin_support::scenes::{Room, cornell, exposure};
use plugin_support::stage::{counters, keep, view};
use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI};
use std::sync::{Arc, OnceLock};

/// The room, whose points remember what they see; baked once.
fn remembering() -> Arc<BakedScene> {
    static BAKED: OnceLock<Arc<BakedScene>> = OnceLock::new();
    let bake = || {
        Room::cornell().bake_as(&Recipe {
            viewpoints: vec![[0.0, 1.0, 0.6]],
            coarse_radius: Some(0.3),
            levels: Some(4),
            sender_levels: Some(4),
            rays: Some(32),
            seed: 1,
            soft_shadows: Some(SoftShadows::default()),
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

/// Below the ceiling, shining down.
fn hanging(at: Vec3) -> Transform {
    Transform::from_translation(at).with_rotation(Quat::from_rotation_x(-FRAC_PI_2))
}

const PLACE: Vec3 = Vec3::new(-0.35, 1.9, 0.1);

/// The panel in the core's terms, in the world.
fn core_panel(at: Transform, samples: u32) -> SoftLight {
    let radiance = LUMENS / (PI * 4.0 * HALF.x * HALF.y) * Vec3::new(1.0, 0.9, 0.6);
    let (u, v) = (
        at.rotation * Vec3::X * HALF.x,
        at.rotation * Vec3::NEG_Y * HALF.y,
    );
    SoftLight::rectangle(at.translation, u, v, radiance, samples).within(RANGE)
}

/// The room on `root` with `bake`, and a camera that shows it without indirect light.
fn direct_room(
    app: &mut App,
    bake: Arc<BakedScene>,
    root: Transform,
    look: Transform,
) -> (Entity, Handle<Image>) {
    let asset = app
        .world_mut()
        .resource_mut::<Assets<MeshlessGiAsset>>()
        .add(MeshlessGiAsset { scene: bake });
    let root = app.world_mut().spawn((MeshlessGi(asset), root)).id();
    Room::cornell().spawn(app, root);
    let image = target(app);
    let none = MeshlessGiCamera {
        intensity: 0.0,
        ..default()
    };
    let eye = app.world_mut().spawn((camera(&image, look), none)).id();
    (eye, image)
}

/// Three pictures of the room in the light of `light` (in the bake's local space, as `root` places it) by the CPU: without shadows, with the shadows of the twins, and with those of rays; and the visible part of the lamp
/// at every pixel, 1 where there is nothing.
struct Expected {
    bright: Picture,
    twin: Picture,
    rays: Picture,
    seen: Vec<f32>,
}

fn expected(
    bake: &BakedScene,
    root: Transform,
    look: Transform,
    few: SoftLight,
    many: SoftLight,
) -> Expected {
    let room = Room::cornell();
    let size = [WIDTH, HEIGHT];
    let aspect = WIDTH as f32 / HEIGHT as f32;
    let clip_from_view = Mat4::perspective_infinite_reverse_rh(FRAC_PI_4, aspect, 0.1);
    // Drawn in the bake's space, where rays are cast; normals are turned into the world's.
    let world_from_local = root.to_matrix();
    let clip_from_local = clip_from_view * look.to_matrix().inverse() * world_from_local;
    let things = Things {
        quads: room.0.clone(),
        ..Things::default()
    };
    let drawn = DrawnView::new(&things, clip_from_local, size);
    let view = SplatParams::new(
        clip_from_local.inverse(),
        Mat4::IDENTITY,
        [0.0, 0.0, WIDTH as f32, HEIGHT as f32],
        size,
        exposure(),
        (&bake.display.grid).into(),
    );
    let lights = [few.to_local(&world_from_local.inverse())];
    let many = many.to_local(&world_from_local.inverse());
    let deficits = soft::deficits(bake, &lights);
    let params = ShadeParams::new(bake, 1);
    let mut out = [const { Vec::new() }; 3];
    let mut seen = Vec::new();
    for i in 0..WIDTH * HEIGHT {
        let pixel = [i % WIDTH, i / WIDTH];
        // The room's material: rough.
        let texel = gbuffer::glossy(drawn.gbuffer[i as usize], 1.0, 0.0);
        let depth = drawn.depth[i as usize];
        if depth <= 0.0 {
            out.iter_mut().for_each(|p| p.push([0.0; 3]));
            seen.push(1.0);
            continue;
        }
        let (x, n) = splat::place(&view, pixel, depth, texel);
        let eye = clip_from_local.inverse().project_point3(Vec3::new(
            (pixel[0] as f32 + 0.5) / WIDTH as f32 * 2.0 - 1.0,
            1.0 - (pixel[1] as f32 + 0.5) / HEIGHT as f32 * 2.0,
            1.0,
        ));
        let e = shade::drawn(&params, &lights, x, n, (eye - x).normalize(), 1.0);
        let bright = exposure() / PI * gbuffer::diffuse(texel) * e;
        let [r, g, b, _] = shade::shade_pixel(
            (&params, &view),
            bake,
            &deficits,
            &lights,
            pixel,
            depth,
            texel,
        );
        let rays = Rays {
            geometry: &room,
            start: x + n * room.lift(x),
        };
        let f = match soft::unshadowed(&many, x, n, extent(bake)) > 0.0 {
            true => soft::fraction(&many, x, n, &rays).0,
            false => 1.0,
        };
        out[0].push(bright.to_array());
        out[1].push((bright - Vec3::new(r, g, b)).to_array());
        out[2].push((bright * f).to_array());
        seen.push(f);
    }
    let [bright, twin, rays] = out.map(|pixels| Picture {
        width: WIDTH as usize,
        height: HEIGHT as usize,
        pixels,
    });
    Expected {
        bright,
        twin,
        rays,
        seen,
    }
}

/// Means of `picture` over `of` at the pixels that `which` picks, where `of` is not dark.
fn share(picture: &Picture, of: &Picture, which: impl Fn(usize) -> bool) -> f32 {
    let luminance = |p: [f32; 3]| p[0] + p[1] + p[2];
    let (mut sum, mut whole, mut count) = (0.0, 0.0, 0);
    for i in (0..of.pixels.len()).filter(|&i| which(i)) {
        sum += luminance(picture.pixels[i]);
        whole += luminance(of.pixels[i]);
        count += 1;
    }
    assert!(count > 50 && whole > 0.0, "{count} pixels");
    sum / whole
}

/// Pixels where all neighbours within two pixels see as much of the lamp as `wanted` says.
fn within(seen: &[f32], wanted: impl Fn(f32) -> bool) -> Vec<bool> {
    let (w, h) = (WIDTH as i32, HEIGHT as i32);
    let at = |i: i32| {
        (-2..=2).all(|dy| {
            (-2..=2).all(|dx| {
                let (x, y) = ((i % w + dx).clamp(0, w - 1), (i / w + dy).clamp(0, h - 1));
                wanted(seen[(y * w + x) as usize])
            })
        })
    };
    (0..w * h).map(at).collect()
}

fn soft_work(c: &MeshlessGiCounters) -> [u32; 2] {
    [Stage::Soft, Stage::Shade].map(|s| c.dispatches_of(s))
}

/// What a picture with soft shadows must be: nothing below black, Bevy's own where the lamp is seen whole, dark where it is not seen, the twins' everywhere, and that of rays as nearly
/// as the bake remembers.
#[track_caller]
fn assert_shadows(name: &str, plain: &Picture, shaded: &Picture, expected: &Expected) {
    keep(&format!("{name}_plain"), &expected.bright.beside(plain));
    keep(&format!("{name}_twin"), &expected.twin.beside(shaded));
    keep(name, &expected.rays.beside(shaded));
    let off = plain.nrmse(&expected.bright);
    println!("{name}: Bevy's light without shadows, NRMSE {off:.4}");
    assert!(
        off < 0.01,
        "{name}: what Bevy draws is not what is taken from it: {off}"
    );
    let least = shaded
        .pixels
        .iter()
        .flatten()
        .fold(0.0f32, |a, v| a.min(*v));
    assert!(least >= 0.0, "{name}: darker than black, {least}");
    let lit = within(&expected.seen, |f| f > 0.999);
    let dark = within(&expected.seen, |f| f < 0.001);
    let in_light = share(shaded, plain, |i| lit[i]);
    let in_shadow = share(shaded, plain, |i| dark[i]);
    let (twin, rays) = (shaded.nrmse(&expected.twin), shaded.nrmse(&expected.rays));
    let without = plain.nrmse(&expected.rays);
    println!(
        "{name}: {in_light:.4} of the light, {in_shadow:.4} in the umbra; NRMSE to the twins {twin:.4}, to rays {rays:.4}, without shadows {without:.4}"
    );
    assert!(
        (in_light - 1.0).abs() < 0.01,
        "{name}: in full light {in_light}"
    );
    assert!(in_shadow < 0.05, "{name}: in full shadow {in_shadow}");
    assert!(twin < 0.01, "{name}: not what the twins say, {twin}");
    assert!(rays < 0.06, "{name}: not what rays say, {rays}");
    // The test can fail: without shadows it does, and with shadows that are elsewhere.
    assert!(
        without > 0.2,
        "{name}: no shadow is not told apart, {without}"
    );
    let mut moved = shaded.clone();
    moved.pixels.rotate_right(3);
    assert!(moved.nrmse(&expected.twin) > 0.01 && moved.nrmse(&expected.rays) > 0.06);
}

#[test]
fn a_panel_casts_the_shadow_that_rays_cast_and_its_light_is_not_doubled() {
    let bake = remembering();
    let mut app = app();
    let (_, image) = direct_room(&mut app, bake.clone(), Transform::IDENTITY, view());
    let lamp = app.world_mut().spawn((panel(), hanging(PLACE))).id();
    run(&mut app, 3);
    let before = counters(&app);
    assert_eq!(soft_work(&before), [0, 0], "{}", before.plan);
    let plain = picture(&mut app, &image);

    app.world_mut()
        .entity_mut(lamp)
        .insert(MeshlessGiSoftShadow::default());
    run(&mut app, 1);
    let c = counters(&app);
    assert_eq!(soft_work(&c), [1, 1], "in the same frame: {}", c.plan);
    assert!(
        c.plan.contains("soft shadows changed, 1 light(s)"),
        "{}",
        c.plan
    );
    assert!(c.buffers > before.buffers && c.pipelines == before.pipelines + 3);
    run(&mut app, 1);
    let c = counters(&app);
    assert_eq!(soft_work(&c), [0, 1], "at rest: {}", c.plan);
    let shaded = picture(&mut app, &image);
    let both = |at| (core_panel(at, 25), core_panel(at, 225));
    let (few, many) = both(hanging(PLACE));
    let right = expected(&bake, Transform::IDENTITY, view(), few, many);
    assert_shadows("panel", &plain, &shaded, &right);

    // It moves: found anew once, and the shadow is elsewhere.
    let there = hanging(Vec3::new(0.4, 1.9, -0.3));
    *app.world_mut().get_mut::<Transform>(lamp).unwrap() = there;
    run(&mut app, 1);
    assert_eq!(soft_work(&counters(&app)), [1, 1]);
    let moved = picture(&mut app, &image);
    let (few, many) = both(there);
    let right = expected(&bake, Transform::IDENTITY, view(), few, many);
    let [now, before_it_moved] = [&moved, &shaded].map(|p| p.nrmse(&right.twin));
    println!("moved: {now:.4}, as it was {before_it_moved:.4}");
    assert!(now < 0.01 && before_it_moved > 0.1);
    *app.world_mut().get_mut::<Transform>(lamp).unwrap() = hanging(PLACE);

    // A view of indirect light alone has no direct light to take from.
    let mut cameras = app.world_mut().query::<&mut MeshlessGiCamera>();
    let only = |app: &mut App, view| {
        for mut camera in cameras.iter_mut(app.world_mut()) {
            camera.view = view;
        }
        run(app, 1);
        soft_work(&counters(app))
    };
    assert_eq!(only(&mut app, MeshlessGiView::Indirect), [0, 0]);
    let indirect = picture(&mut app, &image);
    assert!(indirect.pixels.iter().flatten().all(|v| *v == 0.0));
    assert_eq!(only(&mut app, MeshlessGiView::Lit), [1, 1], "caught up");

    // Off, or without the component: Bevy's picture, to the bit, and nothing is held.
    for off in [true, false] {
        let mut lamp = app.world_mut().entity_mut(lamp);
        if off {
            lamp.insert(Visibility::Hidden);
        } else {
            lamp.insert(Visibility::Visible)
                .remove::<MeshlessGiSoftShadow>();
        }
        run(&mut app, 2);
        let c = counters(&app);
        assert_eq!(soft_work(&c), [0, 0], "{}", c.plan);
        assert_eq!((c.buffers, c.bytes), (before.buffers, before.bytes));
    }
    assert_eq!(picture(&mut app, &image), plain);
    let findings = &app.world().resource::<MeshlessGiFindings>().0;
    assert_eq!(findings, &[], "nothing is wrong with any of that");
}

#[test]
fn a_lamp_with_a_radius_in_a_room_that_is_moved_turned_and_scaled() {
    let bake = remembering();
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
    let place = root.transform_point(Vec3::new(-0.4, 1.6, 0.3));
    let bulb = PointLight {
        intensity: 30_000.0 * 4.0,
        radius: 0.3,
        range: 12.0,
        ..default()
    };
    let lamp = app
        .world_mut()
        .spawn((bulb, Transform::from_translation(place)))
        .id();
    run(&mut app, 3);
    let plain = picture(&mut app, &image);
    app.world_mut()
        .entity_mut(lamp)
        .insert(MeshlessGiSoftShadow { samples: 16 });
    run(&mut app, 2);
    let shaded = picture(&mut app, &image);
    let candela = Vec3::splat(bulb.intensity / (4.0 * PI));
    let core = |samples| SoftLight::sphere(place, 0.3, candela, 12.0, samples);
    let right = expected(&bake, root, look, core(16), core(225));
    assert_shadows("bulb", &plain, &shaded, &right);
}

#[test]
fn what_casts_no_soft_shadows_says_why_and_holds_nothing() {
    let mut app = app();
    let (_, forgetful) = cornell();
    let (_, image) = direct_room(&mut app, forgetful, Transform::IDENTITY, view());
    let lamp = app.world_mut().spawn((panel(), hanging(PLACE))).id();
    run(&mut app, 3);
    let before = counters(&app);
    let plain = picture(&mut app, &image);
    let found = |app: &App| app.world().resource::<MeshlessGiFindings>().0.clone();
    assert_eq!(found(&app), []);

    // A bake that does not remember.
    app.world_mut()
        .entity_mut(lamp)
        .insert(MeshlessGiSoftShadow::default());
    run(&mut app, 2);
    let c = counters(&app);
    assert_eq!(soft_work(&c), [0, 0]);
    assert!(
        c.plan.contains("the bake holds no visibility"),
        "{}",
        c.plan
    );
    assert_eq!(
        (c.buffers, c.bytes, c.pipelines),
        (before.buffers, before.bytes, before.pipelines)
    );
    assert_eq!(picture(&mut app, &image), plain);
    let mut expected = vec![MeshlessGiFinding::NoVisibility];
    assert_eq!(found(&app), expected);

    // Lamps of other kinds, and one that has a shadow map.
    app.world_mut()
        .spawn((SpotLight::default(), MeshlessGiSoftShadow::default()));
    run(&mut app, 1);
    expected.push(MeshlessGiFinding::SoftShadowKind);
    assert_eq!(found(&app), expected);
    let mapped = PointLight {
        shadow_maps_enabled: true,
        ..default()
    };
    app.world_mut()
        .spawn((mapped, MeshlessGiSoftShadow::default()));
    run(&mut app, 1);
    expected.push(MeshlessGiFinding::SoftShadowTwice);
    assert_eq!(found(&app), expected);
    // More panels than Bevy draws.
    for _ in 0..8 {
        app.world_mut().spawn((panel(), hanging(PLACE)));
    }
    run(&mut app, 1);
    expected.push(MeshlessGiFinding::SoftShadowCount);
    assert_eq!(found(&app), expected);
}

#[test]
fn lamps_without_numbers_and_lamps_in_crowds_are_borne() {
    let mut app = app();
    let (_, image) = direct_room(&mut app, remembering(), Transform::IDENTITY, view());
    let soft = MeshlessGiSoftShadow { samples: u32::MAX };
    let bad = RectLight {
        intensity: f32::NAN,
        ..panel()
    };
    app.world_mut().spawn((bad, hanging(PLACE), soft));
    let flat = RectLight {
        width: 0.0,
        ..panel()
    };
    app.world_mut().spawn((flat, hanging(PLACE), soft));
    for i in 0..20 {
        let bulb = PointLight {
            intensity: 1000.0,
            ..default()
        };
        let place = Transform::from_xyz(-0.8 + 0.08 * i as f32, 1.5, 0.4);
        app.world_mut()
            .spawn((bulb, place, MeshlessGiSoftShadow { samples: 0 }));
    }
    run(&mut app, 3);
    assert_eq!(soft_work(&counters(&app)), [0, 1]);
    assert!(counters(&app).plan.contains("shade"));
    // More come: the buffers grow.
    for i in 0..20 {
        let place = Transform::from_xyz(-0.8 + 0.08 * i as f32, 1.2, 0.5);
        app.world_mut().spawn((
            PointLight::default(),
            place,
            MeshlessGiSoftShadow::default(),
        ));
    }
    run(&mut app, 1);
    assert_eq!(soft_work(&counters(&app)), [1, 1]);
    run(&mut app, 1);
    let _ = picture(&mut app, &image);
}
