//! Cost of the passes of thirteen scenes, from one light at rest to all effects together, in the
//! running plugin without a window. Prints the stages of a frame with their dispatches, pipelines,
//! buffers, bytes and milliseconds, or writes them to FOLDER/effects.md.
//!
//! ```text
//! cargo run --example pass_costs -- [-o FOLDER]
//! ```

#[path = "../../common/mod.rs"]
mod common;
mod scenes;

use bevy::app::PluginsState;
use bevy::diagnostic::{DiagnosticPath, DiagnosticsStore};
use bevy::prelude::*;
use bevy::render::diagnostic::RenderDiagnosticsPlugin;
use bevy::render::render_resource::PollType;
use bevy::render::renderer::{RenderAdapterInfo, RenderDevice};
use bevy_meshless_gi::prelude::*;
use bevy_meshless_gi::{FrameStats, GiFrameStats};
use meshless_gi::{Preset, ProbeSettings, Recipe, VisibilityRecipe};
use meshless_gi_lab::report::split_sentences;
use scenes::{SCENES, Scene};
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// Size of each camera, in pixels.
const SIZE: UVec2 = UVec2::new(640, 360);
/// Number of measured frames, after the same number of frames to settle.
const FRAMES: u32 = 12;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let folder = match arguments.as_slice() {
        [] => None,
        [flag, folder] if flag == "-o" => Some(PathBuf::from(folder)),
        _ => {
            eprintln!("usage: pass_costs [-o FOLDER]");
            return ExitCode::from(2);
        }
    };
    match table() {
        Ok(text) => match folder {
            None => print!("{text}"),
            Some(folder) => {
                let path = folder.join("effects.md");
                if let Err(error) = std::fs::write(&path, split_sentences(&text)) {
                    eprintln!("{}: {error}", path.display());
                    return ExitCode::from(3);
                }
                println!("{}", path.display());
            }
        },
        Err(error) => {
            eprintln!("{error}");
            return ExitCode::from(1);
        }
    }
    ExitCode::SUCCESS
}

fn table() -> Result<String, String> {
    let bakes = scenes::bakes(&Recipe {
        preset: Preset::Draft,
        probes: Some(ProbeSettings::default()),
        soft_shadows: Some(VisibilityRecipe::default()),
        ..Recipe::default()
    })?;
    let mut rows = String::new();
    let mut device = String::new();
    for scene in &SCENES {
        eprintln!("{}", scene.name);
        let mut app = app();
        scenes::spawn(&mut app, scene, &bakes, SIZE);
        for k in 0..FRAMES {
            frame(&mut app, scene, k);
        }
        let mut spans = [const { Vec::new() }; 3];
        for k in FRAMES..2 * FRAMES {
            frame(&mut app, scene, k);
            for (span, name) in spans.iter_mut().zip(["compute", "composite", "fog"]) {
                span.extend(milliseconds(&app, name));
            }
        }
        let seen = app.world().resource::<GiFrameStats>().get();
        let mut wanted = scene.runs.to_vec();
        wanted.sort_unstable();
        let stages = seen.dispatches.iter().map(|(stage, _)| *stage);
        if !stages.eq(wanted.iter().map(|stage| stage.name())) {
            return Err(format!("{}: ran {}", scene.name, ran(&seen)));
        }
        let _ = writeln!(
            rows,
            "| {} | {} | {} | {} | {:.2} | {} | {} | {} |",
            scene.name,
            ran(&seen),
            seen.pipelines,
            seen.buffers,
            seen.bytes as f64 / 1e6,
            median(&mut spans[0]),
            median(&mut spans[1]),
            median(&mut spans[2]),
        );
        if let Some(info) = app.world().get_resource::<RenderAdapterInfo>() {
            device.clone_from(&info.name);
        }
    }
    Ok(format!(
        "# Passes and cost by scene\n\n\
         Made by `cargo run --example pass_costs -- -o docs/reports`. Do not edit.\n\n\
         Thirteen scenes in the Cornell box at preset `Draft`, {} × {} pixels per camera, on {device}.\n\n\
         - Stages: dispatches in one frame (draws for composite and fog).\n\
         - Pipelines, buffers, MB: resources on the device.\n\
         - Times: medians of {FRAMES} frames by timestamp queries, for the passes that all cameras share, the display of the deferred camera, and light in fog of the camera that was drawn last.\n\n\
         A stage that a scene does not need has no dispatch, no pipeline and no buffer. In gray scenes `apply` runs in one channel.\n\
         `cargo test --test plugin effects` checks this for every scene.\n\n\
         | scene | stages and their dispatches | pipelines | buffers | MB | shared, ms | display, ms | fog, ms |\n\
         |---|---|---|---|---|---|---|---|\n\
         {rows}",
        SIZE.x, SIZE.y
    ))
}

/// Returns the stages of a frame with their dispatches.
fn ran(seen: &FrameStats) -> String {
    let all = seen.dispatches.iter();
    let all: Vec<String> = all.map(|(s, n)| format!("{s} {n}")).collect();
    all.join(", ")
}

/// Returns the last GPU time of one of the plugin's spans.
fn milliseconds(app: &App, span: &str) -> Option<f64> {
    let path = DiagnosticPath::new(format!("render/meshless_gi_{span}/elapsed_gpu"));
    let store = app.world().resource::<DiagnosticsStore>();
    store.get(&path)?.value()
}

fn median(values: &mut [f64]) -> String {
    values.sort_by(f64::total_cmp);
    let middle = values.get(values.len() / 2);
    middle.map_or_else(|| "–".into(), |ms| format!("{ms:.2}"))
}

fn app() -> App {
    let mut app = App::new();
    app.add_plugins((
        common::capture::windowless().disable::<bevy::log::LogPlugin>(),
        // Measures GPU times.
        RenderDiagnosticsPlugin,
        MeshlessGiPlugin::default(),
    ))
    .insert_resource(GlobalAmbientLight::NONE);
    while app.plugins_state() == PluginsState::Adding {
        bevy::tasks::tick_global_task_pools_on_main_thread();
    }
    app.finish();
    app.cleanup();
    app
}

fn frame(app: &mut App, scene: &Scene, k: u32) {
    scenes::step(app, scene, k);
    app.update();
    if let Some(device) = app.world().get_resource::<RenderDevice>() {
        // A lost device shows in the log.
        let _ = device.wgpu_device().poll(PollType::wait_indefinitely());
    }
}
