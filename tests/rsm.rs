//! One bounce from what moves, against the reference integrator's: reflective shadow maps drawn from the light, their virtual point lights, and the light of
//! these on the walls. Beside it \[N09\]'s own choice, and what goes wrong in hard cases. `cargo test --test rsm -- --nocapture` prints the tables.

#[path = "rsm/room.rs"]
mod room;

use bevy_meshless_gi::accuracy::errors;
use bevy_meshless_gi::frame::reflective::{light_in_space, space_from_clip};
use bevy_meshless_gi::frame::splat::LARGEST_HALF;
use bevy_meshless_gi::frame::{
    FrameLight, RsmParams, RsmShadowParams, RsmTexel, Vpl, VplParams, VplViewParams, gbuffer, rsm,
    vpl,
};
use bevy_meshless_gi::scene::{Bvh, Light};
use glam::{Mat4, Vec3};
use room::{Aim, Grid, ORANGE, Room, ball, choose, cuboid, mesh};

const PATHS: u32 = 16_384;
/// Places nearer to the object are compared by themselves, metres.
const NEAR: f32 = 0.5;

fn lamp(position: Vec3) -> Light {
    Light::Point {
        position,
        intensity: Vec3::new(30.0, 28.0, 25.0),
        range: f32::INFINITY,
    }
}

/// A ball in the middle of a room of 4 × 3 × 4 m.
fn ball_room() -> Room {
    let eye = Vec3::new(0.5, 2.5, 0.6);
    let center = Vec3::new(2.2, 1.0, 2.0);
    Room::new(
        cuboid(Vec3::ZERO, Vec3::new(4.0, 3.0, 4.0), true),
        ball(center, 0.5),
        lamp(eye),
        Aim::lamp(eye, center, 0.6),
    )
}

/// A crate on the floor near a wall, under a spot lamp.
fn crate_room() -> Room {
    let eye = Vec3::new(1.5, 2.8, 1.0);
    let center = Vec3::new(3.2, 0.4, 2.0);
    let light = Light::Spot {
        position: eye,
        direction: (center - eye).normalize(),
        intensity: Vec3::new(60.0, 50.0, 40.0),
        inner: 0.25,
        outer: 0.45,
        range: 20.0,
    };
    Room::new(
        cuboid(Vec3::ZERO, Vec3::new(4.0, 3.0, 4.0), true),
        cuboid(Vec3::new(2.8, 0.0, 1.6), Vec3::new(3.6, 0.8, 2.4), false),
        light,
        Aim::lamp(eye, center, 0.9),
    )
}

/// Two rooms with a door between them; the ball is lit in one of them, half of it in the shadow of the wall.
fn door_room() -> Room {
    let eye = Vec3::new(0.6, 2.2, 1.0);
    let center = Vec3::new(2.4, 1.0, 2.2);
    let mut walls = cuboid(Vec3::ZERO, Vec3::new(6.0, 3.0, 4.0), true);
    walls.extend(cuboid(
        Vec3::new(3.1, 0.0, 0.0),
        Vec3::new(3.2, 3.0, 2.6),
        false,
    ));
    walls.extend(cuboid(
        Vec3::new(3.1, 2.0, 2.6),
        Vec3::new(3.2, 3.0, 4.0),
        false,
    ));
    // A screen between the lamp and the lower half of the ball.
    walls.extend(cuboid(
        Vec3::new(1.4, 0.0, 0.5),
        Vec3::new(1.45, 1.45, 3.0),
        false,
    ));
    Room::new(
        walls,
        ball(center, 0.5),
        lamp(eye),
        Aim::lamp(eye, center, 0.6),
    )
}

/// A ball in parallel light through an open roof.
fn sunny_room() -> Room {
    let center = Vec3::new(2.0, 0.7, 2.0);
    let direction = Vec3::new(0.3, -1.0, 0.2).normalize();
    let walls = cuboid(Vec3::ZERO, Vec3::new(4.0, 3.0, 4.0), true);
    let open = |t: &[Vec3; 3]| t.iter().any(|p| p.y < 2.9);
    Room::new(
        walls.into_iter().filter(open).collect(),
        ball(center, 0.5),
        Light::Directional {
            direction,
            irradiance: Vec3::splat(20.0),
        },
        Aim::parallel(center - 5.0 * direction, center, 1.2),
    )
}

struct Case {
    name: &'static str,
    room: Room,
    /// Bounds of the NRMSE with 128 lights of 64² texels, at [`NEAR`] or farther: with and without visibility.
    bounds: [f64; 2],
    /// Bound at all places, with visibility.
    near: f64,
}

/// Raw errors (the reference's noise is in them) at places far from the object, and at all.
fn nrmse(room: &Room, truth: &[(Vec3, Vec3)], values: &[Vec3]) -> [f64; 2] {
    let distance = |x: Vec3| {
        let corners = room.object.iter().flatten();
        corners.map(|p| p.distance(x)).fold(f32::MAX, f32::min)
    };
    let of = |keep: &dyn Fn(usize) -> bool| {
        let kept: Vec<usize> = (0..values.len()).filter(|&i| keep(i)).collect();
        assert!(kept.len() > 100);
        let [x, r, s] = [
            kept.iter().map(|&i| values[i]).collect::<Vec<_>>(),
            kept.iter().map(|&i| truth[i].0).collect(),
            kept.iter().map(|&i| truth[i].1).collect(),
        ];
        errors(&x, &r, &s).raw_nrmse
    };
    [of(&|i| distance(room.places[i].0) >= NEAR), of(&|_| true)]
}

fn truth(room: &Room) -> Vec<(Vec3, Vec3)> {
    let all = room.truth(PATHS);
    all.iter().map(|e| (e.indirect, e.indirect_error)).collect()
}

#[test]
fn one_bounce_agrees_with_the_reference() {
    let case = |name, room, bounds, near| Case {
        name,
        room,
        bounds,
        near,
    };
    let cases = [
        case("ball", ball_room(), [0.02, 0.02], 0.02),
        case("crate", crate_room(), [0.05, 0.05], 0.4),
        case("door", door_room(), [0.05, 1.0], 0.05),
        case("sun", sunny_room(), [0.02, 0.02], 0.02),
    ];
    let mut wrong = Vec::new();
    for case in &cases {
        let room = &case.room;
        let truth = truth(room);
        let mean = truth.iter().map(|t| t.0.x).sum::<f32>() / truth.len() as f32;
        eprintln!(
            "{}: mean {mean:.4} W/m²; NRMSE {NEAR} m or farther from the object / everywhere",
            case.name
        );
        assert!(mean > 1e-3);
        for (side, vpls) in [
            (64, 1),
            (64, 4),
            (64, 16),
            (64, 64),
            (64, 128),
            (64, 256),
            (64, 1024),
            (16, 128),
            (32, 128),
            (128, 128),
            (128, 1024),
        ] {
            let lights = room.lights(side, vpls);
            let [with, without] =
                [true, false].map(|v| nrmse(room, &truth, &room.light_of(&lights, v)));
            eprintln!(
                "  {side:>3}² texels, {vpls:>4} lights: {:.4} / {:.4} with visibility, {:.4} / {:.4} without",
                with[0], with[1], without[0], without[1]
            );
            if (side, vpls) == (64, 128) {
                let within = [
                    with[0] < case.bounds[0],
                    without[0] < case.bounds[1],
                    with[1] < case.near,
                ];
                if within != [true; 3] {
                    wrong.push((case.name, with, without));
                }
            }
        }
        for count in [8, 16, 64] {
            let grid = Grid::new(room, 64, count);
            let places = room.places.iter();
            let values: Vec<Vec3> = places.map(|&(x, n)| grid.light_at(x, n)).collect();
            let error = nrmse(room, &truth, &values);
            eprintln!(
                "  [N09], a grid of {count}² in 64² texels, {} of them lit: {:.4} / {:.4}",
                grid.lights.len(),
                error[0],
                error[1]
            );
        }
    }
    assert!(wrong.is_empty(), "{wrong:?}");
}
