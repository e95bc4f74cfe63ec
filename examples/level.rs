//! Any glTF level: bakes in the background while you already walk in it, then lights up.
//!
//! ```text
//! cargo run --release --features engine --example level -- path/to/level.glb [draft|medium|high]
//! ```
//!
//! | key | does |
//! |---|---|
//! | W A S D, Q E | walk, sink and rise (Shift: fast) |
//! | right mouse button, held | look round |
//! | F | put the lamp where you are |
//! | L | the lamp on and off |
//! | Up, Down | sunlight stronger and weaker |
//! | Space | indirect light on and off |
//! | G | the points of the bake, then the radii of a level, then the non-zero coefficients, then none |
//! | P | the plan of the frame: what runs, why, and how long it takes |
//!
//! `--screenshot FILE.png [--frames N] [--press L,Space]` writes a picture without a window when the bake is done (with `--while-baking`:
//! before), and ends.

mod common;

use bevy::gizmos::config::GizmoConfigStore;
use bevy::input::mouse::AccumulatedMouseMotion;
use bevy::light::CascadeShadowConfigBuilder;
use bevy::prelude::*;
use bevy_meshless_gi::asset::BakedScene;
use bevy_meshless_gi::bake::{Preset, Recipe};
use bevy_meshless_gi::prelude::*;
use bevy_meshless_gi::scene::{Bvh, Geometry, Ray, TriangleMesh, load_gltf};
use common::capture::{Capture, default_plugins};
use std::f32::consts::TAU;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

fn main() -> ExitCode {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let capture = match Capture::take_from(&mut arguments) {
        Ok(capture) => capture,
        Err(why) => {
            eprintln!("{why}");
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
        Err(why) => {
            eprintln!("{file}: {why}");
            return ExitCode::from(3);
        }
    };
    let level = match load_gltf(&path) {
        Ok(level) => level.mesh,
        Err(why) => {
            eprintln!("{why}");
            return ExitCode::from(1);
        }
    };
    let folder = path
        .parent()
        .unwrap_or(Path::new("/"))
        .to_string_lossy()
        .into_owned();
    let name = path.file_name().map(PathBuf::from).unwrap_or_default();
    let mut app = App::new();
    app.add_plugins((
        default_plugins(capture.as_ref()).set(AssetPlugin {
            file_path: folder,
            ..default()
        }),
        MeshlessGiPlugin::default(),
        common::table::PlanTable,
    ))
    .insert_resource(GlobalAmbientLight::NONE)
    .insert_resource(Level {
        name,
        mesh: Some(level),
        preset,
        start: Transform::default(),
    })
    .add_systems(Startup, setup)
    .add_systems(Update, (walk, switch, tell))
    .add_observer(baked);
    if let Some(capture) = capture {
        app.add_plugins(capture);
    }
    common::run(app)
}

fn usage() -> ExitCode {
    eprintln!(
        "usage: level LEVEL.glb|LEVEL.gltf [draft|medium|high] [--screenshot FILE.png [--frames N] [--while-baking] [--press KEY,KEY]]"
    );
    ExitCode::from(2)
}

#[derive(Resource)]
struct Level {
    name: PathBuf,
    mesh: Option<TriangleMesh>,
    preset: Preset,
    /// Where the camera starts.
    start: Transform,
}

#[derive(Component)]
struct Lamp;

#[derive(Component)]
struct Overlay;

fn setup(mut commands: Commands, mut level: ResMut<Level>, assets: Res<AssetServer>) {
    let Some(mesh) = level.mesh.take() else {
        return;
    };
    let bounds = mesh.bounds();
    let size = bounds.size().length();
    let recipe = Recipe {
        preset: level.preset,
        ..default()
    };
    commands.spawn((
        WorldAssetRoot(assets.load(GltfAssetLabel::Scene(0).from_asset(level.name.clone()))),
        MeshlessGiBake::spawn(mesh, recipe),
    ));
    let eye = bounds.center() + Vec3::new(0.25 * bounds.size().x, -0.1 * bounds.size().y, 0.0);
    level.start = Transform::from_translation(eye).looking_at(bounds.center(), Vec3::Y);
    commands.spawn((
        Camera3d::default(),
        IsDefaultUiCamera,
        Projection::from(PerspectiveProjection {
            near: 1e-3 * size,
            ..default()
        }),
        MeshlessGiCamera::default(),
        level.start,
    ));
    commands.spawn((
        Lamp,
        PointLight {
            // As bright at a tenth of the level as a 60 W bulb at two metres.
            intensity: 800.0 * (0.05 * size).powi(2).max(1.0) * 40.0,
            range: 2.0 * size,
            shadow_maps_enabled: true,
            shadow_map_near_z: 1e-3 * size,
            ..default()
        },
        Transform::from_translation(bounds.center()),
    ));
    commands.spawn((
        DirectionalLight {
            illuminance: 10_000.0,
            shadow_maps_enabled: true,
            ..default()
        },
        // The shadow map's texels are for the level, not for Bevy's 150 m: or sunlight shows at the foot of the walls.
        CascadeShadowConfigBuilder {
            minimum_distance: 1e-3 * size,
            first_cascade_far_bound: 0.15 * size,
            maximum_distance: size,
            ..default()
        }
        .build(),
        Transform::default().looking_to(Vec3::new(0.35, -1.0, 0.25), Vec3::Y),
    ));
    commands.spawn((
        Overlay,
        Text::default(),
        TextFont::from_font_size(14.0),
        Node {
            position_type: PositionType::Absolute,
            top: px(8),
            left: px(8),
            padding: UiRect::all(px(4)),
            ..default()
        },
        BackgroundColor(Color::srgba(0.0, 0.0, 0.0, 0.6)),
    ));
}

/// The bake is done: the viewpoints that it found are good places for who has not walked yet, and for the lamp.
fn baked(
    event: On<MeshlessGiBakeFinished>,
    scenes: Query<&MeshlessGi>,
    bakes: Res<Assets<MeshlessGiAsset>>,
    level: Res<Level>,
    mut camera: Single<&mut Transform, (With<Camera3d>, Without<Lamp>)>,
    mut lamp: Single<&mut Transform, (With<Lamp>, Without<Camera3d>)>,
) {
    let Some(bake) = scenes
        .get(event.entity)
        .ok()
        .and_then(|gi| bakes.get(&gi.0))
    else {
        return;
    };
    if **camera != level.start {
        return;
    }
    if let Some(outlook) = Outlook::best(&bake.scene) {
        **camera = Transform::from_translation(outlook.from).looking_to(outlook.toward, Vec3::Y);
        lamp.translation = outlook.from + 0.4 * outlook.free * outlook.toward;
    }
}

/// A place, and a horizontal direction in which the level is far away.
struct Outlook {
    from: Vec3,
    toward: Vec3,
    /// Metres to the level straight ahead, about.
    free: f32,
}

impl Outlook {
    /// The one with most room before it, of all viewpoints and sixteen directions.
    fn best(scene: &BakedScene) -> Option<Self> {
        let [min, max] = scene.info.bounds.map(Vec3::from_array);
        let far = (max - min).length();
        let mut best: Option<(f32, Self)> = None;
        for from in scene
            .info
            .viewpoints
            .iter()
            .take(64)
            .map(|p| Vec3::from_array(*p))
        {
            for i in 0..16 {
                let toward = Quat::from_rotation_y(i as f32 * TAU / 16.0) * Vec3::NEG_Z;
                let free = free_way(&scene.bvh, from, toward, far);
                // To both sides as well; out of the level is no view.
                let sides = [-0.4, 0.4].map(|turn| {
                    free_way(&scene.bvh, from, Quat::from_rotation_y(turn) * toward, far)
                });
                let room = free.min(2.0 * sides[0]).min(2.0 * sides[1]);
                if free < far && best.as_ref().is_none_or(|(most, _)| room > *most) {
                    best = Some((room, Self { from, toward, free }));
                }
            }
        }
        best.map(|(_, outlook)| outlook)
    }
}

/// How far it is from a place to what is seen from there, to a thousandth of `far`; `far` where nothing is.
fn free_way(bvh: &Bvh, from: Vec3, toward: Vec3, far: f32) -> f32 {
    let meets = |distance| bvh.occluded(&Ray::segment(from, toward, distance));
    if !meets(far) {
        return far;
    }
    let (mut open, mut closed) = (0.0, far);
    for _ in 0..10 {
        let middle = 0.5 * (open + closed);
        if meets(middle) {
            closed = middle;
        } else {
            open = middle;
        }
    }
    open
}

type TheLamp<'w, 's> = Single<
    'w,
    's,
    (&'static mut Transform, &'static mut Visibility),
    (With<Lamp>, Without<Camera3d>),
>;

fn walk(
    mut camera: Single<&mut Transform, (With<Camera3d>, Without<Lamp>)>,
    mut lamp: TheLamp,
    mut sun: Single<&mut DirectionalLight>,
    keys: Res<ButtonInput<KeyCode>>,
    buttons: Res<ButtonInput<MouseButton>>,
    mouse: Res<AccumulatedMouseMotion>,
    time: Res<Time>,
) {
    if buttons.pressed(MouseButton::Right) && mouse.delta != Vec2::ZERO {
        let (yaw, pitch, _) = camera.rotation.to_euler(EulerRot::YXZ);
        let pitch = (pitch - 0.003 * mouse.delta.y).clamp(-1.5, 1.5);
        camera.rotation = Quat::from_euler(EulerRot::YXZ, yaw - 0.003 * mouse.delta.x, pitch, 0.0);
    }
    let axis = |plus, minus| {
        f32::from(u8::from(keys.pressed(plus))) - f32::from(u8::from(keys.pressed(minus)))
    };
    let step = Vec3::new(
        axis(KeyCode::KeyD, KeyCode::KeyA),
        axis(KeyCode::KeyE, KeyCode::KeyQ),
        axis(KeyCode::KeyS, KeyCode::KeyW),
    );
    let speed = if keys.pressed(KeyCode::ShiftLeft) {
        8.0
    } else {
        2.0
    };
    let turned = camera.rotation * step;
    camera.translation += turned * speed * time.delta_secs();
    if keys.just_pressed(KeyCode::KeyF) {
        lamp.0.translation = camera.translation;
    }
    if keys.just_pressed(KeyCode::KeyL) {
        *lamp.1 = if *lamp.1 == Visibility::Hidden {
            Visibility::Visible
        } else {
            Visibility::Hidden
        };
    }
    let brighter = axis(KeyCode::ArrowUp, KeyCode::ArrowDown);
    if brighter != 0.0 {
        sun.illuminance =
            (sun.illuminance * (brighter * time.delta_secs()).exp()).clamp(1.0, 150_000.0);
    }
}

fn switch(
    keys: Res<ButtonInput<KeyCode>>,
    mut camera: Single<&mut MeshlessGiCamera>,
    mut gizmos: ResMut<GizmoConfigStore>,
) {
    if keys.just_pressed(KeyCode::Space) {
        camera.enabled = !camera.enabled;
    }
    if keys.just_pressed(KeyCode::KeyG) {
        common::next_gizmos(&mut gizmos);
    }
}

fn tell(
    mut overlay: Single<&mut Text, With<Overlay>>,
    under_way: Query<&MeshlessGiBake>,
    baked: Query<&MeshlessGi>,
    camera: Single<&MeshlessGiCamera>,
) {
    let state = if let Some(bake) = under_way.iter().next() {
        let (stage, done) = bake.progress();
        let full = (20.0 * done) as usize;
        format!(
            "[{}{}] {}",
            "#".repeat(full),
            "-".repeat(20 - full.min(20)),
            stage.name()
        )
    } else if baked.is_empty() {
        "the bake failed: see the log".into()
    } else {
        format!(
            "indirect light {}",
            if camera.enabled { "on" } else { "off" }
        )
    };
    let text = format!(
        "{state}\nWASD QE: walk    right mouse: look    F L: lamp    Up Down: sun    Space: indirect light    G: points    P: plan"
    );
    if overlay.0 != text {
        overlay.0 = text;
    }
}
