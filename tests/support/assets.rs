//! Apps that load assets, with and without a renderer.

use super::app::ready;
use bevy::prelude::*;
use bevy_meshless_gi::MeshlessGiPlugin;
use std::path::Path;
use std::time::Duration;

/// Most updates that a test waits for anything.
const MAX_UPDATES: usize = 100_000;

/// App without renderer and window, with unprocessed assets.
pub fn bare_app(assets: &Path) -> App {
    bare_app_with(AssetPlugin {
        file_path: assets.to_string_lossy().into_owned(),
        ..default()
    })
}

/// App without renderer and window.
pub fn bare_app_with(assets: AssetPlugin) -> App {
    let mut app = App::new();
    app.add_plugins((
        MinimalPlugins,
        assets,
        TransformPlugin,
        MeshlessGiPlugin::default(),
    ));
    ready(&mut app);
    app
}

/// Assets that were processed before, without the folder of their sources.
pub fn shipped(processed: &Path) -> AssetPlugin {
    AssetPlugin {
        mode: AssetMode::Processed,
        use_asset_processor_override: Some(false),
        file_path: processed.join("no sources").to_string_lossy().into_owned(),
        processed_file_path: processed.to_string_lossy().into_owned(),
        ..default()
    }
}

/// Updates until `done` gives something.
pub fn until<T>(app: &mut App, what: &str, mut done: impl FnMut(&mut App) -> Option<T>) -> T {
    for _ in 0..MAX_UPDATES {
        app.update();
        if let Some(value) = done(app) {
            return value;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    panic!("{what} does not happen");
}
