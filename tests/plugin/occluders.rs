//! Screen across a room that opens and closes in the running plugin. Pictures match the CPU's frame
//! in the frame of the change. Frames without a change run neither transport nor occluder updates.

use crate::support::app::{app, camera, picture, run, target};
use crate::support::flip::{Picture, flip};
use crate::support::scenes::{Quad, Room, cpu_indirect};
use crate::support::stage::{
    MAX, assert_pictures_match, bevy_light, counters, indirect, light_source, settings, view, work,
};
use bevy::prelude::*;
use bevy_meshless_gi::internals::plan::FrameStage;
use bevy_meshless_gi::prelude::*;
use meshless_gi::{BakedScene, CpuFrame, OccluderBox, OccluderDesc, ProbeSettings, Recipe};
use std::sync::Arc;

/// Returns the Cornell room and a bake with a screen from floor to ceiling across its middle. The
/// screen is not drawn.
fn cornell() -> (Room, Arc<BakedScene>) {
    cornell_with(0.01, None)
}

/// Returns [`cornell`] with a screen of half thickness `half`, in meters, and with optional probes
/// for dynamic objects.
fn cornell_with(half: f32, probes: Option<ProbeSettings>) -> (Room, Arc<BakedScene>) {
    let room = Room::cornell();
    let screen = OccluderDesc {
        name: "screen".into(),
        boxes: vec![OccluderBox {
            center: [-0.45, 1.0, 0.0],
            half_edges: [half, 1.0, 1.0],
        }],
    };
    let baked = room.bake_as(&Recipe {
        viewpoints: vec![[0.2, 1.0, 0.6], [-0.8, 1.0, 0.6]],
        coarse_radius: Some(0.6),
        levels: Some(3),
        sender_levels: Some(2),
        max_refinement_points: Some(1000),
        rays_per_point: Some(128),
        occluders: vec![screen],
        probes,
        ..default()
    });
    (room, baked)
}

/// Position of the light: in the small part, behind the screen.
const LIGHT_POSITION: Vec3 = Vec3::new(-0.75, 1.5, 0.3);

/// Draws the CPU's picture for the transmittance of the screen.
fn cpu_picture(room: &Room, bake: &BakedScene, transmittance: f32) -> Picture {
    cpu_picture_lit_from(LIGHT_POSITION, room, bake, transmittance)
}

/// Draws [`cpu_picture`] with the light at `position`.
fn cpu_picture_lit_from(
    position: Vec3,
    room: &Room,
    bake: &BakedScene,
    transmittance: f32,
) -> Picture {
    let mut frame = CpuFrame::new(bake);
    frame.set_occluders(bake, &[transmittance]);
    let mut now = bake.clone();
    let [links, of_probes] = frame.links(bake);
    now.data_mut().operator.links = links.to_vec();
    if let Some(probes) = &mut now.data_mut().probes {
        probes.links = of_probes.to_vec();
    }
    now.data_mut().bvh = frame.bvh(bake).clone();
    let surfaces = frame.surfaces(bake);
    now.data_mut().surfaces[..surfaces.len()].copy_from_slice(surfaces);
    let placed = Transform::IDENTITY;
    cpu_indirect(
        room,
        &now,
        placed,
        view(),
        &[light_source(position)],
        &settings(),
    )
}

/// Creates an app with a room, its bake, a light and a camera, and runs three frames.
fn stage(room: &Room, scene: Arc<BakedScene>) -> (App, Handle<Image>) {
    stage_lit_from(LIGHT_POSITION, room, scene)
}

/// Creates the app of [`stage`] with the light at `position`.
fn stage_lit_from(position: Vec3, room: &Room, scene: Arc<BakedScene>) -> (App, Handle<Image>) {
    let mut app = app();
    let asset = app
        .world_mut()
        .resource_mut::<Assets<GiBakedScene>>()
        .add(GiBakedScene { scene });
    let root = app
        .world_mut()
        .spawn((GiScene(asset), Transform::IDENTITY))
        .id();
    room.spawn(&mut app, root);
    let image = target(&mut app);
    app.world_mut().spawn((camera(&image, view()), indirect()));
    app.world_mut()
        .spawn((bevy_light(), Transform::from_translation(position)));
    run(&mut app, 3);
    (app, image)
}

#[test]
fn light_follows_door_in_same_frame_and_idles_without_change() {
    let (room, bake) = cornell();
    let (mut app, image) = stage(&room, bake.clone());
    let open = cpu_picture(&room, &bake, 1.0);
    assert_pictures_match("open", &open, &picture(&mut app, &image));

    // One entity names the screen and leaves it open. Another entity names an occluder that does
    // not exist.
    let spawn_occluder = |app: &mut App, name: &str, transmittance: f32| {
        let name = name.into();
        let occluder = GiOccluder {
            name,
            transmittance,
        };
        app.world_mut().spawn(occluder).id()
    };
    let door = spawn_occluder(&mut app, "screen", 1.0);
    spawn_occluder(&mut app, "gate", 0.0);
    run(&mut app, 1);
    let none = ([0; 4], 0);
    let c = counters(&app);
    assert_eq!((work(&c), c.dispatches_of(FrameStage::OCCLUDE)), none);

    let mut last = open.clone();
    for transmittance in [0.0, 0.4, 1.0] {
        let mut moved = app.world_mut().get_mut::<GiOccluder>(door).unwrap();
        moved.transmittance = transmittance;
        run(&mut app, 1);
        let c = counters(&app);
        assert_eq!(c.dispatches_of(FrameStage::OCCLUDE), 1, "{}", c.plan);
        assert!(c.plan.to_string().contains("opened or shut"), "{}", c.plan);
        assert!(c.projected_slots == 1 && c.dispatches_of(FrameStage::APPLY) > 0);
        let now = cpu_picture(&room, &bake, transmittance);
        let found = picture(&mut app, &image);
        assert_pictures_match("door", &now, &found);
        assert!(flip(&last, &now) > MAX, "the change shows");
        last = now;
        run(&mut app, 1);
        let c = counters(&app);
        assert_eq!((work(&c), c.dispatches_of(FrameStage::OCCLUDE)), none);
    }
    assert!(flip(&last, &open) < 1e-6, "open again");

    // Of two entities with the same name the smallest transmittance applies. After both are
    // despawned, the screen is open.
    let other = spawn_occluder(&mut app, "screen", 0.0);
    run(&mut app, 1);
    assert_eq!(counters(&app).dispatches_of(FrameStage::OCCLUDE), 1);
    let shut = cpu_picture(&room, &bake, 0.0);
    assert_pictures_match("two_occluders", &shut, &picture(&mut app, &image));
    app.world_mut().despawn(other);
    app.world_mut().despawn(door);
    run(&mut app, 1);
    assert_eq!(counters(&app).dispatches_of(FrameStage::OCCLUDE), 1);
    assert_pictures_match("gone", &open, &picture(&mut app, &image));
}

/// A closed screen matches the CPU if it is drawn in the farther half of an occluder three times as
/// thick. The light is in front of it.
#[test]
fn door_in_thick_occluder_is_lit_from_faced_side() {
    let (mut room, bake) = cornell_with(0.06, Some(ProbeSettings::default()));
    let corner = Vec3::new(-0.505, 0.0, -1.0);
    let (thick, high, deep) = (Vec3::X * 0.04, Vec3::Y * 2.0, Vec3::Z * 2.0);
    let quad = |corner, u, v| Quad {
        corner,
        u,
        v,
        color: Vec3::splat(0.6),
    };
    room.0.extend([
        quad(corner, deep, high),
        quad(corner + thick, high, deep),
        quad(corner + deep, thick, high),
    ]);
    let position = Vec3::new(0.1, 1.6, 0.6);
    let (mut app, image) = stage_lit_from(position, &room, bake.clone());
    let name = "screen".into();
    app.world_mut().spawn(GiOccluder {
        name,
        transmittance: 0.0,
    });
    run(&mut app, 2);
    let shut = cpu_picture_lit_from(position, &room, &bake, 0.0);
    assert_pictures_match("drawn door", &shut, &picture(&mut app, &image));
    // With clip planes that do not shift with the normal, the screen is black.
    let mut upright = (*bake).clone();
    let arrays = upright.data_mut();
    let probes = &mut arrays.probes.as_mut().unwrap().planes;
    for plane in probes.iter_mut().chain(&mut arrays.display.planes) {
        let length = Vec3::from_slice(&plane[..3]).length();
        *plane = plane.map(|c| c / length);
    }
    let black = cpu_picture_lit_from(position, &room, &upright, 0.0);
    assert!(flip(&shut, &black) > MAX, "{}", flip(&shut, &black));
}

#[test]
fn scene_without_occluders_has_no_occluder_buffers() {
    let room = Room::cornell();
    let (mut app, _) = stage(&room, room.bake(1));
    let before = counters(&app);
    app.world_mut().spawn(GiOccluder {
        name: "screen".into(),
        transmittance: 0.0,
    });
    run(&mut app, 2);
    let c = counters(&app);
    assert_eq!(
        (work(&c), c.dispatches_of(FrameStage::OCCLUDE)),
        ([0; 4], 0)
    );
    assert_eq!(
        (c.pipelines, c.buffers, c.bytes),
        (before.pipelines, before.buffers, before.bytes)
    );
}
