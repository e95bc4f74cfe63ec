//! Passes of a scene that all views share.

use super::{Recorder, Spans, report_missing};
use crate::gpu::{GpuError, KernelPipelines};
use crate::plan::{Plan, kind_of};
use crate::plugin::effect_states::EffectStates;
use crate::plugin::effects::inspection::coefficients::SharedCoefficients;
use crate::plugin::effects::volume::irradiance_volume::ExtractedVolumes;
use crate::plugin::effects::{Effect, Record};
use crate::plugin::extract::ExtractedScene;
use crate::plugin::render_state::SceneRuntime;

/// A baked scene, and the means to record its passes.
pub(crate) struct SceneContext<'a> {
    pub kernels: &'a KernelPipelines,
    pub queue: &'a wgpu::Queue,
    pub encoder: &'a mut wgpu::CommandEncoder,
    /// The scene as extracted from the main world.
    pub scene: &'a ExtractedScene,
    pub volumes: &'a ExtractedVolumes,
    /// Coefficients on the CPU.
    pub coefficients: &'a SharedCoefficients,
    /// Transient states of an earlier frame. Those that no pass takes are released.
    pub earlier: EffectStates,
    pub runtime: &'a mut SceneRuntime,
}

/// Records the passes of a scene that all views share.
///
/// # Errors
/// The error of the first pass that fails. The passes after it are not recorded.
pub(crate) fn record_scene(
    effects: &[Effect],
    plan: &Plan,
    ctx: &mut SceneContext<'_>,
    recorder: Recorder<'_>,
) -> Result<(), GpuError> {
    let mut spans = Spans::new(recorder);
    let mut result = Ok(());
    for pass in plan.of_scene(ctx.scene.id) {
        if let Some(Record::Scene(record)) = kind_of(effects, pass).map(|kind| &kind.record.how) {
            spans.enter(ctx.encoder, pass.timing);
            match record(ctx, pass) {
                Ok(recorded) => report_missing(recorded, pass),
                Err(error) => {
                    result = Err(error);
                    break;
                }
            }
        }
    }
    spans.enter(ctx.encoder, None);
    result
}
