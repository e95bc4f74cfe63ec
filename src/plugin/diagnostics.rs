//! Counters of what the frame did, from the render world to Bevy's `DiagnosticsStore`.
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

use super::effects::{EFFECTS, stages};
use crate::plan::{FrameStage, Plan};
use bevy::app::{App, PreUpdate};
use bevy::diagnostic::{Diagnostic, DiagnosticPath, Diagnostics, RegisterDiagnostic};
use bevy::ecs::prelude::*;
use meshless_gi::BakedScene;
use meshless_gi::internals::frame::SubsplatCounts;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Statistics of one rendered frame.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct FrameStats {
    /// Rendered frames since the start, this one included.
    pub frame: u64,
    /// Pipelines that exist.
    pub pipelines: u32,
    /// Buffers that exist.
    pub buffers: u32,
    /// Their bytes.
    pub bytes: u64,
    /// Bytes of each scene whose bake is on the device, by the bits of its root.
    pub scene_bytes: BTreeMap<u64, u64>,
    /// Addresses of the bakes that these bytes hold.
    pub(crate) scene_bakes: BTreeMap<u64, usize>,
    /// Baked scenes that any pass touched.
    pub active_scenes: u32,
    /// Light slots projected.
    pub projected_slots: u32,
    /// Dispatches (draws, for the composite) of each stage. A stage that did not run is missing.
    pub dispatches: BTreeMap<FrameStage, u32>,
    /// The scenes that were solved, by the bits of their roots, and with which tier of the
    /// operator.
    pub solved: BTreeMap<u64, u32>,
    /// Counts of subsplats of each view that uses them, by the bits of its camera. The counts are a
    /// few frames old.
    pub subsplats: BTreeMap<u64, SubsplatCounts>,
    /// Plan of the frame: passes and reasons, skipped passes, expected and measured costs,
    /// decisions ([`Plan::decisions`]) and inventory ([`Plan::inventory`]). Its `Display` writes it
    /// as text.
    pub plan: Plan,
}

impl FrameStats {
    /// Dispatches of a stage.
    #[must_use]
    pub fn dispatches_of(&self, stage: FrameStage) -> u32 {
        self.dispatches.get(&stage).copied().unwrap_or(0)
    }
}

/// The counters of the last rendered frame, in both worlds. Read them with [`get`](Self::get), or
/// from Bevy's diagnostics.
#[derive(Resource, Clone, Default)]
pub struct GiFrameStats(Arc<Mutex<FrameStats>>);

impl GiFrameStats {
    /// A copy of the counters.
    #[must_use]
    pub fn get(&self) -> FrameStats {
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }

    /// Returns the bytes on the device of the scene on the root with these bits. `None` if the
    /// device does not hold `bake`.
    pub(crate) fn bytes_of(&self, root: u64, bake: &Arc<BakedScene>) -> Option<u64> {
        let counters = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let held = counters.scene_bakes.get(&root)?;
        let bytes = counters.scene_bytes.get(&root).copied();
        bytes.filter(|_| *held == Arc::as_ptr(bake) as usize)
    }

    pub(crate) fn set(&self, counters: FrameStats) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = counters;
    }
}

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
    let counters = status.get();
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
    let views = counters.subsplats.values();
    let (evaluated, pixels) = views.fold((0, 0), |(e, p), c| (e + c.total(), p + c.pixels));
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
