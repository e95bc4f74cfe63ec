//! Any glTF scene, baked in the background while you walk in it.
//!
//! ```text
//! cargo run --release --example load_gltf -- path/to/level.glb [draft|medium|high]
//! ```
//!
//! A `.glb` or `.gltf` that is dropped on the window replaces the scene. A file without lights gets
//! a point light and a sun.
//!
//! | key | effect |
//! |---|---|
//! | W A S D, Q E | walk, move down and up (Shift: fast) |
//! | right mouse button, held | look around |
//! | F | puts the light at the camera |
//! | L | light on and off |
//! | Up, Down | sunlight stronger and weaker |
//! | Space | indirect light on and off |
//! | Ctrl+S | saves the bake next to the scene, as `level.mgi` |
//! | G | gizmos: points of the bake, radii of a level, non-zero coefficients, none |
//! | F1 | the tuning panel, with a button that bakes again |
//! | P | the plan of the frame: passes, reasons, times |
//!
//! `--screenshot FILE.png [--frames N] [--press L,Space]` writes a picture without a window when
//! the bake is done (with `--while-baking`: before).

mod camera;
#[path = "../common/mod.rs"]
mod common;
pub mod drop;
pub mod progress;
mod save;

use bevy::asset::UnapprovedPathMode;
use bevy::gizmos::config::GizmoConfigStore;
use bevy::prelude::*;
use bevy_meshless_gi::prelude::*;
use common::capture::{Capture, default_plugins};
use common::panel::{PanelPreset, TuningPanelPlugin};
use drop::{DefaultLight, Loaded};
use meshless_gi::Preset;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Mutex;

fn main() -> ExitCode {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let capture = match Capture::take_from(&mut arguments) {
        Ok(capture) => capture,
        Err(error) => {
            eprintln!("{error}");
            return usage();
        }
    };
    let (file, preset) = match arguments.as_slice() {
        [file] => (file, Preset::Medium),
        [file, preset] => match preset.as_str() {
            "draft" => (file, Preset::Draft),
            "medium" => (file, Preset::Medium),
            "high" => (file, Preset::High),
            _ => return usage(),
        },
        _ => return usage(),
    };
    let path = match Path::new(file).canonicalize() {
        Ok(path) => path,
        Err(error) => {
            eprintln!("{file}: {error}");
            return ExitCode::from(3);
        }
    };
    let first = match drop::read(&path) {
        Ok(first) => first,
        Err(error) => {
            eprintln!("{error}");
            return ExitCode::from(1);
        }
    };
    let mut app = App::new();
    app.add_plugins((
        default_plugins(capture.as_ref()).set(assets()),
        MeshlessGiPlugin::default(),
        LoadGltfPlugin::new(first, preset),
    ));
    if let Some(capture) = capture {
        app.add_plugins(capture);
    }
    common::run(app)
}

fn usage() -> ExitCode {
    eprintln!(
        "usage: load_gltf LEVEL.glb|LEVEL.gltf [draft|medium|high] [--screenshot FILE.png [--frames N] [--while-baking] [--press KEY,KEY]]"
    );
    ExitCode::from(2)
}

/// Returns an asset plugin that loads from any folder, by absolute paths.
pub fn assets() -> AssetPlugin {
    AssetPlugin {
        unapproved_path_mode: UnapprovedPathMode::Allow,
        ..default()
    }
}

/// Plugin of the example.
pub struct LoadGltfPlugin {
    first: Mutex<Option<Loaded>>,
    preset: Preset,
}

impl LoadGltfPlugin {
    /// Creates the plugin with its first scene.
    pub fn new(first: Loaded, preset: Preset) -> Self {
        Self {
            first: Mutex::new(Some(first)),
            preset,
        }
    }
}

impl Plugin for LoadGltfPlugin {
    fn build(&self, app: &mut App) {
        let mut first = self.first.lock().ok().and_then(|mut f| f.take());
        let set_up = move |world: &mut World| {
            if let Some(first) = first.take() {
                drop::show(world, first);
            }
        };
        app.insert_resource(GlobalAmbientLight::NONE)
            .insert_resource(PanelPreset(self.preset))
            .init_resource::<progress::Notice>()
            .add_plugins((common::table::PlanTable, TuningPanelPlugin))
            .add_systems(Startup, (camera::set_up, set_up, progress::set_up).chain())
            .add_systems(
                Update,
                (
                    drop::follow_drops,
                    drop::cast_shadows,
                    camera::walk,
                    switch,
                    save::start,
                    save::finish,
                    progress::show,
                )
                    .chain(),
            )
            .add_observer(progress::keep_error)
            .add_observer(drop::bake_again)
            .add_observer(camera::look_at_light);
    }
}

fn switch(
    keys: Res<ButtonInput<KeyCode>>,
    mut camera: Single<(&mut GiCamera, &Transform), Without<DefaultLight>>,
    mut default_light: Query<(&mut Transform, &mut Visibility), With<DefaultLight>>,
    mut suns: Query<&mut DirectionalLight>,
    mut gizmos: ResMut<GizmoConfigStore>,
    time: Res<Time>,
) {
    if keys.just_pressed(KeyCode::Space) {
        camera.0.enabled = !camera.0.enabled;
    }
    if keys.just_pressed(KeyCode::KeyG) {
        common::next_gizmos(&mut gizmos);
    }
    for (mut transform, mut visibility) in &mut default_light {
        if keys.just_pressed(KeyCode::KeyF) {
            transform.translation = camera.1.translation;
        }
        if keys.just_pressed(KeyCode::KeyL) {
            visibility.toggle_visible_hidden();
        }
    }
    let brighter = camera::axis(&keys, KeyCode::ArrowUp, KeyCode::ArrowDown);
    if brighter != 0.0 {
        let factor = (brighter * time.delta_secs()).exp();
        for mut sun in &mut suns {
            sun.illuminance = (sun.illuminance * factor).clamp(1.0, 150_000.0);
        }
    }
}
