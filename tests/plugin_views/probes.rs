//! Probes in the running plugin. A panel that is not part of the bake hangs in the room. Pictures
//! by every pixel and by subsplats are compared with the CPU's picture.

use crate::support::app::{app, camera, picture, run, target};
use crate::support::flip::{Picture, flip};
use crate::support::scenes::{Quad, Room, cpu_indirect, rough_recipe};
use crate::support::stage::{
    MAX, assert_pictures_match, counters, indirect, light_source, save_picture, settings,
    spawn_baked, spawn_light_source, view, work,
};
use bevy::camera::visibility::NoFrustumCulling;
use bevy::mesh::VertexAttributeValues;
use bevy::mesh::skinning::{SkinnedMesh, SkinnedMeshInverseBindposes};
use bevy::prelude::*;
use bevy_meshless_gi::internals::plan::FrameStage;
use bevy_meshless_gi::prelude::*;
use meshless_gi::{BakedScene, ProbeSettings, Recipe};
use std::sync::Arc;

const LIGHT_SOURCE: Vec3 = Vec3::new(0.3, 1.7, 0.5);

fn bake(probes: bool) -> Arc<BakedScene> {
    Room::cornell().bake_as(&Recipe {
        probes: probes.then_some(ProbeSettings {
            spacing: Some(0.3),
            rays_per_probe: None,
        }),
        ..rough_recipe()
    })
}

/// Returns the room with a floating panel that faces the camera from the left.
fn with_panel() -> Room {
    let mut room = Room::cornell();
    let turn = Quat::from_rotation_y(0.5) * Quat::from_rotation_x(-0.2);
    room.0.push(Quad {
        corner: Vec3::new(-0.75, 1.0, 0.4),
        u: turn * Vec3::new(0.6, 0.0, 0.0),
        v: turn * Vec3::new(0.0, 0.6, 0.0),
        color: Vec3::splat(0.7),
    });
    room
}

/// Creates an app that shows the room with the panel in the light of `bake`.
fn stage(bake: &Arc<BakedScene>, display: GiSplatting) -> (App, Handle<Image>, Entity) {
    let (app, image, light_source, _) = stage_with_room(&with_panel(), bake, display);
    (app, image, light_source)
}

/// Creates an app that shows a room in the light of `bake`. Returns the app, its picture, its light
/// and its root.
fn stage_with_room(
    room: &Room,
    bake: &Arc<BakedScene>,
    display: GiSplatting,
) -> (App, Handle<Image>, Entity, Entity) {
    let mut app = app();
    let root = spawn_baked(&mut app, room, bake, Transform::IDENTITY);
    let image = target(&mut app);
    app.world_mut()
        .spawn((camera(&image, view()), indirect()))
        .insert(display);
    let light_source = spawn_light_source(&mut app, LIGHT_SOURCE);
    (app, image, light_source, root)
}

fn cpu_picture(bake: &BakedScene, position: Vec3) -> Picture {
    cpu_picture_of_room(&with_panel(), bake, position)
}

fn cpu_picture_of_room(room: &Room, bake: &BakedScene, position: Vec3) -> Picture {
    let lights = [light_source(position)];
    cpu_indirect(
        room,
        bake,
        Transform::IDENTITY,
        view(),
        &lights,
        &settings(),
    )
}

#[test]
fn dynamic_objects_are_lit_per_pixel_and_by_subsplats() {
    let bake = bake(true);
    let without = self::bake(false);
    let expected = cpu_picture(&bake, LIGHT_SOURCE);
    // The panel covers a tenth of the picture. Without probes it is black.
    let dark = cpu_picture(&without, LIGHT_SOURCE);
    let panel = expected.pixels.iter().zip(&dark.pixels);
    let panel = panel.filter(|(a, b)| a != b).count();
    assert!(panel > 200, "{panel} pixels");
    // Values that are interpolated between subsplats can differ at edges, so FLIP is the criterion.
    let assert_flip = |name: &str, reference: &Picture, test: &Picture| {
        save_picture(name, &reference.beside(test));
        let d = flip(reference, test);
        println!("{name}: FLIP {d:.4}");
        assert!(d <= MAX, "{name}: FLIP {d}");
        assert!(
            flip(&dark, test) > 1.5 * d,
            "{name}: a black panel is not distinguished"
        );
    };
    type Compare<'a> = &'a dyn Fn(&str, &Picture, &Picture);
    let full = &assert_pictures_match as Compare<'_>;
    for (name, display, compare) in [
        ("probes_full", GiSplatting::PerPixel, full),
        ("probes_subsplats", GiSplatting::default(), &assert_flip),
    ] {
        let (mut app, image, light_source) = stage(&bake, display);
        run(&mut app, 4);
        compare(name, &expected, &picture(&mut app, &image));
        // Without a change no transport runs, but the display does.
        run(&mut app, 2);
        assert_eq!(work(&counters(&app)), [0; 4]);
        assert!(counters(&app).dispatches_of(FrameStage::PROBE_PIXELS) > 0);
        // The light moves. The next picture has its light on the panel.
        let moved = Vec3::new(-0.6, 1.2, 0.9);
        app.world_mut()
            .get_mut::<Transform>(light_source)
            .unwrap()
            .translation = moved;
        run(&mut app, 1);
        let moved_name = format!("{name}_moved");
        compare(
            &moved_name,
            &cpu_picture(&bake, moved),
            &picture(&mut app, &image),
        );
    }
}

#[test]
fn bake_without_probes_runs_no_probe_pass() {
    let [with, without] = [true, false].map(|probes| {
        let (mut app, image, _) = stage(&bake(probes), GiSplatting::PerPixel);
        run(&mut app, 4);
        let shown = picture(&mut app, &image);
        (shown, counters(&app))
    });
    assert_eq!(without.1.dispatches_of(FrameStage::PROBE_PIXELS), 0);
    assert!(
        !without.1.plan.to_string().contains("(probes)"),
        "{}",
        without.1.plan
    );
    assert!(
        with.1.plan.to_string().contains("(probes)"),
        "{}",
        with.1.plan
    );
    assert!(without.1.buffers < with.1.buffers && without.1.bytes < with.1.bytes);
    assert!(without.1.pipelines < with.1.pipelines);
    // The walls are equal, the panel differs.
    let alike = (without.0.pixels.iter().zip(&with.0.pixels))
        .filter(|(a, b)| a == b)
        .count();
    let all = without.0.pixels.len();
    assert!(alike * 2 > all && alike + 200 < all, "{alike} of {all}");
}

/// Draws the panel as a skinned mesh. Its vertices are behind the room, and the joint's pose moves
/// them into the room. In each pose the panel has the light of its drawn position.
#[test]
fn skinned_mesh_is_lit_at_joint_positions() {
    let bake = bake(true);
    let (mut app, image, _, root) = stage_with_room(&with_panel(), &bake, GiSplatting::PerPixel);
    let world = app.world_mut();
    let panel = *world.get::<Children>(root).unwrap().last().unwrap();
    let away = Vec3::new(0.0, 0.0, -7.0);
    let mesh = world.get::<Mesh3d>(panel).unwrap().0.clone();
    {
        let mut meshes = world.resource_mut::<Assets<Mesh>>();
        let mut mesh = meshes.get_mut(&mesh).unwrap();
        let Some(VertexAttributeValues::Float32x3(positions)) =
            mesh.attribute_mut(Mesh::ATTRIBUTE_POSITION)
        else {
            panic!("the panel has no positions");
        };
        for position in positions.iter_mut() {
            *position = (Vec3::from(*position) + away).to_array();
        }
        let count = positions.len();
        mesh.insert_attribute(
            Mesh::ATTRIBUTE_JOINT_INDEX,
            VertexAttributeValues::Uint16x4(vec![[0; 4]; count]),
        );
        mesh.insert_attribute(
            Mesh::ATTRIBUTE_JOINT_WEIGHT,
            vec![[1.0f32, 0.0, 0.0, 0.0]; count],
        );
    }
    let poses = world
        .resource_mut::<Assets<SkinnedMeshInverseBindposes>>()
        .add(SkinnedMeshInverseBindposes::from(vec![
            Mat4::from_translation(-away),
        ]));
    let joint = world.spawn(Transform::IDENTITY).id();
    world.entity_mut(panel).insert((
        SkinnedMesh {
            inverse_bindposes: poses,
            joints: vec![joint],
        },
        NoFrustumCulling,
    ));
    run(&mut app, 4);
    let first = cpu_picture(&bake, LIGHT_SOURCE);
    assert_pictures_match("skinned", &first, &picture(&mut app, &image));
    // The joint moves. The light differs in the same frame.
    let step = Vec3::new(0.05, -0.3, 0.35);
    let mut pose = app.world_mut().get_mut::<Transform>(joint).unwrap();
    pose.translation = step;
    run(&mut app, 1);
    assert_eq!(work(&counters(&app)), [0; 4], "no light changed");
    let mut moved_room = with_panel();
    moved_room.0.last_mut().unwrap().corner += step;
    let expected = cpu_picture_of_room(&moved_room, &bake, LIGHT_SOURCE);
    assert!(first.nrmse(&expected) > 0.1, "another picture");
    assert_pictures_match("skinned_walked", &expected, &picture(&mut app, &image));
}

/// Draws many small floating quads to the G-buffer, like particles.
#[test]
fn particles_are_lit_at_own_positions() {
    let bake = bake(true);
    let mut room = Room::cornell();
    for k in 0..48 {
        let at = |a: f32| (a * (k as f32 + 0.5)).fract() - 0.5;
        room.0.push(Quad {
            corner: Vec3::new(1.5 * at(0.618), 1.0 + 1.4 * at(0.755), 0.3 + at(0.57)),
            u: Vec3::X * 0.09,
            v: Vec3::Y * 0.09,
            color: Vec3::splat(0.7),
        });
    }
    let (mut app, image, ..) = stage_with_room(&room, &bake, GiSplatting::PerPixel);
    run(&mut app, 4);
    let expected = cpu_picture_of_room(&room, &bake, LIGHT_SOURCE);
    let dark = cpu_picture_of_room(&room, &self::bake(false), LIGHT_SOURCE);
    assert!(flip(&dark, &expected) > MAX, "they show");
    assert_pictures_match("particles", &expected, &picture(&mut app, &image));
}
