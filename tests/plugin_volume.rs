//! Light in free space for forward cameras in the running plugin: the same room through a deferred camera with our display and through a forward one with a volume.

mod plugin_support;

use bevy::camera::visibility::VisibleEntities;
use bevy::light::IrradianceVolume;
use bevy::light::cluster::ClusterVisibilityClass;
use bevy::material::OpaqueRendererMethod;
use bevy::pbr::DefaultOpaqueRendererMethod;
use bevy::prelude::*;
use bevy_meshless_gi::asset::BakedScene;
use bevy_meshless_gi::bake::{FreeSpaceLight, Recipe};
use bevy_meshless_gi::plan::Stage;
use bevy_meshless_gi::plugin::{MeshlessGiFinding, MeshlessGiFindings, MeshlessGiSettings};
use bevy_meshless_gi::prelude::*;
use plugin_support::app::{app, camera, picture, run, target};
use plugin_support::flip::{Picture, flip};
use plugin_support::scenes::{Quad, Room};
use plugin_support::stage::{counters, keep, spawn_lamp, view, work};
use std::sync::{Arc, OnceLock};

const LAMP: Vec3 = Vec3::new(0.3, 1.7, 0.5);
/// What a panel in the air reflects.
const PANEL: [f32; 3] = [0.7, 0.65, 0.7];
/// The largest mean FLIP between the pictures of both cameras.
const MOST: f32 = 0.05;

/// With light in free space or without; baked once.
fn bake(probes: bool) -> Arc<BakedScene> {
    static MADE: [OnceLock<Arc<BakedScene>>; 2] = [const { OnceLock::new() }; 2];
    let make = || {
        Room::cornell().bake_as(&Recipe {
            viewpoints: vec![[0.0, 1.0, 0.6]],
            coarse_radius: Some(0.4),
            levels: Some(3),
            sender_levels: Some(2),
            rays: Some(128),
            probes: probes.then_some(FreeSpaceLight {
                spacing: Some(0.25),
                rays: None,
            }),
            ..Recipe::default()
        })
    };
    MADE[usize::from(probes)].get_or_init(make).clone()
}

/// The room with a panel in the air.
fn with_panel() -> Room {
    let mut room = Room::cornell();
    let turn = Quat::from_rotation_y(0.5) * Quat::from_rotation_x(-0.2);
    room.0.push(Quad {
        corner: Vec3::new(-0.75, 1.0, 0.4),
        u: turn * Vec3::new(0.6, 0.0, 0.0),
        v: turn * Vec3::new(0.0, 0.6, 0.0),
        colour: PANEL.into(),
    });
    room
}

struct Shown {
    app: App,
    root: Entity,
    lamp: Entity,
    image: Handle<Image>,
}

/// An app with the room below a root that stands so in the world, a lamp, and a camera: deferred with our display (none), or forward with so many samples a pixel.
fn stage(bake: &Arc<BakedScene>, placed: Transform, forward: Option<Msaa>) -> Shown {
    let mut app = app();
    if forward.is_some() {
        app.insert_resource(DefaultOpaqueRendererMethod::forward());
    }
    let asset = app
        .world_mut()
        .resource_mut::<Assets<MeshlessGiAsset>>()
        .add(MeshlessGiAsset {
            scene: bake.clone(),
        });
    let root = app.world_mut().spawn((MeshlessGi(asset), placed)).id();
    with_panel().spawn(&mut app, root);
    let image = target(&mut app);
    let mut eye = app.world_mut().spawn(camera(&image, placed * view()));
    match forward {
        None => eye.insert(MeshlessGiCamera::default()),
        Some(samples) => eye.insert((bevy::camera::Hdr, samples)),
    };
    let lamp = spawn_lamp(&mut app, placed * LAMP);
    Shown {
        app,
        root,
        lamp,
        image,
    }
}

impl Shown {
    fn picture(&mut self) -> Picture {
        picture(&mut self.app, &self.image)
    }

    fn ask(&mut self, volume: MeshlessGiVolume) {
        self.app.world_mut().entity_mut(self.root).insert(volume);
        run(&mut self.app, 4);
    }

    /// Waits until the deferred camera sees the volume: what lights its G-buffer without it is compiled meanwhile.
    fn wait(&mut self) {
        let sees = |app: &mut App| {
            let mut cameras = app
                .world_mut()
                .query_filtered::<&VisibleEntities, With<MeshlessGiCamera>>();
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
        panic!("the camera never sees the volume");
    }

    fn move_lamp(&mut self, place: Vec3) {
        let mut lamp = self
            .app
            .world_mut()
            .get_mut::<Transform>(self.lamp)
            .unwrap();
        lamp.translation = place;
        run(&mut self.app, 1);
    }
}

#[test]
fn both_kinds_of_cameras_show_the_same_light() {
    let turned = Transform::from_xyz(3.0, -1.0, 2.0).with_rotation(Quat::from_rotation_y(0.6));
    for (name, placed) in [("volume", Transform::IDENTITY), ("volume_turned", turned)] {
        // One sample a pixel in both: what edges look like is not what is compared.
        let kinds = [None, Some(Msaa::Off)];
        let [mut deferred, mut forward] = kinds.map(|of| stage(&bake(true), placed, of));
        run(&mut deferred.app, 4);
        run(&mut forward.app, 4);
        let expected = deferred.picture();
        // Not asked for: the forward camera shows direct light alone, and nothing of a volume is there.
        let dark = forward.picture();
        let none = counters(&forward.app);
        assert_eq!((none.buffers, none.bytes, none.pipelines), (0, 0, 0));
        assert!(!none.plan.to_string().contains("volume"), "{}", none.plan);
        forward.ask(MeshlessGiVolume::default());
        let lit = forward.picture();
        keep(name, &expected.beside(&lit));
        keep(&format!("{name}_without"), &expected.beside(&dark));
        let [d, without] = [&lit, &dark].map(|p| flip(&expected, p));
        println!("{name}: FLIP {d:.4}, {without:.4} without the volume");
        assert!(d <= MOST, "{name}: {d}");
        assert!(without > 2.0 * MOST, "{name}: {without}");
        assert!(
            forward
                .app
                .world()
                .resource::<MeshlessGiFindings>()
                .0
                .is_empty()
        );
        // At rest nothing is written.
        run(&mut forward.app, 2);
        assert_eq!(counters(&forward.app).dispatches_of(Stage::Volume), 0);
        // A lamp moves: both follow in that frame.
        let moved = placed * Vec3::new(-0.6, 1.2, 0.9);
        deferred.move_lamp(moved);
        forward.move_lamp(moved);
        assert_eq!(counters(&forward.app).dispatches_of(Stage::Volume), 1);
        let d = flip(&deferred.picture(), &forward.picture());
        println!("{name}, lamp moved: FLIP {d:.4}");
        assert!(d <= MOST, "{name}, lamp moved: {d}");
    }
}

#[test]
fn a_volume_lights_no_g_buffer() {
    let mut s = stage(&bake(true), Transform::IDENTITY, None);
    run(&mut s.app, 4);
    let before = s.picture();
    let buffers = counters(&s.app).buffers;
    // A forward camera beside it, for which the volume is written.
    let other = target(&mut s.app);
    let eye = (camera(&other, view()), bevy::camera::Hdr, Msaa::Sample4);
    s.app.world_mut().spawn(eye);
    s.ask(MeshlessGiVolume::default());
    s.wait();
    assert_eq!(s.picture().pixels, before.pixels);
    // Parameters, starts and shares of the places.
    assert_eq!(counters(&s.app).buffers, buffers + 3);
    s.move_lamp(Vec3::new(-0.6, 1.2, 0.9));
    assert_eq!(counters(&s.app).dispatches_of(Stage::Volume), 1);
}

/// What is made of a material.
type Change = fn(&mut StandardMaterial);

/// Glass, and a forward material, in a view with a G-buffer: a volume lights them as the display lights the same panel, and nothing else of the picture changes.
#[test]
fn what_is_drawn_forward_in_a_deferred_view_is_lit_by_a_volume() {
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
            MeshlessGiFinding::TransparentMaterial,
        ),
        (
            "forward",
            |m| m.opaque_render_method = OpaqueRendererMethod::Forward,
            MeshlessGiFinding::ForwardMaterial,
        ),
    ];
    for (name, change, finding) in kinds {
        let mut s = shown(change);
        let told = |s: &Shown| s.app.world().resource::<MeshlessGiFindings>().0.clone();
        assert_eq!(told(&s), [finding]);
        s.app
            .world_mut()
            .resource_mut::<MeshlessGiFindings>()
            .0
            .clear();
        let dark = s.picture();
        s.ask(MeshlessGiVolume::default());
        s.wait();
        let lit = s.picture();
        assert_eq!(told(&s), []);
        keep(&format!("volume_{name}"), &expected.beside(&lit));
        keep(&format!("volume_{name}_without"), &expected.beside(&dark));
        // The panel alone: where a volume changes anything, and a tenth of the picture or so.
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
        // In the frame in which a lamp moves.
        s.move_lamp(Vec3::new(-0.6, 1.2, 0.9));
        assert_eq!(counters(&s.app).dispatches_of(Stage::Volume), 1);
    }
}

#[test]
fn volumes_come_and_go_and_need_no_deferred_camera() {
    let mut s = stage(&bake(true), Transform::IDENTITY, Some(Msaa::Sample4));
    run(&mut s.app, 4);
    let before = counters(&s.app);
    assert_eq!((before.buffers, before.bytes, before.pipelines), (0, 0, 0));
    let dark = s.picture();
    s.ask(MeshlessGiVolume::default());
    let lit = s.picture();
    assert!(
        lit.mean() > 1.2 * dark.mean(),
        "{} {}",
        lit.mean(),
        dark.mean()
    );
    assert!(counters(&s.app).bytes > 0);
    assert_eq!(work(&counters(&s.app)), [0; 4]);
    // Other voxels: one volume in place of the other.
    let volumes = |app: &mut App| {
        let mut found = app.world_mut().query::<&IrradianceVolume>();
        found.iter(app.world()).count()
    };
    let coarse = MeshlessGiVolume {
        voxel: Some(0.5),
        most: 64,
    };
    s.ask(coarse);
    assert_eq!(volumes(&mut s.app), 1);
    let blurred = s.picture();
    let d = flip(&lit, &blurred);
    println!("64 voxels: FLIP {d:.4} to the usual number");
    assert!(d > 0.0 && d < 0.2, "{d}");
    // No more: the picture of before, and nothing on the device once nobody has seen the scene for long.
    s.app
        .world_mut()
        .resource_mut::<MeshlessGiSettings>()
        .keep_frames = 2;
    s.app
        .world_mut()
        .entity_mut(s.root)
        .remove::<MeshlessGiVolume>();
    run(&mut s.app, 6);
    assert_eq!(volumes(&mut s.app), 0);
    assert_eq!(s.picture().pixels, dark.pixels);
    assert_eq!((counters(&s.app).buffers, counters(&s.app).bytes), (0, 0));
}

#[test]
fn a_bake_without_light_in_free_space_says_so() {
    let mut s = stage(&bake(false), Transform::IDENTITY, Some(Msaa::Sample4));
    s.ask(MeshlessGiVolume::default());
    assert_eq!(
        s.app.world().resource::<MeshlessGiFindings>().0,
        [MeshlessGiFinding::NoFreeSpace]
    );
    assert_eq!(counters(&s.app).bytes, 0);
}
