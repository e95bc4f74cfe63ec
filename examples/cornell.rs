//! A Cornell box whose lamp moves, with the indirect light following in the same frame. A blue ball rolls through it, which no bake knows: it colours the floor and the blocks beside it.
//!
//! ```text
//! cargo run --release --features engine --example cornell
//! ```
//!
//! The box is made in code and baked while the window is already open.
//!
//! | key | does |
//! |---|---|
//! | arrows, Page Up, Page Down | move the lamp |
//! | left mouse button, held | the lamp follows the mouse |
//! | Space | indirect light on and off |
//! | Tab | one view, or direct light alone beside both |
//! | M | the ball stops and rolls on |
//! | B | the light that the ball reflects, on and off |
//! | D | indirect light at a fraction of the pixels, or at every pixel |
//! | V | the picture, indirect light alone, or irradiance |
//! | G | the points of the bake, then the radii of a level, then the non-zero coefficients, then none |
//!
//! With `-- --soft` the lamp is a panel that shines down, and casts soft shadows without a shadow map; the ball, which no bake knows, casts none and reflects none of its light.
//!
//! `-- --screenshot FILE.png [--frames N] [--press Tab,G]` writes a picture of the window and ends (with M first, the ball stays where it starts).

mod common;

use bevy::camera::Viewport;
use bevy::gizmos::config::GizmoConfigStore;
use bevy::prelude::*;
use bevy_meshless_gi::bake::{Preset, Recipe, SoftShadows};
use bevy_meshless_gi::plugin::{
    MeshlessGiBake, MeshlessGiBakeFailed, MeshlessGiStatus, MeshlessGiView,
};
use bevy_meshless_gi::prelude::*;
use bevy_meshless_gi::scene::{cornell_box, mesh_of_quads};
use common::capture::Capture;
use std::process::ExitCode;

fn main() -> ExitCode {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let before = arguments.len();
    arguments.retain(|a| a != "--soft");
    let soft = arguments.len() < before;
    let capture = match Capture::take_from(&mut arguments) {
        Ok(capture) if arguments.is_empty() => capture,
        Ok(_) => return usage(&format!("what is {}?", arguments.join(" "))),
        Err(why) => return usage(&why),
    };
    let mut app = App::new();
    app.add_plugins((DefaultPlugins, MeshlessGiPlugin::default()))
        .insert_resource(GlobalAmbientLight::NONE)
        .init_resource::<SideBySide>()
        .insert_resource(Soft(soft))
        .add_systems(Startup, setup)
        .init_resource::<Rolling>()
        .add_systems(
            Update,
            (move_lamp, roll, switch, switch_bounce, lay_out, tell).chain(),
        );
    if let Some(capture) = capture {
        app.add_plugins(capture);
    }
    match app.run() {
        AppExit::Success => ExitCode::SUCCESS,
        AppExit::Error(code) => ExitCode::from(code.get()),
    }
}

fn usage(why: &str) -> ExitCode {
    eprintln!(
        "{why}\nusage: cornell [--soft] [--screenshot FILE.png [--frames N] [--while-baking] [--press KEY,KEY]]"
    );
    ExitCode::from(2)
}

#[derive(Component)]
struct Lamp;

/// What moves: the bake does not hold its light.
#[derive(Component)]
struct Ball;

/// Seconds of the ball's path, and whether they go on.
#[derive(Resource)]
struct Rolling {
    seconds: f32,
    on: bool,
}

impl Default for Rolling {
    fn default() -> Self {
        Self {
            seconds: 0.0,
            on: true,
        }
    }
}

/// The camera of the left half: direct light alone. It sleeps while there is one view.
#[derive(Component)]
struct DirectOnly;

#[derive(Component)]
struct Help;

/// The lamp is a panel with soft shadows, and no bulb with a shadow map.
#[derive(Resource)]
struct Soft(bool);

#[derive(Resource, Default)]
struct SideBySide(bool);

fn setup(
    mut commands: Commands,
    soft: Res<Soft>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let quads = cornell_box();
    let recipe = Recipe {
        preset: Preset::Draft,
        soft_shadows: soft.0.then(SoftShadows::default),
        ..default()
    };
    let mut root = commands.spawn((
        Transform::default(),
        Visibility::default(),
        MeshlessGiBake::spawn(mesh_of_quads(&quads), recipe),
    ));
    common::spawn_quads(&quads, &mut root, &mut meshes, &mut materials);

    let bulb = materials.add(StandardMaterial {
        base_color: Color::BLACK,
        emissive: LinearRgba::rgb(4.0, 3.8, 3.4),
        ..default()
    });
    if soft.0 {
        commands.spawn((
            Lamp,
            RectLight {
                color: Color::linear_rgb(1.0, 0.95, 0.85),
                intensity: 20_000.0,
                width: PANEL.x,
                height: PANEL.y,
                ..default()
            },
            MeshlessGiSoftShadow::default(),
            Transform::from_xyz(0.0, 1.9, 0.0).looking_to(Vec3::NEG_Y, Vec3::NEG_Z),
            // It shines along -Z.
            Mesh3d(meshes.add(Cuboid::new(PANEL.x, PANEL.y, 0.005))),
            MeshMaterial3d(bulb),
        ));
    } else {
        commands.spawn((
            Lamp,
            PointLight {
                color: Color::linear_rgb(1.0, 0.95, 0.85),
                intensity: 60_000.0,
                shadow_maps_enabled: true,
                // The lamp may come close to a wall; what is nearer than this would cast no shadow.
                shadow_map_near_z: 0.01,
                ..default()
            },
            // What moves bounces its light.
            MeshlessGiReflective::default(),
            Transform::from_xyz(0.0, 1.6, 0.0),
            Mesh3d(meshes.add(Sphere::new(0.03))),
            MeshMaterial3d(bulb),
            bevy::light::NotShadowCaster,
        ));
    }
    let blue = materials.add(StandardMaterial {
        base_color: Color::linear_rgb(0.05, 0.3, 0.95),
        perceptual_roughness: 1.0,
        ..default()
    });
    commands.spawn((
        Ball,
        MeshlessGiBouncer,
        Mesh3d(meshes.add(Sphere::new(BALL))),
        MeshMaterial3d(blue),
        Transform::from_translation(ball_at(0.0)),
    ));
    let look = Transform::from_xyz(0.0, 1.0, 4.2).looking_at(Vec3::new(0.0, 1.0, 0.0), Vec3::Y);
    commands.spawn((
        Camera3d::default(),
        IsDefaultUiCamera,
        MeshlessGiCamera::default(),
        look,
    ));
    let off = MeshlessGiCamera {
        enabled: false,
        ..default()
    };
    let asleep = Camera {
        order: 1,
        is_active: false,
        ..default()
    };
    commands.spawn((DirectOnly, Camera3d::default(), asleep, off, look));
    commands.spawn((
        Help,
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

/// Edges of the panel, metres.
const PANEL: Vec2 = Vec2::new(0.6, 0.4);

/// Where the lamp may be: inside the box.
const REACH: (Vec3, Vec3) = (Vec3::new(-0.9, 0.1, -0.9), Vec3::new(0.9, 1.9, 1.5));

type TheCamera<'w, 's> = Query<
    'w,
    's,
    (&'static Camera, &'static GlobalTransform),
    (With<MeshlessGiCamera>, Without<DirectOnly>),
>;

fn move_lamp(
    mut lamp: Single<&mut Transform, With<Lamp>>,
    keys: Res<ButtonInput<KeyCode>>,
    buttons: Res<ButtonInput<MouseButton>>,
    windows: Query<&Window>,
    camera: TheCamera,
    time: Res<Time>,
) {
    let axis = |plus, minus| {
        f32::from(u8::from(keys.pressed(plus))) - f32::from(u8::from(keys.pressed(minus)))
    };
    let step = Vec3::new(
        axis(KeyCode::ArrowRight, KeyCode::ArrowLeft),
        axis(KeyCode::PageUp, KeyCode::PageDown),
        axis(KeyCode::ArrowDown, KeyCode::ArrowUp),
    );
    let mut place = lamp.translation + step * time.delta_secs();
    if buttons.pressed(MouseButton::Left)
        && let Some(cursor) = windows.iter().find_map(Window::cursor_position)
        && let Ok((camera, at)) = camera.single()
        && let Ok(ray) = camera.viewport_to_world(at, cursor)
        && let Some(distance) = ray.intersect_plane(place, InfinitePlane3d::new(Vec3::Z))
    {
        place = ray.get_point(distance);
    }
    let place = place.clamp(REACH.0, REACH.1);
    // A lamp at rest must not look changed.
    if place != lamp.translation {
        lamp.translation = place;
    }
}

/// Radius of the ball, metres.
const BALL: f32 = 0.18;

/// Ends of the ball's way on the floor: along the front of the small block, which it passes 4 cm away from.
const WAY: (Vec3, Vec3) = (Vec3::new(-0.7, BALL, 0.57), Vec3::new(0.6, BALL, 0.98));

/// Where the ball is: to and fro, from the middle of its way.
fn ball_at(seconds: f32) -> Vec3 {
    WAY.0.lerp(WAY.1, 0.5 + 0.5 * (0.7 * seconds).sin())
}

fn roll(
    mut ball: Single<&mut Transform, With<Ball>>,
    baking: Query<(), With<MeshlessGiBake>>,
    keys: Res<ButtonInput<KeyCode>>,
    mut rolling: ResMut<Rolling>,
    time: Res<Time>,
) {
    if keys.just_pressed(KeyCode::KeyM) {
        rolling.on = !rolling.on;
    }
    // It waits for its light.
    if rolling.on && baking.is_empty() {
        rolling.seconds += time.delta_secs();
        ball.translation = ball_at(rolling.seconds);
    }
}

fn switch_bounce(
    mut commands: Commands,
    keys: Res<ButtonInput<KeyCode>>,
    ball: Single<(Entity, Has<MeshlessGiBouncer>), With<Ball>>,
    mut displays: Query<&mut MeshlessGiDisplay>,
) {
    let (ball, bounces) = *ball;
    if keys.just_pressed(KeyCode::KeyB) {
        match bounces {
            true => commands.entity(ball).remove::<MeshlessGiBouncer>(),
            false => commands.entity(ball).insert(MeshlessGiBouncer),
        };
    }
    if keys.just_pressed(KeyCode::KeyD) {
        for mut display in &mut displays {
            *display = match *display {
                MeshlessGiDisplay::Full => MeshlessGiDisplay::default(),
                MeshlessGiDisplay::Subsplats(_) => MeshlessGiDisplay::Full,
            };
        }
    }
}

fn switch(
    keys: Res<ButtonInput<KeyCode>>,
    mut cameras: Query<&mut MeshlessGiCamera, Without<DirectOnly>>,
    mut side_by_side: ResMut<SideBySide>,
    mut gizmos: ResMut<GizmoConfigStore>,
) {
    for mut camera in &mut cameras {
        if keys.just_pressed(KeyCode::Space) {
            camera.enabled = !camera.enabled;
        }
        if keys.just_pressed(KeyCode::KeyV) {
            camera.view = match camera.view {
                MeshlessGiView::Lit => MeshlessGiView::Indirect,
                MeshlessGiView::Indirect => MeshlessGiView::Irradiance,
                MeshlessGiView::Irradiance => MeshlessGiView::Lit,
            };
        }
    }
    if keys.just_pressed(KeyCode::Tab) {
        side_by_side.0 = !side_by_side.0;
    }
    if keys.just_pressed(KeyCode::KeyG) {
        common::next_gizmos(&mut gizmos);
    }
}

/// One view over the window, or two halves.
fn lay_out(
    side_by_side: Res<SideBySide>,
    windows: Query<&Window>,
    mut both: Single<&mut Camera, (With<MeshlessGiCamera>, Without<DirectOnly>)>,
    mut direct: Single<&mut Camera, With<DirectOnly>>,
) {
    let Some(size) = windows.iter().next().map(Window::physical_size) else {
        return;
    };
    let half = UVec2::new((size.x / 2).max(1), size.y.max(1));
    let view = |x| Viewport {
        physical_position: UVec2::new(x, 0),
        physical_size: half,
        ..default()
    };
    direct.is_active = side_by_side.0;
    direct.viewport = side_by_side.0.then(|| view(0));
    both.viewport = side_by_side.0.then(|| view(half.x));
}

fn tell(
    mut help: Single<&mut Text, With<Help>>,
    under_way: Query<&MeshlessGiBake>,
    failed: Query<&MeshlessGiBakeFailed>,
    cameras: Query<&MeshlessGiCamera, Without<DirectOnly>>,
    status: Res<MeshlessGiStatus>,
    side_by_side: Res<SideBySide>,
) {
    let state = if let Some(bake) = under_way.iter().next() {
        let (stage, done) = bake.progress();
        format!("baking: {} {:.0} %", stage.name(), 100.0 * done)
    } else if let Some(why) = failed.iter().next() {
        format!("the bake failed: {}", why.0)
    } else {
        let counters = status.get();
        let on = cameras.iter().any(|c| c.enabled);
        let views = counters.subsplats.values();
        let (by, of) = views.fold((0, 0), |(by, of), c| (by + c.total(), of + c.pixels));
        let share = match of {
            _ if !on => String::new(),
            0 => ", at every pixel".to_string(),
            _ => format!(", at {by} of {of} pixels"),
        };
        format!(
            "indirect light {}{share}; {} light(s) projected in this frame",
            if on { "on" } else { "off" },
            counters.projected_slots
        )
    };
    let halves = if side_by_side.0 {
        "\nleft: direct light alone; right: with indirect light"
    } else {
        ""
    };
    let text = format!(
        "{state}{halves}\narrows, Page Up/Down, mouse: lamp    Space: indirect light    M: ball    B: its bounce\nTab: side by side    V: view    D: display    G: points"
    );
    if help.0 != text {
        help.0 = text;
    }
}
