//! Counters of the work of a frame, from the render world to Bevy's `DiagnosticsStore`.
//!
//! | path | what |
//! |---|---|
//! | `meshless_gi/pipelines` | pipelines that exist |
//! | `meshless_gi/buffers` | buffers that exist |
//! | `meshless_gi/bytes` | their bytes |
//! | `meshless_gi/scenes/active` | baked scenes that any pass touched |
//! | `meshless_gi/slots/projected` | light slots projected |
//! | `meshless_gi/subsplats` | evaluations of the views that are shown by subsplats |
//! | `meshless_gi/subsplats/saved` | their pixels that were not evaluated |
//! | `meshless_gi/dispatches/<stage>` | dispatches (draws, for `composite`; both, for `fog`) of a stage |
//!
//! Pipelines, buffers and bytes are current totals. The other counters refer to the last rendered
//! frame. With pipelined rendering that frame is one behind the main world's.

use super::GiFrameStats;
use super::effects::{EFFECTS, stages};
use crate::plan::FrameStage;
use bevy::app::{App, PreUpdate};
use bevy::diagnostic::{Diagnostic, DiagnosticPath, Diagnostics, RegisterDiagnostic};
use bevy::ecs::prelude::*;

/// The path `meshless_gi/<name>`.
fn path(name: &str) -> DiagnosticPath {
    DiagnosticPath::new(format!("meshless_gi/{name}"))
}

/// The diagnostic path of a stage's dispatches.
#[must_use]
pub fn dispatch_path(stage: FrameStage) -> DiagnosticPath {
    path(&format!("dispatches/{}", stage.name()))
}

/// Registers the diagnostics and the system that fills them each frame.
pub(crate) fn register(app: &mut App) {
    for name in [
        "pipelines",
        "buffers",
        "bytes",
        "scenes/active",
        "slots/projected",
        "subsplats",
        "subsplats/saved",
    ] {
        app.register_diagnostic(Diagnostic::new(path(name)).with_smoothing_factor(0.0));
    }
    for stage in stages(EFFECTS) {
        app.register_diagnostic(Diagnostic::new(dispatch_path(stage)).with_smoothing_factor(0.0));
    }
    app.add_systems(PreUpdate, publish.in_set(super::GiSystems::CollectBakes));
}

fn publish(status: Res<GiFrameStats>, mut diagnostics: Diagnostics, mut last: Local<u64>) {
    let counters = status.record();
    if counters.frame == *last {
        return;
    }
    *last = counters.frame;
    let mut add = |path: DiagnosticPath, value: f64| diagnostics.add_measurement(&path, || value);
    add(path("pipelines"), f64::from(counters.pipelines));
    add(path("buffers"), f64::from(counters.buffers));
    add(path("bytes"), counters.bytes as f64);
    add(path("scenes/active"), f64::from(counters.active_scenes));
    add(path("slots/projected"), f64::from(counters.projected_slots));
    let (evaluated, pixels) = counters.subsplat_totals();
    add(path("subsplats"), f64::from(evaluated));
    add(
        path("subsplats/saved"),
        f64::from(pixels) - f64::from(evaluated),
    );
    for stage in stages(EFFECTS) {
        add(
            dispatch_path(stage),
            f64::from(counters.dispatches_of(stage)),
        );
    }
}
