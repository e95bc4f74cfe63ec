//! Cameras without indirect light next to a camera that displays it. They draw the same picture as
//! without the plugin, also after cameras, meshes and materials are added, changed and removed.
//! Also tests the warning if no camera displays a bake.

use crate::support::app::{
    app, camera, drawn, finish_plugins, headless_plugins, picture, run, target,
};
use crate::support::flip::Picture;
use crate::support::scenes::{Room, cornell};
use crate::support::stage::{
    bevy_light, save_picture, spawn_baked, spawn_light_source, spawn_room, view,
};
use bevy::asset::RenderAssetUsages;
use bevy::camera::{
    Camera3dDepthLoadOp, ClearColorConfig, Hdr, RenderTarget, ScalingMode, Viewport,
    visibility::RenderLayers,
};
use bevy::core_pipeline::prepass::{
    DeferredPrepass, DepthPrepass, MotionVectorPrepass, NormalPrepass,
};
use bevy::core_pipeline::tonemapping::{DebandDither, Tonemapping};
use bevy::material::OpaqueRendererMethod;
use bevy::pbr::DefaultOpaqueRendererMethod;
use bevy::prelude::*;
use bevy::render::render_resource::{Extent3d, TextureDimension, TextureFormat};
use bevy_meshless_gi::prelude::*;
use bevy_meshless_gi::{GiWarning, GiWarnings};
use meshless_gi::{Preset, ProbeSettings, Recipe};

const LIGHT_SOURCE: Vec3 = Vec3::new(0.3, 1.7, 0.2);
/// Render layer of the preview camera's objects.
const PREVIEW: usize = 5;
/// Largest difference of a pixel's channel between the pictures of two apps. Both apps run the same
/// draws with the same shaders.
const MAX_DIFFERENCE: f32 = 1e-4;

/// Room with a light that casts shadows, a grid with holes, and a ball on a separate layer. With
/// the plugin, a bake lights the room.
struct Stage {
    app: App,
    images: Vec<Handle<Image>>,
    cameras: Vec<Entity>,
    ball: Handle<StandardMaterial>,
    floor: Entity,
    floor_material: Handle<StandardMaterial>,
}

impl Stage {
    fn new(plugin: bool, plugins: impl Fn(&mut App)) -> Self {
        let mut app = App::new();
        app.add_plugins(headless_plugins());
        if plugin {
            app.add_plugins(MeshlessGiPlugin::default());
        }
        app.insert_resource(GlobalAmbientLight::NONE)
            .insert_resource(bevy::light::PointLightShadowMap { size: 256 });
        plugins(&mut app);
        finish_plugins(&mut app);
        if plugin {
            spawn_room(&mut app, Transform::IDENTITY);
        } else {
            let root = (Transform::IDENTITY, Visibility::default());
            let root = app.world_mut().spawn(root).id();
            cornell().0.spawn(&mut app, root);
        }
        let light_source = PointLight {
            shadow_maps_enabled: true,
            ..bevy_light()
        };
        let transform = Transform::from_translation(LIGHT_SOURCE);
        app.world_mut().spawn((light_source, transform));
        let (floor, floor_material) = floor(&mut app);
        let ball = material(&mut app, Color::linear_rgb(0.1, 0.3, 0.8));
        let mut stage = Self {
            app,
            images: Vec::new(),
            cameras: Vec::new(),
            ball: ball.clone(),
            floor,
            floor_material,
        };
        stage.spawn_ball(Vec3::new(-0.4, 0.3, 0.3), 0.25, RenderLayers::layer(0));
        stage.spawn_ball(Vec3::new(0.0, 10.0, 0.0), 0.8, RenderLayers::layer(PREVIEW));
        stage.grid();
        let sun = DirectionalLight {
            illuminance: 5000.0,
            ..default()
        };
        let toward = Transform::from_xyz(1.0, 2.0, 3.0).looking_at(Vec3::ZERO, Vec3::Y);
        let layer = RenderLayers::layer(PREVIEW);
        stage.app.world_mut().spawn((sun, toward, layer));
        stage
    }

    fn spawn_ball(&mut self, transform: Vec3, radius: f32, layers: RenderLayers) -> Entity {
        let mesh = Sphere::new(radius).mesh().ico(8).unwrap();
        let mesh = self.add(mesh);
        let ball = MeshMaterial3d(self.ball.clone());
        let transform = Transform::from_translation(transform);
        let parts = (Mesh3d(mesh), ball, transform, layers);
        self.app.world_mut().spawn(parts).id()
    }

    /// Spawns a wall with round holes that has a masked material.
    fn grid(&mut self) {
        let texel = |i: usize| {
            let at = |v: usize| (v % 8) as f32 - 3.5;
            let hole = at(i % 32).hypot(at(i / 32)) < 2.6;
            [230, 200, 60, if hole { 0 } else { 255 }]
        };
        let size = Extent3d {
            width: 32,
            height: 32,
            depth_or_array_layers: 1,
        };
        let image = Image::new(
            size,
            TextureDimension::D2,
            (0..32 * 32).flat_map(texel).collect(),
            TextureFormat::Rgba8UnormSrgb,
            RenderAssetUsages::default(),
        );
        let image = self.add(image);
        let material = self.add(StandardMaterial {
            base_color_texture: Some(image),
            alpha_mode: AlphaMode::Mask(0.5),
            perceptual_roughness: 1.0,
            double_sided: true,
            cull_mode: None,
            ..default()
        });
        let mesh = self.add(Rectangle::new(0.8, 0.8).mesh().build());
        let transform =
            Transform::from_xyz(-0.5, 1.2, -0.3).with_rotation(Quat::from_rotation_y(0.5));
        let parts = (Mesh3d(mesh), MeshMaterial3d(material), transform);
        self.app.world_mut().spawn(parts);
    }

    fn add<A: Asset>(&mut self, asset: A) -> Handle<A> {
        let mut assets = self.app.world_mut().resource_mut::<Assets<A>>();
        assets.add(asset)
    }

    /// Spawns a camera with its own target.
    fn spawn_camera(&mut self, kind: impl Bundle, at: Transform) -> Entity {
        let image = target(&mut self.app);
        let shared = (
            Camera3d::default(),
            RenderTarget::Image(image.clone().into()),
            Tonemapping::None,
            DebandDither::Disabled,
            at,
        );
        let eye = self.app.world_mut().spawn(shared).insert(kind).id();
        self.images.push(image);
        self.cameras.push(eye);
        eye
    }

    /// Spawns plain cameras of three kinds, and a camera with four samples and a prepass.
    fn plain_cameras(&mut self) {
        let above = Transform::from_xyz(0.0, 1.9, 0.0).looking_at(Vec3::ZERO, Vec3::NEG_Z);
        let map = OrthographicProjection {
            scaling_mode: ScalingMode::FixedVertical {
                viewport_height: 2.2,
            },
            ..OrthographicProjection::default_3d()
        };
        self.spawn_camera((Projection::Orthographic(map), Msaa::Sample4), above);
        let prepasses = (
            DepthPrepass,
            NormalPrepass,
            MotionVectorPrepass,
            Msaa::Off,
            Hdr,
        );
        self.spawn_camera(prepasses, view());
        self.spawn_camera((DepthPrepass, Msaa::Sample4), view());
        let preview = Camera {
            viewport: Some(Viewport {
                physical_position: UVec2::new(16, 8),
                physical_size: UVec2::new(64, 64),
                ..default()
            }),
            order: 3,
            clear_color: ClearColorConfig::Custom(Color::linear_rgb(0.05, 0.05, 0.1)),
            ..default()
        };
        let layers = RenderLayers::layer(PREVIEW);
        let eye = Transform::from_xyz(0.0, 10.3, 3.0).looking_at(Vec3::Y * 10.0, Vec3::Y);
        self.spawn_camera((preview, layers), eye);
    }

    fn pictures(&mut self) -> Vec<Picture> {
        run(&mut self.app, 2);
        self.images.iter().map(|i| drawn(&self.app, i)).collect()
    }
}

fn material(app: &mut App, color: Color) -> Handle<StandardMaterial> {
    let material = StandardMaterial {
        base_color: color,
        perceptual_roughness: 0.8,
        ..default()
    };
    let mut materials = app.world_mut().resource_mut::<Assets<StandardMaterial>>();
    materials.add(material)
}

/// Returns the first surface of the room and its material.
fn floor(app: &mut App) -> (Entity, Handle<StandardMaterial>) {
    let mut meshes = app
        .world_mut()
        .query::<(Entity, &MeshMaterial3d<StandardMaterial>)>();
    let (floor, material) = meshes.iter(app.world()).next().expect("the floor");
    (floor, material.0.clone())
}

/// Returns the largest difference of a channel.
fn difference(a: &Picture, b: &Picture) -> f32 {
    let pairs = a.pixels.iter().flatten().zip(b.pixels.iter().flatten());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// Returns the number of pixels that differ from the first pixel.
fn pixels_drawn(picture: &Picture) -> usize {
    let clear = picture.pixels[0];
    picture.pixels.iter().filter(|p| **p != clear).count()
}

#[track_caller]
fn assert_equal(name: &str, with: &[Picture], without: &[Picture]) {
    assert_eq!(with.len(), without.len());
    for (k, (with, without)) in with.iter().zip(without).enumerate() {
        save_picture(&format!("cameras_{name}_{k}"), &without.beside(with));
        let d = difference(with, without);
        println!("{name}, camera {k}: {d}");
        assert!(
            pixels_drawn(without) > 1000,
            "{name}, camera {k} draws something"
        );
        assert!(d <= MAX_DIFFERENCE, "{name}, camera {k}: {d}");
    }
}

/// Applies a change to each app and compares their pictures. Returns the pictures without the
/// plugin.
fn step(apps: &mut [Stage; 2], name: &str, change: impl Fn(&mut Stage)) -> Vec<Picture> {
    apps.iter_mut().for_each(change);
    let [with, without] = apps.each_mut().map(Stage::pictures);
    assert_equal(name, &with, &without);
    without
}

fn spawn_apps() -> [Stage; 2] {
    [true, false].map(|plugin| {
        let mut stage = Stage::new(plugin, |_| {});
        stage.plain_cameras();
        stage
    })
}

#[test]
fn cameras_without_gi_match_picture_without_plugin() {
    let mut apps = spawn_apps();
    // The camera that displays indirect light has a separate picture, which is not compared.
    let image = target(&mut apps[0].app);
    let eye = (camera(&image, view()), GiCamera::default());
    let eye = apps[0].app.world_mut().spawn(eye).id();
    let plain = step(&mut apps, "three_kinds", |_| {});
    let lit = picture(&mut apps[0].app, &image);
    save_picture("cameras_display", &plain[1].beside(&lit));
    // The second camera has the transform of the display camera and shows direct light alone.
    assert!(lit.mean() > 1.2 * plain[1].mean(), "{}", lit.mean());
    let findings = apps[0].app.world().resource::<GiWarnings>();
    assert_eq!(findings.0, [], "no warnings for these cameras");
    // The comparison can fail.
    assert!(difference(&lit, &plain[1]) > 100.0 * MAX_DIFFERENCE);
    apps[0].app.world_mut().despawn(eye);
    step(&mut apps, "display_gone", |_| {});
}

#[test]
fn runtime_changes_reach_cameras_without_gi() {
    let mut apps = spawn_apps();
    let first = step(&mut apps, "start", |_| {});
    let moved = step(&mut apps, "mesh_later", |s| {
        s.spawn_ball(Vec3::new(0.6, 0.3, 0.7), 0.2, RenderLayers::layer(0));
    });
    assert!(
        difference(&first[1], &moved[1]) > 0.01,
        "the ball is visible"
    );
    let change = |s: &mut Stage, change: &dyn Fn(&mut StandardMaterial)| {
        let floor = s.floor_material.clone();
        let mut materials = s.app.world_mut().resource_mut::<Assets<StandardMaterial>>();
        change(&mut materials.get_mut(&floor).expect("the floor"));
    };
    let colored = step(&mut apps, "color", |s| {
        change(s, &|m| m.base_color = Color::linear_rgb(0.8, 0.1, 0.6));
    });
    assert!(
        difference(&colored[0], &moved[0]) > 0.01,
        "the color is visible"
    );
    step(&mut apps, "masked", |s| {
        change(s, &|m| m.alpha_mode = AlphaMode::Mask(0.5));
    });
    step(&mut apps, "blended", |s| {
        change(s, &|m| m.alpha_mode = AlphaMode::Blend);
    });
    step(&mut apps, "opaque_again", |s| {
        change(s, &|m| m.alpha_mode = AlphaMode::Opaque);
    });
    step(&mut apps, "forward", |s| {
        change(s, &|m| {
            m.opaque_render_method = OpaqueRendererMethod::Forward
        });
    });
    step(&mut apps, "other_material", |s| {
        let ball = MeshMaterial3d(s.ball.clone());
        let floor = s.floor;
        s.app.world_mut().entity_mut(floor).insert(ball);
    });
    step(&mut apps, "camera_later", |s| {
        let at = Transform::from_xyz(0.5, 0.5, 2.5).looking_at(Vec3::Y * 0.5, Vec3::Y);
        s.spawn_camera((NormalPrepass, Msaa::Off), at);
    });
    step(&mut apps, "camera_gone", |s| {
        let eye = s.cameras.remove(0);
        s.images.remove(0);
        s.app.world_mut().despawn(eye);
    });
    step(&mut apps, "hidden", |s| {
        let floor = s.floor;
        s.app
            .world_mut()
            .entity_mut(floor)
            .insert(Visibility::Hidden);
    });
    step(&mut apps, "shown_again", |s| {
        let floor = s.floor;
        s.app
            .world_mut()
            .entity_mut(floor)
            .insert(Visibility::Inherited);
    });
    step(&mut apps, "mesh_gone", |s| {
        let floor = s.floor;
        s.app.world_mut().despawn(floor);
    });
}

#[test]
fn camera_that_toggles_gi_returns_to_its_picture() {
    let mut apps = spawn_apps();
    let eye = apps[0].cameras[1];
    step(&mut apps, "plain", |_| {});
    apps[0]
        .app
        .world_mut()
        .entity_mut(eye)
        .insert(GiCamera::default());
    let image = apps[0].images[1].clone();
    let plain = picture(&mut apps[1].app, &image);
    run(&mut apps[0].app, 3);
    let lit = picture(&mut apps[0].app, &image);
    save_picture("cameras_becomes_display", &plain.beside(&lit));
    assert!(lit.mean() > 1.2 * plain.mean(), "{}", lit.mean());
    apps[0]
        .app
        .world_mut()
        .entity_mut(eye)
        .remove::<(GiCamera, DeferredPrepass)>();
    step(&mut apps, "plain_again", |_| {});
    // Removes a prepass from one camera and adds a prepass to another.
    step(&mut apps, "prepasses", |s| {
        let (first, second) = (s.cameras[0], s.cameras[1]);
        let world = s.app.world_mut();
        world
            .entity_mut(second)
            .remove::<(DepthPrepass, NormalPrepass, MotionVectorPrepass)>();
        world.entity_mut(first).insert(DepthPrepass);
    });
}

/// Plugin that spawns a camera which draws over the picture of another camera. It does not use this
/// crate's plugin.
struct Overlay;

#[derive(Resource)]
struct Drawn(Handle<Image>);

impl Plugin for Overlay {
    fn build(&self, app: &mut App) {
        app.add_systems(
            Startup,
            |mut commands: Commands, mut images: ResMut<Assets<Image>>| {
                let image = crate::support::app::create_target_image(128, 96);
                let image = images.add(image);
                commands.spawn((
                    Camera3d {
                        depth_load_op: Camera3dDepthLoadOp::Clear(0.0),
                        ..default()
                    },
                    Camera {
                        order: 7,
                        ..default()
                    },
                    RenderTarget::Image(image.clone().into()),
                    Tonemapping::None,
                    DebandDither::Disabled,
                    Transform::from_xyz(0.4, 1.0, 3.5).looking_at(Vec3::Y, Vec3::Y),
                ));
                commands.insert_resource(Drawn(image));
            },
        );
    }
}

#[test]
fn camera_of_another_plugin_draws_the_scene() {
    // The overlay is added before `finish` of this plugin.
    let mut apps = [true, false].map(|plugin| {
        let mut stage = Stage::new(plugin, |app| {
            app.add_plugins(Overlay);
        });
        run(&mut stage.app, 1);
        let image = stage.app.world().resource::<Drawn>().0.clone();
        stage.images.push(image);
        stage
    });
    step(&mut apps, "second_plugin", |_| {});
}

#[test]
fn renderer_method_of_game_is_kept() {
    let method = |app: &App| {
        format!(
            "{:?}",
            app.world().resource::<DefaultOpaqueRendererMethod>()
        )
    };
    let forward = format!("{:?}", DefaultOpaqueRendererMethod::forward());
    let mut app = App::new();
    app.add_plugins((headless_plugins(), MeshlessGiPlugin::default()));
    assert_ne!(method(&app), forward);
    app.insert_resource(DefaultOpaqueRendererMethod::forward());
    finish_plugins(&mut app);
    run(&mut app, 2);
    assert_eq!(method(&app), forward);
    let mut app = App::new();
    app.add_plugins(headless_plugins())
        .insert_resource(DefaultOpaqueRendererMethod::forward())
        .add_plugins(MeshlessGiPlugin {
            deferred_by_default: false,
        });
    assert_eq!(method(&app), forward);
}

/// Returns the recipe of the room's bake with probes.
fn with_probes() -> Recipe {
    Recipe {
        preset: Preset::Draft,
        probes: Some(ProbeSettings {
            spacing: Some(0.25),
            rays_per_probe: None,
        }),
        ..Recipe::default()
    }
}

#[test]
fn masked_materials_with_volume_are_lit_once() {
    let bake = Room::cornell().bake_as(&with_probes());
    let mut app = app();
    let root = spawn_baked(&mut app, &Room::cornell(), &bake, Transform::IDENTITY);
    app.world_mut()
        .entity_mut(root)
        .insert(GiIrradianceVolume::default());
    spawn_light_source(&mut app, LIGHT_SOURCE);
    let image = target(&mut app);
    let eye = (camera(&image, view()), GiCamera::default());
    let eye = app.world_mut().spawn(eye).id();
    // Writing the volume takes some frames. Meanwhile the lighting pass without the volume is
    // compiled.
    run(&mut app, 60);
    let opaque = picture(&mut app, &image);
    let set_alpha_mode = |app: &mut App, mode: AlphaMode| {
        let mut materials = app.world_mut().resource_mut::<Assets<StandardMaterial>>();
        let ids: Vec<_> = materials.ids().collect();
        for id in ids {
            materials.get_mut(id).expect("it is there").alpha_mode = mode;
        }
        run(app, 4);
    };
    set_alpha_mode(&mut app, AlphaMode::Mask(0.5));
    let masked = picture(&mut app, &image);
    save_picture("cameras_masked", &opaque.beside(&masked));
    let d = masked.nrmse(&opaque);
    println!("masked: NRMSE {d}");
    assert!(d < 0.005, "{d}");
    // If `enabled` is `false`, the camera shows direct light alone, for masked and opaque
    // materials. Enabled again, it shows all light.
    let enable = |app: &mut App, on: bool| {
        let mut display = app.world_mut().get_mut::<GiCamera>(eye).unwrap();
        display.enabled = on;
        run(app, 4);
        picture(app, &image)
    };
    let off = enable(&mut app, false);
    assert!(off.mean() < 0.8 * opaque.mean(), "{}", off.mean());
    let again = enable(&mut app, true);
    assert!(again.nrmse(&opaque) < 0.005, "{}", again.nrmse(&opaque));
}

/// Returns the warnings of an app with a baked room and a camera with these components after 24
/// frames.
fn warnings_with(components: impl Bundle, change: impl Fn(&mut App, Entity)) -> Vec<GiWarning> {
    let mut app = app();
    let root = spawn_room(&mut app, Transform::IDENTITY);
    let image = target(&mut app);
    let mut eye = app.world_mut().spawn(camera(&image, view()));
    eye.insert(components);
    change(&mut app, root);
    run(&mut app, 24);
    app.world().resource::<GiWarnings>().0.clone()
}

#[test]
fn bake_without_gi_camera_warns_once() {
    let nothing = |_: &mut App, _: Entity| {};
    assert_eq!(warnings_with((), nothing), [GiWarning::NoDisplay]);
    let deferred = (DepthPrepass, NormalPrepass, DeferredPrepass, Msaa::Off);
    assert_eq!(
        warnings_with(deferred, nothing),
        [GiWarning::NoDeferredDisplay]
    );
    // No warning with either remedy, with an inactive camera, with a camera on another layer, or
    // with a disabled display.
    assert_eq!(warnings_with(GiCamera::default(), nothing), []);
    let volume = |app: &mut App, root: Entity| {
        app.world_mut()
            .entity_mut(root)
            .insert(GiIrradianceVolume::default());
    };
    assert_eq!(warnings_with((), volume), [GiWarning::NoProbes]);
    let inactive = Camera {
        is_active: false,
        ..default()
    };
    assert_eq!(warnings_with(inactive, nothing), []);
    assert_eq!(warnings_with(RenderLayers::layer(3), nothing), []);
    let off = GiCamera {
        enabled: false,
        ..default()
    };
    assert_eq!(warnings_with(off, nothing), []);
}

#[test]
fn missing_camera_message_names_remedies_volume_first_for_forward() {
    let warned = |finding: GiWarning| {
        ["GiIrradianceVolume", "GiCamera"].map(|remedy| finding.message().find(remedy))
    };
    let [Some(volume), Some(camera)] = warned(GiWarning::NoDisplay) else {
        panic!("the message lacks a remedy");
    };
    assert!(volume < camera);
    let [Some(volume), Some(camera)] = warned(GiWarning::NoDeferredDisplay) else {
        panic!("the message lacks a remedy");
    };
    assert!(camera < volume);
}

#[test]
fn late_gi_camera_does_not_warn() {
    let mut app = app();
    spawn_room(&mut app, Transform::IDENTITY);
    let image = target(&mut app);
    let eye = app.world_mut().spawn(camera(&image, view())).id();
    run(&mut app, 8);
    app.world_mut().entity_mut(eye).insert(GiCamera::default());
    run(&mut app, 24);
    assert_eq!(app.world().resource::<GiWarnings>().0, []);
}

/// Returns the largest relative difference between neighboring pixels on the back wall. Light
/// varies slowly there.
fn largest_relative_difference(picture: &Picture) -> f32 {
    let (left, right, top, bottom) = (45, 58, 29, 46);
    let at = |x: usize, y: usize| picture.pixels[y * picture.width + x][1];
    let mut largest = 0.0f32;
    for y in top..bottom {
        for x in left..right {
            let (here, beside, below) = (at(x, y), at(x + 1, y), at(x, y + 1));
            assert!(here > 0.0, "the wall is lit at {x}, {y}");
            largest = largest.max((here - beside).abs() / here);
            largest = largest.max((here - below).abs() / here);
        }
    }
    largest
}

#[test]
fn volume_at_draft_is_smooth_with_default_camera() {
    let bake = Room::cornell().bake_as(&with_probes());
    let mut shown = [false, true].map(|deferred| {
        let mut app = app();
        let root = spawn_baked(&mut app, &Room::cornell(), &bake, Transform::IDENTITY);
        app.world_mut()
            .entity_mut(root)
            .insert(GiIrradianceVolume::default());
        spawn_light_source(&mut app, LIGHT_SOURCE);
        let image = target(&mut app);
        let mut eye = app.world_mut().spawn(camera(&image, view()));
        if deferred {
            eye.insert(GiCamera::default());
        }
        run(&mut app, 60);
        let shown = picture(&mut app, &image);
        let findings = app.world().resource::<GiWarnings>().0.clone();
        assert_eq!(findings, []);
        shown
    });
    let [forward, deferred] = &mut shown;
    save_picture("cameras_draft", &deferred.beside(forward));
    let (smooth, full) = (
        largest_relative_difference(forward),
        largest_relative_difference(deferred),
    );
    println!("largest jump: volume {smooth:.4}, display {full:.4}");
    println!("NRMSE to the display {}", forward.nrmse(deferred));
    assert!(smooth < full, "the volume is smoother than the display");
    assert!(forward.nrmse(deferred) < 0.08);
}
