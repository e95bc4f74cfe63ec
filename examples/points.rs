//! A statue of points in a room of triangles, with a light that circles it. Points and triangles
//! light and shadow each other.
//!
//! ```text
//! cargo run --release --example points
//! cargo run --release --example points -- path/to/scan.ply [draft|medium|high]
//! ```
//!
//! Without a file, points are scattered over the built-in statue. A `.ply` file replaces it, Y up,
//! scaled to fit. The room is baked in the background.
//!
//! | key | effect |
//! |---|---|
//! | M | the light stops and circles on |
//! | arrows, Page Up, Page Down | stop the light and move it |
//! | left mouse button, held | the light follows the mouse |
//! | Space | indirect light on and off |
//! | Tab | one view, or direct light alone on the left |
//! | V | the picture, indirect light alone, or irradiance |
//! | G | gizmos: points of the bake, radii of a level, non-zero coefficients, none |
//! | P | the plan of the frame: passes, reasons, times |
//! | H | help on and off |
//!
//! `-- --screenshot FILE.png [--frames N] [--press Tab,M]` writes a picture without a window. Press
//! M first to keep the light at its start.

mod common;

use bevy::prelude::*;
use bevy_meshless_gi::GiBakeTask;
use bevy_meshless_gi::point_cloud::{GiPointCloud, GiPointCloudAsset};
use common::capture::Capture;
use common::clock::{Clock, ClockSystems};
use common::stage::{MovableLight, Stage, StageSystems, spawn_light};
use meshless_gi::internals::samples::scatter;
use meshless_gi::internals::scene::{PlyPoints, read_ply, statue};
use meshless_gi::{Bounds, PointCloud, Preset, Quad, Recipe, TriangleMesh};
use std::path::Path;
use std::process::ExitCode;

/// Minimum distance between points of the statue, in meters.
const SPACING: f32 = 0.012;
/// Size that a scan is scaled to, in meters.
const SCAN_SIZE: Vec3 = Vec3::new(1.2, 1.5, 1.2);

fn main() -> ExitCode {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let capture = match Capture::take_from(&mut arguments) {
        Ok(capture) => capture,
        Err(error) => return usage(&error),
    };
    let mut preset = Preset::Draft;
    if let Some(last) = arguments.last() {
        let named = match last.as_str() {
            "draft" => Some(Preset::Draft),
            "medium" => Some(Preset::Medium),
            "high" => Some(Preset::High),
            _ => None,
        };
        if let Some(named) = named {
            preset = named;
            arguments.pop();
        }
    }
    let cloud = match arguments.as_slice() {
        [] => scattered(),
        [file] => read(Path::new(file)),
        more => return usage(&format!("unknown arguments: {}", more[1..].join(" "))),
    };
    let cloud = match cloud {
        Ok(cloud) => cloud,
        Err(error) => {
            eprintln!("{error}");
            return ExitCode::from(1);
        }
    };
    let mut app = common::app(capture.as_ref());
    app.add_plugins(Stage {
        look: Transform::from_xyz(0.0, 1.0, 4.2).looking_at(Vec3::new(0.0, 1.0, 0.0), Vec3::Y),
        // Positions inside the room.
        reach: Some((Vec3::new(-0.9, 0.1, -0.9), Vec3::new(0.9, 1.9, 1.5))),
        keys: "M: circle",
    })
    .insert_resource(RoomToBake {
        cloud: Some(cloud),
        preset,
    })
    .add_plugins(Clock::new(0.0, 1.0, capture.as_ref().and_then(|c| c.at)))
    .add_systems(Startup, set_up)
    .add_systems(Update, circle.after(ClockSystems).before(StageSystems));
    common::run(app)
}

fn usage(error: &str) -> ExitCode {
    eprintln!(
        "{error}\nusage: points [FILE.ply] [draft|medium|high] [--screenshot FILE.png [--size WIDTHxHEIGHT] [--frames N] [--at SECONDS] [--while-baking] [--press KEY,KEY]]"
    );
    ExitCode::from(2)
}

/// Returns points of the built-in statue.
fn scattered() -> Result<PointCloud, String> {
    let points = scatter(&statue(), SPACING, 1).ok_or("too many points")?;
    PointCloud::new(points, &[]).map_err(|error| error.to_string())
}

/// Reads the points of a file, placed on the middle of the floor and scaled to [`SCAN_SIZE`].
fn read(file: &Path) -> Result<PointCloud, String> {
    let points = read_ply(file).map_err(|error| error.to_string())?;
    let finite = points.positions.iter().filter(|x| x.is_finite());
    let bounds = finite.fold(Bounds::EMPTY, |bounds, x| bounds.join(*x));
    let (size, middle) = (bounds.size(), bounds.center());
    let scale = (SCAN_SIZE / size.max(Vec3::splat(1e-6))).min_element();
    let foot = Vec3::new(middle.x, bounds.min.y, middle.z);
    let stood = PlyPoints {
        positions: points
            .positions
            .iter()
            .map(|x| (*x - foot) * scale)
            .collect(),
        ..points
    };
    PointCloud::new(stood, &[]).map_err(|error| format!("{}: {error}", file.display()))
}

#[derive(Resource)]
struct RoomToBake {
    cloud: Option<PointCloud>,
    preset: Preset,
}

fn set_up(
    mut commands: Commands,
    clock: Res<Clock>,
    mut room_to_bake: ResMut<RoomToBake>,
    mut clouds: ResMut<Assets<GiPointCloudAsset>>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let Some(cloud) = room_to_bake.cloud.take() else {
        return;
    };
    info!("{} points", cloud.len());
    // Walls without the blocks.
    let mut quads = Quad::cornell_box();
    quads.truncate(5);
    // Geometry of the rays: triangles and the points' cells in one mesh.
    let (cells, _) = cloud.mesh();
    let room = TriangleMesh::joined(vec![TriangleMesh::from_quads(&quads), cells]);
    let recipe = Recipe {
        preset: room_to_bake.preset,
        ..default()
    };
    let points = clouds.add(GiPointCloudAsset::new(cloud, &mut meshes, &mut materials));
    let mut root = commands.spawn((
        Transform::default(),
        Visibility::default(),
        GiBakeTask::spawn(room, recipe),
    ));
    common::spawn_quads(&quads, &mut root, &mut meshes, &mut materials);
    root.with_child(GiPointCloud(points));
    spawn_light(
        &mut commands,
        &mut meshes,
        &mut materials,
        light_at(clock.now),
    );
}

/// Returns the position of the light at a time: around the statue, up and down.
fn light_at(seconds: f32) -> Vec3 {
    let angle = 0.6 * seconds + 0.9;
    Vec3::new(
        0.72 * angle.cos(),
        1.35 + 0.3 * (0.43 * seconds).sin(),
        0.72 * angle.sin(),
    )
}

fn circle(
    mut light: Single<&mut Transform, With<MovableLight>>,
    keys: Res<ButtonInput<KeyCode>>,
    buttons: Res<ButtonInput<MouseButton>>,
    mut clock: ResMut<Clock>,
) {
    use KeyCode::{ArrowDown, ArrowLeft, ArrowRight, ArrowUp, PageDown, PageUp};
    let by_hand = [ArrowDown, ArrowLeft, ArrowRight, ArrowUp, PageDown, PageUp];
    if keys.any_pressed(by_hand) || buttons.pressed(MouseButton::Left) {
        clock.on = false;
    }
    let position = light_at(clock.now);
    // A light at rest must not be marked as changed.
    if clock.on && position != light.translation {
        light.translation = position;
    }
}
