//! View of a room: a light that keys and mouse move, one view or two halves (direct light alone on
//! the left), help lines, and the plan.

use super::panel::TuningPanel;
use bevy::camera::Viewport;
use bevy::gizmos::config::GizmoConfigStore;
use bevy::prelude::*;
use bevy_meshless_gi::prelude::*;

/// Cameras, help and keys. Arrows, Page Up, Page Down and the mouse move the [`MovableLight`].
/// Space, Tab, V, G, P and H switch the display.
#[derive(Resource, Clone)]
pub struct Stage {
    /// Transform of the camera.
    pub look: Transform,
    /// Box that limits the light's position, in meters. `None` if there is no [`MovableLight`].
    pub reach: Option<(Vec3, Vec3)>,
    /// Help text of the example's own keys.
    pub keys: &'static str,
}

/// Light that keys and mouse move.
#[derive(Component)]
pub struct MovableLight;

/// Systems of a [`Stage`].
#[derive(SystemSet, Clone, Debug, PartialEq, Eq, Hash)]
pub struct StageSystems;

/// Camera of the left half, which shows direct light alone. Inactive while there is one view.
#[derive(Component)]
struct DirectOnly;

#[derive(Component)]
struct Help;

#[derive(Resource, Default)]
struct SideBySide(bool);

/// Error of the last bake.
#[derive(Resource, Default)]
struct BakeError(Option<String>);

impl Plugin for Stage {
    fn build(&self, app: &mut App) {
        app.insert_resource(self.clone())
            .init_resource::<SideBySide>()
            .init_resource::<BakeError>()
            .add_observer(keep_error)
            .add_plugins((super::table::PlanTable, super::panel::TuningPanelPlugin))
            .add_systems(Startup, set_up)
            .add_systems(
                Update,
                (move_light, switch, lay_out, update_status)
                    .chain()
                    .in_set(StageSystems),
            );
    }
}

/// Spawns a point light with shadow maps.
pub fn spawn_light<'a>(
    commands: &'a mut Commands,
    meshes: &mut Assets<Mesh>,
    materials: &mut Assets<StandardMaterial>,
    position: Vec3,
) -> EntityCommands<'a> {
    let bulb = materials.add(StandardMaterial {
        base_color: Color::BLACK,
        emissive: LinearRgba::rgb(4.0, 3.8, 3.4),
        ..default()
    });
    commands.spawn((
        MovableLight,
        PointLight {
            color: Color::linear_rgb(1.0, 0.95, 0.85),
            intensity: 60_000.0,
            shadow_maps_enabled: true,
            // The light can be close to a wall. Geometry nearer than this casts no shadow.
            shadow_map_near_z: 0.01,
            ..default()
        },
        Transform::from_translation(position),
        Mesh3d(meshes.add(Sphere::new(0.03))),
        MeshMaterial3d(bulb),
        bevy::light::NotShadowCaster,
    ))
}

fn set_up(mut commands: Commands, stage: Res<Stage>) {
    commands.spawn((
        Camera3d::default(),
        IsDefaultUiCamera,
        GiCamera::default(),
        stage.look,
    ));
    let off = GiCamera {
        enabled: false,
        ..default()
    };
    let inactive_camera = Camera {
        order: 1,
        is_active: false,
        ..default()
    };
    commands.spawn((
        DirectOnly,
        Camera3d::default(),
        inactive_camera,
        off,
        stage.look,
    ));
    commands.spawn((
        Help,
        Visibility::Visible,
        Text::default(),
        TextFont::from_font_size(14.0),
        Node {
            position_type: PositionType::Absolute,
            top: px(8),
            left: px(8),
            // The panel has the other settings.
            max_width: percent(62),
            padding: UiRect::all(px(4)),
            ..default()
        },
        BackgroundColor(Color::srgba(0.0, 0.0, 0.0, 0.6)),
    ));
}

type TheCamera<'w, 's> = Query<
    'w,
    's,
    (&'static Camera, &'static GlobalTransform),
    (With<GiCamera>, Without<DirectOnly>),
>;

fn move_light(
    mut light: Single<&mut Transform, With<MovableLight>>,
    stage: Res<Stage>,
    (keys, buttons): (Res<ButtonInput<KeyCode>>, Res<ButtonInput<MouseButton>>),
    windows: Query<&Window>,
    panel: Query<&Interaction, With<TuningPanel>>,
    camera: TheCamera,
    time: Res<Time>,
) {
    let Some((low, high)) = stage.reach else {
        return;
    };
    let axis = |plus, minus| {
        f32::from(u8::from(keys.pressed(plus))) - f32::from(u8::from(keys.pressed(minus)))
    };
    let step = Vec3::new(
        axis(KeyCode::ArrowRight, KeyCode::ArrowLeft),
        axis(KeyCode::PageUp, KeyCode::PageDown),
        axis(KeyCode::ArrowDown, KeyCode::ArrowUp),
    );
    let mut position = light.translation + step * time.delta_secs();
    let on_panel = panel.iter().any(|over| *over != Interaction::None);
    if buttons.pressed(MouseButton::Left)
        && !on_panel
        && let Some(cursor) = windows.iter().find_map(Window::cursor_position)
        && let Ok((camera, at)) = camera.single()
        && let Ok(ray) = camera.viewport_to_world(at, cursor)
        && let Some(distance) = ray.intersect_plane(position, InfinitePlane3d::new(Vec3::Z))
    {
        position = ray.get_point(distance);
    }
    let position = position.clamp(low, high);
    // A light at rest must not be marked as changed.
    if position != light.translation {
        light.translation = position;
    }
}

fn switch(
    keys: Res<ButtonInput<KeyCode>>,
    mut cameras: Query<&mut GiCamera, Without<DirectOnly>>,
    mut side_by_side: ResMut<SideBySide>,
    mut gizmos: ResMut<GizmoConfigStore>,
    mut help: Single<&mut Visibility, With<Help>>,
) {
    for mut camera in &mut cameras {
        if keys.just_pressed(KeyCode::Space) {
            camera.enabled = !camera.enabled;
        }
        if keys.just_pressed(KeyCode::KeyV) {
            camera.debug_view = match camera.debug_view {
                GiDebugView::Final => GiDebugView::IndirectOnly,
                GiDebugView::IndirectOnly => GiDebugView::Irradiance,
                _ => GiDebugView::Final,
            };
        }
    }
    if keys.just_pressed(KeyCode::Tab) {
        side_by_side.0 = !side_by_side.0;
    }
    if keys.just_pressed(KeyCode::KeyH) {
        help.toggle_visible_hidden();
    }
    if keys.just_pressed(KeyCode::KeyG) {
        super::next_gizmos(&mut gizmos);
    }
}

/// Sets one view over the window, or two halves.
fn lay_out(
    side_by_side: Res<SideBySide>,
    mut both: Single<&mut Camera, (With<GiCamera>, Without<DirectOnly>)>,
    mut direct: Single<&mut Camera, With<DirectOnly>>,
) {
    let Some(size) = both.physical_target_size() else {
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

fn keep_error(event: On<GiBakeFinished>, mut kept: ResMut<BakeError>) {
    kept.0 = event.result.as_ref().err().map(ToString::to_string);
}

fn update_status(
    mut help: Single<&mut Text, With<Help>>,
    stage: Res<Stage>,
    baking: Query<&GiBakeProgress>,
    failed: Res<BakeError>,
    cameras: Query<&GiCamera, Without<DirectOnly>>,
    status: Res<GiFrameStats>,
    side_by_side: Res<SideBySide>,
) {
    let state = if let Some(bake) = baking.iter().next() {
        format!(
            "baking: {} {:.0} %",
            bake.stage.name(),
            100.0 * bake.fraction
        )
    } else if let Some(error) = &failed.0 {
        format!("the bake failed: {error}")
    } else {
        let counters = status.get();
        let on = cameras.iter().any(|c| c.enabled);
        let (by, of) = (counters.subsplats, counters.subsplat_pixels);
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
    let light = match stage.reach {
        Some(_) => "arrows, Page Up/Down, mouse: light    ",
        None => "",
    };
    let text = format!(
        "{state}{halves}\n{light}Space: indirect light    {}\nTab: side by side    V: view    G: points    P: plan    F1: panel    H: help",
        stage.keys
    );
    if help.0 != text {
        help.0 = text;
    }
}
