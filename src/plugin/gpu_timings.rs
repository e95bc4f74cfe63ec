//! Costs of the passes on this device. Bevy's `RenderDiagnosticsPlugin` has one span for each group
//! of passes that is timed together. These spans update a [`CostModel`], which estimates the costs
//! of the next plans.
//!
//! The app has to add that plugin. Without it, the costs stay unknown, and the plan reports this.
//! The same holds without timestamps inside command encoders, which Bevy lacks on Metal and WebGPU.

use super::GiFrameStats;
use super::effects::EFFECTS;
use super::quality::{SolveCostSource, span_name};
use crate::plan::{CostModel, FrameStage, Plan, TimingScope, Work};
use bevy::diagnostic::{DiagnosticPath, DiagnosticsStore};
use bevy::ecs::prelude::*;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Model of the costs, shared by both worlds.
#[derive(Resource, Clone, Default)]
pub(crate) struct DeviceCosts(Arc<Mutex<CostModel>>);

impl DeviceCosts {
    fn model(&self) -> MutexGuard<'_, CostModel> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes the known costs into the plan.
    pub fn price(&self, plan: &mut Plan) {
        self.model().price(plan);
    }

    /// Removes all costs. Used after a change of the device.
    pub fn forget(&self) {
        *self.model() = CostModel::new();
    }
}

/// Names of the spans that time a scope, outermost first, below the span of its point of the frame.
/// Projection and transport of a scene share the span of its solve.
pub(crate) fn spans(scope: &TimingScope) -> Vec<String> {
    let solve =
        scope.view.is_none() && matches!(scope.stage, FrameStage::PROJECT | FrameStage::APPLY);
    let solve = solve.then(|| span_name(scope.scene.0));
    solve.into_iter().chain([scope.span()]).collect()
}

/// Diagnostic path of the milliseconds of a scope. `None` if no effect has it.
fn path(scope: &TimingScope) -> Option<DiagnosticPath> {
    let kinds = EFFECTS.iter().flat_map(|effect| effect.passes);
    let kind = kinds
        .filter(|kind| kind.per_view == scope.view.is_some())
        .find(|kind| kind.timed_with == Some(scope.stage))?;
    let spans = spans(scope);
    let names = spans.iter().map(String::as_str);
    let parts = ["render", kind.record.how.point().span()].into_iter();
    let parts = parts.chain(names).chain(["elapsed_gpu"]);
    Some(DiagnosticPath::from_components(parts))
}

/// Runs in [`GiSystems::CollectBakes`](super::GiSystems::CollectBakes).
pub(crate) fn learn(
    status: Res<GiFrameStats>,
    costs: Res<DeviceCosts>,
    given: Res<SolveCostSource>,
    store: Option<Res<DiagnosticsStore>>,
    mut seen: Local<BTreeMap<TimingScope, (Instant, u64)>>,
    mut last: Local<u64>,
) {
    let counters = status.record();
    if counters.frame == *last {
        return;
    }
    *last = counters.frame;
    let mut model = costs.model();
    model.record_plan(&counters.plan);
    for (timed, cost) in &counters.plan.costs {
        if let (
            SolveCostSource::Given(of),
            FrameStage::APPLY,
            Work::Links(links) | Work::OneChannel(links),
        ) = (&*given, timed.stage, cost.work)
        {
            model.record_time(*timed, of(links));
            continue;
        }
        let measurement = (store.as_ref()).and_then(|s| s.get(&path(timed)?)?.measurement());
        if let Some(found) = measurement
            && seen
                .insert(*timed, (found.time, counters.frame))
                .map(|s| s.0)
                != Some(found.time)
        {
            model.record_time(*timed, found.value as f32);
        }
    }
    // Spans that no plan had for long are removed.
    seen.retain(|_, (_, frame)| *frame + 1000 > counters.frame);
}
