//! What the examples share: the built-in Cornell box as Bevy's meshes, what the gizmos' key does, a room to look into, pictures.
#![allow(dead_code, reason = "each example uses its part")]

pub mod capture;
pub mod stage;

use bevy::asset::RenderAssetUsages;
use bevy::gizmos::config::GizmoConfigStore;
use bevy::mesh::{Indices, PrimitiveTopology};
use bevy::prelude::*;
use bevy_meshless_gi::plugin::MeshlessGiGizmos;
use bevy_meshless_gi::scene::Quad;

/// Draws the next of: the points, the radii of a level, the non-zero coefficients, nothing.
pub fn next_gizmos(store: &mut GizmoConfigStore) {
    let (config, group) = store.config_mut::<MeshlessGiGizmos>();
    let next = match (config.enabled, group.points, group.radii) {
        (false, ..) => 0,
        (true, true, _) => 1,
        (true, false, true) => 2,
        (true, false, false) => 3,
    };
    config.enabled = next < 3;
    (group.points, group.radii, group.coefficients) = (next == 0, next == 1, next == 2);
    group.level = group.radii.then_some(1);
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
            let [r, g, b, _] = quad.material.base_color.to_array();
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
