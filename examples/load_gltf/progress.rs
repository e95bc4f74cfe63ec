//! Progress bar and text of the bake.

use super::save::Saving;
use bevy::prelude::*;
use bevy_meshless_gi::prelude::*;
use meshless_gi::BakeStage;

/// Message about the last file: an error, or the path of a saved bake. Empty if there is none.
#[derive(Resource, Default)]
pub struct Notice(pub String);

/// Completed part of the bar.
#[derive(Component)]
pub struct Bar;

/// Lines of text.
#[derive(Component)]
pub struct Lines;

pub fn set_up(mut commands: Commands) {
    let across = Node {
        position_type: PositionType::Absolute,
        top: px(0),
        left: px(0),
        width: percent(100),
        height: px(8),
        ..default()
    };
    let done = Node {
        width: percent(0),
        height: percent(100),
        ..default()
    };
    commands.spawn((
        across,
        BackgroundColor(Color::srgba(0.0, 0.0, 0.0, 0.6)),
        children![(Bar, done, BackgroundColor(Color::srgb(0.95, 0.65, 0.2)))],
    ));
    commands.spawn((
        Lines,
        Text::default(),
        TextFont::from_font_size(14.0),
        Node {
            position_type: PositionType::Absolute,
            top: px(16),
            left: px(8),
            // The panel has the other settings.
            max_width: percent(62),
            padding: UiRect::all(px(4)),
            ..default()
        },
        BackgroundColor(Color::srgba(0.0, 0.0, 0.0, 0.6)),
    ));
}

/// Returns the completed fraction of the bake, 0 to 1, from a stage and its fraction. Stages that a
/// recipe leaves out are skipped.
pub fn overall(stage: BakeStage, done: f32) -> f32 {
    let [from, to] = match stage {
        BakeStage::Waiting => [0.0, 0.0],
        BakeStage::Geometry => [0.0, 0.02],
        BakeStage::Points => [0.02, 0.2],
        BakeStage::Transport => [0.2, 0.7],
        BakeStage::Probes => [0.7, 0.75],
        BakeStage::Bounces => [0.75, 0.8],
        BakeStage::Visibility => [0.8, 0.85],
        _ => [0.85, 1.0],
    };
    from + (to - from) * done.clamp(0.0, 1.0)
}

/// Shows the error of a bake.
pub fn keep_error(event: On<GiBakeFinished>, mut notice: ResMut<Notice>) {
    if let Err(error) = &event.result {
        notice.0 = format!("the bake failed: {error}");
    }
}

/// Updates bar and text.
pub fn show(
    mut lines: Single<&mut Text, With<Lines>>,
    mut bar: Single<(&mut Node, &ChildOf), With<Bar>>,
    mut visibility: Query<&mut Visibility>,
    bakes: Query<Ref<GiBakeTask>>,
    camera: Single<&GiCamera>,
    (saving, notice): (Option<Res<Saving>>, Res<Notice>),
    mut max: Local<f32>,
) {
    let baking = bakes.iter().next().map(|bake| {
        let (stage, done) = bake.progress();
        // A bake repeats stages. The bar must not go back.
        let before = if bake.is_added() { 0.0 } else { *max };
        *max = before.max(overall(stage, done));
        (stage, *max)
    });
    if let Some((_, done)) = baking {
        bar.0.width = percent(100.0 * done);
    }
    if let Ok(mut of_bar) = visibility.get_mut(bar.1.parent()) {
        of_bar.set_if_neq(match baking {
            Some(_) => Visibility::Inherited,
            None => Visibility::Hidden,
        });
    }
    let state = match baking {
        Some((stage, done)) => {
            format!("baking {:.0} %: {}", 100.0 * done, stage.name())
        }
        None => {
            let on = if camera.enabled { "on" } else { "off" };
            format!("indirect light {on}")
        }
    };
    let saving = saving.map_or("", |_| "\nsaving the bake");
    let notice = match notice.0.is_empty() {
        true => String::new(),
        false => format!("\n{}", notice.0),
    };
    let text = format!(
        "{state}{saving}{notice}\nWASD QE: walk    right mouse: look    F L: light    Up Down: sun    Space: indirect light\n\
         Ctrl+S: save    G: points    P: plan    F1: panel    drop a file: another scene"
    );
    if lines.0 != text {
        lines.0 = text;
    }
}
