//! Saving the bake beside its level, on another thread.

use super::drop::Level;
use super::progress::Notice;
use bevy::prelude::*;
use bevy::tasks::{IoTaskPool, Task, block_on, poll_once};
use bevy_meshless_gi::prelude::*;
use std::path::PathBuf;

/// A file that is being written. The task returns the line for the screen.
#[derive(Resource)]
pub struct Saving(Task<String>);

/// Ctrl+S: starts to write `level.mgi` beside `level.glb`. The file is replaced as a whole or not
/// at all.
pub fn start(
    mut commands: Commands,
    keys: Res<ButtonInput<KeyCode>>,
    saving: Option<Res<Saving>>,
    level: Option<Res<Level>>,
    scenes: Query<&GiScene>,
    bakes: Res<Assets<GiBakedScene>>,
    mut notice: ResMut<Notice>,
) {
    let control = keys.any_pressed([KeyCode::ControlLeft, KeyCode::ControlRight]);
    if !(control && keys.just_pressed(KeyCode::KeyS)) || saving.is_some() {
        return;
    }
    let Some(level) = level else {
        return;
    };
    let baked = scenes.get(level.root).ok();
    let Some(bake) = baked.and_then(|gi| bakes.get(&gi.0)) else {
        notice.0 = "not saved: there is no bake yet".into();
        return;
    };
    let (scene, path): (_, PathBuf) = (bake.scene.clone(), level.path.with_extension("mgi"));
    notice.0.clear();
    let task = IoTaskPool::get().spawn(async move {
        match scene.write(&path) {
            Ok(bytes) => format!("saved {}, {:.1} MB", path.display(), 1e-6 * bytes as f64),
            Err(why) => format!("not saved: {why}"),
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
