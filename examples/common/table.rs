//! Overlay of the frame's plan: effects that run, effects that do not, the reasons, and the
//! device's measured milliseconds.

use bevy::diagnostic::DiagnosticsStore;
use bevy::prelude::*;
use bevy::render::diagnostic::RenderDiagnosticsPlugin;
use bevy_meshless_gi::{GiFrameStats, GiSystems};
use std::fmt::Write;

/// Overlay plugin. P shows and hides the plan.
pub struct PlanTable;

/// Frames between two updates of the text.
const UPDATE_INTERVAL: u32 = 15;

#[derive(Component)]
struct Table;

impl Plugin for PlanTable {
    fn build(&self, app: &mut App) {
        // Measures GPU times.
        app.add_plugins(RenderDiagnosticsPlugin)
            .add_systems(Startup, set_up)
            .add_systems(Update, update_text.after(GiSystems::CollectBakes));
    }
}

fn set_up(mut commands: Commands) {
    commands.spawn((
        Table,
        Visibility::Hidden,
        Text::default(),
        TextFont::from_font_size(12.0),
        Node {
            position_type: PositionType::Absolute,
            bottom: px(8),
            left: px(8),
            padding: UiRect::all(px(4)),
            ..default()
        },
        BackgroundColor(Color::srgba(0.0, 0.0, 0.0, 0.75)),
    ));
}

fn update_text(
    mut table: Single<(&mut Text, &mut Visibility), With<Table>>,
    keys: Res<ButtonInput<KeyCode>>,
    status: Res<GiFrameStats>,
    diagnostics: Res<DiagnosticsStore>,
    names: Query<Option<&Name>>,
    mut frame: Local<u32>,
) {
    let (text, visibility) = &mut *table;
    if keys.just_pressed(KeyCode::KeyP) {
        visibility.toggle_visible_hidden();
        *frame = 0;
    }
    if **visibility == Visibility::Hidden {
        return;
    }
    if frame.is_multiple_of(UPDATE_INTERVAL) {
        text.0 = overlay_text(&status, &diagnostics, &names);
    }
    *frame += 1;
}

/// Replaces the numbers of scenes, views and lights in the plan by names.
fn named(plan: &str, names: &Query<Option<&Name>>) -> String {
    let mut out = String::with_capacity(plan.len());
    let mut number_follows = false;
    for part in plan.split_inclusive(|c: char| !c.is_ascii_alphanumeric()) {
        let word = part.trim_end_matches(|c: char| !c.is_ascii_alphanumeric());
        let bits = u64::from_str_radix(word, 16)
            .ok()
            .filter(|_| number_follows);
        let entity = bits.and_then(Entity::try_from_bits);
        match entity.and_then(|entity| Some((entity, names.get(entity).ok()?))) {
            Some((_, Some(name))) => out += &format!("\"{name}\""),
            Some((entity, None)) => out += &entity.to_string(),
            None => out += word,
        }
        out += &part[word.len()..];
        number_follows = matches!(part, "scene " | "view " | "light ");
    }
    out
}

/// Returns the plan and its measured times.
pub fn overlay_text(
    status: &GiFrameStats,
    diagnostics: &DiagnosticsStore,
    names: &Query<Option<&Name>>,
) -> String {
    let seen = status.get();
    // The font has no × sign.
    let mut out = named(&status.plan_text(), names).replace('×', "x");
    let dispatches = seen.dispatches.iter();
    let dispatches: Vec<String> = dispatches
        .map(|(stage, n)| format!("{stage} {n}"))
        .collect();
    let _ = writeln!(
        out,
        "dispatches: {}\n{} pipelines, {} buffers, {:.1} MB",
        dispatches.join(", "),
        seen.pipelines,
        seen.buffers,
        seen.bytes as f64 / 1e6
    );
    let mut spans: Vec<String> = diagnostics
        .iter()
        .filter_map(|d| {
            let path = d.path().as_str();
            let span = path.strip_prefix("render/meshless_gi_")?;
            let span = span.strip_suffix("/elapsed_gpu")?;
            Some(format!("{span} {:.2}", d.average()?))
        })
        .collect();
    spans.sort();
    match spans.is_empty() {
        true => out.push_str("the device has no timestamp queries"),
        false => {
            let _ = write!(out, "device, ms: {}", spans.join(", "));
        }
    }
    out
}
