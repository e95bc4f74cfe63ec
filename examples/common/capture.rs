//! Pictures of an example without a window (`--screenshot`).
//!
//! ```text
//! --screenshot FILE.png    writes a picture, and ends; no window opens, and software Vulkan does
//! --size WIDTHxHEIGHT      of this size, in pixels (960x540); text is scaled with the width
//! --frames N               after N frames in which nothing bakes (30), or
//! --while-baking           after N frames, whatever bakes
//! --at T                   of the time T on the example's clock, which stands still
//! --press KEY,KEY          presses keys first, one every second frame: Tab, Space, G, V, L, B, D,
//! F, H, M, P, S, Ctrl, F1, Up, Down, Left, Right, as far as the example has them; Ctrl+S presses
//! both
//! ```
//!
//! Every frame lasts 1/60 s for the app, so that pictures are the same on any machine.

use bevy::app::{PluginGroupBuilder, ScheduleRunnerPlugin};
use bevy::camera::{RenderTarget, ShadowLodOrigin};
use bevy::input::InputSystems;
use bevy::prelude::*;
use bevy::render::RenderPlugin;
use bevy::render::pipelined_rendering::PipelinedRenderingPlugin;
use bevy::render::render_resource::{TextureFormat, TextureUsages};
use bevy::render::view::screenshot::{Screenshot, ScreenshotCaptured, save_to_disk};
use bevy::time::TimeUpdateStrategy;
use bevy::window::ExitCondition;
use bevy::winit::WinitPlugin;
use bevy_meshless_gi::{GiBakeProgress, GiRsmCamera};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

/// Default size of a picture, in pixels. Text has its own size at this width.
const DEFAULT_SIZE: UVec2 = UVec2::new(960, 540);
/// Largest edge of a picture, in pixels: every device has textures of this size.
const MAX_EDGE: u32 = 8192;

/// Picture options of the command line.
#[derive(Resource, Clone)]
pub struct Capture {
    file: PathBuf,
    /// Size of the picture, in pixels.
    size: UVec2,
    frames: u32,
    while_baking: bool,
    /// Clock time of the picture.
    pub at: Option<f32>,
    /// Successive presses. Each is a set of keys.
    keys: Vec<Vec<KeyCode>>,
}

/// Returns Bevy's plugins, with a window or, for a picture, without one.
pub fn default_plugins(capture: Option<&Capture>) -> PluginGroupBuilder {
    match capture {
        None => DefaultPlugins.build(),
        Some(_) => windowless(),
    }
}

/// Returns Bevy's plugins without a window. A frame is drawn before the next one begins.
pub fn windowless() -> PluginGroupBuilder {
    DefaultPlugins
        .set(WindowPlugin {
            primary_window: None,
            exit_condition: ExitCondition::DontExit,
            ..default()
        })
        .set(RenderPlugin {
            synchronous_pipeline_compilation: true,
            ..default()
        })
        .disable::<WinitPlugin>()
        .disable::<PipelinedRenderingPlugin>()
}

impl Capture {
    /// Reads the command line of an example without further options. Prints a message and returns
    /// the exit code on an error.
    pub fn from_command_line(example: &str) -> Result<Option<Self>, ExitCode> {
        let mut arguments: Vec<String> = std::env::args().skip(1).collect();
        let error = match Self::take_from(&mut arguments) {
            Ok(capture) if arguments.is_empty() => return Ok(capture),
            Ok(_) => format!("unknown arguments: {}", arguments.join(" ")),
            Err(error) => error,
        };
        eprintln!(
            "{error}\nusage: {example} [--screenshot FILE.png [--size WIDTHxHEIGHT] [--at T] [--frames N] [--while-baking] [--press KEY,KEY]]"
        );
        Err(ExitCode::from(2))
    }

    /// Removes the picture options from the arguments. Returns `None` without `--screenshot`.
    ///
    /// # Errors
    /// A message if an option has no value or an invalid one.
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
        let size = value("--size")?;
        let frames = value("--frames")?;
        let keys = value("--press")?;
        let at = value("--at")?;
        let before = arguments.len();
        arguments.retain(|a| a != "--while-baking");
        let while_baking = arguments.len() < before;
        let Some(file) = file else {
            let values = [&size, &frames, &keys, &at];
            return if while_baking || values.iter().any(|value| value.is_some()) {
                Err(
                    "--size, --frames, --at, --press and --while-baking belong to --screenshot"
                        .into(),
                )
            } else {
                Ok(None)
            };
        };
        let size = size.map_or(Ok(DEFAULT_SIZE), |text| parse_size(&text))?;
        let frames = match frames {
            None => 30,
            Some(text) => text.parse().map_err(|error| format!("--frames: {error}"))?,
        };
        let number = |text: String| match text.parse::<f32>() {
            Ok(number) if number.is_finite() => Ok(number),
            _ => Err(format!("--at: {text} is not a time in seconds")),
        };
        let at = at.map(number).transpose()?;
        let key = |name: &str| match name {
            "Tab" => Ok(KeyCode::Tab),
            "Space" => Ok(KeyCode::Space),
            "Up" => Ok(KeyCode::ArrowUp),
            "Down" => Ok(KeyCode::ArrowDown),
            "Left" => Ok(KeyCode::ArrowLeft),
            "Right" => Ok(KeyCode::ArrowRight),
            "Ctrl" => Ok(KeyCode::ControlLeft),
            "F1" => Ok(KeyCode::F1),
            "B" => Ok(KeyCode::KeyB),
            "D" => Ok(KeyCode::KeyD),
            "F" => Ok(KeyCode::KeyF),
            "G" => Ok(KeyCode::KeyG),
            "H" => Ok(KeyCode::KeyH),
            "M" => Ok(KeyCode::KeyM),
            "P" => Ok(KeyCode::KeyP),
            "S" => Ok(KeyCode::KeyS),
            "V" => Ok(KeyCode::KeyV),
            "L" => Ok(KeyCode::KeyL),
            other => Err(format!("--press: unknown key {other}")),
        };
        let together = |names: &str| names.split('+').map(key).collect::<Result<Vec<_>, _>>();
        let keys = keys.map_or(Ok(Vec::new()), |k| k.split(',').map(together).collect())?;
        Ok(Some(Self {
            file: file.into(),
            size,
            frames,
            while_baking,
            at,
            keys,
        }))
    }
}

/// Parses `WIDTHxHEIGHT`.
fn parse_size(text: &str) -> Result<UVec2, String> {
    let edge = |text: &str| {
        text.parse()
            .ok()
            .filter(|edge| (1..=MAX_EDGE).contains(edge))
    };
    text.split_once('x')
        .and_then(|(width, height)| Some(UVec2::new(edge(width)?, edge(height)?)))
        .ok_or_else(|| {
            format!("--size: {text} is not WIDTHxHEIGHT with edges from 1 to {MAX_EDGE}")
        })
}

/// Target of all cameras.
#[derive(Resource)]
struct Picture(Handle<Image>);

impl Plugin for Capture {
    fn build(&self, app: &mut App) {
        let UVec2 { x, y } = self.size;
        let mut image = Image::new_target_texture(x, y, TextureFormat::Rgba8UnormSrgb, None);
        image.texture_descriptor.usage |= TextureUsages::COPY_SRC;
        let image = app.world_mut().resource_mut::<Assets<Image>>().add(image);
        let sixtieth = Duration::from_secs_f64(1.0 / 60.0);
        app.insert_resource(self.clone())
            .insert_resource(Picture(image))
            .insert_resource(UiScale(x as f32 / DEFAULT_SIZE.x as f32))
            .insert_resource(TimeUpdateStrategy::ManualDuration(sixtieth))
            .add_plugins(ScheduleRunnerPlugin::run_loop(Duration::ZERO))
            .add_observer(set_target)
            .add_systems(PreUpdate, capture.after(InputSystems));
    }
}

/// Directs all cameras to the picture, except the plugin's own.
fn set_target(
    event: On<Add, Camera3d>,
    mut commands: Commands,
    picture: Res<Picture>,
    own: Query<(), With<GiRsmCamera>>,
) {
    if !own.contains(event.entity) {
        let target = RenderTarget::Image(picture.0.clone().into());
        commands
            .entity(event.entity)
            .insert((target, ShadowLodOrigin));
    }
}

fn capture(
    mut commands: Commands,
    capture: Res<Capture>,
    picture: Res<Picture>,
    bakes: Query<(), With<GiBakeProgress>>,
    mut keys: ResMut<ButtonInput<KeyCode>>,
    mut frame: Local<u32>,
) {
    if !capture.while_baking && !bakes.is_empty() {
        // Few frames are drawn, so that the bake gets the processor.
        std::thread::sleep(Duration::from_secs(1));
        return;
    }
    let pressed = *frame as usize / 2;
    for &key in capture.keys.get(pressed).into_iter().flatten() {
        if frame.is_multiple_of(2) {
            keys.press(key);
        } else {
            keys.release(key);
        }
    }
    if *frame == capture.frames + 2 * capture.keys.len() as u32 {
        commands
            .spawn(Screenshot::image(picture.0.clone()))
            .observe(save_to_disk(capture.file.clone()))
            .observe(
                |_: On<ScreenshotCaptured>, mut exit: MessageWriter<AppExit>| {
                    exit.write(AppExit::Success);
                },
            );
    }
    *frame += 1;
}
