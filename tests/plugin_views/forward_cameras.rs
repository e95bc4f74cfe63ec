//! Display of forward cameras. It matches the light of a deferred camera, also without HDR, in a
//! viewport, and next to transparent or transmissive surfaces.

use crate::support::app::{app, camera, picture, run, target};
use crate::support::flip::Picture;
use crate::support::scenes::{Room, rough_recipe};
use crate::support::stage::{counters, save_picture, spawn_baked, spawn_light_source, view};
use bevy::camera::{Hdr, Viewport};
use bevy::pbr::ViewTransmissionTexture;
use bevy::prelude::*;
use bevy_meshless_gi::GiWarnings;
use bevy_meshless_gi::internals::plan::FrameStage;
use bevy_meshless_gi::prelude::*;
use meshless_gi::{BakedScene, ProbeSettings, Recipe};
use std::sync::{Arc, OnceLock};

const LIGHT_SOURCE: Vec3 = Vec3::new(0.3, 1.7, 0.5);
/// Largest NRMSE between the indirect light of a forward display and of the deferred display.
/// Normals have ten bits instead of twelve, and values have half precision.
const MAX_ERROR: f32 = 0.012;

/// Returns the room's bake with coarse probes, so that the pictures of the display and of the
/// volume differ.
fn bake() -> Arc<BakedScene> {
    static MADE: OnceLock<Arc<BakedScene>> = OnceLock::new();
    let make = || {
        Room::cornell().bake_as(&Recipe {
            probes: Some(ProbeSettings {
                spacing: Some(0.5),
                rays_per_probe: None,
            }),
            ..rough_recipe()
        })
    };
    MADE.get_or_init(make).clone()
}

struct Scene {
    app: App,
    root: Entity,
    eye: Entity,
    image: Handle<Image>,
}

impl Scene {
    /// Creates the room with its volume, a light, and a camera with the components `kind`.
    fn new(kind: impl Bundle) -> Self {
        let mut app = app();
        let root = spawn_baked(&mut app, &Room::cornell(), &bake(), Transform::IDENTITY);
        app.world_mut()
            .entity_mut(root)
            .insert(GiIrradianceVolume::default());
        spawn_light_source(&mut app, LIGHT_SOURCE);
        let image = target(&mut app);
        let mut eye = app.world_mut().spawn(camera(&image, view()));
        eye.insert(kind);
        let eye = eye.id();
        run(&mut app, 16);
        Self {
            app,
            root,
            eye,
            image,
        }
    }

    fn picture(&mut self) -> Picture {
        run(&mut self.app, 3);
        picture(&mut self.app, &self.image)
    }

    /// Returns indirect light alone: the difference of the picture and the picture with direct
    /// light alone.
    fn indirect(&mut self) -> Picture {
        let mut shown = self.picture();
        let world = self.app.world_mut();
        let intensity = |world: &mut World, eye: Entity, to: f32| {
            if let Some(mut camera) = world.get_mut::<GiCamera>(eye) {
                camera.intensity = to;
            }
            if let Some(mut camera) = world.get_mut::<GiForwardCamera>(eye) {
                camera.intensity = to;
            }
        };
        intensity(world, self.eye, 0.0);
        let direct = self.picture();
        intensity(self.app.world_mut(), self.eye, 1.0);
        let pairs = shown
            .pixels
            .iter_mut()
            .flatten()
            .zip(direct.pixels.iter().flatten());
        pairs.for_each(|(all, direct)| *all -= direct);
        shown
    }

    /// Disables the forward display and returns the picture with the volume's light alone.
    fn picture_of_volume(&mut self) -> Picture {
        self.insert(GiForwardCamera {
            enabled: false,
            ..default()
        });
        self.picture()
    }

    fn insert(&mut self, parts: impl Bundle) {
        self.app.world_mut().entity_mut(self.eye).insert(parts);
    }

    /// Returns the picture with a pane of this material in front of the room.
    fn picture_with_pane(&mut self, material: StandardMaterial) -> Picture {
        let world = self.app.world_mut();
        let mesh = Rectangle::new(0.7, 0.7).mesh().build();
        let mesh = world.resource_mut::<Assets<Mesh>>().add(mesh);
        let material = world
            .resource_mut::<Assets<StandardMaterial>>()
            .add(material);
        let transform = Transform::from_xyz(-0.4, 0.9, 0.8);
        let pane = world.spawn((Mesh3d(mesh), MeshMaterial3d(material), transform));
        let pane = pane.id();
        let picture = self.picture();
        self.app.world_mut().despawn(pane);
        picture
    }
}

fn forward() -> impl Bundle {
    (GiForwardCamera::default(), Msaa::Off, Hdr)
}

fn deferred() -> impl Bundle {
    GiCamera::default()
}

/// Returns the deferred picture and its indirect light.
fn deferred_pictures() -> &'static [Picture; 2] {
    static MADE: OnceLock<[Picture; 2]> = OnceLock::new();
    MADE.get_or_init(|| {
        let mut scene = Scene::new(deferred());
        [scene.picture(), scene.indirect()]
    })
}

#[test]
fn forward_camera_matches_deferred() {
    let [picture, expected] = deferred_pictures();
    let mut shown = Scene::new(forward());
    let display = shown.picture();
    save_picture("forward_display", &picture.beside(&display));
    let light = shown.indirect();
    save_picture("forward_indirect", &expected.beside(&light));
    // With the display disabled, the coarser volume alone lights the picture.
    let volume = shown.picture_of_volume();
    save_picture("forward_volume", &display.beside(&volume));
    let (d, v) = (
        light.nrmse(expected),
        error_of_volume(&display, &volume, expected),
    );
    println!("forward display: NRMSE {d:.5}, volume {v:.5}");
    assert!(d < MAX_ERROR, "{d}");
    assert!(v > 2.0 * MAX_ERROR, "the volume is distinguished: {v}");
    // Enabled again with subsplats, then with intensity 0, then removed.
    shown.insert((GiForwardCamera::default(), GiSplatting::default()));
    let again = shown.picture();
    let d = again.nrmse(&display);
    println!("by subsplats: NRMSE {d:.5}");
    assert!(d < MAX_ERROR, "{d}");
    assert!(counters(&shown.app).dispatches_of(FrameStage::SPLAT) > 10);
    shown.insert(GiForwardCamera {
        intensity: 0.0,
        ..default()
    });
    let dark = shown.picture();
    assert!(dark.mean() < 0.8 * volume.mean(), "{}", dark.mean());
    let world = shown.app.world_mut();
    world.entity_mut(shown.eye).remove::<GiForwardCamera>();
    let plain = shown.picture();
    assert!(plain.nrmse(&volume) < 1e-3, "{}", plain.nrmse(&volume));
    assert_eq!(counters(&shown.app).dispatches_of(FrameStage::SPLAT), 0);
    let render = shown.app.sub_app_mut(bevy::render::RenderApp).world_mut();
    let mut bound = render.query::<&ViewTransmissionTexture>();
    assert_eq!(bound.iter(render).count(), 0, "the binding is Bevy's again");
    let findings = shown.app.world().resource::<GiWarnings>();
    assert_eq!(findings.0, []);
}

#[test]
fn forward_camera_without_hdr_matches_deferred() {
    let [expected, _] = deferred_pictures();
    let mut shown = Scene::new((GiForwardCamera::default(), Msaa::Off));
    let display = shown.picture();
    save_picture("forward_low", &expected.beside(&display));
    let volume = shown.picture_of_volume();
    let [d, v] = [&display, &volume].map(|p| p.nrmse(expected));
    println!("without HDR: NRMSE {d:.5}, volume {v:.5}");
    assert!(d < 0.5 * MAX_ERROR && v > 1.5 * d, "{d}, {v}");
}

/// Returns the difference between the volume's light and the display's light, relative to indirect
/// light.
fn error_of_volume(display: &Picture, volume: &Picture, indirect: &Picture) -> f32 {
    let mut moved = indirect.clone();
    let changes = volume
        .pixels
        .iter()
        .flatten()
        .zip(display.pixels.iter().flatten());
    let all = moved.pixels.iter_mut().flatten().zip(changes);
    all.for_each(|(light, (volume, display))| *light += volume - display);
    moved.nrmse(indirect)
}

#[test]
fn forward_camera_follows_light_and_viewport() {
    let [mut expected, mut shown] = [Scene::new(deferred()), Scene::new(forward())];
    for stage in [&mut expected, &mut shown] {
        let mut camera = stage.app.world_mut().get_mut::<Camera>(stage.eye).unwrap();
        camera.viewport = Some(Viewport {
            physical_position: UVec2::new(24, 10),
            physical_size: UVec2::new(80, 70),
            ..default()
        });
        let world = stage.app.world_mut();
        let mut light_sources = world.query_filtered::<&mut Transform, With<PointLight>>();
        light_sources.single_mut(world).unwrap().translation = Vec3::new(-0.5, 1.2, 0.6);
    }
    let (expected, shown) = (expected.indirect(), shown.indirect());
    save_picture("forward_viewport", &expected.beside(&shown));
    let d = shown.nrmse(&expected);
    println!("viewport: NRMSE {d:.5}");
    assert!(d < MAX_ERROR, "{d}");
}

#[test]
fn transparent_and_transmissive_surfaces_are_unchanged() {
    let pane = StandardMaterial {
        base_color: Color::linear_rgba(0.9, 0.8, 0.2, 0.5),
        alpha_mode: AlphaMode::Blend,
        perceptual_roughness: 1.0,
        reflectance: 0.0,
        ..default()
    };
    let glass = StandardMaterial {
        base_color: Color::WHITE,
        specular_transmission: 0.9,
        perceptual_roughness: 0.1,
        thickness: 0.1,
        ior: 1.2,
        ..default()
    };
    let [mut with, mut without] = [Scene::new(forward()), Scene::new(deferred())];
    let empty = without.picture();
    for (name, material) in [("pane", pane), ("glass", glass)] {
        let expected = without.picture_with_pane(material.clone());
        let shown = with.picture_with_pane(material);
        save_picture(&format!("forward_{name}"), &expected.beside(&shown));
        // In both pictures the volume lights the pane, and the display lights the surfaces behind
        // it.
        let d = shown.nrmse(&expected);
        println!("{name}: NRMSE {d:.5}");
        assert!(d < 2.0 * MAX_ERROR, "{name}: {d}");
        let change = expected.nrmse(&empty);
        assert!(change > 4.0 * d, "{name} is visible: {change}");
    }
}

#[test]
fn forward_camera_without_volume_evaluates_nothing() {
    let mut shown = Scene::new(forward());
    assert!(counters(&shown.app).dispatches_of(FrameStage::SPLAT) > 0);
    let root = shown.root;
    let world = shown.app.world_mut();
    world.entity_mut(root).remove::<GiIrradianceVolume>();
    shown.picture();
    assert_eq!(counters(&shown.app).dispatches_of(FrameStage::SPLAT), 0);
}
