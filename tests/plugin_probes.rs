//! Light in free space in the running plugin: a panel that the bake knows nothing of hangs in the room, at every pixel and by subsplats, beside the CPU's picture of it.

mod plugin_support;

use bevy::prelude::*;
use bevy_meshless_gi::asset::BakedScene;
use bevy_meshless_gi::bake::{FreeSpaceLight, Recipe};
use bevy_meshless_gi::plan::Stage;
use bevy_meshless_gi::prelude::*;
use plugin_support::app::{app, camera, picture, run, target};
use plugin_support::flip::{Picture, flip};
use plugin_support::scenes::{Quad, Room, cpu_indirect};
use plugin_support::stage::{
    MOST, assert_alike, counters, indirect, keep, lamp, settings, spawn_lamp, view, work,
};
use std::sync::Arc;

const LAMP: Vec3 = Vec3::new(0.3, 1.7, 0.5);

fn bake(probes: bool) -> Arc<BakedScene> {
    Room::cornell().bake_as(&Recipe {
        viewpoints: vec![[0.0, 1.0, 0.6]],
        coarse_radius: Some(0.4),
        levels: Some(3),
        sender_levels: Some(2),
        rays: Some(128),
        probes: probes.then_some(FreeSpaceLight {
            spacing: Some(0.3),
            rays: None,
        }),
        ..Recipe::default()
    })
}

/// The room with a panel in the air, which faces the camera from the left.
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

/// An app that shows the room with the panel in the light of `bake`.
fn stage(bake: &Arc<BakedScene>, display: MeshlessGiDisplay) -> (App, Handle<Image>, Entity) {
    let mut app = app();
    let asset = app
        .world_mut()
        .resource_mut::<Assets<MeshlessGiAsset>>()
        .add(MeshlessGiAsset {
            scene: bake.clone(),
        });
    let root = app
        .world_mut()
        .spawn((MeshlessGi(asset), Transform::IDENTITY))
        .id();
    with_panel().spawn(&mut app, root);
    let image = target(&mut app);
    app.world_mut()
        .spawn((camera(&image, view()), indirect()))
        .insert(display);
    let lamp = spawn_lamp(&mut app, LAMP);
    (app, image, lamp)
}

fn on_cpu(bake: &BakedScene, place: Vec3) -> Picture {
    let lights = [lamp(place)];
    cpu_indirect(
        &with_panel(),
        bake,
        Transform::IDENTITY,
        view(),
        &lights,
        &settings(),
    )
}

#[test]
fn what_the_bake_does_not_know_is_lit_at_every_pixel_and_by_subsplats() {
    let bake = bake(true);
    let without = self::bake(false);
    let expected = on_cpu(&bake, LAMP);
    // The panel is a tenth of the picture; without probes it is black.
    let dark = on_cpu(&without, LAMP);
    let panel = expected.pixels.iter().zip(&dark.pixels);
    let panel = panel.filter(|(a, b)| a != b).count();
    assert!(panel > 200, "{panel} pixels");
    // What is interpolated between subsplats may differ at edges: there the eye is the measure.
    let by_eye = |name: &str, reference: &Picture, test: &Picture| {
        keep(name, &reference.beside(test));
        let d = flip(reference, test);
        println!("{name}: FLIP {d:.4}");
        assert!(d <= MOST, "{name}: FLIP {d}");
        assert!(
            flip(&dark, test) > 1.5 * d,
            "{name}: a black panel is not told apart"
        );
    };
    type Compare<'a> = &'a dyn Fn(&str, &Picture, &Picture);
    let full = &assert_alike as Compare<'_>;
    for (name, display, compare) in [
        ("probes_full", MeshlessGiDisplay::Full, full),
        ("probes_subsplats", MeshlessGiDisplay::default(), &by_eye),
    ] {
        let (mut app, image, lamp) = stage(&bake, display);
        run(&mut app, 4);
        compare(name, &expected, &picture(&mut app, &image));
        // At rest nothing is carried on, and the display goes on.
        run(&mut app, 2);
        assert_eq!(work(&counters(&app)), [0; 4]);
        assert!(counters(&app).dispatches_of(Stage::Probe) > 0);
        // The lamp moves: the next picture has its light on the panel.
        let moved = Vec3::new(-0.6, 1.2, 0.9);
        app.world_mut()
            .get_mut::<Transform>(lamp)
            .unwrap()
            .translation = moved;
        run(&mut app, 1);
        let moved_name = format!("{name}_moved");
        compare(
            &moved_name,
            &on_cpu(&bake, moved),
            &picture(&mut app, &image),
        );
    }
}

#[test]
fn a_bake_without_probes_runs_nothing_of_them() {
    let [with, without] = [true, false].map(|probes| {
        let (mut app, image, _) = stage(&bake(probes), MeshlessGiDisplay::Full);
        run(&mut app, 4);
        let shown = picture(&mut app, &image);
        (shown, counters(&app))
    });
    assert_eq!(without.1.dispatches_of(Stage::Probe), 0);
    assert!(
        !without.1.plan.to_string().contains("free_space"),
        "{}",
        without.1.plan
    );
    assert!(
        with.1.plan.to_string().contains("free_space"),
        "{}",
        with.1.plan
    );
    assert!(without.1.buffers < with.1.buffers && without.1.bytes < with.1.bytes);
    assert!(without.1.pipelines < with.1.pipelines);
    // The walls are the same, the panel is not.
    let alike = (without.0.pixels.iter().zip(&with.0.pixels))
        .filter(|(a, b)| a == b)
        .count();
    let all = without.0.pixels.len();
    assert!(alike * 2 > all && alike + 200 < all, "{alike} of {all}");
}
