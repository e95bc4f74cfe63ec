//! A room of Bevy meshes with indirect light: `cargo run --release --example minimal`

use bevy::prelude::*;
use bevy_meshless_gi::prelude::*;

fn main() {
    App::new()
        .add_plugins((DefaultPlugins, MeshlessGiPlugin::default()))
        .insert_resource(GlobalAmbientLight::NONE)
        .add_systems(Startup, set_up)
        .run();
}

pub fn set_up(
    mut commands: Commands,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let mut block = |size: [f32; 3], [x, y, z]: [f32; 3], [r, g, b]: [f32; 3]| {
        let mesh = Mesh3d(meshes.add(Cuboid::from_size(size.into())));
        let material = MeshMaterial3d(materials.add(Color::linear_rgb(r, g, b)));
        (mesh, material, Transform::from_xyz(x, y, z))
    };
    let room = children![
        block([6.0, 0.2, 6.0], [0.0, -0.1, 0.0], [0.7, 0.7, 0.7]),
        block([6.0, 0.2, 6.0], [0.0, 3.1, 0.0], [0.7, 0.7, 0.7]),
        block([0.2, 3.4, 6.0], [-3.1, 1.5, 0.0], [0.7, 0.06, 0.05]),
        block([0.2, 3.4, 6.0], [3.1, 1.5, 0.0], [0.1, 0.5, 0.1]),
        block([6.4, 3.4, 0.2], [0.0, 1.5, -3.1], [0.7, 0.7, 0.7]),
        block([6.4, 3.4, 0.2], [0.0, 1.5, 3.1], [0.7, 0.7, 0.7]),
        block([1.2, 1.6, 1.2], [-1.0, 0.8, -1.2], [0.7, 0.7, 0.7]),
    ];
    commands.spawn(room).bake_gi(Preset::Draft);
    let light = PointLight {
        intensity: 120_000.0,
        shadow_maps_enabled: true,
        ..default()
    };
    commands.spawn((light, Transform::from_xyz(0.8, 2.3, 0.0)));
    let eye = Transform::from_xyz(0.0, 1.6, 2.8).looking_at(Vec3::new(0.0, 1.3, 0.0), Vec3::Y);
    commands.spawn((Camera3d::default(), GiCamera::default(), eye));
}
