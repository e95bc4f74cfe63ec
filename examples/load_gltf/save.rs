//! Saves the bake next to its scene, on another thread.

use super::drop::CurrentScene;
use super::progress::Notice;
use bevy::prelude::*;
use bevy::tasks::{IoTaskPool, Task, block_on, poll_once};
use bevy_meshless_gi::prelude::*;
use std::path::PathBuf;

/// File that is being written. The task returns a message.
#[derive(Resource)]
pub struct Saving(Task<String>);

/// Starts to write `level.mgi` next to `level.glb` on Ctrl+S. The file is replaced atomically.
pub fn start(
    mut commands: Commands,
    keys: Res<ButtonInput<KeyCode>>,
    saving: Option<Res<Saving>>,
    current: Option<Res<CurrentScene>>,
    scenes: Query<&GiScene>,
    bakes: Res<Assets<GiBakedScene>>,
    mut notice: ResMut<Notice>,
) {
    let control = keys.any_pressed([KeyCode::ControlLeft, KeyCode::ControlRight]);
    if !(control && keys.just_pressed(KeyCode::KeyS)) || saving.is_some() {
        return;
    }
    let Some(current) = current else {
        return;
    };
    let baked = scenes.get(current.root).ok();
    let Some(bake) = baked.and_then(|gi| bakes.get(&gi.0)) else {
        notice.0 = "not saved: there is no bake yet".into();
        return;
    };
    let (scene, path): (_, PathBuf) = (bake.scene.clone(), current.path.with_extension("mgi"));
    notice.0.clear();
    let task = IoTaskPool::get().spawn(async move {
        match scene.write(&path) {
            Ok(bytes) => format!("saved {}, {:.1} MB", path.display(), 1e-6 * bytes as f64),
            Err(error) => format!("not saved: {error}"),
        }
    });
    commands.insert_resource(Saving(task));
}

/// Shows the result.
pub fn finish(mut commands: Commands, saving: Option<ResMut<Saving>>, mut notice: ResMut<Notice>) {
    if let Some(line) = saving.and_then(|mut saving| block_on(poll_once(&mut saving.0))) {
        notice.0 = line;
        commands.remove_resource::<Saving>();
    }
}
