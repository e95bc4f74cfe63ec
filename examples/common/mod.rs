//! Shared parts of the examples: scenes of flat surfaces as Bevy meshes, gizmos, a stage, a clock,
//! the tuning panel, the plan overlay, and pictures.
#![allow(dead_code, reason = "each example uses its part")]

pub mod capture;
pub mod clock;
pub mod panel;
pub mod stage;
pub mod table;

use bevy::asset::RenderAssetUsages;
use bevy::gizmos::config::GizmoConfigStore;
use bevy::mesh::{Indices, PrimitiveTopology};
use bevy::prelude::*;
use bevy_meshless_gi::{GiGizmos, MeshlessGiDebugPlugin, MeshlessGiPlugin};
use capture::{Capture, default_plugins};
use meshless_gi::{Material, Quad};
use std::process::ExitCode;

/// Creates an app with Bevy's plugins and this crate's, without Bevy's ambient light. Adds the
/// picture options.
pub fn app(capture: Option<&Capture>) -> App {
    let mut app = App::new();
    app.add_plugins((
        default_plugins(capture),
        MeshlessGiPlugin::default(),
        MeshlessGiDebugPlugin,
    ))
    .insert_resource(GlobalAmbientLight::NONE);
    if let Some(capture) = capture {
        app.add_plugins(capture.clone());
    }
    app
}

/// Runs an app and returns its exit code.
pub fn run(mut app: App) -> ExitCode {
    match app.run() {
        AppExit::Success => ExitCode::SUCCESS,
        AppExit::Error(code) => ExitCode::from(code.get()),
    }
}

/// Selects the next gizmos: points, radii of a level, non-zero coefficients, none.
pub fn next_gizmos(store: &mut GizmoConfigStore) {
    let (config, group) = store.config_mut::<GiGizmos>();
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

/// Returns the sides of an axis-aligned box that face outward.
pub fn block(min: Vec3, max: Vec3, material: &Material) -> Vec<Quad> {
    let side = |axis: usize, far: bool| {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let corner = |a: bool, b: bool| {
            let mut at = min;
            at[axis] = if far { max } else { min }[axis];
            at[u] = if a { max } else { min }[u];
            at[v] = if b { max } else { min }[v];
            at
        };
        let mut corners = [
            corner(false, false),
            corner(true, false),
            corner(true, true),
            corner(false, true),
        ];
        if !far {
            corners.reverse();
        }
        Quad {
            corners,
            material: material.clone(),
        }
    };
    let sides = (0..3).flat_map(|axis| [side(axis, false), side(axis, true)]);
    sides.collect()
}

/// Returns the sides of an axis-aligned box that face inward.
pub fn room(min: Vec3, max: Vec3, material: &Material) -> Vec<Quad> {
    let mut quads = block(min, max, material);
    quads.iter_mut().for_each(|quad| quad.corners.reverse());
    quads
}

/// Spawns the surfaces as children of `root`, one mesh per material, rough and without reflections.
/// Returns the named materials.
pub fn spawn_quads(
    quads: &[Quad],
    root: &mut EntityCommands,
    meshes: &mut Assets<Mesh>,
    materials: &mut Assets<StandardMaterial>,
) -> Vec<(String, Handle<StandardMaterial>)> {
    let mut kinds: Vec<(&Material, Vec<&Quad>)> = Vec::new();
    for quad in quads {
        match kinds.iter_mut().find(|(m, _)| **m == quad.material) {
            Some((_, same)) => same.push(quad),
            None => kinds.push((&quad.material, vec![quad])),
        }
    }
    let mut named = Vec::new();
    root.with_children(|parent| {
        for (material, same) in kinds {
            let [r, g, b, _] = material.base_color.to_array();
            let [red, green, blue] = material.emissive.to_array();
            let handle = materials.add(StandardMaterial {
                base_color: Color::linear_rgb(r, g, b),
                emissive: LinearRgba::rgb(red, green, blue),
                perceptual_roughness: 1.0,
                reflectance: 0.0,
                double_sided: material.double_sided,
                ..default()
            });
            if !material.name.is_empty() {
                named.push((material.name.clone(), handle.clone()));
            }
            parent.spawn((Mesh3d(meshes.add(mesh_of(&same))), MeshMaterial3d(handle)));
        }
    });
    named
}

fn mesh_of(quads: &[&Quad]) -> Mesh {
    let normal = |q: &Quad| {
        let [a, b, _, d] = q.corners;
        (b - a).cross(d - a).normalize().to_array()
    };
    let corners = quads.iter().flat_map(|q| q.corners).map(|c| c.to_array());
    let normals = quads.iter().flat_map(|q| [normal(q); 4]);
    let indices = (0..quads.len() as u32).flat_map(|i| [0, 1, 2, 0, 2, 3].map(|k| 4 * i + k));
    let uv = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    Mesh::new(
        PrimitiveTopology::TriangleList,
        RenderAssetUsages::default(),
    )
    .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, corners.collect::<Vec<_>>())
    .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, normals.collect::<Vec<_>>())
    .with_inserted_attribute(Mesh::ATTRIBUTE_UV_0, uv.repeat(quads.len()))
    .with_inserted_indices(Indices::U32(indices.collect()))
}
