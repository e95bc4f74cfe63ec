//! Logs one line per baked scene: when its light starts, and again when its bake changes.

use super::GiFrameStats;
use super::asset::GiBakedScene;
use super::scene::GiScene;
use bevy::asset::Assets;
use bevy::ecs::name::Name;
use bevy::ecs::prelude::*;
use bevy::log::info;
use bevy::platform::collections::HashMap;
use meshless_gi::internals::bake::BakeSettings;
use meshless_gi::{BakedScene, Preset, Recipe};
use std::sync::{Arc, Weak};

/// Returns an entity as the log prints it: its name and its number, or its number alone.
pub(crate) fn entity_label(entity: Entity, name: Option<&Name>) -> String {
    match name {
        Some(name) => format!("{:?} ({entity})", name.as_str()),
        None => entity.to_string(),
    }
}

/// The bake that was last logged for a scene, and its line.
type Logged = (Weak<BakedScene>, String);

/// Runs in [`GiSystems::CollectBakes`](super::GiSystems::CollectBakes).
pub(crate) fn log_scenes(
    status: Res<GiFrameStats>,
    scenes: Query<(Entity, &GiScene, Option<&Name>)>,
    assets: Res<Assets<GiBakedScene>>,
    mut logged: Local<HashMap<Entity, Logged>>,
) {
    logged.retain(|entity, _| scenes.contains(*entity));
    for (entity, gi, name) in &scenes {
        let Some(asset) = assets.get(&gi.0) else {
            continue;
        };
        let (bake, last) = logged.entry(entity).or_default();
        if bake.as_ptr() == Arc::as_ptr(&asset.scene) {
            continue;
        }
        // The device may still hold the bake before.
        let Some(bytes) = status.bytes_of(entity.to_bits(), &asset.scene) else {
            continue;
        };
        *bake = Arc::downgrade(&asset.scene);
        let line = format!(
            "indirect light on {}: {}",
            entity_label(entity, name),
            summary(&asset.scene, bytes)
        );
        // A file that was loaded again unchanged adds no line.
        if *last != line {
            info!("{line}");
            *last = line;
        }
    }
}

/// Returns the size of a bake, its preset and its estimated error. `bytes`: its memory on the
/// device.
fn summary(bake: &BakedScene, bytes: u64) -> String {
    let links = bake.data().operator.links.len() as f64;
    let links = match links {
        n if n < 1e5 => format!("{} links", thousands(n as u64)),
        n => format!("{:.1} M links", 1e-6 * n),
    };
    let mut parts = vec![
        format!("{} points", thousands(bake.data().points.len() as u64)),
        links,
        format!("{:.1} MB", 1e-6 * bytes as f64),
    ];
    parts.extend(preset_of(bake).map(|preset| format!("{preset:?}")));
    // A bake whose error was not estimated stores zero.
    if bake.info().estimated_nrmse > 0.0 {
        let percent = 100.0 * bake.info().estimated_nrmse;
        parts.push(format!("estimated error {percent:.1} %"));
    }
    parts.join(", ")
}

/// Returns the preset whose tolerances the bake has. `None` if it has others.
fn preset_of(bake: &BakedScene) -> Option<Preset> {
    let found = BakeSettings::from_ron(&bake.info().recipe).ok()?;
    [Preset::Draft, Preset::Medium, Preset::High]
        .into_iter()
        .find(|preset| {
            let recipe = Recipe {
                preset: *preset,
                transport: found.transport,
                ..Recipe::default()
            };
            recipe.settings(1.0).is_ok_and(|usual| {
                (usual.truncation_error, usual.receiver_tolerance)
                    == (found.truncation_error, found.receiver_tolerance)
            })
        })
}

/// Returns a number with a comma between groups of three digits.
fn thousands(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thousands_of_any_length_has_commas_between_groups() {
        let found = [0, 7, 999, 1000, 4210, 65_536, 1_234_567].map(thousands);
        assert_eq!(
            found,
            ["0", "7", "999", "1,000", "4,210", "65,536", "1,234,567"]
        );
    }

    #[test]
    fn entity_label_with_and_without_name_has_the_number() {
        let entity = Entity::from_raw_u32(12).expect("a valid index");
        assert_eq!(entity_label(entity, None), "12v0");
        let name = Name::new("Room");
        assert_eq!(entity_label(entity, Some(&name)), "\"Room\" (12v0)");
    }
}
