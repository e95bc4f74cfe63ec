//! A picture of a window without a person in front of it: what `--screenshot` of the examples does.
//!
//! ```text
//! --screenshot FILE.png    writes the window's picture, and ends
//! --frames N               after N frames in which nothing bakes (30), or
//! --while-baking           after N frames, whatever bakes
//! --press KEY,KEY          presses keys first, one every second frame: Tab, Space, G, V, L, B, D, M, Up, Down, Left, Right, as far as the example knows them
//! ```
//!
//! Every frame lasts a sixtieth of a second for the app, however long it took: what moves by itself is at the same place on any machine.

use bevy::input::InputSystems;
use bevy::prelude::*;
use bevy::render::view::screenshot::{Screenshot, ScreenshotCaptured, save_to_disk};
use bevy::time::TimeUpdateStrategy;
use bevy_meshless_gi::plugin::MeshlessGiBake;
use std::path::PathBuf;
use std::time::Duration;

/// What the command line says of a picture.
#[derive(Resource, Clone)]
pub struct Capture {
    file: PathBuf,
    frames: u32,
    while_baking: bool,
    keys: Vec<KeyCode>,
}

impl Capture {
    /// Takes its options out of the arguments; None where there is no `--screenshot`.
    ///
    /// # Errors
    /// A message where an option lacks its value or makes no sense.
    pub fn take_from(arguments: &mut Vec<String>) -> Result<Option<Self>, String> {
        let mut value = |name: &str| -> Result<Option<String>, String> {
            let Some(at) = arguments.iter().position(|a| a == name) else {
                return Ok(None);
            };
            if at + 1 >= arguments.len() {
                return Err(format!("{name} needs a value"));
            }
            arguments.remove(at);
            Ok(Some(arguments.remove(at)))
        };
        let file = value("--screenshot")?;
        let frames = value("--frames")?;
        let keys = value("--press")?;
        let before = arguments.len();
        arguments.retain(|a| a != "--while-baking");
        let while_baking = arguments.len() < before;
        let Some(file) = file else {
            return if frames.is_some() || keys.is_some() || while_baking {
                Err("--frames, --press and --while-baking belong to --screenshot".into())
            } else {
                Ok(None)
            };
        };
        let frames = match frames {
            None => 30,
            Some(text) => text.parse().map_err(|why| format!("--frames: {why}"))?,
        };
        let key = |name: &str| match name {
            "Tab" => Ok(KeyCode::Tab),
            "Space" => Ok(KeyCode::Space),
            "Up" => Ok(KeyCode::ArrowUp),
            "Down" => Ok(KeyCode::ArrowDown),
            "Left" => Ok(KeyCode::ArrowLeft),
            "Right" => Ok(KeyCode::ArrowRight),
            "B" => Ok(KeyCode::KeyB),
            "D" => Ok(KeyCode::KeyD),
            "G" => Ok(KeyCode::KeyG),
            "M" => Ok(KeyCode::KeyM),
            "V" => Ok(KeyCode::KeyV),
            "L" => Ok(KeyCode::KeyL),
            other => Err(format!("--press: there is no key {other}")),
        };
        let keys = keys.map_or(Ok(Vec::new()), |k| k.split(',').map(key).collect())?;
        Ok(Some(Self {
            file: file.into(),
            frames,
            while_baking,
            keys,
        }))
    }
}

impl Plugin for Capture {
    fn build(&self, app: &mut App) {
        let sixtieth = Duration::from_secs_f64(1.0 / 60.0);
        app.insert_resource(self.clone())
            .insert_resource(TimeUpdateStrategy::ManualDuration(sixtieth))
            .add_systems(PreUpdate, capture.after(InputSystems));
    }
}

fn capture(
    mut commands: Commands,
    capture: Res<Capture>,
    bakes: Query<(), With<MeshlessGiBake>>,
    mut keys: ResMut<ButtonInput<KeyCode>>,
    mut frame: Local<u32>,
) {
    if !capture.while_baking && !bakes.is_empty() {
        return;
    }
    let pressed = *frame as usize / 2;
    if let Some(&key) = capture.keys.get(pressed) {
        if frame.is_multiple_of(2) {
            keys.press(key);
        } else {
            keys.release(key);
        }
    }
    if *frame == capture.frames + 2 * capture.keys.len() as u32 {
        commands
            .spawn(Screenshot::primary_window())
            .observe(save_to_disk(capture.file.clone()))
            .observe(
                |_: On<ScreenshotCaptured>, mut exit: MessageWriter<AppExit>| {
                    exit.write(AppExit::Success);
                },
            );
    }
    *frame += 1;
}
