//! Bevy's volumetric fog in a baked room, in the running plugin. Compares the light that the scene
//! adds to the picture with the twin, for all kinds of cameras. Without fog or volume, nothing
//! runs.

use crate::support::app::{HEIGHT, WIDTH, app, camera, picture, run, target};
use crate::support::flip::Picture;
use crate::support::scenes::{Room, exposure, rough_recipe};
use crate::support::stage::{
    counters, light_source, save_picture, settings, spawn_baked, spawn_light_source, view,
};
use bevy::asset::RenderAssetUsages;
use bevy::camera::Hdr;
use bevy::light::{FogVolume, VolumetricFog, VolumetricLight};
use bevy::pbr::DefaultOpaqueRendererMethod;
use bevy::prelude::*;
use bevy::render::render_resource::{Extent3d, TextureDimension, TextureFormat};
use bevy_meshless_gi::internals::plan::FrameStage;
use bevy_meshless_gi::prelude::*;
use bevy_meshless_gi::{GiDebugView, GiWarning, GiWarnings};
use meshless_gi::internals::frame::fog_inscatter::fog_inscatter;
use meshless_gi::internals::frame::volume::volume_texels;
use meshless_gi::internals::frame::{
    Fog, FogInscatterParams, FogParams, FogView, VolumeParams, VolumeValues, VoxelGrid,
    VoxelWeights, fog, voxels_of,
};
use meshless_gi::{BakedScene, CpuFrame, FrameLight, Geometry, ProbeSettings, Ray, Recipe};
use std::f32::consts::FRAC_PI_4;
use std::sync::{Arc, OnceLock};

const LIGHT_SOURCE: Vec3 = Vec3::new(0.3, 1.7, 0.5);
const STEPS: u32 = 48;
/// Voxel size in meters.
const VOXEL: f32 = 0.15;
/// Texels of a density along each edge.
const EDGE: u32 = 4;
/// Largest NRMSE between the fog's light and the twin. Pictures store half floats, and the fog's
/// light is a difference of two pictures.
const MAX_NRMSE: f32 = 0.01;

fn bake() -> Arc<BakedScene> {
    static BAKED: OnceLock<Arc<BakedScene>> = OnceLock::new();
    let make = || {
        Room::cornell().bake_as(&Recipe {
            probes: Some(ProbeSettings {
                spacing: Some(0.25),
                rays_per_probe: None,
            }),
            ..rough_recipe()
        })
    };
    BAKED.get_or_init(make).clone()
}

/// Rendering method of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
enum CameraKind {
    Deferred,
    Forward(Msaa),
}

struct Shown {
    app: App,
    placed: Transform,
    root: Entity,
    eye: Entity,
    light_source: Entity,
    sun: Entity,
    fog: Entity,
    image: Handle<Image>,
}

/// Returns the box of the fog in the room's space. The box extends beyond one side of the room and
/// does not fill the room.
fn fog_transform() -> Transform {
    Transform::from_xyz(0.3, 0.9, 0.4)
        .with_rotation(Quat::from_rotation_y(0.4))
        .with_scale(Vec3::new(1.9, 1.5, 1.7))
}

fn uniform_fog() -> FogVolume {
    FogVolume {
        fog_color: Color::linear_rgb(0.9, 1.0, 0.8),
        density_factor: 0.5,
        light_intensity: 2.0,
        ..default()
    }
}

fn fog_components(intensity: f32) -> (GiIrradianceVolume, GiVolumetricFog) {
    let volume = GiIrradianceVolume {
        voxel_size: Some(VOXEL),
        ..default()
    };
    (volume, GiVolumetricFog { intensity })
}

/// Returns the room with a light and fog, and a black sun, without which Bevy draws no fog.
fn stage(placed: Transform, kind: CameraKind, volume: FogVolume) -> Shown {
    let mut app = app();
    if kind != CameraKind::Deferred {
        app.insert_resource(DefaultOpaqueRendererMethod::forward());
    }
    let root = spawn_baked(&mut app, &Room::cornell(), &bake(), placed);
    let image = target(&mut app);
    let world = app.world_mut();
    world.entity_mut(root).insert(fog_components(1.0));
    let clear = VolumetricFog {
        ambient_intensity: 0.0,
        step_count: STEPS,
        ..default()
    };
    let mut eye = world.spawn((camera(&image, placed * view()), clear));
    match kind {
        CameraKind::Deferred => eye.insert(GiCamera::default()),
        CameraKind::Forward(samples) => eye.insert((Hdr, samples)),
    };
    let eye = eye.id();
    let sun = DirectionalLight {
        illuminance: 0.0,
        ..default()
    };
    let sun = world.spawn((sun, VolumetricLight)).id();
    let fog = world.spawn((volume, placed * fog_transform())).id();
    let light_source = spawn_light_source(&mut app, placed * LIGHT_SOURCE);
    let mut shown = Shown {
        app,
        placed,
        root,
        eye,
        light_source,
        sun,
        fog,
        image,
    };
    // Meanwhile, the probe weights of its voxels are computed.
    let mut frames = 0;
    while counters(&shown.app).dispatches_of(FrameStage::VOLUME) == 0 {
        run(&mut shown.app, 1);
        frames += 1;
        assert!(frames < 1000, "the volume is never written");
    }
    run(&mut shown.app, 3);
    shown
}

impl Shown {
    fn picture(&mut self) -> Picture {
        picture(&mut self.app, &self.image)
    }

    fn set_fog(&mut self, fog: f32) {
        let mut root = self.app.world_mut().entity_mut(self.root);
        root.get_mut::<GiVolumetricFog>().unwrap().intensity = fog;
        run(&mut self.app, 2);
    }

    /// Returns the light that the scene's fog adds to the picture.
    fn fog_light(&mut self) -> Picture {
        let with = self.picture();
        self.set_fog(0.0);
        let without = self.picture();
        self.set_fog(1.0);
        subtract(&with, &without)
    }

    /// Returns the number of dispatches and draws for fog in the last frame: one of each per fog
    /// volume.
    fn draws(&self) -> u32 {
        counters(&self.app).dispatches_of(FrameStage::FOG)
    }

    /// Returns the twin's light of the fog, with a light at `position` in the room's space and an
    /// optional density `texture`.
    fn twin(
        &self,
        position: Vec3,
        fog: &FogVolume,
        texture: Option<&dyn Fn(Vec3) -> f32>,
    ) -> Picture {
        let bake = bake();
        let local_from_world = self.placed.to_matrix().inverse();
        let mut frame = CpuFrame::new(&bake);
        let lights: Vec<FrameLight> = FrameLight::expand(&light_source(self.placed * position), 16)
            .iter()
            .map(|l| l.to_local(&local_from_world))
            .collect();
        frame.set_lights(&bake, &lights);
        frame.solve(&bake, &settings());
        let bounds = bake.info().bounds.map(Vec3::from_array);
        let shape = shape();
        let weights = VoxelWeights::from_scene(shape, bake.data());
        let values = VolumeValues {
            points: frame.vector_irradiance(),
            probes: frame.probes(),
        };
        let voxels = VolumeParams::new(&shape, &local_from_world);
        let texels = volume_texels(&voxels, &weights, values);
        let aspect = WIDTH as f32 / HEIGHT as f32;
        let near = 0.1;
        let seen = FogView {
            view_from_clip: Mat4::perspective_infinite_reverse_rh(FRAC_PI_4, aspect, near)
                .inverse(),
            world_from_view: (self.placed * view()).to_matrix(),
            viewport: [0.0, 0.0, WIDTH as f32, HEIGHT as f32],
            exposure: exposure(),
            steps: STEPS,
        };
        let rgb = |c: Color| Vec3::from_array(c.to_linear().to_f32_array_no_alpha());
        let volume = Fog {
            world_from_local: (self.placed * fog_transform()).to_matrix(),
            color: rgb(fog.fog_color) * rgb(fog.light_tint) * fog.light_intensity,
            density: fog.density_factor,
            absorption: fog.absorption,
            scattering: fog.scattering,
            asymmetry: fog.scattering_asymmetry,
            texture: texture.map(|_| fog.density_texture_offset),
        };
        let world_from_local = self.placed.to_matrix();
        let params = FogParams::new(&seen, &volume, &shape, bounds, &world_from_local, &[]);
        let sent = FogInscatterParams::new(&seen, volume.asymmetry, &shape, &world_from_local);
        let size = shape.size();
        let light: Vec<[f32; 4]> = (0..size.element_product())
            .map(|i| UVec3::new(i % size.x, i / size.x % size.y, i / (size.x * size.y)))
            .map(|voxel| fog_inscatter(&sent, &texels, voxel))
            .collect();
        let texture = texture.unwrap_or(&|_| 1.0);
        let room = Room::cornell();
        let half = (FRAC_PI_4 / 2.0).tan();
        let pixel = |i: u32| {
            let at = Vec2::new((i % WIDTH) as f32, (i / WIDTH) as f32) + 0.5;
            let ndc = Vec2::new(
                2.0 * at.x / WIDTH as f32 - 1.0,
                1.0 - 2.0 * at.y / HEIGHT as f32,
            );
            let toward = view().rotation * Vec3::new(ndc.x * aspect * half, ndc.y * half, -1.0);
            // Bevy culls back faces.
            let faces = |q: &&_| {
                let q: &crate::support::scenes::Quad = q;
                q.u.cross(q.v).dot(toward) < 0.0
            };
            let front = Room(room.0.iter().filter(faces).copied().collect());
            let hit = front.cast(&Ray::new(view().translation, toward));
            let depth = hit.map_or(0.0, |hit| near / hit.t);
            fog::fog(&params, &texels, &light, texture, at, depth).to_array()
        };
        Picture {
            width: WIDTH as usize,
            height: HEIGHT as usize,
            pixels: (0..WIDTH * HEIGHT).map(pixel).collect(),
        }
    }
}

/// Returns the volume's voxel grid.
fn shape() -> VoxelGrid {
    let [low, high] = bake().info().bounds.map(Vec3::from_array);
    let (low, high) = (low - VOXEL, high + VOXEL);
    let max = GiIrradianceVolume::default().max_voxels;
    VoxelGrid::new([low, high], voxels_of(high - low, VOXEL, max)).unwrap()
}

fn subtract(a: &Picture, b: &Picture) -> Picture {
    let less = |(a, b): (&[f32; 3], &[f32; 3])| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    Picture {
        width: a.width,
        height: a.height,
        pixels: a.pixels.iter().zip(&b.pixels).map(less).collect(),
    }
}

fn rotated_transform() -> Transform {
    Transform::from_xyz(3.0, -1.0, 2.0).with_rotation(Quat::from_rotation_y(0.6))
}

#[test]
fn fog_of_every_camera_matches_twin() {
    let kinds = [
        ("deferred", Transform::IDENTITY, CameraKind::Deferred),
        ("deferred_turned", rotated_transform(), CameraKind::Deferred),
        (
            "forward",
            Transform::IDENTITY,
            CameraKind::Forward(Msaa::Off),
        ),
        (
            "forward_sampled",
            Transform::IDENTITY,
            CameraKind::Forward(Msaa::Sample4),
        ),
    ];
    for (name, placed, kind) in kinds {
        let mut s = stage(placed, kind, uniform_fog());
        let findings = s.app.world().resource::<GiWarnings>().0.clone();
        assert_eq!(findings, [], "{name}");
        let whole = s.picture();
        let fog_light = s.fog_light();
        let twin = s.twin(LIGHT_SOURCE, &uniform_fog(), None);
        save_picture(&format!("fog_{name}"), &fog_light.beside(&twin));
        save_picture(&format!("fog_{name}_whole"), &whole.beside(&whole));
        let (off, share) = (fog_light.nrmse(&twin), twin.mean() / whole.mean());
        println!("{name}: NRMSE {off:.4}; fog adds {share:.3} of the picture's light");
        // The first of several samples is not in the center of the pixel, so edges differ.
        let max = if name == "forward_sampled" { 5.0 } else { 1.0 } * MAX_NRMSE;
        assert!(off <= max, "{name}: {off}");
        assert!(share > 0.02, "{name}: {share}");
        // A light moves. The light in the fog follows in that frame.
        let position = Vec3::new(-0.6, 0.5, 0.9);
        let aside = fog_light.nrmse(&s.twin(position, &uniform_fog(), None));
        assert!(aside > 5.0 * max, "{name}: {aside}");
        let mut light_source = s.app.world_mut().entity_mut(s.light_source);
        light_source.get_mut::<Transform>().unwrap().translation = s.placed * position;
        run(&mut s.app, 1);
        let now = counters(&s.app);
        let ran = [FrameStage::VOLUME, FrameStage::FOG].map(|stage| now.dispatches_of(stage));
        assert_eq!(ran, [1, 2], "{name}: {}", now.plan);
        let off = s.fog_light().nrmse(&s.twin(position, &uniform_fog(), None));
        println!("{name}, light moved: NRMSE {off:.4}");
        assert!(off <= max, "{name}: {off}");
    }
}

/// Returns a texel of the density texture, of `EDGE` texels along each edge.
fn density(k: UVec3) -> u8 {
    [0, 255, 40, 160][((k.x + 2 * k.y + 3 * k.z) % 4) as usize]
}

fn trilinear(at: Vec3) -> f32 {
    let at = at * EDGE as f32 - 0.5;
    let first = at.floor();
    (0..8u32)
        .map(|k| {
            let corner = first + UVec3::new(k & 1, k >> 1 & 1, k >> 2).as_vec3();
            let weight = (1.0 - (at - corner).abs()).element_product();
            let last = Vec3::splat(EDGE as f32 - 1.0);
            weight * f32::from(density(corner.clamp(Vec3::ZERO, last).as_uvec3())) / 255.0
        })
        .sum()
}

#[test]
fn fog_density_texture_scales_light() {
    let mut s = stage(rotated_transform(), CameraKind::Deferred, uniform_fog());
    let texels = (0..EDGE * EDGE * EDGE)
        .map(|i| density(UVec3::new(i % EDGE, i / EDGE % EDGE, i / (EDGE * EDGE))))
        .collect();
    let mut image = Image::new(
        Extent3d {
            width: EDGE,
            height: EDGE,
            depth_or_array_layers: EDGE,
        },
        TextureDimension::D3,
        texels,
        TextureFormat::R8Unorm,
        RenderAssetUsages::RENDER_WORLD,
    );
    image.sampler = bevy::image::ImageSampler::linear();
    let world = s.app.world_mut();
    let image = world.resource_mut::<Assets<Image>>().add(image);
    let textured = FogVolume {
        density_factor: 1.5,
        density_texture: Some(image),
        density_texture_offset: Vec3::new(0.1, 0.0, -0.05),
        ..uniform_fog()
    };
    world.entity_mut(s.fog).insert(textured.clone());
    run(&mut s.app, 3);
    let fog_light = s.fog_light();
    let twin = s.twin(LIGHT_SOURCE, &textured, Some(&trilinear));
    save_picture("fog_textured", &fog_light.beside(&twin));
    let aside = FogVolume {
        density_texture_offset: Vec3::ZERO,
        ..textured.clone()
    };
    let aside = s.twin(LIGHT_SOURCE, &aside, Some(&trilinear));
    let [off, moved] = [&twin, &aside].map(|t| fog_light.nrmse(t));
    println!("NRMSE {off:.4}, without the offset {moved:.4}");
    assert!(off <= MAX_NRMSE && moved > 3.0 * MAX_NRMSE, "{off} {moved}");
}

/// Tests that only the first of two overlapping scenes lights the fog.
#[test]
fn fog_in_two_scenes_is_lit_once() {
    let mut s = stage(Transform::IDENTITY, CameraKind::Deferred, uniform_fog());
    let one = s.fog_light();
    let world = s.app.world_mut();
    let asset = world.get::<GiScene>(s.root).unwrap().clone();
    world.spawn((asset, Transform::IDENTITY, fog_components(1.0)));
    let mut frames = 0;
    while s.draws() < 4 || counters(&s.app).dispatches_of(FrameStage::VOLUME) > 0 {
        run(&mut s.app, 1);
        frames += 1;
        assert!(frames < 1000, "the second scene never lights fog");
    }
    run(&mut s.app, 3);
    // Both are toggled: the second adds nothing.
    let with = s.picture();
    let mut volumes = s.app.world_mut().query::<&mut GiVolumetricFog>();
    for mut fog in volumes.iter_mut(s.app.world_mut()) {
        fog.intensity = 0.0;
    }
    run(&mut s.app, 2);
    let both = subtract(&with, &s.picture());
    let off = both.nrmse(&one);
    println!("two scenes to one: NRMSE {off:.4}");
    assert!(off <= 0.01, "{off}");
}

#[test]
fn plugin_without_lit_fog_runs_no_fog_pass() {
    let mut s = stage(Transform::IDENTITY, CameraKind::Deferred, uniform_fog());
    let lit = counters(&s.app);
    assert_eq!(s.draws(), 2);
    let words = lit.plan.to_string();
    assert!(words.contains("(fog): 1 fog volume(s)"), "{words}");
    assert_eq!(lit.plan.inventory.fogs, 1);
    // Disabled: the parameters and the in-scattered light are released, and the voxels stay.
    s.set_fog(0.0);
    let off = counters(&s.app);
    assert_eq!((off.plan.count(FrameStage::FOG), s.draws()), (0, 0));
    let params = (size_of::<FogParams>() + size_of::<FogInscatterParams>()) as u64;
    let sent = 8 * u64::from(shape().voxels());
    assert_eq!(
        (off.buffers, off.bytes),
        (lit.buffers - 2, lit.bytes - params - sent)
    );
    assert_eq!(off.dispatches_of(FrameStage::VOLUME), 0);
    let dark = s.picture();
    s.set_fog(1.0);
    assert_eq!(s.draws(), 2);
    assert_eq!(counters(&s.app).dispatches_of(FrameStage::VOLUME), 0);
    // Each of these changes disables the fog's light, and its reversal enables it again.
    type Change = fn(&mut Shown, bool);
    let changes: [(&str, Change); 6] = [
        ("fog is outside the scene", |s, back| {
            let position = match back {
                true => fog_transform(),
                false => fog_transform().with_translation(Vec3::splat(20.0)),
            };
            s.app.world_mut().entity_mut(s.fog).insert(position);
        }),
        ("no light is volumetric", |s, back| {
            let mut sun = s.app.world_mut().entity_mut(s.sun);
            match back {
                true => sun.insert(VolumetricLight),
                false => sun.remove::<VolumetricLight>(),
            };
        }),
        ("the camera shows no fog", |s, back| {
            let mut eye = s.app.world_mut().entity_mut(s.eye);
            match back {
                true => eye.insert(VolumetricFog {
                    ambient_intensity: 0.0,
                    step_count: STEPS,
                    ..default()
                }),
                false => eye.remove::<VolumetricFog>(),
            };
        }),
        ("the camera's indirect light is off", |s, back| {
            let mut eye = s.app.world_mut().entity_mut(s.eye);
            eye.get_mut::<GiCamera>().unwrap().enabled = back;
        }),
        ("the camera shows indirect light alone", |s, back| {
            let mut eye = s.app.world_mut().entity_mut(s.eye);
            eye.get_mut::<GiCamera>().unwrap().debug_view = match back {
                true => GiDebugView::Final,
                false => GiDebugView::IndirectOnly,
            };
        }),
        ("scattering is NaN", |s, back| {
            let mut fog = s.app.world_mut().entity_mut(s.fog);
            fog.get_mut::<FogVolume>().unwrap().scattering = if back { 0.3 } else { f32::NAN };
        }),
    ];
    for (name, change) in changes {
        change(&mut s, false);
        run(&mut s.app, 2);
        let now = counters(&s.app);
        assert_eq!(
            (now.plan.count(FrameStage::FOG), s.draws()),
            (0, 0),
            "{name}"
        );
        change(&mut s, true);
        run(&mut s.app, 3);
        assert_eq!(s.draws(), 2, "{name}, undone");
    }
    // A factor of two doubles the light.
    let one = subtract(&s.picture(), &dark);
    s.set_fog(2.0);
    let two = subtract(&s.picture(), &dark);
    let ratio = two.mean() / one.mean();
    assert!((ratio - 2.0).abs() < 0.02, "{ratio}");
    // Ambient light in lit fog causes a warning.
    let warned = |app: &App| app.world().resource::<GiWarnings>().0.clone();
    assert_eq!(warned(&s.app), []);
    let mut eye = s.app.world_mut().entity_mut(s.eye);
    eye.insert(VolumetricFog::default());
    run(&mut s.app, 1);
    assert_eq!(warned(&s.app), [GiWarning::FogAmbient]);
}
