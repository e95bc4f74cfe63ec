//! Irradiance volumes for forward cameras in the running plugin. The room's picture by a deferred
//! camera with `GiCamera` is compared with that by a forward camera with a volume.

use crate::support::app::{app, camera, picture, run, target};
use crate::support::flip::{Picture, flip};
use crate::support::scenes::{Quad, Room, rough_recipe};
use crate::support::stage::{counters, save_picture, spawn_light_source, view, work};
use bevy::asset::RenderAssetUsages;
use bevy::camera::visibility::VisibleEntities;
use bevy::light::IrradianceVolume;
use bevy::light::cluster::ClusterVisibilityClass;
use bevy::material::OpaqueRendererMethod;
use bevy::mesh::PrimitiveTopology;
use bevy::pbr::DefaultOpaqueRendererMethod;
use bevy::prelude::*;
use bevy_meshless_gi::internals::plan::FrameStage;
use bevy_meshless_gi::prelude::*;
use bevy_meshless_gi::{GiSettings, GiWarning, GiWarnings};
use meshless_gi::{
    BakedScene, Preset, ProbeSettings, Progress, Recipe, TriangleMesh, bake_scene, load_gltf,
};
use std::sync::{Arc, OnceLock};

const LIGHT_SOURCE: Vec3 = Vec3::new(0.3, 1.7, 0.5);
/// Albedo of a floating panel.
const PANEL: [f32; 3] = [0.7, 0.65, 0.7];
/// Largest mean FLIP between the pictures of both cameras.
const MAX_FLIP: f32 = 0.05;

/// Returns the room's bake with or without probes. Each is baked once.
fn bake(probes: bool) -> Arc<BakedScene> {
    static BAKED: [OnceLock<Arc<BakedScene>>; 2] = [const { OnceLock::new() }; 2];
    let make = || {
        Room::cornell().bake_as(&Recipe {
            probes: probes.then_some(ProbeSettings {
                spacing: Some(0.25),
                rays_per_probe: None,
            }),
            ..rough_recipe()
        })
    };
    BAKED[usize::from(probes)].get_or_init(make).clone()
}

/// Returns the room with a floating panel.
fn with_panel() -> Room {
    let mut room = Room::cornell();
    let turn = Quat::from_rotation_y(0.5) * Quat::from_rotation_x(-0.2);
    room.0.push(Quad {
        corner: Vec3::new(-0.75, 1.0, 0.4),
        u: turn * Vec3::new(0.6, 0.0, 0.0),
        v: turn * Vec3::new(0.0, 0.6, 0.0),
        color: PANEL.into(),
    });
    room
}

struct Shown {
    app: App,
    root: Entity,
    light_source: Entity,
    image: Handle<Image>,
}

/// Creates an app with the room below a root with the transform `placed`, a light, and a camera.
/// The camera is deferred with `GiCamera` if `forward` is `None`, else forward with that number of
/// samples per pixel.
fn stage(bake: &Arc<BakedScene>, placed: Transform, forward: Option<Msaa>) -> Shown {
    let mut app = app();
    if forward.is_some() {
        app.insert_resource(DefaultOpaqueRendererMethod::forward());
    }
    let asset = app
        .world_mut()
        .resource_mut::<Assets<GiBakedScene>>()
        .add(GiBakedScene {
            scene: bake.clone(),
        });
    let root = app.world_mut().spawn((GiScene(asset), placed)).id();
    with_panel().spawn(&mut app, root);
    let image = target(&mut app);
    let mut eye = app.world_mut().spawn(camera(&image, placed * view()));
    match forward {
        None => eye.insert(GiCamera::default()),
        Some(samples) => eye.insert((bevy::camera::Hdr, samples)),
    };
    let light_source = spawn_light_source(&mut app, placed * LIGHT_SOURCE);
    Shown {
        app,
        root,
        light_source,
        image,
    }
}

impl Shown {
    fn picture(&mut self) -> Picture {
        picture(&mut self.app, &self.image)
    }

    fn insert_volume(&mut self, volume: GiIrradianceVolume) {
        self.app.world_mut().entity_mut(self.root).insert(volume);
        run(&mut self.app, 4);
    }

    /// Runs until the volume is visible to the deferred camera. Meanwhile the lighting pass that
    /// excludes the volume from the G-buffer is compiled.
    fn run_until_volume_is_visible(&mut self) {
        let sees = |app: &mut App| {
            let mut cameras = app
                .world_mut()
                .query_filtered::<&VisibleEntities, With<GiCamera>>();
            let seen = cameras.iter(app.world());
            let class = std::any::TypeId::of::<ClusterVisibilityClass>();
            let seen: Vec<Entity> = seen.flat_map(|e| e.get(class)).copied().collect();
            let volume = |e: &Entity| app.world().get::<IrradianceVolume>(*e).is_some();
            seen.iter().any(volume)
        };
        for _ in 0..10_000 {
            run(&mut self.app, 1);
            if sees(&mut self.app) {
                run(&mut self.app, 3);
                return;
            }
        }
        panic!("the volume is never in the view");
    }

    fn move_light_source(&mut self, position: Vec3) {
        let mut light_source = self
            .app
            .world_mut()
            .get_mut::<Transform>(self.light_source)
            .unwrap();
        light_source.translation = position;
        run(&mut self.app, 1);
    }
}

#[test]
fn volume_light_matches_deferred_light() {
    let turned = Transform::from_xyz(3.0, -1.0, 2.0).with_rotation(Quat::from_rotation_y(0.6));
    for (name, placed) in [("volume", Transform::IDENTITY), ("volume_turned", turned)] {
        // One sample per pixel in both, so that antialiasing of edges is not compared.
        let kinds = [None, Some(Msaa::Off)];
        let [mut deferred, mut forward] = kinds.map(|of| stage(&bake(true), placed, of));
        run(&mut deferred.app, 4);
        run(&mut forward.app, 4);
        let expected = deferred.picture();
        // Without the component, the forward camera shows direct light alone, and the device has no
        // data of a volume.
        let dark = forward.picture();
        let none = counters(&forward.app);
        assert_eq!((none.buffers, none.bytes, none.pipelines), (0, 0, 0));
        assert!(!none.plan.to_string().contains("volume"), "{}", none.plan);
        forward.insert_volume(GiIrradianceVolume::default());
        let lit = forward.picture();
        save_picture(name, &expected.beside(&lit));
        save_picture(&format!("{name}_without"), &expected.beside(&dark));
        let [d, without] = [&lit, &dark].map(|p| flip(&expected, p));
        println!("{name}: FLIP {d:.4}, {without:.4} without the volume");
        assert!(d <= MAX_FLIP, "{name}: {d}");
        assert!(without > 2.0 * MAX_FLIP, "{name}: {without}");
        assert!(forward.app.world().resource::<GiWarnings>().0.is_empty());
        // Without a change, nothing is written.
        run(&mut forward.app, 2);
        assert_eq!(counters(&forward.app).dispatches_of(FrameStage::VOLUME), 0);
        // A light moves. Both pictures follow in that frame.
        let moved = placed * Vec3::new(-0.6, 1.2, 0.9);
        deferred.move_light_source(moved);
        forward.move_light_source(moved);
        assert_eq!(counters(&forward.app).dispatches_of(FrameStage::VOLUME), 1);
        let expected = deferred.picture();
        let single = forward.picture();
        let d = flip(&expected, &single);
        println!("{name}, light moved: FLIP {d:.4}");
        assert!(d <= MAX_FLIP, "{name}, light moved: {d}");
        // With four samples per pixel, the edges are softer, also without indirect light. The light
        // is equal.
        let mut sampled = stage(&bake(true), placed, Some(Msaa::Sample4));
        run(&mut sampled.app, 4);
        let edges = flip(&dark, &sampled.picture());
        sampled.insert_volume(GiIrradianceVolume::default());
        sampled.move_light_source(moved);
        let sampled = sampled.picture();
        save_picture(&format!("{name}_sampled"), &expected.beside(&sampled));
        let d = flip(&single, &sampled);
        println!("{name}, four samples to one: FLIP {d:.4}, without indirect light {edges:.4}");
        assert!(d <= 1.3 * edges && edges < MAX_FLIP, "{name}: {d}, {edges}");
    }
}

/// Voxel size of the volume in the rooms in meters. The walls are two centimeters thick.
const VOXEL: f32 = 0.1;
/// Largest NRMSE between the pictures of both cameras in the rooms.
const MAX_NRMSE: f32 = 0.04;

/// Spawns each triangle of `rooms_open` as a Bevy mesh below `root`.
fn spawn_triangles(app: &mut App, mesh: &TriangleMesh, root: Entity) {
    for i in 0..mesh.len() {
        let corners = mesh.triangle(i).unwrap();
        let color = mesh.material(i).unwrap().base_color;
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a).normalize().to_array();
        let triangle = Mesh::new(
            PrimitiveTopology::TriangleList,
            RenderAssetUsages::default(),
        )
        .with_inserted_attribute(
            Mesh::ATTRIBUTE_POSITION,
            corners.map(|p| p.to_array()).to_vec(),
        )
        .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, vec![normal; 3]);
        let world = app.world_mut();
        let triangle = world.resource_mut::<Assets<Mesh>>().add(triangle);
        let material = rough_material(world, color.truncate());
        world.spawn((Mesh3d(triangle), material, ChildOf(root)));
    }
}

fn rough_material(world: &mut World, color: Vec3) -> MeshMaterial3d<StandardMaterial> {
    let material = StandardMaterial {
        base_color: Color::linear_rgb(color.x, color.y, color.z),
        perceptual_roughness: 1.0,
        reflectance: 0.0,
        double_sided: true,
        cull_mode: None,
        ..default()
    };
    MeshMaterial3d(world.resource_mut::<Assets<_>>().add(material))
}

/// Moves a ball from the lit one of two rooms into the door between them. The pictures of a
/// deferred camera and a forward camera match in FLIP and in NRMSE.
#[test]
fn ball_between_rooms_matches_in_forward_and_deferred() {
    let file = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/tests/data/rooms_open/rooms_open.glb"
    );
    let mesh = load_gltf(file).unwrap().mesh;
    let recipe = Recipe {
        preset: Preset::Draft,
        probes: Some(ProbeSettings::default()),
        ..Recipe::default()
    };
    let bake = bake_scene(&mesh, &recipe, 0, &Progress::default()).unwrap();
    let bake = Arc::new(bake.scene);
    let eye = Transform::from_xyz(0.7, 1.4, 3.2).looking_at(Vec3::new(3.9, 1.1, 1.9), Vec3::Y);
    let kinds = [None, Some(Msaa::Off)];
    let mut shown = kinds.map(|forward| {
        let mut app = app();
        if forward.is_some() {
            app.insert_resource(DefaultOpaqueRendererMethod::forward());
        }
        let world = app.world_mut();
        let asset = world
            .resource_mut::<Assets<GiBakedScene>>()
            .add(GiBakedScene {
                scene: bake.clone(),
            });
        let root = world.spawn((GiScene(asset), Transform::IDENTITY)).id();
        spawn_triangles(&mut app, &mesh, root);
        let image = target(&mut app);
        let world = app.world_mut();
        let mut camera = world.spawn(camera(&image, eye));
        match forward {
            None => camera.insert(GiCamera::default()),
            Some(samples) => camera.insert((bevy::camera::Hdr, samples)),
        };
        let light_source = PointLight {
            intensity: 5000.0 * 4.0 * std::f32::consts::PI,
            range: 30.0,
            ..default()
        };
        world.spawn((light_source, Transform::from_xyz(1.2, 2.2, 1.0)));
        let sphere = Sphere::new(0.3).mesh().uv(48, 32);
        let sphere = world.resource_mut::<Assets<Mesh>>().add(sphere);
        let material = rough_material(world, Vec3::splat(0.8));
        let ball = world
            .spawn((Mesh3d(sphere), material, Transform::IDENTITY))
            .id();
        (app, root, image, ball)
    });
    let mut at = |k: usize, position: Vec3, volume: bool| {
        let (app, root, image, ball) = &mut shown[k];
        let world = app.world_mut();
        world.get_mut::<Transform>(*ball).unwrap().translation = position;
        if volume {
            let fine = GiIrradianceVolume {
                voxel_size: Some(VOXEL),
                max_voxels: 1 << 18,
            };
            world.entity_mut(*root).insert(fine);
            // Meanwhile the probe weights of the voxels are computed.
            let written = |app: &App| counters(app).dispatches_of(FrameStage::VOLUME) > 0;
            let mut frames = 0;
            while !written(app) {
                run(app, 1);
                frames += 1;
                assert!(frames < 10_000, "the volume is never written");
            }
        }
        run(app, 4);
        picture(app, image)
    };
    let lit = Vec3::new(2.4, 1.1, 2.2);
    let dark = at(1, lit, false);
    for (name, position) in [
        ("ball_lit", lit),
        ("ball_by_the_wall", Vec3::new(3.6, 1.5, 2.6)),
        ("ball_in_the_door", Vec3::new(4.0, 1.0, 1.95)),
    ] {
        let (deferred, forward) = (at(0, position, false), at(1, position, name == "ball_lit"));
        save_picture(name, &deferred.beside(&forward));
        let (d, off) = (flip(&deferred, &forward), forward.nrmse(&deferred));
        println!("{name}: FLIP {d:.4}, NRMSE {off:.4}");
        assert!(d <= MAX_FLIP && off <= MAX_NRMSE, "{name}: {d}, {off}");
        assert!(dark.nrmse(&deferred) > 3.0 * MAX_NRMSE, "{name}: it is lit");
    }
}

#[test]
fn volume_does_not_light_gbuffer() {
    let mut s = stage(&bake(true), Transform::IDENTITY, None);
    run(&mut s.app, 4);
    let before = s.picture();
    let buffers = counters(&s.app).buffers;
    // Spawns a forward camera, for which the volume is written.
    let other = target(&mut s.app);
    let eye = (camera(&other, view()), bevy::camera::Hdr, Msaa::Sample4);
    s.app.world_mut().spawn(eye);
    s.insert_volume(GiIrradianceVolume::default());
    s.run_until_volume_is_visible();
    assert_eq!(s.picture().pixels, before.pixels);
    // Parameters, starts and weights of the positions, starts and weights of the wall faces, the
    // faces, and the wall distances.
    assert_eq!(counters(&s.app).buffers, buffers + 7);
    s.move_light_source(Vec3::new(-0.6, 1.2, 0.9));
    assert_eq!(counters(&s.app).dispatches_of(FrameStage::VOLUME), 1);
}

/// Change of a material's surface properties.
type Change = fn(&mut StandardMaterial);

/// Draws a transparent and a forward material in a view with a G-buffer. The volume lights them
/// like the display lights the same panel, and the rest of the picture is unchanged.
#[test]
fn forward_materials_in_deferred_view_are_lit_by_volume() {
    let shown = |change: Change| {
        let mut s = stage(&bake(true), Transform::IDENTITY, None);
        let mut materials = s.app.world_mut().resource_mut::<Assets<StandardMaterial>>();
        let panels = materials.iter_mut().filter_map(|(_, material)| {
            let panel = material.base_color == Color::linear_rgb(PANEL[0], PANEL[1], PANEL[2]);
            panel.then(|| change(material))
        });
        assert_eq!(panels.count(), 1);
        run(&mut s.app, 4);
        s
    };
    let expected = shown(|_| ()).picture();
    let kinds: [(&str, Change, _); 2] = [
        (
            "glass",
            |m| m.alpha_mode = AlphaMode::Blend,
            GiWarning::TransparentMaterial,
        ),
        (
            "forward",
            |m| m.opaque_render_method = OpaqueRendererMethod::Forward,
            GiWarning::ForwardMaterial,
        ),
    ];
    for (name, change, finding) in kinds {
        let mut s = shown(change);
        let warned = |s: &Shown| s.app.world().resource::<GiWarnings>().0.clone();
        assert_eq!(warned(&s), [finding]);
        s.app.world_mut().resource_mut::<GiWarnings>().0.clear();
        let dark = s.picture();
        s.insert_volume(GiIrradianceVolume::default());
        s.run_until_volume_is_visible();
        let lit = s.picture();
        assert_eq!(warned(&s), []);
        save_picture(&format!("volume_{name}"), &expected.beside(&lit));
        save_picture(&format!("volume_{name}_without"), &expected.beside(&dark));
        // Pixels of the panel: those that the volume changes. They are about a tenth of the
        // picture.
        let panel: Vec<usize> = (0..lit.pixels.len())
            .filter(|&i| lit.pixels[i] != dark.pixels[i])
            .collect();
        let share = panel.len() as f32 / lit.pixels.len() as f32;
        assert!(
            (0.01..0.3).contains(&share),
            "{name}: {share} of the picture"
        );
        let off = |p: &Picture| {
            let square = |a: &[f32; 3], b: &[f32; 3]| -> f32 {
                a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
            };
            let of = |i: &usize| square(&p.pixels[*i], &expected.pixels[*i]);
            let power = |i: &usize| square(&expected.pixels[*i], &[0.0; 3]);
            let [wrong, whole]: [f32; 2] =
                [panel.iter().map(of).sum(), panel.iter().map(power).sum()];
            (wrong / whole).sqrt()
        };
        let [with, without] = [off(&lit), off(&dark)];
        println!(
            "{name}: {share:.3} of the picture, NRMSE {with:.4}, {without:.4} without the volume"
        );
        assert!(
            with < 0.1 && without > 2.0 * with,
            "{name}: {with} {without}"
        );
        // The volume is written in the frame in which a light moves.
        s.move_light_source(Vec3::new(-0.6, 1.2, 0.9));
        assert_eq!(counters(&s.app).dispatches_of(FrameStage::VOLUME), 1);
    }
}

#[test]
fn volumes_follow_component_without_deferred_camera() {
    let mut s = stage(&bake(true), Transform::IDENTITY, Some(Msaa::Sample4));
    run(&mut s.app, 4);
    let before = counters(&s.app);
    assert_eq!((before.buffers, before.bytes, before.pipelines), (0, 0, 0));
    let dark = s.picture();
    s.insert_volume(GiIrradianceVolume::default());
    let lit = s.picture();
    assert!(
        lit.mean() > 1.2 * dark.mean(),
        "{} {}",
        lit.mean(),
        dark.mean()
    );
    assert!(counters(&s.app).bytes > 0);
    assert_eq!(work(&counters(&s.app)), [0; 4]);
    // With other voxels, a volume replaces the first one.
    let volumes = |app: &mut App| {
        let mut found = app.world_mut().query::<&IrradianceVolume>();
        found.iter(app.world()).count()
    };
    let coarse = GiIrradianceVolume {
        voxel_size: Some(0.5),
        max_voxels: 64,
    };
    s.insert_volume(coarse);
    assert_eq!(volumes(&mut s.app), 1);
    let blurred = s.picture();
    let d = flip(&lit, &blurred);
    println!("64 voxels: FLIP {d:.4} to the usual number");
    assert!(d > 0.0 && d < 0.2, "{d}");
    // Without the component, the picture is the first one again. The device buffers are released
    // after the scene was not visible for `unload_after_frames` frames.
    s.app
        .world_mut()
        .resource_mut::<GiSettings>()
        .unload_after_frames = 2;
    s.app
        .world_mut()
        .entity_mut(s.root)
        .remove::<GiIrradianceVolume>();
    run(&mut s.app, 6);
    assert_eq!(volumes(&mut s.app), 0);
    assert_eq!(s.picture().pixels, dark.pixels);
    assert_eq!((counters(&s.app).buffers, counters(&s.app).bytes), (0, 0));
}

#[test]
fn volume_of_bake_without_probes_warns() {
    let mut s = stage(&bake(false), Transform::IDENTITY, Some(Msaa::Sample4));
    s.insert_volume(GiIrradianceVolume::default());
    assert_eq!(
        s.app.world().resource::<GiWarnings>().0,
        [GiWarning::NoProbes]
    );
    assert_eq!(counters(&s.app).bytes, 0);
}
