//! [`FrameRecord`]: counters and plan of a rendered frame, from the render world.

use super::effects::Effect;
use crate::plan::{FrameStage, Plan};
use meshless_gi::internals::frame::SubsplatCounts;
use std::collections::BTreeMap;

/// Counters and plan of one rendered frame, by the numbers of the plan.
/// [`FrameStats`](super::FrameStats) is the public part.
#[derive(Clone, Debug, Default)]
pub struct FrameRecord {
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
    /// Table of effects that the plan was made with.
    pub(crate) effects: &'static [Effect],
    /// Plan of the frame: passes and reasons, skipped passes, expected and measured costs,
    /// decisions ([`Plan::decisions`]) and inventory ([`Plan::inventory`]). Its `Display` writes it
    /// as text.
    pub plan: Plan,
}

impl FrameRecord {
    /// Dispatches of a stage.
    #[must_use]
    pub fn dispatches_of(&self, stage: FrameStage) -> u32 {
        self.dispatches.get(&stage).copied().unwrap_or(0)
    }

    /// Evaluations and pixels of the views that are shown by subsplats.
    pub(super) fn subsplat_totals(&self) -> (u32, u32) {
        let views = self.subsplats.values();
        views.fold((0, 0), |(e, p), c| (e + c.total(), p + c.pixels))
    }
}
