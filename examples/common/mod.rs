//! What the examples share: the built-in Cornell box, once as Bevy's meshes and once as what the bake takes.
#![allow(dead_code, reason = "each example uses its part")]

use bevy::asset::RenderAssetUsages;
use bevy::mesh::{Indices, PrimitiveTopology};
use bevy::prelude::*;
use bevy_meshless_gi::scene::{Material, TriangleMesh};

/// A flat four-sided surface, its corners counter-clockwise as seen from its front.
pub struct Quad {
    pub corners: [Vec3; 4],
    pub colour: [f32; 3],
}

const WHITE: [f32; 3] = [0.73, 0.71, 0.68];
const RED: [f32; 3] = [0.61, 0.06, 0.05];
const GREEN: [f32; 3] = [0.12, 0.42, 0.09];

/// A room of 2 m, open towards +Z, with two boxes.
pub fn cornell_box() -> Vec<Quad> {
    let v = Vec3::new;
    let wall = |colour, corners| Quad { corners, colour };
    let mut quads = vec![
        wall(
            WHITE,
            [
                v(-1.0, 0.0, -1.0),
                v(-1.0, 0.0, 1.0),
                v(1.0, 0.0, 1.0),
                v(1.0, 0.0, -1.0),
            ],
        ),
        wall(
            WHITE,
            [
                v(-1.0, 2.0, -1.0),
                v(1.0, 2.0, -1.0),
                v(1.0, 2.0, 1.0),
                v(-1.0, 2.0, 1.0),
            ],
        ),
        wall(
            WHITE,
            [
                v(-1.0, 0.0, -1.0),
                v(1.0, 0.0, -1.0),
                v(1.0, 2.0, -1.0),
                v(-1.0, 2.0, -1.0),
            ],
        ),
        wall(
            RED,
            [
                v(-1.0, 0.0, 1.0),
                v(-1.0, 0.0, -1.0),
                v(-1.0, 2.0, -1.0),
                v(-1.0, 2.0, 1.0),
            ],
        ),
        wall(
            GREEN,
            [
                v(1.0, 0.0, -1.0),
                v(1.0, 0.0, 1.0),
                v(1.0, 2.0, 1.0),
                v(1.0, 2.0, -1.0),
            ],
        ),
    ];
    quads.extend(block(v(-0.35, 0.0, -0.35), v(0.6, 1.2, 0.6), 0.3));
    quads.extend(block(v(0.35, 0.0, 0.35), v(0.6, 0.6, 0.6), -0.3));
    quads
}

/// A box that stands on `foot`, without its underside.
fn block(foot: Vec3, size: Vec3, turn: f32) -> Vec<Quad> {
    let rotation = Quat::from_rotation_y(turn);
    let at = |x: f32, y: f32, z: f32| {
        foot + rotation * (Vec3::new(x, y, z) * size * Vec3::new(0.5, 1.0, 0.5))
    };
    let side = |a: [f32; 2], b: [f32; 2]| Quad {
        corners: [
            at(a[0], 0.0, a[1]),
            at(b[0], 0.0, b[1]),
            at(b[0], 1.0, b[1]),
            at(a[0], 1.0, a[1]),
        ],
        colour: WHITE,
    };
    vec![
        side([-1.0, 1.0], [1.0, 1.0]),
        side([1.0, 1.0], [1.0, -1.0]),
        side([1.0, -1.0], [-1.0, -1.0]),
        side([-1.0, -1.0], [-1.0, 1.0]),
        Quad {
            corners: [
                at(-1.0, 1.0, 1.0),
                at(1.0, 1.0, 1.0),
                at(1.0, 1.0, -1.0),
                at(-1.0, 1.0, -1.0),
            ],
            colour: WHITE,
        },
    ]
}

/// The surfaces as the bake takes them.
pub fn level(quads: &[Quad]) -> TriangleMesh {
    let halves = |q: &Quad| {
        [
            [q.corners[0], q.corners[1], q.corners[2]],
            [q.corners[0], q.corners[2], q.corners[3]],
        ]
    };
    TriangleMesh::new(
        quads.iter().flat_map(halves).collect(),
        (0..2 * quads.len() as u32).map(|i| i / 2).collect(),
        quads
            .iter()
            .map(|q| Material::diffuse(q.colour.into()))
            .collect(),
    )
}

/// Spawns the surfaces as children of `root`, rough and without reflections.
pub fn spawn_quads(
    quads: &[Quad],
    root: &mut EntityCommands,
    meshes: &mut Assets<Mesh>,
    materials: &mut Assets<StandardMaterial>,
) {
    root.with_children(|parent| {
        for quad in quads {
            let [a, b, c, d] = quad.corners;
            let normal = (b - a).cross(d - a).normalize().to_array();
            let mesh = Mesh::new(
                PrimitiveTopology::TriangleList,
                RenderAssetUsages::default(),
            )
            .with_inserted_attribute(
                Mesh::ATTRIBUTE_POSITION,
                vec![a.to_array(), b.to_array(), c.to_array(), d.to_array()],
            )
            .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, vec![normal; 4])
            .with_inserted_attribute(
                Mesh::ATTRIBUTE_UV_0,
                vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]],
            )
            .with_inserted_indices(Indices::U32(vec![0, 1, 2, 0, 2, 3]));
            let [r, g, b] = quad.colour;
            parent.spawn((
                Mesh3d(meshes.add(mesh)),
                MeshMaterial3d(materials.add(StandardMaterial {
                    base_color: Color::linear_rgb(r, g, b),
                    perceptual_roughness: 1.0,
                    reflectance: 0.0,
                    ..default()
                })),
            ));
        }
    });
}
