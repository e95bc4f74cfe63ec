//! Two rooms and the light that comes through the wall between them: for the tests of leaks and for the example that prints their table.
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
    /// Errors on each side, relative to the light on that side.
    pub lit: Errors,
    pub dark: Errors,
    /// Places that no function covers.
    pub uncovered: [usize; 2],
    /// The largest error in the dark room, W/m², and where.
    pub worst: (f32, Vec3),
}

fn quad(origin: Vec3, u: Vec3, v: Vec3) -> Quad {
    Quad {
        corners: [origin, origin + u, origin + u + v, origin + v],
        material: Material::diffuse(Vec3::splat(0.7)),
    }
}

/// Two rooms without a door, the wall between them so thick; without any thickness it is one sheet with two sides. The dark room is dark: what is right
/// needs no simulation there.
pub fn sealed(name: &str, thickness: f32) -> Walled {
    let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z];
    let [w, h, d] = SIZE.to_array();
    let mut quads = vec![
        quad(Vec3::ZERO, d * z, w * x),
        quad(h * y, w * x, d * z),
        quad(Vec3::ZERO, w * x, h * y),
        quad(d * z, h * y, w * x),
        quad(Vec3::ZERO, h * y, d * z),
        quad(w * x, d * z, h * y),
        quad(WALL * x, d * z, h * y),
    ];
    if thickness > 0.0 {
        quads.push(quad((WALL + thickness) * x, h * y, d * z));
    }
    let mesh = mesh_of_quads(&quads);
    let lights = vec![Light::Point {
        position: Vec3::new(1.2, 2.2, 1.0),
        intensity: Vec3::splat(10.0),
        range: f32::INFINITY,
    }];
    let lit = random_places(quads.len(), &quads, |x| x.x < WALL);
    let dark = random_places(quads.len(), &quads, |x| x.x > WALL + thickness);
    // Of the sheet, what is behind it counts to the dark room.
    let mut dark = Side {
        values: vec![Vec3::ZERO; dark.len()],
        noise: vec![Vec3::ZERO; dark.len()],
        places: dark,
    };
    let mut behind = random_places(quads.len(), &quads[quads.len() - 1..], |_| true);
    for (_, n) in &mut behind {
        *n = Vec3::X;
    }
    dark.values.extend(vec![Vec3::ZERO; behind.len()]);
    dark.noise.extend(vec![Vec3::ZERO; behind.len()]);
    dark.places.extend(behind);
    let settings = ReferenceSettings {
        paths: 1024,
        bounces: Some(REFLECTIONS),
        seed: 3,
    };
    let (values, noise) = irradiance_at_all(&mesh, &lights, &lit, &settings)
        .iter()
        .map(|e| (e.indirect, e.indirect_error))
        .unzip();
    Walled {
        name: name.into(),
        mesh,
        lights,
        lit: Side {
            places: lit,
            values,
            noise,
        },
        dark,
    }
}

/// Places on quads, as many for each square metre, on the side of their normals.
fn random_places(seed: usize, quads: &[Quad], keep: impl Fn(Vec3) -> bool) -> Vec<(Vec3, Vec3)> {
    const DENSITY: f32 = 12.0;
    let mut out = Vec::new();
    for (q, quad) in quads.iter().enumerate() {
        let [o, a, _, b] = quad.corners;
        let (u, v) = (a - o, b - o);
        let cross = u.cross(v);
        let mut random = Random::new(seed as u64, 0x6c65, q as u64);
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
        name: "2 cm, open door".into(),
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
        let off = dark.iter().zip(&self.dark.values).zip(&self.dark.places);
        let off = off.map(|((x, r), (at, _))| ((*x - *r).length(), *at));
        Leak {
            ratio: leak_ratio(&dark, &self.dark.values, &self.lit.values),
            lit: errors(&lit, &self.lit.values, &self.lit.noise),
            dark: errors(&dark, &self.dark.values, &self.dark.noise),
            uncovered: [a, b],
            worst: off.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or_default(),
        }
    }
}
