//! The effects, one file or folder each.
//!
//! A file or folder holds the components of its effect, their extraction and their systems. It
//! states which part of the [`FrameState`](crate::plan::FrameState) the effect reads, when it is
//! active and why. It holds its passes, their work (the unit of the cost model), their recording,
//! and their kernels by name. The shader of kernel `k` is `shaders/k.wgsl`, its twin on the CPU is
//! `crates/meshless_gi/src/frame/k.rs`.
//!
//! A new effect is a file here and a row of [`EFFECTS`]. With systems of its own it is also in
//! [`add_to_app`] or [`add_to_render_app`]. The test `effect_row_is_planned_counted_and_recorded`
//! adds the file `test_effect.rs` and a row. docs/DECISIONS.md D23 lists what effects share.

pub(crate) mod display;
pub(crate) mod fog;
pub(crate) mod inspection;
pub(crate) mod materials;
pub(crate) mod occluders;
mod probes;
mod project_lights;
mod residency;
pub(crate) mod rsm;
pub(crate) mod soft_shadows;
pub(crate) mod subtract_shadow;
#[cfg(test)]
mod test_effect;
#[cfg(test)]
mod tests;
mod transport;
pub(crate) mod volume;
pub(crate) mod vpl_specular;

use super::record::{
    LayerRecording, LightMapRecording, PostProcessContext, SceneContext, ViewContext,
};
use crate::gpu;
use crate::gpu::{GpuCounters, GpuError};
use crate::plan::{FrameStage, Pass, Plan, Timing};
#[cfg(test)]
use crate::plan::{FrameState, SceneId};
use bevy::app::{App, SubApp};
use std::collections::BTreeMap;

/// Row of the table of effects.
pub(crate) type Effect = crate::plan::Effect<Recording>;
/// Kind of pass of an effect.
pub(crate) type PassKind = crate::plan::PassKind<Recording>;

/// Recording and counters of a kind of pass.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Recording {
    /// Kernels that count as this stage.
    pub kernels: &'static [gpu::EntryPoint],
    /// Counter of draws of this stage. `None` if it draws nothing.
    pub draws: Option<fn(&GpuCounters) -> u64>,
    /// The recording itself.
    pub how: Record,
}

/// Recording of a pass. The variant gives the
/// [point of the frame](super::record::FramePoint) at which the plan's walk calls it.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Record {
    /// Records a pass that all views share. Returns `None` if it lacks an input, which the walk
    /// reports.
    Scene(fn(&mut SceneContext<'_>, &Pass) -> Result<Option<()>, GpuError>),
    /// Adds a layer of irradiance to a view. The layers of a view are evaluated together, and are
    /// timed with [`FrameStage::SPLAT`].
    Layer(LayerRecording),
    /// Records passes of one stage in a view. Returns `None` if they lack an input, which the walk
    /// reports.
    View(fn(&mut ViewContext<'_>, &[&Pass]) -> Option<()>),
    /// Draws a map of a light in the map's camera, and reads it afterwards.
    LightMap(LightMapRecording),
    /// Records passes of one stage in the post-processing of a view. Returns `None` if they lack an
    /// input, which the walk reports.
    PostProcess(fn(&mut PostProcessContext<'_>, &[&Pass]) -> Option<()>),
}

/// All effects, in the order in which they are scheduled. Effects that add layers to views come
/// before `display`, which adds the draw of all layers to the picture.
pub(crate) const EFFECTS: &[Effect] = &[
    residency::EFFECT,
    materials::EFFECT,
    occluders::EFFECT,
    project_lights::EFFECT,
    transport::EFFECT,
    probes::EFFECT,
    volume::EFFECT,
    soft_shadows::EFFECT,
    rsm::EFFECT,
    display::EFFECT,
    vpl_specular::EFFECT,
    subtract_shadow::EFFECT,
    fog::EFFECT,
    inspection::EFFECT,
];

/// Registers the types of the effects, and adds their resources and systems to the main world.
pub(crate) fn add_to_app(app: &mut App) {
    for add in [
        materials::add_to_app,
        occluders::add_to_app,
        volume::add_to_app,
        soft_shadows::add_to_app,
        rsm::add_to_app,
        vpl_specular::add_to_app,
        fog::add_to_app,
    ] {
        add(app);
    }
}

/// Adds the resources and systems of the effects to the render world.
pub(crate) fn add_to_render_app(render_app: &mut SubApp) {
    for add in [
        volume::add_to_render_app,
        soft_shadows::add_to_render_app,
        rsm::add_to_render_app,
        fog::add_to_render_app,
    ] {
        add(render_app);
    }
}

/// Plans a frame with [`EFFECTS`].
#[cfg(test)]
pub(crate) fn plan_frame(state: &FrameState) -> Plan {
    Plan::new(EFFECTS, state)
}

/// Returns the first pass of this stage for this scene.
///
/// # Panics
/// Panics if there is none.
#[cfg(test)]
pub(crate) fn pass_of(plan: &Plan, stage: FrameStage, scene: SceneId) -> &Pass {
    let own = |pass: &&Pass| pass.stage == stage && pass.scene == scene;
    plan.passes.iter().find(own).expect("the pass is planned")
}

/// Stages of a table of effects, in the order of the frame.
pub(crate) fn stages(effects: &[Effect]) -> Vec<FrameStage> {
    let kinds = effects.iter().flat_map(|effect| effect.passes);
    let mut stages: Vec<FrameStage> = kinds.map(|kind| kind.stage).collect();
    stages.sort_unstable();
    stages.dedup();
    stages
}

/// Dispatches and draws of each stage in a frame. A stage that only copies counts its passes.
pub(crate) fn count_stages(
    effects: &[Effect],
    plan: &Plan,
    recorded: &GpuCounters,
) -> BTreeMap<FrameStage, u32> {
    let mut counts = BTreeMap::new();
    for kind in effects.iter().flat_map(|effect| effect.passes) {
        let Recording { kernels, draws, .. } = &kind.record;
        let dispatches = kernels
            .iter()
            .map(|k| recorded.dispatches_of(*k))
            .sum::<u64>();
        let copies = kernels.is_empty() && draws.is_none() && kind.timing == Timing::None;
        let count = dispatches
            + draws.map_or(0, |draws| draws(recorded))
            + if copies {
                plan.count(kind.stage) as u64
            } else {
                0
            };
        if count > 0 {
            *counts.entry(kind.stage).or_insert(0) += count as u32;
        }
    }
    counts
}
