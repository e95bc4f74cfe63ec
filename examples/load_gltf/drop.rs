//! Scenes: reading, displaying, and files that are dropped on the window.

use super::camera::Eye;
use super::common::panel::{BakeAgain, PanelPreset};
use super::progress::Notice;
use bevy::light::CascadeShadowConfigBuilder;
use bevy::prelude::*;
use bevy::window::FileDragAndDrop;
use bevy_meshless_gi::GiBakeTask;
use meshless_gi::{Bounds, Geometry, Light, Recipe, TriangleMesh, load_gltf};
use std::f32::consts::PI;
use std::path::{Path, PathBuf};

/// Scene that was read from a file.
pub struct Loaded {
    path: PathBuf,
    mesh: TriangleMesh,
    lights: Vec<Light>,
}

/// Displayed scene.
#[derive(Resource)]
pub struct CurrentScene {
    /// Path of the file.
    pub path: PathBuf,
    /// Root of the meshes and the bake.
    pub root: Entity,
    /// Lights of the file in the scene's space. Empty for a scene with [`DefaultLight`] and sun.
    pub lights: Vec<Light>,
    /// Diagonal of the bounding box, in meters.
    pub size: f32,
}

/// Entity that is despawned with the scene.
#[derive(Component)]
pub struct ScenePart;

/// Point light of a scene without lights.
#[derive(Component)]
pub struct DefaultLight;

/// Illuminance of the sun of a scene without lights, in lux.
const SUN: f32 = 10_000.0;

/// Direction of that sun.
const SUN_DIRECTION: Vec3 = Vec3::new(0.35, -1.0, 0.25);

/// Reads a scene.
///
/// # Errors
/// A message with the file and the reason.
pub fn read(path: &Path) -> Result<Loaded, String> {
    let loaded = load_gltf(path).map_err(|error| error.to_string())?;
    Ok(Loaded {
        path: path.into(),
        mesh: loaded.mesh,
        lights: loaded.lights,
    })
}

/// Replaces the displayed scene and starts its bake.
pub fn show(world: &mut World, loaded: Loaded) {
    let mut before = world.query_filtered::<Entity, With<ScenePart>>();
    for entity in before.iter(world).collect::<Vec<_>>() {
        world.despawn(entity);
    }
    let bounds = loaded.mesh.bounds();
    let size = bounds.size().length();
    let recipe = Recipe {
        preset: world.resource::<PanelPreset>().0,
        ..default()
    };
    let scene = GltfAssetLabel::Scene(0).from_asset(loaded.path.clone());
    let scene = world.resource::<AssetServer>().load(scene);
    let name = loaded.path.file_name().unwrap_or_default();
    let root = (world.spawn((
        ScenePart,
        Name::new(name.to_string_lossy().into_owned()),
        WorldAssetRoot(scene),
        GiBakeTask::spawn(loaded.mesh, recipe),
    )))
    .id();
    if loaded.lights.is_empty() {
        spawn_lights(world, &bounds, size);
    }
    Eye::move_to_middle(world, &bounds, size);
    world.insert_resource(CurrentScene {
        path: loaded.path,
        root,
        lights: loaded.lights,
        size,
    });
}

/// Spawns a point light and a sun.
fn spawn_lights(world: &mut World, bounds: &Bounds, size: f32) {
    world.spawn((
        ScenePart,
        DefaultLight,
        Name::new("light"),
        PointLight {
            // At a tenth of the scene's size as bright as a 60 W bulb at 2 m.
            intensity: 800.0 * (0.05 * size).powi(2).max(1.0) * 40.0,
            range: 2.0 * size,
            shadow_maps_enabled: true,
            shadow_map_near_z: 1e-3 * size,
            ..default()
        },
        Transform::from_translation(bounds.center()),
    ));
    world.spawn((
        ScenePart,
        Name::new("sun"),
        DirectionalLight {
            illuminance: SUN,
            shadow_maps_enabled: true,
            ..default()
        },
        // Cascades fit the scene instead of Bevy's 150 m. Otherwise sunlight leaks at the foot of
        // walls.
        CascadeShadowConfigBuilder {
            minimum_distance: 1e-3 * size,
            first_cascade_far_bound: 0.15 * size,
            maximum_distance: size,
            ..default()
        }
        .build(),
        Transform::default().looking_to(SUN_DIRECTION, Vec3::Y),
    ));
}

impl CurrentScene {
    /// Returns the lights of the file, or the default light and the sun.
    pub fn lights_with(&self, default_light: Option<(&PointLight, Vec3)>) -> Vec<Light> {
        let Some((light, position)) = default_light else {
            return self.lights.clone();
        };
        let color = LinearRgba::from(light.color).to_vec3();
        vec![
            Light::Point {
                position,
                intensity: color * light.intensity / (4.0 * PI),
                range: light.range,
            },
            Light::Directional {
                direction: SUN_DIRECTION.normalize(),
                irradiance: Vec3::splat(SUN),
            },
        ]
    }
}

/// Enables shadow maps on lights of glTF files. Light without them passes walls.
pub fn cast_shadows(
    mut points: Query<&mut PointLight, Added<PointLight>>,
    mut spots: Query<&mut SpotLight, Added<SpotLight>>,
    mut suns: Query<&mut DirectionalLight, Added<DirectionalLight>>,
) {
    points
        .iter_mut()
        .for_each(|mut l| l.shadow_maps_enabled = true);
    spots
        .iter_mut()
        .for_each(|mut l| l.shadow_maps_enabled = true);
    suns.iter_mut()
        .for_each(|mut l| l.shadow_maps_enabled = true);
}

/// Displays a scene whose file was dropped on the window. An invalid file keeps the old scene.
pub fn follow_drops(
    mut commands: Commands,
    mut events: MessageReader<FileDragAndDrop>,
    mut notice: ResMut<Notice>,
) {
    for event in events.read() {
        match event {
            FileDragAndDrop::HoveredFile { path_buf, .. } => {
                notice.0 = format!("drop to show {}", path_buf.display());
            }
            FileDragAndDrop::HoveredFileCanceled { .. } => notice.0.clear(),
            FileDragAndDrop::DroppedFile { path_buf, .. } => match read(path_buf) {
                Ok(loaded) => {
                    notice.0.clear();
                    commands.queue(move |world: &mut World| show(world, loaded));
                }
                Err(error) => notice.0 = format!("not shown: {error}"),
            },
        }
    }
}

/// Bakes the scene again. The old light stays until the new bake is done.
pub fn bake_again(
    event: On<BakeAgain>,
    mut commands: Commands,
    current: Res<CurrentScene>,
    mut notice: ResMut<Notice>,
) {
    match read(&current.path) {
        Ok(loaded) => {
            let recipe = Recipe {
                preset: event.0,
                ..default()
            };
            notice.0.clear();
            commands
                .entity(current.root)
                .insert(GiBakeTask::spawn(loaded.mesh, recipe));
        }
        Err(error) => notice.0 = format!("not baked: {error}"),
    }
}
