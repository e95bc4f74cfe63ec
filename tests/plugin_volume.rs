//! Light in free space for forward cameras in the running plugin: the same room through a deferred camera with our display and through a forward one with a volume.

mod plugin_support;

use bevy::light::IrradianceVolume;
use bevy::prelude::*;
use bevy_meshless_gi::asset::BakedScene;
use bevy_meshless_gi::bake::{FreeSpaceLight, Recipe};
use bevy_meshless_gi::plan::Stage;
use bevy_meshless_gi::plugin::{MeshlessGiFinding, MeshlessGiFindings, MeshlessGiSettings};
use bevy_meshless_gi::prelude::*;
use plugin_support::app::{app, camera, picture, run, target};
use plugin_support::flip::flip;
use plugin_support::scenes::{Quad, Room};
use plugin_support::stage::{counters, keep, spawn_lamp, view, work};
use std::sync::{Arc, OnceLock};

const LAMP: Vec3 = Vec3::new(0.3, 1.7, 0.5);
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
        colour: Vec3::splat(0.7),
    });
    room
}

struct Shown {
    app: App,
    root: Entity,
    lamp: Entity,
    forward: Handle<Image>,
    deferred: Handle<Image>,
}

/// An app with the room below a root that stands so in the world, a lamp, and both cameras, or the forward one alone.
fn stage(bake: &Arc<BakedScene>, placed: Transform, both: bool) -> Shown {
    let mut app = app();
    let asset = app
        .world_mut()
        .resource_mut::<Assets<MeshlessGiAsset>>()
        .add(MeshlessGiAsset {
            scene: bake.clone(),
        });
    let root = app.world_mut().spawn((MeshlessGi(asset), placed)).id();
    with_panel().spawn(&mut app, root);
    let [forward, deferred] = [0; 2].map(|_| target(&mut app));
    let eye = placed * view();
    app.world_mut()
        .spawn((camera(&forward, eye), bevy::camera::Hdr, Msaa::Sample4));
    if both {
        app.world_mut()
            .spawn((camera(&deferred, eye), MeshlessGiCamera::default()));
    }
    let lamp = spawn_lamp(&mut app, placed * LAMP);
    Shown {
        app,
        root,
        lamp,
        forward,
        deferred,
    }
}

#[test]
fn both_kinds_of_cameras_show_the_same_light() {
    let turned = Transform::from_xyz(3.0, -1.0, 2.0).with_rotation(Quat::from_rotation_y(0.6));
    for (name, placed) in [("volume", Transform::IDENTITY), ("volume_turned", turned)] {
        let mut s = stage(&bake(true), placed, true);
        run(&mut s.app, 4);
        let expected = picture(&mut s.app, &s.deferred);
        // Not asked for: the forward camera shows direct light alone, and nothing of a volume is there.
        let dark = picture(&mut s.app, &s.forward);
        let none = counters(&s.app);
        assert_eq!(none.dispatches_of(Stage::Volume), 0);
        assert!(!none.plan.contains("volume"), "{}", none.plan);
        s.app
            .world_mut()
            .entity_mut(s.root)
            .insert(MeshlessGiVolume::default());
        run(&mut s.app, 4);
        let lit = picture(&mut s.app, &s.forward);
        keep(name, &expected.beside(&lit));
        keep(&format!("{name}_without"), &expected.beside(&dark));
        let [d, without] = [&lit, &dark].map(|p| flip(&expected, p));
        println!("{name}: FLIP {d:.4}, {without:.4} without the volume");
        assert!(d <= MOST, "{name}: {d}");
        assert!(without > 2.0 * MOST, "{name}: {without}");
        // The deferred camera shows what it showed: nothing is counted twice.
        assert_eq!(picture(&mut s.app, &s.deferred).pixels, expected.pixels);
        assert!(s.app.world().resource::<MeshlessGiFindings>().0.is_empty());
        // At rest nothing is written.
        run(&mut s.app, 2);
        let rest = counters(&s.app);
        assert_eq!(rest.dispatches_of(Stage::Volume), 0);
        assert!(rest.buffers == none.buffers + 1 && rest.bytes > none.bytes);
        // A lamp moves: both follow in that frame.
        let moved = placed * Vec3::new(-0.6, 1.2, 0.9);
        s.app
            .world_mut()
            .get_mut::<Transform>(s.lamp)
            .unwrap()
            .translation = moved;
        run(&mut s.app, 1);
        assert_eq!(counters(&s.app).dispatches_of(Stage::Volume), 1);
        let [expected, lit] =
            [s.deferred.clone(), s.forward.clone()].map(|i| picture(&mut s.app, &i));
        let d = flip(&expected, &lit);
        println!("{name}, lamp moved: FLIP {d:.4}");
        assert!(d <= MOST, "{name}, lamp moved: {d}");
    }
}

#[test]
fn volumes_come_and_go_and_need_no_deferred_camera() {
    let mut s = stage(&bake(true), Transform::IDENTITY, false);
    run(&mut s.app, 4);
    let before = counters(&s.app);
    assert_eq!((before.buffers, before.bytes, before.pipelines), (0, 0, 0));
    let dark = picture(&mut s.app, &s.forward);
    let ask = |app: &mut App, root: Entity, volume: MeshlessGiVolume| {
        app.world_mut().entity_mut(root).insert(volume);
    };
    ask(&mut s.app, s.root, MeshlessGiVolume::default());
    run(&mut s.app, 4);
    let lit = picture(&mut s.app, &s.forward);
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
    ask(&mut s.app, s.root, coarse);
    run(&mut s.app, 4);
    assert_eq!(volumes(&mut s.app), 1);
    let blurred = picture(&mut s.app, &s.forward);
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
    assert_eq!(picture(&mut s.app, &s.forward).pixels, dark.pixels);
    assert_eq!((counters(&s.app).buffers, counters(&s.app).bytes), (0, 0));
}

#[test]
fn a_bake_without_light_in_free_space_says_so() {
    let mut s = stage(&bake(false), Transform::IDENTITY, false);
    s.app
        .world_mut()
        .entity_mut(s.root)
        .insert(MeshlessGiVolume::default());
    run(&mut s.app, 4);
    assert_eq!(
        s.app.world().resource::<MeshlessGiFindings>().0,
        [MeshlessGiFinding::NoFreeSpace]
    );
    assert_eq!(counters(&s.app).bytes, 0);
}
