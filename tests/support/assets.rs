//! Apps without a renderer that load assets.

use super::app::finish_plugins;
use bevy::prelude::*;
use bevy_meshless_gi::MeshlessGiPlugin;
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::path::Path;
use std::time::Duration;

/// Maximum number of updates that a test waits for an event.
const MAX_UPDATES: usize = 100_000;

/// Creates an app without renderer and window, with unprocessed assets.
pub fn bare_app(assets: &Path) -> App {
    bare_app_with(AssetPlugin {
        file_path: assets.to_string_lossy().into_owned(),
        ..default()
    })
}

/// Creates an app without renderer and window.
pub fn bare_app_with(assets: AssetPlugin) -> App {
    let mut app = App::new();
    app.add_plugins((
        MinimalPlugins,
        assets,
        TransformPlugin,
        MeshlessGiPlugin::default(),
    ));
    finish_plugins(&mut app);
    app
}

/// Returns the asset plugin of a released app: processed assets without their source folder.
pub fn shipped_asset_plugin(processed: &Path) -> AssetPlugin {
    AssetPlugin {
        mode: AssetMode::Processed,
        use_asset_processor_override: Some(false),
        file_path: processed.join("no sources").to_string_lossy().into_owned(),
        processed_file_path: processed.to_string_lossy().into_owned(),
        ..default()
    }
}

/// Updates until `done` returns a value.
pub fn until<T>(app: &mut App, event: &str, mut done: impl FnMut(&mut App) -> Option<T>) -> T {
    for _ in 0..MAX_UPDATES {
        app.update();
        if let Some(value) = done(app) {
            return value;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    panic!("{event}: no result after {MAX_UPDATES} updates");
}

/// Returns the identifiers of the threads of this process that bake at present. Returns `None` if
/// the system does not list threads.
pub fn bake_threads() -> Option<BTreeSet<OsString>> {
    let threads = std::fs::read_dir("/proc/self/task").ok()?.flatten();
    let bakes = threads.filter(|thread| {
        std::fs::read_to_string(thread.path().join("comm"))
            .is_ok_and(|name| name.starts_with("meshless gi bak"))
    });
    Some(bakes.map(|thread| thread.file_name()).collect())
}

/// Updates until all of `threads`, from [`bake_threads`], have ended. Ignores bakes that other
/// tests start in this process.
pub fn until_ended(app: &mut App, threads: &Option<BTreeSet<OsString>>) {
    let Some(threads) = threads else { return };
    until(app, "the end of the bakes", |_| {
        bake_threads()
            .is_none_or(|now| now.is_disjoint(threads))
            .then_some(())
    });
}
