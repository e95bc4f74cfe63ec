//! A room with baked light in a Bevy app without this crate's plugin: a Bevy irradiance volume
//! loaded from two files. This suits devices without compute shaders, and games with static lights.
//!
//! ```text
//! cargo run --release --example exported
//! ```
//!
//! The first start bakes the room and exports its light to `out/exported/room.ktx2` and `room.ron`.
//! Later starts load these. The tool writes the same files for any scene:
//!
//! ```text
//! meshless_gi bake level.glb -o level.mgi --probes
//! meshless_gi export level.mgi --scene lights.json --irradiance-volume level.ktx2
//! ```
//!
//! | key | effect |
//! |---|---|
//! | Space | baked light on and off |
//!
//! `-- --screenshot FILE.png [--frames N] [--press Space]` writes a picture without a window. `--
//! --data FOLDER` selects the folder of the files.

mod common;

use bevy::asset::AssetPlugin;
use bevy::light::IrradianceVolume;
use bevy::prelude::*;
use common::capture::{Capture, default_plugins};
use meshless_gi::{
    ExportedVolume, Light, Preset, ProbeSettings, Progress, Quad, Recipe, TriangleMesh,
    VolumeExport, VolumePlacement, bake_scene,
};
use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Light of the room: position in meters, and luminous intensity in cd.
const LIGHT: (Vec3, f32) = (Vec3::new(0.0, 1.7, 0.2), 4800.0);

/// Placement of the irradiance volume, with its intensity while it is on.
#[derive(Resource)]
struct Placement(VolumePlacement);

fn main() -> ExitCode {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let folder = match take_folder(&mut arguments) {
        Ok(folder) => folder,
        Err(error) => return usage(&error),
    };
    let capture = match Capture::take_from(&mut arguments) {
        Ok(capture) if arguments.is_empty() => capture,
        Ok(_) => return usage(&format!("unknown arguments: {}", arguments.join(" "))),
        Err(error) => return usage(&error),
    };
    let placement = match placement(&folder) {
        Ok(placement) => placement,
        Err(error) => {
            eprintln!("{}: {error}", folder.display());
            return ExitCode::FAILURE;
        }
    };
    let mut app = App::new();
    app.add_plugins(default_plugins(capture.as_ref()).set(AssetPlugin {
        file_path: folder.to_string_lossy().into_owned(),
        ..default()
    }))
    .insert_resource(GlobalAmbientLight::NONE)
    .insert_resource(Placement(placement))
    .add_systems(Startup, setup)
    .add_systems(Update, switch);
    if let Some(capture) = capture {
        app.add_plugins(capture);
    }
    common::run(app)
}

fn usage(error: &str) -> ExitCode {
    eprintln!(
        "{error}\nusage: exported [--data FOLDER] [--screenshot FILE.png [--size WIDTHxHEIGHT] [--frames N] [--press KEY,KEY]]"
    );
    ExitCode::from(2)
}

/// Removes `--data FOLDER` from the arguments and returns an absolute path.
fn take_folder(arguments: &mut Vec<String>) -> Result<PathBuf, String> {
    let folder = match arguments.iter().position(|a| a == "--data") {
        Some(at) if at + 1 < arguments.len() => {
            arguments.remove(at);
            PathBuf::from(arguments.remove(at))
        }
        Some(_) => return Err("--data needs a value".into()),
        None => Path::new(env!("CARGO_MANIFEST_DIR")).join("out/exported"),
    };
    std::path::absolute(folder).map_err(|error| error.to_string())
}

/// Reads the description of the volume in `folder`. Bakes and exports first if the files are
/// missing.
fn placement(folder: &Path) -> Result<VolumePlacement, Box<dyn Error>> {
    let (texture, description) = (folder.join("room.ktx2"), folder.join("room.ron"));
    if !texture.exists() || !description.exists() {
        std::fs::create_dir_all(folder)?;
        export(&texture)?;
    }
    let text = std::fs::read_to_string(description)?;
    Ok(VolumePlacement::from_ron(&text)?)
}

/// Bakes the room and writes its light.
fn export(texture: &Path) -> Result<(), Box<dyn Error>> {
    let recipe = Recipe {
        preset: Preset::Draft,
        probes: Some(ProbeSettings::default()),
        ..default()
    };
    let mesh = TriangleMesh::from_quads(&Quad::cornell_box());
    let baked = bake_scene(&mesh, &recipe, 0, &Progress::default())?;
    let light = Light::Point {
        position: LIGHT.0,
        intensity: Vec3::splat(LIGHT.1),
        range: 20.0,
    };
    let volume = ExportedVolume::new(&baked.scene, &[light], &VolumeExport::default())?;
    volume.write(texture, "the example's light")?;
    Ok(())
}

fn setup(
    mut commands: Commands,
    placement: Res<Placement>,
    assets: Res<AssetServer>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let mut room = commands.spawn((Transform::default(), Visibility::default()));
    common::spawn_quads(&Quad::cornell_box(), &mut room, &mut meshes, &mut materials);
    let volume = &placement.0;
    commands.spawn((
        LightProbe::default(),
        IrradianceVolume {
            voxels: assets.load(&volume.texture),
            intensity: volume.intensity,
            affects_lightmapped_meshes: false,
        },
        Transform {
            translation: volume.translation.into(),
            rotation: Quat::from_array(volume.rotation),
            scale: volume.scale.into(),
        },
    ));
    // The light that the volume was computed for.
    commands.spawn((
        PointLight {
            intensity: LIGHT.1 * 4.0 * std::f32::consts::PI,
            range: 20.0,
            shadow_maps_enabled: true,
            shadow_map_near_z: 0.01,
            ..default()
        },
        Transform::from_translation(LIGHT.0),
    ));
    commands.spawn((
        Camera3d::default(),
        Transform::from_xyz(0.0, 1.0, 4.2).looking_at(Vec3::new(0.0, 1.0, 0.0), Vec3::Y),
    ));
}

/// Switches the volume on Space.
fn switch(
    keys: Res<ButtonInput<KeyCode>>,
    placement: Res<Placement>,
    mut volume: Single<&mut IrradianceVolume>,
) {
    if keys.just_pressed(KeyCode::Space) {
        volume.intensity = match volume.intensity {
            0.0 => placement.0.intensity,
            _ => 0.0,
        };
    }
}
