//! Two rooms and the light that comes through the wall between them: for the tests of leaks and for the example that prints their table.
#![allow(dead_code, reason = "test and example each use their part")]
//!
//! Floor, ceiling and side walls run on under the wall, as levels are built: functions on them lie on both sides of it.

use bevy_meshless_gi::accuracy::{
    BOUNCES, Bounces, Errors, Evaluator, ReferenceSettings, Truth, errors, irradiance_at_all,
    leak_ratio,
};
use bevy_meshless_gi::asset::BakedScene;
use bevy_meshless_gi::samples::Random;
use bevy_meshless_gi::scene::{
    Light, Material, Quad, SceneDescription, TriangleMesh, load_gltf, mesh_of_quads,
};
use glam::Vec3;
use std::path::Path;

/// Outer corner of both rooms together; the inner one is the origin.
const SIZE: Vec3 = Vec3::new(8.0, 2.6, 3.6);
/// The wall's side towards the lit room.
pub const WALL: f32 = 4.0;
/// The door's sides along z, and its height.
const DOOR: [f32; 3] = [1.5, 2.4, 2.0];
/// Reflections that count.
pub const REFLECTIONS: u32 = 4;

/// A scene with a wall, its lamp in the room before the wall, and what is right.
pub struct Walled {
    pub name: String,
    pub mesh: TriangleMesh,
    pub lights: Vec<Light>,
    /// Places with normals in the lit and in the dark room, and the irradiance there after one to four reflections with its standard error.
    pub lit: Side,
    pub dark: Side,
}

#[derive(Default)]
pub struct Side {
    pub places: Vec<(Vec3, Vec3)>,
    pub values: Vec<Vec3>,
    pub noise: Vec<Vec3>,
}

/// What a bake makes of it.
#[derive(Clone, Copy, Debug)]
pub struct Leak {
    /// Root mean square of the error in the dark room over that of the light in the lit one.
    pub ratio: f64,
    /// Root mean square of the light in the dark room, as it should be, over that in the lit one.
    pub dim: f64,
    /// Errors on each side, relative to the light on that side.
    pub lit: Errors,
    pub dark: Errors,
    /// Places that no function covers.
    pub uncovered: [usize; 2],
}

fn quad(origin: Vec3, u: Vec3, v: Vec3) -> Quad {
    Quad {
        corners: [origin, origin + u, origin + u + v, origin + v],
        material: Material::diffuse(Vec3::splat(0.7)),
    }
}

/// How the two rooms are told apart.
#[derive(Clone, Copy, PartialEq)]
pub enum Door {
    /// There is none. The dark room is dark: what is right needs no simulation there.
    Closed,
    /// An opening in the wall, from the floor to 2 m.
    Open,
}

/// Two rooms with a wall so thick between them; without any thickness it is one sheet with two sides.
/// `paths` is what the reference takes in the lit room.
pub fn rooms(name: &str, thickness: f32, door: Door, paths: u32) -> Walled {
    let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z];
    let [w, h, d] = SIZE.to_array();
    let mut quads = vec![
        quad(Vec3::ZERO, d * z, w * x),
        quad(h * y, w * x, d * z),
        quad(Vec3::ZERO, w * x, h * y),
        quad(d * z, h * y, w * x),
        quad(Vec3::ZERO, h * y, d * z),
        quad(w * x, d * z, h * y),
    ];
    // The wall's side towards the lit room, and the other one.
    let (a, b) = (WALL * x, (WALL + thickness) * x);
    let (left, right, top) = (DOOR[0], DOOR[1], DOOR[2]);
    let parts = match door {
        Door::Closed => vec![[0.0, d, 0.0, h]],
        Door::Open => vec![
            [0.0, left, 0.0, h],
            [right, d, 0.0, h],
            [left, right, top, h],
        ],
    };
    let mut behind = Vec::new();
    for [from, to, low, high] in parts {
        let corner = from * z + low * y;
        let (across, up) = ((to - from) * z, (high - low) * y);
        quads.push(quad(a + corner, across, up));
        behind.push(quad(b + corner, up, across));
    }
    if thickness > 0.0 {
        quads.extend(behind.iter().cloned());
        if door == Door::Open {
            quads.push(quad(a + left * z, thickness * x, top * y));
            quads.push(quad(a + right * z, top * y, thickness * x));
            quads.push(quad(
                a + left * z + top * y,
                thickness * x,
                (right - left) * z,
            ));
        }
    }
    let mesh = mesh_of_quads(&quads);
    let lights = vec![Light::Point {
        position: Vec3::new(1.2, 2.2, 1.0),
        intensity: Vec3::splat(10.0),
        range: f32::INFINITY,
    }];
    let lit = random_places(&quads, |x| x.x <= WALL);
    let mut dark = random_places(&quads, |x| x.x > WALL + thickness);
    dark.extend(random_places(&behind, |_| true));
    let right = |places: Vec<(Vec3, Vec3)>, paths: u32| -> Side {
        let settings = ReferenceSettings {
            paths,
            bounces: Some(REFLECTIONS),
            seed: 3,
        };
        let (values, noise) = irradiance_at_all(&mesh, &lights, &places, &settings)
            .iter()
            .map(|e| (e.indirect, e.indirect_error))
            .unzip();
        Side {
            places,
            values,
            noise,
        }
    };
    let (lit, dark) = match door {
        Door::Closed => {
            let none = vec![Vec3::ZERO; dark.len()];
            let black = Side {
                places: dark,
                values: none.clone(),
                noise: none,
            };
            (right(lit, paths), black)
        }
        // Little light finds its way through a door.
        Door::Open => (right(lit, paths), right(dark, 8 * paths)),
    };
    Walled {
        name: name.into(),
        mesh,
        lights,
        lit,
        dark,
    }
}

/// Places on quads, as many for each square metre, on the side of their normals.
fn random_places(quads: &[Quad], keep: impl Fn(Vec3) -> bool) -> Vec<(Vec3, Vec3)> {
    const DENSITY: f32 = 8.0;
    let mut out = Vec::new();
    for (q, quad) in quads.iter().enumerate() {
        let [o, a, _, b] = quad.corners;
        let (u, v) = (a - o, b - o);
        let cross = u.cross(v);
        let mut random = Random::new(quads.len() as u64, 0x6c65, q as u64);
        for _ in 0..(DENSITY * cross.length()) as usize {
            let x = o + u * random.unit() + v * random.unit();
            if keep(x) {
                out.push((x, cross.normalize()));
            }
        }
    }
    out
}

/// The rooms with an open door, for which another program computed the truth (`tests/data`).
pub fn open() -> Walled {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/rooms_open");
    let scene = SceneDescription::read(folder.join("L0.json")).expect("the scene");
    let mesh = load_gltf(&scene.geometry[0]).expect("its geometry").mesh;
    let truth = Truth::read(folder.join("L0.csv")).expect("its light");
    let k = BOUNCES
        .iter()
        .position(|&b| b == Some(REFLECTIONS))
        .unwrap_or(0);
    let (mut lit, mut dark) = (Side::default(), Side::default());
    for (i, &(x, n)) in truth.places.iter().enumerate() {
        let side = if x.x <= WALL + 0.01 {
            &mut lit
        } else {
            &mut dark
        };
        side.places.push((x, n));
        side.values.push(truth.indirect[k].0[i]);
        side.noise.push(truth.indirect[k].1[i]);
    }
    Walled {
        name: "2 cm, door (`rooms_open`)".into(),
        mesh,
        lights: scene.lights,
        lit,
        dark,
    }
}

impl Walled {
    /// The light of a baked scene, on both sides of the wall.
    pub fn measure(&self, scene: &BakedScene) -> Leak {
        let meshes = std::slice::from_ref(&self.mesh);
        let count = Bounces::Count(REFLECTIONS);
        let evaluator = Evaluator::new(scene, meshes, &self.lights, count);
        let side = |side: &Side| -> (Vec<Vec3>, usize) {
            let found: Vec<_> = (0..)
                .zip(&side.places)
                .map(|(k, &(x, n))| evaluator.at(x, n, k).indirect)
                .collect();
            let uncovered = found.iter().filter(|e| e.is_none()).count();
            let values = found.iter().map(|e| e.unwrap_or_default()).collect();
            (values, uncovered)
        };
        let ((lit, a), (dark, b)) = (side(&self.lit), side(&self.dark));
        Leak {
            ratio: leak_ratio(&dark, &self.dark.values, &self.lit.values),
            dim: leak_ratio(
                &self.dark.values,
                &vec![Vec3::ZERO; dark.len()],
                &self.lit.values,
            ),
            lit: errors(&lit, &self.lit.values, &self.lit.noise),
            dark: errors(&dark, &self.dark.values, &self.dark.noise),
            uncovered: [a, b],
        }
    }
}
